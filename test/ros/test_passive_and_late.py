# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Passive joints without joint states, and cycles that come late."""

from harness import Arm, Status
import numpy as np
import pytest
import robots

PANDA = {'robot': str(robots.PANDA_DH), 'joints': ['panda_joint1', 'panda_joint2'],
         'stack': '- j: {type: joint, joints: panda_joint1, target: [0.5]}'}


def last(commands):
    """Return the latest command, empty before the first."""
    return commands[-1] if commands else []


def test_passive_joints_that_are_not_heard_of_are_within_their_limits_and_named(harness, log):
    node = harness.controller(**PANDA)
    commands = harness.commands()
    arm = Arm(harness, (0.0, 0.1), ('panda_joint1', 'panda_joint2'))
    harness.spin_until(lambda: any(last(commands)), meanwhile=arm.publish)
    # The fourth joint cannot be at zero; the other passive ones can.
    passive = node._robot.loop.measurements.joints.passive
    assert passive == pytest.approx([0.0, -0.0698, 0.0, 0.0, 0.0])
    text = log()
    while 'no joint states of passive joints' not in text:
        harness.spin_for_more(commands, meanwhile=arm.publish)
        text += log()
    assert 'panda_joint3, panda_joint4, panda_joint5, panda_joint6, panda_joint7' in text


def test_passive_joints_are_where_joint_states_say_from_the_first_message_on(harness):
    node = harness.controller(**PANDA)
    commands = harness.commands()
    names = [f'panda_joint{number}' for number in range(1, 8)]
    arm = Arm(harness, robots.PANDA_READY, names)
    harness.spin_until(lambda: any(last(commands)), meanwhile=arm.publish)
    joints = node._robot.loop.measurements.joints
    np.testing.assert_array_equal(joints.passive, robots.PANDA_READY[2:])
    assert not joints.unheard()


def test_cycle_that_is_only_late_is_made_up_for_and_no_zero_is_put_in(harness):
    node = harness.controller(rate=50.0)
    commands, status = harness.commands(), Status(harness)
    arm = Arm(harness)
    harness.spin_until(lambda: any(last(commands)), meanwhile=arm.publish)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    # As if the machine had not let the timer run for ten seconds.
    before = len(commands)
    node._robot.loop._last_cycle -= 10.0
    node._robot.loop._watch()
    harness.spin_for_more(commands, 5, meanwhile=arm.publish)
    assert all(any(command) for command in commands[before:])
    assert status.head == 'running'
