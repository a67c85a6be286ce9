# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Locked joints as a parameter, set while the robot moves."""

import json

from geometry_msgs.msg import PointStamped
from harness import Arm, Status
import numpy as np
import pytest
from robots import CONFIG, planar, PLANAR_DH
from std_srvs.srv import Trigger

STACK = '- swing: {type: joint, joints: [joint1, joint2], target: [3.0, 2.0], gain: 5.0}'
SPEED, ACCELERATION, PERIOD = 1.0, 2.0, 0.01
SLOW = {f'limits__joint{index}__acceleration': ACCELERATION for index in (1, 2, 3)}
NAME = 'locked_joints'


@pytest.fixture
def moving(harness):
    """Return a controller whose first two joints move as fast as they may, and its commands."""
    controller = harness.controller(stack=STACK, state_timeout=5.0, **SLOW)
    arm, commands = Arm(harness), harness.commands()
    harness.spin_until(lambda: commands and commands[-1][:2] == pytest.approx([SPEED, SPEED]),
                       'full speed', arm.publish)
    return controller, arm, commands


def test_a_joint_is_locked_and_unlocked_in_motion_without_a_jump(harness, moving, log):
    controller, arm, commands = moving
    status = Status(harness)
    assert harness.set_parameters({NAME: ['joint1']}) == ''
    harness.spin_until(lambda: commands[-1][0] == 0.0, meanwhile=arm.publish)
    new = harness.spin_for_more(commands, 20, arm.publish)
    assert all(command[0] == 0.0 and command[1] == pytest.approx(SPEED) for command in new)
    harness.spin_until(lambda: status.of_node('locked') == 'joint1', meanwhile=arm.publish)
    assert status.head == 'running'
    assert status.messages[-1].status[0].level == b'\x01'
    assert status.task('swing')['reason'].startswith('joint1 is locked')
    assert harness.set_parameters({NAME: []}) == ''
    harness.spin_until(lambda: commands[-1][0] == pytest.approx(SPEED), meanwhile=arm.publish)
    harness.spin_until(lambda: status.of_node('locked') == '', meanwhile=arm.publish)
    assert list(controller.get_parameter(NAME).value) == ['']
    steps = np.abs(np.diff(np.array(commands), axis=0))
    assert steps.max() <= ACCELERATION * PERIOD + 1e-9
    text = harness.spin_until_logged(log, 'unlocked: joint1', arm.publish)
    assert 'locked: joint1' in text


def test_a_joint_that_the_robot_lacks_is_refused_with_the_valid_ones(harness, moving):
    controller, arm, commands = moving
    refused = harness.set_parameters({NAME: ['joint1', 'joint4']})
    assert "unknown driven joint 'joint4'" in refused and 'joint3' in refused
    assert 'a list of strings' in harness.set_parameters({NAME: 'joint1'})
    assert list(controller.get_parameter(NAME).value) == ['']
    assert harness.spin_for_more(commands, 5, arm.publish)[-1][0] > 0.0


def test_locks_outlive_stop_and_start_another_stack_and_a_configuration(harness, moving):
    controller, arm, commands = moving
    assert harness.set_parameters({NAME: ['joint1']}) == ''
    harness.spin_until(lambda: commands[-1][0] == 0.0, meanwhile=arm.publish)

    def locked():
        """Return whether only joint 2 moves."""
        return commands[-1][0] == 0.0 and commands[-1][1] > 0.5

    assert harness.trigger('stop').success
    harness.spin_until(lambda: not any(commands[-1]), meanwhile=arm.publish)
    harness.start(arm.publish)
    harness.spin_until(locked, meanwhile=arm.publish)
    assert harness.trigger('reload').success
    assert harness.set_parameters({'stack': STACK.replace('5.0', '4.0')}) == ''
    harness.spin_until(locked, meanwhile=arm.publish)
    controller.trigger_deactivate()
    controller.trigger_cleanup()
    controller.trigger_configure()
    controller.trigger_activate()
    del commands[:-1]
    harness.spin_until(locked, meanwhile=arm.publish)
    assert all(command[0] == 0.0 for command in commands)
    # Another robot, which has no such joint.
    controller.trigger_deactivate()
    controller.trigger_cleanup()
    assert harness.set_parameters(
        {'robot': str(CONFIG / 'robots' / 'panda.yaml'), 'stack': '[]'}) == ''
    controller.trigger_configure()
    assert controller._robot is None


def test_a_robot_may_start_with_a_locked_joint_outside_its_limits(harness):
    harness.controller(stack=STACK.replace('2.0]', '0.5]'), locked_joints=['joint2'],
                       limits__joint2__upper=1.0)
    commands, arm = harness.commands(), Arm(harness)
    arm.q[1] = 2.0
    harness.spin_until(lambda: commands and commands[-1][0] > 0.5, meanwhile=arm.publish)
    assert all(command[1] == 0.0 for command in commands)


def test_a_lock_of_the_loop_becomes_one_of_the_parameter(harness, moving):
    controller, arm, commands = moving
    assert harness.set_parameters({NAME: ['joint3']}) == ''
    # As a joint that does not follow.
    controller._robot.loop._lock('joint1', 'joint1 does not follow')
    harness.spin_until(lambda: list(controller.get_parameter(NAME).value) == ['joint3', 'joint1'],
                       meanwhile=arm.publish)
    harness.spin_until(lambda: commands[-1][0] == 0.0, meanwhile=arm.publish)
    assert harness.set_parameters({NAME: ['joint3']}) == ''
    harness.spin_until(lambda: commands[-1][0] > 0.5, meanwhile=arm.publish)


def test_a_reaction_that_does_not_exist_is_refused(harness, moving):
    controller, _, _ = moving
    refused = harness.set_parameters({'on_not_following': 'go on'})
    assert 'on_not_following' in refused and 'stop, lock' in refused
    assert harness.set_parameters({'on_not_following': 'lock'}) == ''
    assert controller._robot.loop.checks.on_not_following == 'lock'


def test_the_service_says_where_the_other_joints_lead(any_harness):
    any_harness.controller(stack='- tip: {type: position, frame: link3, axes: xy}')
    status, arm = Status(any_harness), Arm(any_harness)
    any_harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    assert any_harness.set_parameters({NAME: ['joint3']}) == ''
    goals = any_harness.publisher(PointStamped, '/tp_controller/tip/goal')
    message = PointStamped()
    message.point.x, message.point.y = 1.0, 0.6
    goals.publish(message)
    any_harness.spin_until(lambda: status.task('tip')['goals accepted'] == '1',
                           meanwhile=arm.publish)
    answer = any_harness.call(Trigger, '/tp_controller/solve_position', arm.publish)
    found = json.loads(answer.message)['q']
    assert answer.success and found['joint3'] == arm.q[2]
    np.testing.assert_allclose(planar().state(list(found.values())).position('link3')[:2],
                               [1.0, 0.6], atol=1e-6)


def test_the_tool_arrives_over_real_topics_without_a_joint_that_is_locked_in_motion(harness):
    start = dict(zip(('joint1', 'joint2', 'joint3'), (0.0, 0.6, 0.3)))
    harness.simulator(initial_positions=json.dumps(start), rate=200.0)
    harness.controller(robot=str(PLANAR_DH), follow_window=1.0, jump_tolerance=0.1,
                       stack='- tip: {type: position, frame: link3, axes: xy, gain: 2.0}')
    status, commands = Status(harness), harness.commands()
    harness.spin_until(lambda: status.head == 'running')
    goals = harness.publisher(PointStamped, '/tp_controller/tip/goal')
    message = PointStamped()
    message.point.x, message.point.y = 0.9, 0.9
    goals.publish(message)
    harness.spin_until(lambda: any(np.abs(command[1]) > 0.05 for command in commands))
    assert harness.set_parameters({NAME: ['joint2']}) == ''
    harness.spin_until(lambda: status.of_node('locked') == 'joint2')
    harness.spin_until(lambda: status.task('tip')['status'] == 'reached')
    assert commands[-1][1] == 0.0 and status.head == 'running'
