# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes that command positions: stops, transitions, other nodes on their topics, watchdogs."""

import time

from harness import Arm, COMMANDS, JOINTS, Status
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rclpy.parameter import Parameter
from robots import PLANAR_DH
from std_msgs.msg import Bool, Float64MultiArray
from std_srvs.srv import Trigger
from tp_controller.errors import SettingsError
from tp_controller.ros.controller_node import ControllerNode
from tp_controller.ros.loop.other_publishers import LOOKING, NEW_SECONDS
from tp_controller.ros.watchdog_node import WatchdogNode
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

Q = (0.0, 0.6, 0.3)
# A motion that lasts longer than a test.
SLOW = '- swing: {type: joint, joints: joint1, target: [1.8], gain: 0.2}\n'
TOPICS = {'position': '/position_controller/commands',
          'trajectory': '/joint_trajectory_controller/joint_trajectory'}
STRICT = {'follow_window': 1.0, 'settle_time': 0.3, 'state_timeout': 2.0, 'watchdog_timeout': 2.0}


class Robot:
    """An arm that goes to commanded positions, and what it was commanded."""

    def __init__(self, harness, output, **parameters):
        self.harness, self.output, self.positions = harness, output, []
        self.controller = harness.controller(output=output, **{
            **STRICT, 'stack': SLOW, **{f'limits__{name}__acceleration': 2.0 for name in JOINTS},
            **parameters})
        self.kind = JointTrajectory if output == 'trajectory' else Float64MultiArray
        harness.node.create_subscription(self.kind, TOPICS[output], self._hear, 50)
        self.velocities = harness.commands()
        self.arm, self.status = Arm(harness, Q), Status(harness)
        # Called all the time.
        self.meanwhile = self.publish

    def _hear(self, message):
        """Take commanded positions."""
        point = message.points[0].positions if self.output == 'trajectory' else message.data
        self.positions.append(np.array(point))

    def publish(self):
        """Go to the last position, and publish where the joints are."""
        if self.positions:
            self.arm.q = list(self.positions[-1])
        self.arm.publish(time.time())

    def until(self, condition, what='the condition'):
        """Spin until something has come about."""
        self.harness.spin_until(condition, what, meanwhile=self.meanwhile)

    def until_moving(self):
        """Spin until the robot has come up to its speed."""
        count = len(self.positions)
        self.until(lambda: len(self.positions) > count
                   and self.positions[-1][0] - self.positions[count][0] > 0.1, 'motion')

    def until_still(self):
        """Spin until the same position was commanded ten times; return it."""
        self.until(lambda: len(self.positions) > 10
                   and (np.array(self.positions[-10:]) == self.positions[-1]).all(), 'a hold')
        return self.positions[-1]

    def wait(self, seconds):
        """Spin for so long: to see that something does not happen."""
        since = time.monotonic()
        self.until(lambda: time.monotonic() > since + seconds)

    def change(self, name):
        """Ask for a transition."""
        number = getattr(Transition, f'TRANSITION_{name.upper()}')
        assert self.harness.call(ChangeState, '/tp_controller/change_state', self.publish,
                                 transition=Transition(id=number)).success


def braked(robot, count):
    """Check that a robot came to rest on its way, from the position of this number on."""
    positions = np.array(robot.positions[count - 1:])[:, 0]
    assert (np.diff(positions) >= -1e-12).all()
    # With 2 rad/s² from 0.36 rad/s it is 0.032 rad, but less if the machine is busy.
    assert positions[-1] - positions[0] < 0.1


@pytest.fixture(params=TOPICS)
def output(request):
    """Return an output of positions."""
    return request.param


def test_a_stop_brakes_and_holds_and_a_start_goes_on_from_there(harness, output):
    robot = Robot(harness, output)
    robot.until_moving()
    count = len(robot.positions)
    assert harness.call(Trigger, '/tp_controller/stop', robot.publish).success
    still = robot.until_still()
    robot.until(lambda: robot.status.head.startswith('stopped'))
    robot.wait(0.3)
    assert (robot.positions[-1] == still).all()
    braked(robot, count)
    harness.start(robot.publish)
    robot.until_moving()
    steps = np.abs(np.diff(np.array(robot.positions), axis=0))
    # Between two messages that were heard; nothing jumps, at 1.5 rad/s at most.
    assert steps.max() < 0.1 and not robot.velocities
    assert float(robot.status.of_node('lead')) < 1.0


def test_a_deactivated_node_holds_and_then_says_nothing_and_begins_where_the_robot_is(
        harness, output):
    robot = Robot(harness, output, keep_goals=True)
    robot.until_moving()
    count = len(robot.positions)
    robot.change('deactivate')
    robot.until(lambda: robot.status.head.startswith('inactive'))
    robot.until(lambda: (np.array(robot.positions[-3:]) == robot.positions[-1]).all())
    braked(robot, count)
    robot.wait(0.2)
    count = len(robot.positions)
    robot.wait(0.3)
    assert len(robot.positions) == count
    # Somebody moves the arm meanwhile.
    robot.positions.append(np.array([-0.5, 0.9, 0.1]))
    for _ in range(30):
        robot.publish()
    robot.change('activate')
    robot.until(lambda: len(robot.positions) > count + 5)
    np.testing.assert_allclose(robot.positions[count + 1], [-0.5, 0.9, 0.1], atol=0.05)


def test_shutdown_of_an_active_node_brakes_first(harness, output):
    robot = Robot(harness, output)
    robot.until_moving()
    count = len(robot.positions)
    robot.change('active_shutdown')
    robot.wait(0.3)
    braked(robot, count)


def test_a_node_that_ends_in_motion_brakes_first_and_says_why(harness, output):
    robot = Robot(harness, output)
    robot.until_moving()
    count = len(robot.positions)
    robot.controller.halt('ended by SIGTERM')
    robot.controller.close('ended by SIGTERM')
    robot.until(lambda: robot.status.head == 'ended by SIGTERM')
    robot.wait(0.2)
    braked(robot, count)
    assert robot.controller._robot.loop.commands.output.at_rest


def test_a_newcomer_publishes_nothing_and_one_that_is_disturbed_leaves_the_robot(harness, output):
    robot = Robot(harness, output, exclusive=True)
    topic = TOPICS[output]
    robot.until(lambda: robot.status.head == LOOKING)
    robot.until_moving()
    robot.wait(NEW_SECONDS)
    harness.make(ControllerNode, robot=str(PLANAR_DH), stack=SLOW, output=output,
                 status_rate=50.0, arguments=['--ros-args', '-r', '__node:=second'])
    status = Status(harness, '/second/status')
    told = f'/tp_controller publishes on {topic}, too; call ~/start to go on'
    robot.until(lambda: status.head == told, told)
    robot.until_moving()
    # Now somebody does command the robot.
    stranger, message = harness.publisher(robot.kind, topic), Float64MultiArray(data=list(Q))
    if output == 'trajectory':
        message = JointTrajectory(joint_names=list(JOINTS),
                                  points=[JointTrajectoryPoint(positions=Q)])

    def disturb():
        robot.publish()
        stranger.publish(message)

    harness.spin_until(lambda: f'on {topic}, too' in robot.status.head, meanwhile=disturb)
    robot.wait(0.3)
    count = len(robot.positions)
    robot.wait(0.5)
    assert len(robot.positions) == count


def test_only_a_base_needs_a_watchdog(harness, output):
    robot = Robot(harness, output, require_watchdog=True, require_listener=True)
    robot.until_moving()
    assert robot.status.of_node('listeners') == '1'
    # It does not touch positions either, though they stop coming.
    harness.make(WatchdogNode, timeout=0.05)
    robot.change('deactivate')
    robot.until(lambda: robot.status.head.startswith('inactive'))
    robot.wait(0.3)
    assert not robot.velocities and harness.node.count_publishers(TOPICS[output]) == 1


def test_a_listener_of_the_positions_counts_as_one(harness, output):
    harness.controller(output=output, require_listener=True)
    status, arm = Status(harness), Arm(harness)
    harness.spin_until(lambda: status.head == f'no node listens to {TOPICS[output]}',
                       meanwhile=arm.publish)
    assert harness.node.count_publishers(COMMANDS) == 0
    kind = JointTrajectory if output == 'trajectory' else Float64MultiArray
    heard = harness.record(kind, TOPICS[output])
    harness.spin_until(lambda: status.head == 'running' and heard, meanwhile=arm.publish)


def test_a_switch_and_a_state_of_the_robot_stop_it_in_the_same_way(harness, output):
    robot = Robot(harness, output, enable_topic='/enable', permit_topics=['/program'],
                  enable_timeout=0.5)
    switch, program = (harness.publisher(Bool, topic, connected=False)
                       for topic in ('/enable', '/program'))
    allowed = {'enable': True, 'program': True}

    def meanwhile():
        robot.publish()
        for publisher, name in ((switch, 'enable'), (program, 'program')):
            if allowed[name] is not None:
                publisher.publish(Bool(data=allowed[name]))

    robot.meanwhile = meanwhile
    # Off, no longer received, and lost for good; then it comes to rest on its way.
    for name, value, told in (('enable', False, 'not enabled: /enable is false'),
                              ('enable', None, 'not enabled: nothing received on /enable'),
                              ('program', False, '/program is 0; call')):
        robot.until_moving()
        allowed[name] = value
        robot.until(lambda told=told: told in robot.status.head, told)
        count = len(robot.positions)
        robot.until_still()
        braked(robot, count)
        allowed[name] = True
    robot.until(lambda: '/program' not in harness.call(
        Trigger, '/tp_controller/start', meanwhile).message)
    robot.until_moving()


def test_commands_come_in_the_order_of_command_joints(harness, output):
    order = ['joint3', 'joint1', 'joint2']
    robot = Robot(harness, output, command_joints=order)
    robot.harness.spin_until(lambda: robot.positions, meanwhile=robot.arm.publish)
    np.testing.assert_allclose(robot.positions[0], [Q[2], Q[0], Q[1]], atol=0.02)


def test_an_unknown_output_is_refused_with_the_valid_ones(harness):
    with pytest.raises(SettingsError, match="'velocty'.*velocity.*position.*trajectory"):
        harness.controller(output='velocty')
    controller = harness.controller(autostart=False)
    result, = controller.set_parameters([Parameter('output', value='torque')])
    assert not result.successful and 'trajectory' in result.reason
    result, = controller.set_parameters([Parameter('output', value='position')])
    assert result.successful and controller.trigger_configure()
    assert controller._robot.controller.settings.command_delay == 0
    result, = controller.set_parameters([Parameter('output', value='velocity')])
    assert not result.successful and 'fixed' in result.reason
