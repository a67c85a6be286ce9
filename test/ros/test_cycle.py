# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The cycle: joint states in, commands out, and zeros whenever something is missing."""

from harness import Arm, COMMANDS, JOINTS, Status
import numpy as np
import pytest
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

ZEROS = [0.0, 0.0, 0.0]
Q = (0.0, 0.6, 0.3)
# What MOVING_STACK commands at Q, with its gain of 1/s.
VELOCITY = [1.0, -0.1, -0.55]
# Limits of some tests [rad/s², rad/s³].
ACCELERATION, JERK = 4.0, 30.0
ALL_MISSING = 'no joint states of joint1, joint2, joint3'


def last(commands):
    """Return the latest command, zeros before the first."""
    return commands[-1] if commands else ZEROS


def spin_until_moving(harness, commands, arm):
    """Spin until the controller commands a motion."""
    harness.spin_until(lambda: any(last(commands)), 'motion', meanwhile=arm.publish)


# What comes in --------------------------------------------------------------------------------

def test_a_joint_state_becomes_a_command_by_the_control_law(any_harness):
    any_harness.controller()
    commands, arm = any_harness.commands(), Arm(any_harness, Q)
    spin_until_moving(any_harness, commands, arm)
    np.testing.assert_allclose(last(commands), VELOCITY, atol=1e-12)


@pytest.mark.parametrize('rate', [100.0, 0.0])
def test_the_order_of_the_names_and_joints_of_others_do_not_matter(harness, rate):
    harness.controller(rate=rate)
    commands = harness.commands()
    arm = Arm(harness, (9.0, Q[2], float('nan'), Q[0], Q[1]),
              ('wheel', 'joint3', 'gripper', 'joint1', 'joint2'))
    spin_until_moving(harness, commands, arm)
    np.testing.assert_allclose(last(commands), VELOCITY, atol=1e-12)


@pytest.mark.parametrize('rate', [100.0, 0.0])
def test_several_publishers_complement_each_other(harness, rate):
    harness.controller(rate=rate)
    commands, status = harness.commands(), Status(harness)
    first = Arm(harness, (Q[2], Q[0]), ('joint3', 'joint1'))
    second = Arm(harness, (Q[1], 0.5), ('joint2', 'gripper'))
    harness.spin_until(lambda: status.head == 'no joint states of joint2',
                       meanwhile=first.publish)
    assert last(commands) == ZEROS

    def both():
        first.publish()
        second.publish()

    harness.spin_until(lambda: any(last(commands)), meanwhile=both)
    np.testing.assert_allclose(last(commands), VELOCITY, atol=1e-12)


@pytest.mark.parametrize('names, positions, told', [
    (JOINTS, Q[:2], '3 joints with 2 positions'),
    (JOINTS, (*Q, 0.0), '3 joints with 4 positions'),
    (JOINTS[:2], Q, '2 joints with 3 positions'),
    (JOINTS, (), '3 joints with 0 positions'),
    (JOINTS, (0.0, float('nan'), 0.3), 'not finite, or beyond 1e+06: joint2'),
    (JOINTS, (float('inf'), 0.6, -1e300), 'not finite, or beyond 1e+06: joint1, joint3'),
])
def test_a_faulty_joint_state_is_ignored_with_one_warning(harness, log, names, positions, told):
    harness.controller()
    commands, status = harness.commands(), Status(harness)
    bad = Arm(harness, positions, names)
    for _ in range(5):
        bad.publish()
    harness.spin_for_more(commands, 10, meanwhile=bad.publish)
    assert set(map(tuple, commands)) == {tuple(ZEROS)}
    harness.spin_until(lambda: status.head.startswith(f'{ALL_MISSING} (ignored: '))
    lines = [line for line in log().splitlines() if 'joint state ignored' in line]
    assert len(lines) == 1 and told in lines[0]
    # A good one is taken all the same, in spite of bad ones in between.
    good = Arm(harness, Q)

    def both():
        good.publish()
        bad.publish()

    harness.spin_until(lambda: any(last(commands)), meanwhile=both)
    np.testing.assert_allclose(last(commands), VELOCITY, atol=1e-12)


def test_a_joint_state_that_is_no_message_at_all_is_survived(any_harness):
    any_harness.controller()
    commands, arm = any_harness.commands(), Arm(any_harness, Q)
    raw = any_harness.publisher(JointState, '/joint_states')
    for data in (b'', b'\x00\x01\x00\x00\xff', bytes(range(256))):
        raw.publish(data)
    spin_until_moving(any_harness, commands, arm)


def test_absurd_positions_of_sliding_joints_never_make_a_command_that_is_no_number(harness):
    harness.controller(stack='- tip: {type: position, frame: tip, reference: base}',
                       robot_description=SLIDES)
    commands = harness.commands()
    for q in ((1e6, -1e6), (-1e6, 1e6), (1e-300, 1e6)):
        arm = Arm(harness, q, ('x', 'y'))
        harness.spin_for_more(commands, 10, meanwhile=arm.publish)
    assert np.isfinite(commands).all() and np.abs(commands).max() <= 1.0


# What goes out --------------------------------------------------------------------------------

def test_commands_come_in_the_order_of_command_joints(any_harness):
    any_harness.controller(command_joints=['joint3', 'joint1', 'joint2'])
    commands, arm = any_harness.commands(), Arm(any_harness, Q)
    spin_until_moving(any_harness, commands, arm)
    np.testing.assert_allclose(last(commands), [VELOCITY[2], VELOCITY[0], VELOCITY[1]],
                               atol=1e-12)


def test_commands_come_in_the_order_of_joints_by_default(harness):
    harness.controller(joints=['joint3', 'joint1', 'joint2'])
    commands, arm = harness.commands(), Arm(harness, Q)
    spin_until_moving(harness, commands, arm)
    np.testing.assert_allclose(last(commands), [VELOCITY[2], VELOCITY[0], VELOCITY[1]],
                               atol=1e-12)


def test_joints_that_are_not_driven_stay_where_joint_states_says(harness):
    harness.controller(joints=['joint2', 'joint3'], stack='- rest: {type: posture, joints: '
                       'joint2, target: [0.1]}')
    commands, arm = harness.commands(), Arm(harness, (0.5, 0.0, 0.0))
    spin_until_moving(harness, commands, arm)
    np.testing.assert_allclose(last(commands), [0.1, 0.0], atol=1e-12)


def test_a_command_comes_every_cycle_even_without_joint_states(harness):
    harness.controller(rate=200.0)
    commands = harness.commands()
    harness.spin_for_more(commands, 20)
    assert commands == [ZEROS] * len(commands)


def test_without_a_rate_every_complete_state_makes_one_command(any_harness):
    # A long timeout, so that the watch over stale states does not interfere.
    any_harness.controller(rate=0.0, state_timeout=1.0, braking_gain=1.0)
    commands, status = any_harness.commands(), Status(any_harness)
    arm = Arm(any_harness, Q)
    any_harness.spin_until(lambda: any_harness.node.count_publishers(COMMANDS) == 1)
    for count in range(1, 21):
        arm.publish()
        any_harness.spin_until(lambda: len(commands) >= count)
    any_harness.spin_for_more(status.messages, 2)
    assert len(commands) == 20
    assert all(any(command) for command in commands)


def test_without_a_rate_a_part_of_the_joints_makes_no_command(harness):
    harness.controller(rate=0.0, state_timeout=1.0, braking_gain=1.0)
    commands, status = harness.commands(), Status(harness)
    first, second = Arm(harness, Q[:1], JOINTS[:1]), Arm(harness, Q[1:], JOINTS[1:])
    harness.spin_until(lambda: harness.node.count_publishers(COMMANDS) == 1)
    for _ in range(5):
        first.publish()
    harness.spin_for_more(status.messages, 2)
    assert commands == []
    second.publish()
    harness.spin_until(lambda: commands)
    second.publish()
    harness.spin_for_more(status.messages, 2)
    assert len(commands) == 1


@pytest.mark.parametrize('scaling, share', [('uniform', 0.25), ('redistribute', 1.0)])
def test_the_velocity_limit_of_the_parameter_is_respected(harness, scaling, share):
    harness.controller(limits__joint1__velocity=0.25, scaling=scaling)
    commands, arm = harness.commands(), Arm(harness, Q)
    spin_until_moving(harness, commands, arm)
    expected = [0.25, *(share * np.array(VELOCITY[1:]))]
    np.testing.assert_allclose(last(commands), expected, atol=1e-12)


# Zeros ----------------------------------------------------------------------------------------

@pytest.mark.parametrize('rate', [100.0, 0.0])
def test_zeros_are_commanded_when_joint_states_stop(any_harness, rate):
    any_harness.controller(rate=rate)
    commands, status = any_harness.commands(), Status(any_harness)
    arm = Arm(any_harness, Q)
    spin_until_moving(any_harness, commands, arm)
    any_harness.spin_until(lambda: last(commands) == ZEROS)
    any_harness.spin_until(lambda: status.head == ALL_MISSING)
    assert any_harness.spin_for_more(commands, 5)[-5:] == [ZEROS] * 5
    # And it goes on by itself.
    spin_until_moving(any_harness, commands, arm)
    any_harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)


@pytest.mark.parametrize('rate', [100.0, 0.0])
def test_zeros_are_commanded_when_one_joint_is_not_heard_of_any_more(harness, rate):
    harness.controller(rate=rate)
    commands, status = harness.commands(), Status(harness)
    arm = Arm(harness, Q)
    spin_until_moving(harness, commands, arm)
    others = Arm(harness, Q[:2], JOINTS[:2])
    harness.spin_until(lambda: status.head == 'no joint states of joint3',
                       meanwhile=others.publish)
    assert harness.spin_for_more(commands, 5, others.publish)[-1] == ZEROS


def test_faulty_joint_states_do_not_keep_a_command_alive(harness):
    harness.controller()
    commands = harness.commands()
    arm = Arm(harness, Q)
    spin_until_moving(harness, commands, arm)
    arm.q[1] = float('nan')
    harness.spin_until(lambda: last(commands) == ZEROS, meanwhile=arm.publish)


def test_stamps_of_the_messages_do_not_count(harness):
    harness.controller()
    commands = harness.commands()
    publisher = harness.publisher(JointState, '/joint_states')

    def publish(seconds):
        message = JointState(name=list(JOINTS), position=list(Q))
        message.header.stamp.sec = seconds
        publisher.publish(message)

    harness.spin_until(lambda: any(last(commands)), meanwhile=lambda: publish(1))
    publish(2**31 - 1)
    harness.spin_until(lambda: last(commands) == ZEROS)


def test_a_clock_that_stands_still_stops_the_robot(any_harness):
    any_harness.controller(use_sim_time=True)
    commands, status = any_harness.commands(), Status(any_harness)
    arm, clock = Arm(any_harness, Q), any_harness.publisher(Clock, '/clock')
    time = Clock()

    def tick():
        time.clock.nanosec += 10_000_000
        if time.clock.nanosec >= 1_000_000_000:
            time.clock.sec, time.clock.nanosec = time.clock.sec + 1, 0
        clock.publish(time)
        arm.publish()

    any_harness.spin_until(lambda: any(last(commands)), meanwhile=tick)
    any_harness.spin_until(lambda: last(commands) == ZEROS, meanwhile=arm.publish)
    any_harness.spin_until(lambda: status.head == 'simulated time (/clock) stands still',
                           meanwhile=arm.publish)
    any_harness.spin_until(lambda: any(last(commands)), meanwhile=tick)
    # Neither is time that runs backwards the end.
    time.clock.sec = 0
    any_harness.spin_until(lambda: status.head == 'running', meanwhile=tick)
    assert any(last(commands))


@pytest.mark.parametrize('blend', [0.0, 0.2])
def test_published_commands_keep_the_jerk_limit(harness, blend):
    limits = {f'limits__{joint}__{key}': value for joint in JOINTS
              for key, value in (('acceleration', ACCELERATION), ('jerk', JERK))}
    node = harness.controller(rate=0.0, use_sim_time=True, blend=blend, **limits)
    commands, arm = harness.commands(), Arm(harness, Q)
    clock = harness.publisher(Clock, '/clock')
    goal = harness.publisher(JointState, '/tp_controller/swing/goal')
    rng, now, times, taken, alone = np.random.default_rng(1), 10_000_000, [], [], []
    for cycle in range(200):
        now += int(rng.integers(2, 20)) * 1_000_000
        clock.publish(Clock(clock=Time(nanoseconds=now).to_msg()))
        harness.spin_until(lambda: node.loop_node.get_clock().now().nanoseconds >= now)
        if cycle % 30 == 20:
            goal.publish(JointState(name=JOINTS, position=rng.uniform(-2.0, 2.0, 3).tolist()))
        count = len(commands)
        arm.publish()
        harness.spin_until(lambda: len(commands) > count)
        times.append(1e-9 * now)
        taken.append(commands[-1])
        # More are zeros of a slow machine, which stop the robot. They are exempt.
        alone.append(len(commands) == count + 1 and any(commands[-1]))
        if cycle:
            arm.q = (np.array(arm.q) + (times[-1] - times[-2]) * np.array(taken[-2])).tolist()
    h, alone = np.diff(times), np.array(alone)
    changes = np.diff(taken, axis=0) / h[:, None]
    second = np.abs(np.diff(changes, axis=0)) / (0.5 * (h[1:] + h[:-1]))[:, None]
    counts = alone[:-2] & alone[1:-1] & alone[2:]
    assert counts.sum() > 100
    assert second[counts].max() <= JERK * (1.0 + 1e-6)
    assert np.abs(changes[1:][counts]).max() <= ACCELERATION * (1.0 + 1e-9)
    # It makes a difference: the acceleration limit alone allows 400 rad/s³ and more.
    assert second[counts].max() > 0.9 * JERK


def test_without_any_clock_zeros_are_commanded_from_the_start(harness):
    harness.controller(use_sim_time=True)
    commands, arm = harness.commands(), Arm(harness, Q)
    harness.spin_for_more(commands, 3, arm.publish)
    assert commands == [ZEROS] * len(commands)


def test_a_slow_cycle_is_no_standstill(harness):
    harness.controller(rate=4.0, braking_gain=4.0)
    commands, status = harness.commands(), Status(harness)
    arm = Arm(harness, Q)
    spin_until_moving(harness, commands, arm)
    harness.spin_until(lambda: status.head == 'running' and len(commands) > 3
                       and all(any(command) for command in commands[-3:]), meanwhile=arm.publish)
    # Joint states that stop still stop the robot within their own time.
    del commands[:]
    harness.spin_until(lambda: status.head == ALL_MISSING)
    assert commands[-1] == ZEROS


@pytest.mark.parametrize('stack, told', [
    ('', 'parameter stack is empty'),
    ('- swing: {type: joint}', "line 1: swing: needs the key 'joints'"),
    ('- a: {type: pose, frame: nowhere}\n- b: {type: what}', "line 2: b: unknown type 'what'"),
    ('/nowhere/stack.yaml', 'no file /nowhere/stack.yaml'),
    ('- [', 'not valid YAML'),
])
def test_without_a_valid_stack_zeros_are_commanded_and_the_reason_said(harness, log, stack, told):
    harness.controller(stack=stack)
    commands, status = harness.commands(), Status(harness)
    arm = Arm(harness, Q)
    harness.spin_for_more(commands, 5, arm.publish)
    assert commands == [ZEROS] * len(commands)
    harness.spin_until(lambda: status.head.startswith('no valid stack: '))
    assert told in status.head
    assert told in log()


@pytest.mark.parametrize('rate', [100.0, 0.0])
def test_closing_commands_a_last_zero(any_harness, rate):
    controller = any_harness.controller(rate=rate)
    commands, arm = any_harness.commands(), Arm(any_harness, Q)
    spin_until_moving(any_harness, commands, arm)
    # As at the end of a process: the node is spun no more, then closed.
    any_harness.executor.remove_node(controller)
    controller.close('ended')
    any_harness.spin_until(lambda: last(commands) == ZEROS)


def test_closing_before_the_robot_is_known_is_silent(harness):
    controller = harness.controller(robot='')
    controller.close('ended')


# An arm of two slides: its positions have no natural end.
SLIDES = """
<robot name="slides">
  <link name="base"/><link name="middle"/><link name="tip"/>
  <joint name="x" type="prismatic"><parent link="base"/><child link="middle"/>
    <axis xyz="1 0 0"/><limit lower="-1e9" upper="1e9" velocity="1" effort="1"/></joint>
  <joint name="y" type="prismatic"><parent link="middle"/><child link="tip"/>
    <axis xyz="0 1 0"/><limit lower="-1e9" upper="1e9" velocity="1" effort="1"/></joint>
</robot>
"""


def test_closing_when_the_context_is_gone_already_raises_nothing(harness):
    controller = harness.controller()
    commands, arm = harness.commands(), Arm(harness, Q)
    spin_until_moving(harness, commands, arm)
    harness.context.try_shutdown()
    controller.close('ended')
