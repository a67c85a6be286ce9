# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator node: what a robot with a velocity interface does, seen through its topics."""

from harness import COMMANDS, JOINTS, LATCHED
import numpy as np
import pytest
from rclpy.duration import Duration
from robots import PANDA_DH, PLANAR_DH
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger
from tp_controller import Robot
from tp_controller.errors import RobotError, SettingsError
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


def states_of(harness):
    """Return a list that grows by every joint state."""
    return harness.record(JointState, '/joint_states')


def commander(harness, *velocities):
    """Return what publishes the same command once more."""
    publisher = harness.publisher(Float64MultiArray, COMMANDS)
    return lambda: publisher.publish(Float64MultiArray(data=velocities))


def seconds(stamp):
    """Return a time in seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec


def test_joint_states_and_the_latched_description_are_published(any_harness):
    any_harness.simulator()
    states = states_of(any_harness)
    any_harness.spin_for_more(states, 3)
    assert states[-1].name == list(JOINTS)
    assert list(states[-1].position) == [0.0, 0.0, 0.0]
    assert list(states[-1].velocity) == [0.0, 0.0, 0.0]
    assert states[0].header.stamp.sec > 0
    # A listener that comes late gets the description all the same.
    descriptions = any_harness.record(String, '/robot_description', LATCHED)
    any_harness.spin_for_more(descriptions)
    assert Robot.from_urdf(descriptions[0].data).joint_names == JOINTS


def point(positions, seconds=0.0, names=JOINTS):
    """Return a trajectory of one point."""
    time = Duration(seconds=seconds).to_msg()
    return JointTrajectory(joint_names=names, points=[
        JointTrajectoryPoint(positions=positions, time_from_start=time)])


@pytest.mark.parametrize('topic, message', [
    ('position_controller/commands', Float64MultiArray(data=[0.2, 0.1, -0.1])),
    ('joint_trajectory_controller/joint_trajectory', point([0.2, 0.1, -0.1])),
    ('joint_trajectory_controller/joint_trajectory',
     point([-0.1, 0.1, 0.2], 0.05, ['joint3', 'joint2', 'joint1']))])
def test_positions_are_reached_and_stay(harness, topic, message):
    harness.simulator(command_timeout=0.01)
    states, publisher = states_of(harness), harness.publisher(type(message), topic)
    publisher.publish(message)
    harness.spin_until(lambda: states and np.allclose(states[-1].position, [0.2, 0.1, -0.1]))
    harness.spin_for_more(states, 10)
    np.testing.assert_allclose(states[-1].position, [0.2, 0.1, -0.1])


def test_a_trajectory_of_some_joints_leaves_the_others_where_they_are(harness):
    harness.simulator()
    states = states_of(harness)
    topic = 'joint_trajectory_controller/joint_trajectory'
    harness.publisher(JointTrajectory, topic).publish(point([0.3], names=['joint2']))
    harness.spin_until(lambda: states and np.allclose(states[-1].position, [0.0, 0.3, 0.0]))


@pytest.mark.parametrize('topic, message, fault', [
    ('position_controller/commands', Float64MultiArray(data=[0.2]), '1 positions for 3 joints'),
    ('position_controller/commands', Float64MultiArray(data=[0.2, np.nan, 0.0]),
     'a position is not a finite number'),
    ('joint_trajectory_controller/joint_trajectory', point([0.1], names=['wrist']),
     "of unknown joints: ['wrist']"),
    ('joint_trajectory_controller/joint_trajectory', JointTrajectory(joint_names=JOINTS),
     'a trajectory without points'),
    ('joint_trajectory_controller/joint_trajectory', point([0.1]), '1 positions for 3 joints')])
def test_wrong_positions_are_ignored(harness, log, topic, message, fault):
    harness.simulator()
    states = states_of(harness)
    harness.publisher(type(message), topic).publish(message)
    harness.spin_until_logged(log, f'command ignored: {fault}' if 'unknown' not in fault
                              else fault)
    harness.spin_for_more(states, 2)
    assert not any(states[-1].position)


def test_a_robot_without_initial_positions_starts_away_from_its_limits(harness):
    harness.simulator(robot=str(PANDA_DH))
    states = states_of(harness)
    harness.spin_for_more(states)
    # Zero is outside the range of joint 4, and 0.0175 rad from a limit of joint 6.
    np.testing.assert_allclose(states[0].position, [0, 0, 0, -1.5708, 0, 1.8675, 0])


@pytest.mark.parametrize('position, told', [
    (57.3, True), (2.01, True), (2.0, False), (-2.0, False), (-2.01, True)])
def test_a_start_outside_the_limits_is_warned_of(harness, log, position, told):
    harness.simulator(initial_positions=f'{{joint2: {position}}}', limits__joint2__lower=-2.0,
                      limits__joint2__upper=2.0)
    harness.spin_for_more(states_of(harness))
    warning = (f'initial_positions: joint2 is at {position:g}, outside its position limits '
               '-2 … 2: wrong unit or offset?')
    assert (warning in log()) == told


def test_commands_move_the_joints_in_the_order_of_the_commands(any_harness):
    any_harness.simulator(command_joints=['joint3', 'joint1'])
    states = states_of(any_harness)
    command = commander(any_harness, 0.2, -0.4)
    any_harness.spin_until(lambda: states and states[-1].position[2] > 0.01, meanwhile=command)
    np.testing.assert_allclose(states[-1].velocity, [-0.4, 0.0, 0.2])
    assert states[-1].position[0] == pytest.approx(-2.0 * states[-1].position[2])
    assert states[-1].position[1] == 0.0


def test_the_robot_stops_by_itself_when_commands_stop(any_harness):
    any_harness.simulator(command_timeout=0.05)
    states = states_of(any_harness)
    command = commander(any_harness, 0.3, 0.3, 0.3)
    any_harness.spin_until(lambda: states and states[-1].velocity[0] > 0.0, meanwhile=command)
    any_harness.spin_until(lambda: states[-1].velocity[0] == 0.0)
    stopped = list(states[-1].position)
    any_harness.spin_for_more(states, 5)
    assert list(states[-1].position) == stopped


def test_the_timeout_is_one_of_the_wall_clock_whatever_the_speed(harness):
    harness.simulator(command_timeout=0.1, speed=10.0, publish_clock=True, rate=100.0)
    states = states_of(harness)
    command = commander(harness, 0.1, 0.1, 0.1)
    harness.spin_until(lambda: states and states[-1].velocity[0] > 0.0, meanwhile=command)
    harness.spin_until(lambda: states[-1].velocity[0] == 0.0)
    # The last command was in force for a whole simulated second.
    assert states[-1].position[0] >= 0.1 - 1e-9


def test_commands_are_clipped_at_the_velocity_limits(harness):
    harness.simulator(limits__joint2__velocity=0.25)
    states = states_of(harness)
    command = commander(harness, 5.0, 5.0, -5.0)
    harness.spin_until(lambda: states and states[-1].velocity[0] > 0.0, meanwhile=command)
    np.testing.assert_allclose(states[-1].velocity, [1.0, 0.25, -1.0])


@pytest.mark.parametrize('data, told', [
    ([], 'command ignored: 0 velocities for 3 joints; the parameter command_joints names them'),
    ([0.1, 0.2], 'command ignored: 2 velocities for 3 joints'),
    ([0.1, 0.2, 0.3, 0.4], 'command ignored: 4 velocities for 3 joints'),
    ([0.1, float('nan'), 0.3], 'command ignored: a velocity is not a finite number'),
    ([float('inf'), 0.2, 0.3], 'command ignored: a velocity is not a finite number'),
])
def test_a_command_that_makes_no_sense_is_ignored(harness, log, data, told):
    harness.simulator()
    states = states_of(harness)
    publisher = harness.publisher(Float64MultiArray, COMMANDS)
    publisher.publish(Float64MultiArray(data=data))
    harness.spin_until(lambda: told in log())
    harness.spin_for_more(states, 3)
    assert list(states[-1].position) == [0.0, 0.0, 0.0]
    # The next good one counts.
    harness.spin_until(lambda: states[-1].velocity[2] == -0.5,
                       meanwhile=lambda: publisher.publish(
                           Float64MultiArray(data=[0.0, 0.0, -0.5])))
    assert list(states[-1].velocity) == [0.0, 0.0, -0.5]


def test_a_burst_of_bad_commands_does_not_keep_an_old_one_alive(harness):
    harness.simulator(command_timeout=0.05)
    states = states_of(harness)
    publisher = harness.publisher(Float64MultiArray, COMMANDS)
    harness.spin_until(lambda: states and states[-1].velocity[0] > 0.0,
                       meanwhile=lambda: publisher.publish(
                           Float64MultiArray(data=[0.3, 0.3, 0.3])))
    harness.spin_until(lambda: states[-1].velocity[0] == 0.0,
                       meanwhile=lambda: publisher.publish(Float64MultiArray(data=[0.3])))


def test_simulated_time_is_published_and_runs_faster_than_the_clock(any_harness):
    any_harness.simulator(publish_clock=True, speed=10.0, rate=100.0)
    clocks = any_harness.record(Clock, '/clock')
    states = states_of(any_harness)
    began = any_harness.node.get_clock().now()
    any_harness.spin_until(lambda: clocks and states and seconds(clocks[-1].clock) > 3.0)
    elapsed = 1e-9 * (any_harness.node.get_clock().now() - began).nanoseconds
    assert elapsed < seconds(clocks[-1].clock)
    times = [seconds(message.clock) for message in clocks]
    # A slow listener may miss some.
    steps = np.diff(times) / 0.01
    np.testing.assert_allclose(steps, np.maximum(np.round(steps), 1.0), atol=1e-6)
    # States bear simulated time, too.
    assert {round(seconds(message.header.stamp), 6) for message in states} <= {
        round(number * 0.01, 6) for number in range(round(100 * times[-1]) + 100)}


def test_without_publish_clock_nobodys_clock_is_touched(harness):
    harness.simulator(speed=10.0)
    states = states_of(harness)
    harness.spin_for_more(states)
    assert harness.node.count_publishers('/clock') == 0


@pytest.mark.parametrize('as_file', [False, True])
def test_initial_positions_are_a_mapping_or_a_file_of_it(harness, tmp_path, as_file):
    text = '{joint3: -0.5, joint1: 0.25}'
    path = tmp_path / 'start.yaml'
    path.write_text(text)
    harness.simulator(initial_positions=str(path) if as_file else text)
    states = states_of(harness)
    harness.spin_for_more(states)
    assert list(states[-1].position) == [0.25, 0.0, -0.5]


def test_reset_brings_the_robot_back_at_rest_while_time_goes_on(any_harness):
    any_harness.simulator(initial_positions='{joint1: 0.25}', publish_clock=True)
    states = states_of(any_harness)
    clocks = any_harness.record(Clock, '/clock')
    command = commander(any_harness, 0.5, 0.5, 0.5)
    any_harness.spin_until(lambda: states and states[-1].position[1] > 0.01, meanwhile=command)
    # All commands that are still on the way arrive before.
    any_harness.spin_until(lambda: states[-1].velocity[1] == 0.0)
    assert any_harness.call(Trigger, '/tp_simulator/reset').success
    any_harness.spin_until(lambda: list(states[-1].position) == [0.25, 0.0, 0.0])
    any_harness.spin_for_more(states, 3)
    assert list(states[-1].position) == [0.25, 0.0, 0.0]
    assert list(states[-1].velocity) == [0.0, 0.0, 0.0]
    times = [seconds(message.clock) for message in clocks]
    assert times == sorted(times)


def test_noise_are_passed_on(harness):
    harness.simulator(noise=0.01, seed=7)
    states = states_of(harness)
    harness.spin_for_more(states, 5)
    positions = np.array([message.position for message in states])
    assert (np.abs(positions) < 0.1).all() and (np.diff(positions, axis=0) != 0.0).all()


def test_lost_joint_states_leave_the_clock_alone(harness):
    harness.simulator(drop=0.9, publish_clock=True)
    states, clocks = states_of(harness), harness.record(Clock, '/clock')
    harness.spin_for_more(clocks, 40)
    assert 0 < len(states) < len(clocks) / 2


def test_a_speed_that_cannot_be_kept_does_not_block_the_node(harness, log):
    harness.simulator(rate=5000.0, speed=1000.0)
    assert harness.call(Trigger, '/tp_simulator/reset').success
    harness.spin_until(lambda: 'the simulation cannot keep up with its speed' in log())


@pytest.mark.parametrize('parameters, told', [
    ({'initial_positions': '{joint9: 0.1}'}, "unknown joint 'joint9'"),
    ({'initial_positions': '{joint1: x}'}, 'joint1 must be a finite number'),
    ({'initial_positions': '/nowhere/start.yaml'}, 'no file /nowhere/start.yaml'),
    ({'initial_positions': '[1, 2, 3]'}, 'initial positions'),
    ({'seed': -1}, 'seed must be a whole number that is not negative, not -1'),
    ({'rate': True}, 'parameter rate must be a number, such as 1.0, not True'),
    ({'rate': 0.0}, 'parameter rate must be from 1 to 5000, not 0.0'),
    ({'speed': float('nan')}, 'parameter speed must be from 0.01 to 1000, not nan'),
    ({'publish_clock': 1}, 'parameter publish_clock must be true or false, not 1'),
])
def test_a_faulty_parameter_is_refused_with_its_name(harness, parameters, told):
    with pytest.raises((RobotError, SettingsError)) as error:
        harness.simulator(**parameters)
    assert told in str(error.value)
    assert '\n' not in str(error.value)


def test_a_simulator_needs_a_robot(harness):
    with pytest.raises(RobotError, match=r'parameter robot .* or robot_description'):
        harness.simulator(robot='')


def test_unknown_parameters_are_named(harness, log):
    harness.simulator(robot=str(PLANAR_DH), sped=2.0, wait__what=1)
    assert "unknown parameters, ignored: 'sped' (did you mean 'speed'?), 'wait.what'" in log()


def test_every_parameter_is_described(harness):
    simulator = harness.simulator()
    for name in simulator._parameters:
        if name != 'use_sim_time' and not name.startswith('start_type_description'):
            assert simulator.describe_parameter(name).description, name
