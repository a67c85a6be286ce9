# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Random messages and calls, valid or not, in any order: the node goes on, within all limits."""

from geometry_msgs.msg import PointStamped, PoseStamped, TwistStamped
from harness import Arm, Harness, JOINTS, MOVING_STACK, Status
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from tp_controller.ros.runner import make_executor
from tp_controller.tools.demos.processes import own_domain

NUMBERS = (0.0, 0.1, -0.7, 1.5, 100.0, -1e6, 1e7, 1e300, float('nan'), float('inf'))
NAMES = (*JOINTS, 'wheel', '')
STACKS = (
    MOVING_STACK,
    '- tip: {type: position, frame: link3, axes: xy}\n- swing: {type: joint_velocity}',
    '- [tip: {type: pose, frame: link3, axes: [x, y, rz]}, swing: {type: posture}]',
    '- tip: {type: twist, frame: link3, reference: link1}\n- swing: {type: joint, joints: joint2}',
    '[]', '', '- [', '- swing: {type: joint, joints: joint9}', '/nowhere/stack.yaml')
PARAMETERS = (('damping', (0.0, 0.5, -1.0, float('nan'))), ('stack', STACKS),
              ('singular_region', (0.0, 0.1, float('inf'))), ('scaling', ('uniform', 'none')),
              ('weights', ([1.0, 2.0, 3.0], [1.0], [-1.0, 1.0, 1.0])), ('rate', (5.0,)))
EXECUTORS = {'events': make_executor,
             'standard': lambda context: SingleThreadedExecutor(context=context)}


class Storm:
    """Sends whatever there is to send, without waiting for answers."""

    def __init__(self, outside, other, seed):
        self.random = np.random.default_rng(seed)
        self._outside = outside
        node = outside.node
        self.states = node.create_publisher(JointState, '/joint_states', 10)
        self.goals = [sender.create_publisher(kind, f'/tp_controller/{topic}', 10)
                      for sender, kind, topic in (
                          (node, PointStamped, 'tip/goal'), (other.node, PoseStamped, 'tip/goal'),
                          (node, JointState, 'swing/goal'), (node, TwistStamped, 'tip/twist'))]
        self.switches = [node.create_client(SetBool, f'/tp_controller/{task}/enable')
                         for task in ('tip', 'swing')]
        self.switches.append(node.create_client(SetBool, '/tp_controller/lock'))
        self.buttons = [node.create_client(Trigger, f'/tp_controller/{name}')
                        for name in ('stop', 'start', 'start', 'reload')]
        self.knobs = node.create_client(SetParameters, '/tp_controller/set_parameters')

    def __call__(self):
        """Do one of these at random."""
        self._outside.executor.spin_once(timeout_sec=0.0)
        kinds = (self.send_state, self.send_state, self.send_state, self.send_goal,
                 self.send_goal, self.send_bytes, self.throw_switch, self.press_button,
                 self.turn_knob)
        kinds[self.random.integers(len(kinds))]()

    def pick(self, values):
        """Return one of some values."""
        return values[self.random.integers(len(values))]

    def numbers(self, count, calm):
        """Return numbers, mostly without any that make no sense."""
        choice = NUMBERS[:5] if calm else NUMBERS
        return [self.pick(choice) for _ in range(count)]

    def joint_state(self):
        """Return a joint state of any kind."""
        calm = self.random.random() < 0.7
        names = list(JOINTS) if calm else [self.pick(NAMES)
                                           for _ in range(self.random.integers(6))]
        count = len(names) if calm else int(self.random.integers(6))
        return JointState(name=names, position=self.numbers(count, calm),
                          velocity=self.numbers(self.pick((0, count)), calm))

    def send_state(self):
        """Send a joint state."""
        self.states.publish(self.joint_state())

    def send_goal(self):
        """Send a goal of any kind to a topic that may or may not exist."""
        publisher = self.pick(self.goals)
        message = self.joint_state()
        if publisher.msg_type is not JointState:
            message = publisher.msg_type()
            message.header.frame_id = self.pick(('', '', 'base_link', 'link2', 'camera'))
            x, y, z = self.numbers(3, self.random.random() < 0.7)
            if publisher.msg_type is PointStamped:
                message.point.x, message.point.y, message.point.z = x, y, z
            elif publisher.msg_type is PoseStamped:
                message.pose.position.x, message.pose.position.y = x, y
                message.pose.orientation.w = self.pick((1.0, 1.0, 0.0))
            else:
                message.twist.linear.x, message.twist.angular.z = x, z
        publisher.publish(message)

    def send_bytes(self):
        """Send bytes that are no message."""
        self.pick([self.states, *self.goals]).publish(
            self.random.bytes(int(self.random.integers(80))))

    def throw_switch(self):
        """Enable or disable a task, lock or unlock joints."""
        self.pick(self.switches).call_async(SetBool.Request(data=bool(self.random.integers(2))))

    def press_button(self):
        """Stop, start or reload."""
        self.pick(self.buttons).call_async(Trigger.Request())

    def turn_knob(self):
        """Set a parameter."""
        name, values = self.pick(PARAMETERS)
        self.knobs.call_async(SetParameters.Request(
            parameters=[Parameter(name, value=self.pick(values)).to_parameter_msg()]))


@pytest.fixture
def apart(monkeypatch, request):
    """Return three harnesses, the first with either executor: no topic has two types in one."""
    with own_domain() as environment:
        for name in ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE'):
            monkeypatch.setenv(name, environment[name])
        harnesses = [Harness(kind) for kind in (EXECUTORS[request.param], make_executor,
                                                make_executor)]
        yield harnesses
        for harness in harnesses:
            harness.close()


@pytest.mark.parametrize('apart', EXECUTORS, indirect=True)
@pytest.mark.parametrize('rate', [200.0, 0.0])
def test_no_storm_of_messages_ends_the_node_or_makes_it_do_harm(apart, rate):
    harness, *others = apart
    controller = harness.controller(rate=rate, status_rate=200.0)
    commands, status = harness.commands(), Status(harness)
    arm = Arm(harness)
    storm = Storm(*others, seed=3)
    harness.spin_until(lambda: storm.states.get_subscription_count()
                       and storm.knobs.service_is_ready())
    for _ in range(600):
        storm()
        if storm.random.random() < 0.4:
            count = len(status.messages)
            harness.spin_until(lambda count=count: len(status.messages) > count)
    assert len(commands) > 100 and np.abs(commands).max() > 0.0
    assert np.isfinite(commands).all()
    assert (np.abs(commands) <= controller._robot.controller.robot.velocity).all()
    # Afterwards everything is as ever.
    harness.start(arm.publish)
    controller.set_parameters([Parameter('stack', value='- other: {type: posture}')])
    controller.set_parameters([Parameter('stack', value=MOVING_STACK),
                               Parameter('damping', value=0.1),
                               Parameter('singular_region', value=0.1)])
    harness.spin_until(lambda: commands and np.allclose(
        commands[-1], (1.0, -0.1, -0.55), atol=1e-9), meanwhile=arm.publish)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
