# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A device drives a task of a controller, and stops as soon as nobody presses its switch."""

import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from harness import Status
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from robots import CONFIG, panda, PANDA_DH, PANDA_READY, PANDA_TOOL
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool
from tp_controller.errors import SettingsError
from tp_controller.tools.teleop.teleop_node import TeleopNode
import yaml

STACK = f'[tool: {{type: twist, frame: {PANDA_TOOL}}}, rest: {{type: posture}}]'
GAMEPAD = {'x': 'axis 0', 'rz': 'axis 1', 'dead_man': 'button 0', 'gripper': 'button 1',
           'linear_scale': 0.1, 'angular_scale': 0.5, 'deadband': 0.0, 'ramp': 0.0}


class Driver:
    """A teleop node, its device, and what it sends."""

    def __init__(self, harness, **parameters):
        self.harness = harness
        self.twists = harness.record(TwistStamped, '/tp_controller/tool/twist')
        self._status = harness.record(DiagnosticArray, '/tp_teleop/status')
        self.node = harness.make(TeleopNode, **{**GAMEPAD, **parameters})
        self.joy = harness.publisher(Joy, '/joy')
        self.axes, self.pressed = [1.0, 0.0], False

    @property
    def state(self):
        """Return the last status."""
        return self._status[-1].status[0].message if self._status else ''

    def send(self):
        """Publish the state of the device."""
        self.joy.publish(Joy(axes=self.axes, buttons=[int(self.pressed), 0]))

    def spin_until(self, condition, what='the condition'):
        """Spin, while the device sends."""
        self.harness.spin_until(condition, what, meanwhile=self.send)

    def press(self):
        """Open the switch, then press it, and wait for motion."""
        self.pressed = False
        self.spin_until(lambda: self.state == 'timeout: dead-man switch not pressed')
        self.pressed = True
        self.spin_until(lambda: self.state == 'driving' and self.twists
                        and any(values(self.twists[-1])), 'motion')


def values(message):
    """Return the six values of a message."""
    linear, angular = message.twist.linear, message.twist.angular
    return [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]


def test_a_stick_moves_the_tool_until_the_switch_opens(harness):
    harness.simulator(robot=str(PANDA_DH), initial_positions=str(dict(
        zip(panda().joint_names, PANDA_READY))))
    harness.controller(robot=str(PANDA_DH), stack=STACK)
    commands, states = harness.commands(), harness.record(JointState, '/joint_states')
    driver = Driver(harness)
    driver.axes = [0.5, -0.4]
    driver.press()

    def moves_with(twist):
        J = panda().state(states[-1].position).jacobian(PANDA_TOOL)
        return np.allclose(J @ commands[-1], twist, atol=2e-3)

    driver.spin_until(lambda: moves_with([0.05, 0, 0, 0, 0, -0.2]), 'the twist of the stick')
    driver.pressed = False
    driver.spin_until(lambda: moves_with(np.zeros(6)), 'standstill')
    assert driver.state == 'timeout: dead-man switch not pressed'


def test_opening_the_switch_sends_zeros_before_the_next_cycle(harness):
    driver = Driver(harness)
    driver.press()
    for timer in list(driver.node.timers):
        timer.cancel()
    driver.pressed = False
    driver.spin_until(lambda: not any(values(driver.twists[-1])), 'zeros')


def test_a_lost_stream_ends_in_zeros_and_moves_nothing_when_it_is_back(harness):
    driver = Driver(harness, timeout=0.1)
    driver.press()
    harness.spin_until(lambda: not any(values(driver.twists[-1])), 'zeros')
    harness.spin_until(lambda: driver.state == 'timeout: no input on joy for 0.1 s')
    driver.spin_until(lambda: driver.state
                      == 'timeout: open the dead-man switch once, then press it')
    assert not any(values(driver.twists[-1]))
    driver.press()


def test_pressing_anew_begins_from_zero(harness):
    # No input gets lost on a busy machine.
    driver = Driver(harness, ramp=1.0, timeout=10.0)
    for _ in range(2):
        driver.press()
        before = len(driver.twists)
        driver.pressed = False
        driver.spin_until(lambda: not any(values(driver.twists[-1])), 'zeros')
        driver.pressed = True
        sent = len(driver.twists)
        driver.spin_until(lambda: len(driver.twists) >= sent + 5, 'five twists')
        speeds = [values(twist)[0] for twist in driver.twists[sent:]]
        assert speeds == sorted(speeds) and speeds[0] < 0.1 * 0.2
        assert sent > before


def test_nobody_else_is_disturbed_while_the_switch_is_open(harness):
    driver = Driver(harness)
    driver.press()
    driver.pressed = False
    driver.spin_until(lambda: not any(values(driver.twists[-1])), 'zeros')
    started = time.monotonic()
    driver.spin_until(lambda: time.monotonic() - started > 0.2, 'ten cycles')
    zeros = [twist for twist in driver.twists if not any(values(twist))]
    assert len(zeros) <= 3


def test_the_button_of_the_gripper_is_passed_on_when_it_changes(harness):
    driver = Driver(harness)
    gripped = harness.record(Bool, '/tp_teleop/gripper')
    harness.spin_until(lambda: driver.node.count_subscribers('/tp_teleop/gripper') == 1)
    for pressed in (0, 0, 1, 1, 0):
        driver.joy.publish(Joy(axes=[0.0, 0.0], buttons=[0, pressed]))
    harness.spin_until(lambda: len(gripped) == 3, 'three changes')
    assert [message.data for message in gripped] == [False, True, False]


@pytest.mark.parametrize('stamped', [True, False])
def test_twists_of_a_device_are_scaled(harness, stamped):
    driver = Driver(harness, x='', rz='', dead_man='', gripper='', twist_topic='spacenav/twist',
                    twist_stamped=stamped)
    kind = TwistStamped if stamped else Twist
    publisher = harness.publisher(kind, '/spacenav/twist')
    message = kind()

    def send():
        publisher.publish(message)

    harness.spin_until(lambda: driver.state == 'at rest', meanwhile=send)
    inner = message.twist if stamped else message
    inner.linear.y, inner.angular.z = 0.5, -1.0
    if stamped:
        message.header.frame_id = 'panda_link0'
    harness.spin_until(lambda: driver.twists, 'a twist', meanwhile=send)
    assert values(driver.twists[-1]) == pytest.approx([0, 0.05, 0, 0, 0, -0.5])
    assert driver.twists[-1].header.frame_id == ('panda_link0' if stamped else '')


def test_scale_deadband_and_frame_change_while_driving(harness):
    driver = Driver(harness)
    driver.press()
    harness.call(SetParameters, '/tp_teleop/set_parameters', meanwhile=driver.send, parameters=[
        Parameter(name, value=value).to_parameter_msg() for name, value in (
            ('linear_scale', 0.3), ('deadband', 0.5), ('frame', 'panda_hand_tcp'))])
    driver.axes = [0.75, 0.4]
    driver.spin_until(lambda: values(driver.twists[-1]) == pytest.approx([0.15, 0, 0, 0, 0, 0]))
    assert driver.twists[-1].header.frame_id == 'panda_hand_tcp'


def test_a_task_that_nobody_has_is_told(harness):
    driver = Driver(harness, task='tol')
    driver.spin_until(lambda: driver.state == 'no listener on /tp_controller/tol/twist')


def test_the_end_of_the_node_sends_zeros(harness):
    driver = Driver(harness)
    driver.press()
    for timer in list(driver.node.timers):
        timer.cancel()
    driver.node.close('ended')
    harness.spin_until(lambda: not any(values(driver.twists[-1])), 'zeros')


def test_damaged_input_is_logged_and_counts_as_lost(harness, log):
    driver = Driver(harness, timeout=0.1)
    driver.press()
    driver.axes = [float('nan'), 0.0]
    driver.spin_until(lambda: not any(values(driver.twists[-1])), 'zeros')
    assert 'joy: axes that are not finite' in log()


@pytest.mark.parametrize(('parameters', 'told'), [
    ({'x': 'axle 1', 'dead_man': 'button'}, "parameter x: 'axle 1' is not a sum .* dead_man"),
    ({'x': '', 'rz': ''}, 'no input: one of the parameters x, y, z, rx, ry, rz, twist_topic or'),
    ({'timeout': 0.0}, 'parameter timeout must be from 0.01 to 10')])
def test_a_faulty_parameter_is_refused_with_its_name(harness, parameters, told):
    with pytest.raises(SettingsError, match=told):
        harness.make(TeleopNode, **{**GAMEPAD, **parameters})


# In place of MoveIt Servo ----------------------------------------------------------------------


SERVO = yaml.safe_load((CONFIG / 'teleop' / 'servo.yaml').read_text())['/**']['ros__parameters']


@pytest.mark.parametrize(('unitless', 'speed'), [(True, 0.1), (False, 0.25)])
def test_twists_for_servo_move_the_task_from_the_first_one(harness, unitless, speed):
    twists = harness.record(TwistStamped, '/tp_controller/tool/twist')
    harness.make(TeleopNode, arguments=('--ros-args', '-r', '__node:=servo_node'),
                 **{**SERVO, 'unitless': unitless})
    publisher = harness.publisher(TwistStamped, '/servo_node/delta_twist_cmds')
    message = TwistStamped()
    message.header.frame_id, message.twist.linear.x = 'panda_link0', 0.25
    harness.spin_until(lambda: twists, 'a twist', meanwhile=lambda: publisher.publish(message))
    assert values(twists[0]) == pytest.approx([speed, 0, 0, 0, 0, 0])
    assert twists[0].header.frame_id == 'panda_link0'
    # Servo stops, too, when nothing comes.
    harness.spin_until(lambda: not any(values(twists[-1])), 'zeros')


def test_poses_for_servo_are_goals_of_the_task(harness):
    harness.controller(robot=str(PANDA_DH), stack=STACK.replace('twist', 'pose'), arguments=(
        '--ros-args', '-r', '~/tool/goal:=servo_node/pose_target_cmds'))
    status = Status(harness)
    publisher = harness.publisher(PoseStamped, '/servo_node/pose_target_cmds')
    message = PoseStamped()
    message.pose.position.x = message.pose.orientation.w = 0.5
    message.pose.orientation.x = 0.75 ** 0.5
    publisher.publish(message)
    harness.spin_until(lambda: status.task('tool')['goals accepted'] == '1', 'the goal')
