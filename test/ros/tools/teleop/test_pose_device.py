# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A tool follows a pose stream, and stays as soon as nobody presses the clutch."""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from robots import CONFIG, panda, PANDA_DH, PANDA_READY, PANDA_TOOL
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool
from tp_controller.errors import SettingsError
from tp_controller.tools.teleop.clutch import WAITING
from tp_controller.tools.teleop.teleop_node import TeleopNode
import yaml

STACK = f'[tool: {{type: pose, frame: {PANDA_TOOL}, gain: 10}}, rest: {{type: posture}}]'
XR = yaml.safe_load((CONFIG / 'teleop' / 'xr.yaml').read_text())['/**']['ros__parameters']
# No input gets lost on a busy machine.
WORLD = {'pose_topic': 'device', 'dead_man_topic': 'clutch', 'pose_deadband': 0.0,
         'pose_turn_deadband': 0.0, 'gripper': 'button 1', 'timeout': 10.0}
OPEN = 'timeout: dead-man switch not pressed'
AGAIN = 'open the dead-man switch once, then press it'


class Operator:
    """A teleop node, and the hand that moves its device."""

    def __init__(self, harness, kind=PoseStamped, **parameters):
        self.harness, values = harness, {**WORLD, 'pose_type': kind.__name__, **parameters}
        self.goals = harness.record(PoseStamped, '/tp_controller/tool/goal')
        self._status = harness.record(DiagnosticArray, '/tp_teleop/status')
        self.node = harness.make(TeleopNode, **values)
        self._poses = harness.publisher(kind, f'/{values["pose_topic"]}')
        self._switch = harness.publisher(Bool, '/clutch', connected=bool(values['dead_man_topic']))
        self.joy = harness.publisher(Joy, f'/{values.get("joy_topic", "joy")}')
        self.message, self.pressed = kind(), False
        pose = self.message.pose.pose if kind is Odometry else self.message.pose
        self.place, self.turn = pose.position, pose.orientation
        self.place.x, self.place.y = 3.0, -2.0

    @property
    def state(self):
        """Return the last status."""
        return self._status[-1].status[0].message if self._status else ''

    def send(self):
        """Publish the pose of the device and its switch."""
        self._poses.publish(self.message)
        self._switch.publish(Bool(data=self.pressed))

    def spin_until(self, condition, what='the condition'):
        """Spin, while the device sends."""
        self.harness.spin_until(condition, what, meanwhile=self.send)

    def press(self):
        """Open the switch, then press it, and wait until the tool follows."""
        self.pressed = False
        self.spin_until(lambda: self.state == OPEN, 'an open switch')

        def press():
            # A stream that was late on a busy machine has opened the switch.
            self.pressed = self.state in (OPEN, WAITING, 'driving')
            self.send()

        self.harness.spin_until(lambda: self.state == 'driving', 'a tool that follows', press)

    def move(self, distance):
        """Move the device along x, as slowly as a hand does."""
        begin = self.place.x
        for share in np.linspace(0.0, 1.0, 8)[1:]:
            self.place.x = begin + share * distance
            self.harness.spin_for_more(self.goals, meanwhile=self.send)


class Arm:
    """A simulated Panda with its controller."""

    def __init__(self, harness, **parameters):
        harness.simulator(robot=str(PANDA_DH), initial_positions=str(dict(
            zip(panda().joint_names, PANDA_READY))))
        harness.controller(robot=str(PANDA_DH), stack=STACK, **parameters)
        self.commands = harness.commands()
        self._states = harness.record(JointState, '/joint_states')

    @property
    def tool(self):
        """Return the pose of the tool."""
        return panda().state(self._states[-1].position).pose(PANDA_TOOL)

    @property
    def speed(self):
        """Return the commanded speed of the tool."""
        return np.abs(panda().state(self._states[-1].position).jacobian(PANDA_TOOL)
                      @ self.commands[-1]).max()


class Tool:
    """The poses of a tool, without a robot."""

    def __init__(self, harness, operator):
        self.harness, self._operator = harness, operator
        self._poses = harness.publisher(TransformStamped, '/tp_controller/tool/transform')
        self.message = TransformStamped(child_frame_id='hand')
        self.message.header.frame_id = 'base'
        self.message.transform.translation.z = 0.5
        operator.send = self._with(operator.send)

    def _with(self, send):
        """Return a function that publishes the pose of the tool, too."""
        def both():
            self._poses.publish(self.message)
            send()
        return both


def place(goal):
    """Return the frame and the position of a goal."""
    return goal.header.frame_id, [goal.pose.position.x, goal.pose.position.y, goal.pose.position.z]


def rests(operator):
    """Return whether the last goal is the tool itself."""
    return operator.goals and place(operator.goals[-1]) == ('hand', [0.0, 0.0, 0.0])


def test_the_tool_moves_as_the_device_until_the_clutch_opens_and_stays(harness):
    arm, operator = Arm(harness), Operator(harness)
    operator.press()
    before = arm.tool
    operator.move(0.1)
    operator.spin_until(lambda: np.allclose(
        arm.tool[:3, 3], before[:3, 3] + (0.1, 0, 0), atol=2e-3), 'the way of the device')
    np.testing.assert_allclose(arm.tool[:3, :3], before[:3, :3], atol=2e-3)
    operator.move(0.05)
    assert arm.speed > 0.01
    operator.pressed = False
    operator.spin_until(lambda: arm.speed < 1e-4, 'standstill')
    assert operator.state == OPEN
    # Pressed anew, with the device elsewhere, the tool stays where it is.
    there = arm.tool
    operator.place.x -= 5.0
    operator.press()
    harness.spin_for_more(operator.goals, 5, meanwhile=operator.send)
    assert np.abs(arm.tool - there).max() < 1e-3


def test_a_lost_stream_leaves_the_tool_where_it_is(harness):
    arm, operator = Arm(harness), Operator(harness, timeout=0.1)
    operator.press()
    operator.move(0.1)
    harness.spin_until(lambda: operator.state.startswith('timeout: no input on'))
    harness.spin_until(lambda: arm.speed < 1e-4, 'standstill')
    operator.spin_until(lambda: operator.state == f'timeout: {AGAIN}')


def test_opening_the_clutch_acts_before_the_next_cycle(harness):
    operator = Operator(harness)
    Tool(harness, operator)
    operator.press()
    for timer in list(operator.node.timers):
        timer.cancel()
    operator.pressed = False
    operator.spin_until(lambda: rests(operator), 'the goal to stay')


def test_the_end_of_the_node_leaves_the_tool_where_it_is(harness):
    operator = Operator(harness)
    Tool(harness, operator)
    operator.press()
    for timer in list(operator.node.timers):
        timer.cancel()
    operator.node.close('ended')
    harness.spin_until(lambda: rests(operator), 'the goal to stay')


def test_a_controller_that_stops_opens_the_clutch_once_the_tool_is_behind(harness):
    arm, operator = Arm(harness), Operator(harness, pose_largest_lag=0.1)
    operator.press()
    harness.trigger('stop')
    operator.move(0.15)
    operator.spin_until(lambda: 'the tool is behind by 0.1' in operator.state)
    there = arm.tool
    harness.start(operator.send)
    operator.spin_until(lambda: arm.speed < 1e-4, 'standstill')
    assert np.abs(arm.tool - there).max() < 1e-3


def test_a_device_that_jumps_opens_the_clutch(harness):
    operator = Operator(harness)
    Tool(harness, operator)
    operator.press()
    operator.place.y += 1.0
    operator.spin_until(lambda: rests(operator), 'the goal to stay')
    operator.spin_until(
        lambda: operator.state == f'timeout: the device jumped by 1.00 m; {AGAIN}')


def test_a_device_may_send_odometry_and_its_switch_as_a_button(harness):
    operator = Operator(harness, Odometry, dead_man_topic='', dead_man='-axis 0')
    tool = Tool(harness, operator)
    send = operator.send

    def also_joy():
        send()
        operator.joy.publish(Joy(axes=[-1.0 if operator.pressed else 1.0]))

    operator.send = also_joy
    operator.press()
    operator.move(0.1)
    operator.spin_until(lambda: np.allclose(place(operator.goals[-1])[1], (0.1, 0, 0.5)))
    assert place(operator.goals[-1])[0] == tool.message.header.frame_id
    assert operator.goals[-1].header.stamp.sec > 0


def test_scales_and_frame_change_while_driving_without_a_jump(harness):
    operator = Operator(harness)
    tool = Tool(harness, operator)
    tool.message.transform.rotation.x, tool.message.transform.rotation.w = 1.0, 0.0
    operator.press()
    operator.move(0.1)
    operator.spin_until(lambda: np.allclose(place(operator.goals[-1])[1], (0.1, 0, 0.5)))
    harness.call(SetParameters, '/tp_teleop/set_parameters', meanwhile=operator.send, parameters=[
        Parameter(name, value=value).to_parameter_msg()
        for name, value in (('pose_scale', 0.5), ('frame', 'hand'))])
    harness.spin_for_more(operator.goals, 5, meanwhile=operator.send)
    np.testing.assert_allclose(place(operator.goals[-1])[1], (0.1, 0, 0.5), atol=1e-9)
    operator.place.z += 0.1
    operator.spin_until(lambda: np.allclose(place(operator.goals[-1])[1], (0.1, 0, 0.45)),
                        'half the way, along the tool that looks down')


def test_damaged_poses_are_logged_and_count_as_lost(harness, log):
    operator = Operator(harness, timeout=0.1)
    Tool(harness, operator)
    operator.press()
    operator.place.x = float('nan')
    operator.spin_until(lambda: rests(operator), 'the goal to stay')
    assert 'pose: a pose that is not finite' in log()


def test_the_gripper_button_is_passed_on_beside_the_poses(harness):
    operator, gripped = Operator(harness), harness.record(Bool, '/tp_teleop/gripper')
    harness.spin_until(lambda: operator.node.count_subscribers('/tp_teleop/gripper') == 1)
    for pressed in (0, 1, 1):
        operator.joy.publish(Joy(buttons=[0, pressed]))
    harness.spin_until(lambda: len(gripped) == 2, 'two changes')
    assert [message.data for message in gripped] == [False, True]


def test_the_file_for_headsets_drives(harness):
    operator = Operator(harness, **{**XR, 'dead_man_topic': ''})
    Tool(harness, operator)
    send = operator.send

    def also_joy():
        operator.message.header.stamp.nanosec += 1000
        send()
        operator.joy.publish(Joy(buttons=[0, int(operator.pressed), 0, 0, 0, 0]))

    operator.send = also_joy
    # The controller points along y of its world, which becomes x of the robot.
    operator.turn.z, operator.turn.y = 0.5, -0.5
    operator.turn.x, operator.turn.w = 0.5, 0.5
    operator.press()
    operator.place.y += 0.1
    operator.spin_until(lambda: np.allclose(
        place(operator.goals[-1])[1], (0.1, 0, 0.5), atol=1.1e-3), 'a goal ahead')


@pytest.mark.parametrize(('parameters', 'told'), [
    ({'dead_man_topic': ''}, 'pose_topic needs one of the parameters dead_man and dead_man_topic'),
    ({'dead_man': 'button 0'}, 'pose_topic needs one of the parameters dead_man and dead_man_top'),
    ({'pose_type': 'Pose'}, "pose_type: 'Pose' is not PoseStamped or Odometry"),
    ({'pose_forward': 'up'}, "pose_forward: 'up' is not one of x, -x, y"),
    ({'pose_axes': [0.0, 0.0, 1.0]}, 'pose_axes needs 4 numbers'),
    ({'pose_axes': [0.0, 0.0, 0.0, 2.0]}, 'pose_axes: a quaternion .* has norm 1')])
def test_a_faulty_parameter_is_refused_with_its_name(harness, parameters, told):
    with pytest.raises(SettingsError, match=told):
        harness.make(TeleopNode, **{**WORLD, **parameters})
