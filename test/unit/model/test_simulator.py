# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The kinematic simulator: its drives and sensors do what their parameters say."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import KinematicSimulator, Robot, RobotError, SettingsError, SimulatorNoise
from tp_controller.model.simulator import initial_positions

START = np.array(robots.PLANAR_START)
V = np.array([0.5, -0.25, 1.0])
# {number of a joint of the Panda: middle of its range} [rad]
MIDDLE = {4: 0.5 * (-3.0718 - 0.0698), 6: 0.5 * (-0.0175 + 3.7525)}


def simulator(robot=None, q=None, timeout=1.0, **noise):
    """Return a simulator, of the planar arm by default."""
    if robot is None:
        robot, q = robots.planar(), START if q is None else q
    return KinematicSimulator(robot, q, timeout, SimulatorNoise(**noise))


# Positions

def test_positions_are_followed_along_a_line_and_for_ever():
    sim = simulator(timeout=0.1)
    aim = START + [0.1, -0.05, 0.02]
    assert sim.command_positions(aim, 0.5)
    sim.step(0.25)
    np.testing.assert_allclose(sim.q, 0.5 * (START + aim), atol=1e-12)
    np.testing.assert_allclose(sim.velocity, (aim - START) / 0.5, atol=1e-12)
    for _ in range(10):
        sim.step(0.25)
    np.testing.assert_allclose(sim.q, aim, atol=1e-12)
    assert not sim.velocity.any()


def test_positions_are_reached_no_faster_than_the_velocity_limits_allow():
    sim = simulator()
    limit = sim.robot.velocity
    sim.command_positions(START + 10.0 * limit)
    sim.step(0.01)
    np.testing.assert_allclose(sim.q, START + 0.01 * limit, atol=1e-12)
    # The drives stop at the end of the range.
    for _ in range(1000):
        sim.step(0.1)
    np.testing.assert_allclose(sim.q, np.minimum(START + 10.0 * limit, sim.robot.upper))


def test_drives_with_a_lag_approach_positions_exponentially():
    sim = simulator(lag=0.1)
    sim.command_positions(START + 0.01)
    sim.step(0.05)
    np.testing.assert_allclose(sim.q, START + 0.01 * (1.0 - math.exp(-0.5)), atol=1e-12)


def test_a_velocity_replaces_positions_and_the_other_way_round():
    sim = simulator(timeout=0.1)
    sim.command_positions(START + 0.01)
    sim.step(0.05)
    sim.command(V)
    sim.step(0.2)
    np.testing.assert_allclose(sim.q, START + 0.01 + 0.1 * V, atol=1e-12)
    sim.command_positions(START)
    for _ in range(100):
        sim.step(0.05)
    np.testing.assert_allclose(sim.q, START, atol=1e-12)
    sim.command_positions(START + 0.1, 1.0)
    sim.reset()
    sim.step(1.0)
    np.testing.assert_array_equal(sim.q, START)


def test_positions_that_are_not_finite_or_too_few_are_not_taken():
    sim = simulator()
    assert not sim.command_positions([0.0, math.nan, 0.0])
    with pytest.raises(RobotError, match='3 positions, got an array of shape'):
        sim.command_positions([0.0])
    sim.step(0.1)
    np.testing.assert_array_equal(sim.q, START)


# Motion

def test_positions_are_the_integral_of_the_commands():
    sim = simulator()
    expected = START.copy()
    for velocity, dt in ((V, 0.1), (-2.0 * V * 0.4, 0.25), (np.zeros(3), 0.5), (V, 0.01)):
        assert sim.command(velocity) is True
        sim.step(dt)
        expected = expected + dt * velocity
        np.testing.assert_allclose(sim.q, expected, atol=1e-14)
        np.testing.assert_array_equal(sim.velocity, velocity)
    assert sim.now == pytest.approx(0.86)


def test_robot_without_a_command_stays():
    sim = simulator()
    sim.step(3.0)
    assert sim.q.tolist() == START.tolist() and sim.velocity.tolist() == [0.0] * 3
    assert sim.now == 3.0


def test_step_of_no_time_changes_nothing():
    sim = simulator()
    sim.command(V)
    sim.step(0.0)
    assert sim.q.tolist() == START.tolist() and sim.now == 0.0


def test_command_beyond_a_velocity_limit_moves_at_the_limit():
    sim = simulator()
    sim.command([-5.0, 5.0, 0.5])
    sim.step(0.5)
    assert sim.velocity.tolist() == [-1.0, 1.0, 0.5]
    np.testing.assert_allclose(sim.q, START + [-0.5, 0.5, 0.25])


def test_joint_stops_at_its_position_limits():
    robot = robots.mixed()
    sim = simulator(robot, [2.4, -0.1, 0.0, 0.0])
    sim.command([1.0, -0.4, 1.0, 1.0])
    sim.step(0.5)
    np.testing.assert_allclose(sim.q, [2.5, -0.2, 0.5, 0.5])
    assert sim.velocity.tolist() == [0.0, 0.0, 1.0, 1.0]


def test_robot_that_starts_outside_its_limits_gets_no_further_out_but_back_in():
    sim = simulator(robots.mixed(), [2.8, 0.0, 0.0, 0.0])
    sim.command([1.0, 0.0, 0.0, 0.0])
    sim.step(0.1)
    assert sim.q[0] == 2.8
    for _ in range(10):
        sim.command([-1.0, 0.0, 0.0, 0.0])
        sim.step(0.05)
    assert sim.q[0] == pytest.approx(2.3)
    sim.command([1.0, 0.0, 0.0, 0.0])
    sim.step(0.5)
    assert sim.q[0] == 2.5


# Timeout

def test_robot_stops_by_itself_when_commands_stay_away():
    sim = simulator(timeout=0.2)
    sim.command(V)
    sim.step(0.1)
    assert sim.velocity.tolist() == V.tolist()
    sim.step(1.0)
    np.testing.assert_allclose(sim.q, START + 0.2 * V, atol=1e-14)
    assert sim.velocity.tolist() == [0.0] * 3


def test_every_command_starts_the_timeout_anew():
    sim = simulator(timeout=0.2)
    for _ in range(5):
        sim.command(V)
        sim.step(0.15)
    np.testing.assert_allclose(sim.q, START + 0.75 * V, atol=1e-14)


@pytest.mark.parametrize('timeout', [0.0, -1.0, math.nan, math.inf])
def test_timeout_that_is_none_is_refused(timeout):
    with pytest.raises(SettingsError, match='timeout must be positive and finite'):
        simulator(timeout=timeout)


# Delay and lag

def test_delayed_commands_take_effect_at_their_time_whatever_the_steps():
    sim = simulator(delay=0.05)
    sim.command(V)
    sim.step(0.02)
    sim.command(-V)
    assert sim.q.tolist() == START.tolist()
    sim.step(0.02)
    assert sim.velocity.tolist() == [0.0] * 3
    # The first acts from 0.05 to 0.07 s, the second from then on.
    sim.step(0.06)
    np.testing.assert_allclose(sim.q, START + 0.02 * V - 0.03 * V, atol=1e-14)


def test_timeout_of_a_delayed_command_counts_from_its_effect():
    sim = simulator(delay=0.5, timeout=0.2)
    sim.command(V)
    sim.step(5.0)
    np.testing.assert_allclose(sim.q, START + 0.2 * V, atol=1e-14)


@given(st.lists(st.floats(1e-3, 0.3), min_size=1, max_size=8))
def test_lagging_drive_follows_the_first_order_response_exactly(steps):
    tau = 0.08
    sim = simulator(lag=tau, timeout=10.0)
    sim.command(V)
    for dt in steps:
        sim.step(dt)
    t = sum(steps)
    np.testing.assert_allclose(sim.velocity, V * (1.0 - math.exp(-t / tau)), atol=1e-12)
    np.testing.assert_allclose(
        sim.q, START + V * (t - tau * (1.0 - math.exp(-t / tau))), atol=1e-12)


def test_lagging_drive_coasts_after_the_timeout():
    tau, timeout = 0.1, 0.3
    sim = simulator(lag=tau, timeout=timeout)
    sim.command(V)
    sim.step(0.8)
    reached = V * (1.0 - math.exp(-timeout / tau))
    np.testing.assert_allclose(sim.velocity, reached * math.exp(-0.5 / tau), atol=1e-12)
    sim.step(10.0)
    # Coming to rest makes up for coming up to speed: the way is that of the ideal drive.
    np.testing.assert_allclose(sim.q, START + timeout * V, atol=1e-9)


@given(st.lists(st.floats(1e-3, 0.2), min_size=1, max_size=6), st.floats(0.0, 0.1),
       st.floats(0.0, 0.2))
def test_size_of_the_steps_does_not_matter(steps, delay, lag):
    fine, coarse = (simulator(delay=delay, lag=lag, timeout=0.25) for _ in range(2))
    for sim in (fine, coarse):
        sim.command(V)
    for dt in steps:
        fine.step(dt)
    coarse.step(sum(steps))
    np.testing.assert_allclose(fine.q, coarse.q, atol=1e-9)
    np.testing.assert_allclose(fine.velocity, coarse.velocity, atol=1e-6)


# Noise and losses

def test_noise_has_the_deviation_of_its_setting_and_no_bias():
    sim = simulator(noise=0.01, seed=3)
    samples = np.array([sim.measure()[0] for _ in range(4000)]) - START
    np.testing.assert_allclose(samples.std(axis=0), 0.01, rtol=0.05)
    np.testing.assert_allclose(samples.mean(axis=0), 0.0, atol=6e-4)
    np.testing.assert_allclose(np.corrcoef(samples.T), np.eye(3), atol=0.06)
    assert sim.q.tolist() == START.tolist()


def test_measurement_without_noise_is_the_truth_and_a_copy():
    sim = simulator()
    sim.command(V)
    sim.step(0.1)
    q, velocity = sim.measure()
    np.testing.assert_array_equal(q, sim.q)
    np.testing.assert_array_equal(velocity, V)
    q[:], velocity[:] = 9.0, 9.0
    assert sim.q[0] != 9.0 and sim.velocity[0] == 0.5


def test_share_of_commands_and_measurements_gets_lost():
    sim = simulator(drop=0.3, seed=1)
    taken = sum(sim.command(V) for _ in range(3000))
    seen = sum(sim.measure() is not None for _ in range(3000))
    assert taken / 3000 == pytest.approx(0.7, abs=0.03)
    assert seen / 3000 == pytest.approx(0.7, abs=0.03)


def test_lost_command_has_no_effect():
    sim = simulator(drop=0.5, seed=2)
    moved = START.copy()
    for _ in range(40):
        taken = sim.command(V)
        before = sim.velocity.copy()
        sim.step(0.01)
        moved = moved + 0.01 * (V if taken else before)
    np.testing.assert_allclose(sim.q, moved, atol=1e-12)


def test_seed_decides_what_happens():
    def history(seed):
        sim = simulator(noise=0.01, drop=0.2, delay=0.02, seed=seed)
        told = []
        for _ in range(50):
            told.append(sim.command(V))
            sim.step(0.01)
            measured = sim.measure()
            told.append(None if measured is None else measured[0].tolist())
        return told
    assert history(7) == history(7)
    assert history(7) != history(8)


@pytest.mark.parametrize('values, faults', [
    ({'noise': -1.0, 'delay': math.nan, 'lag': math.inf, 'drop': 'x'}, 4),
    ({'noise': True}, 1), ({'drop': 1.0}, 1), ({'drop': 1.5}, 1), ({'delay': None}, 1),
])
def test_all_impossible_noise_are_told_at_once(values, faults):
    with pytest.raises(SettingsError) as caught:
        SimulatorNoise(**values)
    assert len(caught.value.faults) == faults
    assert all(name in str(caught.value) for name in values)


# Commands

@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_command_that_is_not_finite_is_ignored_and_does_not_keep_the_robot_going(bad):
    sim = simulator(timeout=0.2)
    sim.command(V)
    for _ in range(10):
        sim.step(0.1)
        assert sim.command([0.0, bad, 0.0]) is False
    np.testing.assert_allclose(sim.q, START + 0.2 * V, atol=1e-14)


@pytest.mark.parametrize('command', [[1.0, 2.0], [[1.0, 2.0, 3.0]], 1.0])
def test_command_of_the_wrong_shape_is_refused(command):
    with pytest.raises(RobotError, match='a command needs 3 velocities'):
        simulator().command(command)


def test_command_can_be_changed_by_its_sender_afterwards():
    sim, velocity = simulator(), V.copy()
    sim.command(velocity)
    velocity[:] = 0.0
    sim.step(0.1)
    np.testing.assert_allclose(sim.q, START + 0.1 * V)


# Start and reset

def test_reset_goes_back_to_the_start_at_rest():
    sim = simulator(delay=0.1, lag=0.1)
    for _ in range(5):
        sim.command(V)
        sim.step(0.1)
    sim.reset()
    assert (sim.q.tolist(), sim.velocity.tolist(), sim.now) == (START.tolist(), [0.0] * 3, 0.0)
    sim.step(1.0)
    assert sim.q.tolist() == START.tolist()
    sim.reset(now=12.5)
    assert sim.now == 12.5


def test_start_that_is_none_is_refused():
    with pytest.raises(RobotError, match='needs 3 positions'):
        simulator(q=[0.0, 0.0])
    with pytest.raises(RobotError, match='not finite'):
        simulator(q=[0.0, math.nan, 0.0])


def test_initial_positions_come_from_text_or_file_and_have_a_default(tmp_path):
    robot = robots.panda()
    file = tmp_path / 'start.yaml'
    file.write_text('{panda_joint1: 0.5, panda_joint4: -2}\n', encoding='utf-8')
    for source in (file, str(file), 'panda_joint4: -2\npanda_joint1: 0.5',
                   '{panda_joint4: -2, panda_joint1: 0.5}'):
        assert initial_positions(source, robot).tolist() == [0.5, 0, 0, -2.0, 0, MIDDLE[6], 0]
    assert initial_positions('{}', robot).tolist() == simulator(robot).q.tolist()


def test_panda_starts_with_joints_4_and_6_in_the_middle_of_their_ranges():
    # Zero is 0.07 rad outside the range of joint 4, and 0.0175 rad from a limit of joint 6.
    assert simulator(robots.panda()).q.tolist() == [0, 0, 0, MIDDLE[4], 0, MIDDLE[6], 0]


@pytest.mark.parametrize('name', robots.URDFS)
def test_no_joint_starts_near_a_limit(name):
    robot = robots.urdf_robot(name)
    q = simulator(robot).q
    for position, lower, upper in zip(q, robot.lower, robot.upper):
        if math.isinf(upper - lower):
            assert position == 0.0
        else:
            assert min(position - lower, upper - position) >= 0.05 * (upper - lower)


@pytest.mark.parametrize('lower, upper, start', [
    (-1.0, 1.0, 0.0), (-0.1, 1.0, 0.0), (-0.01, 0.99, 0.49), (-1.0, 0.02, -0.49),
    (0.0, 0.4, 0.2), (0.5, 1.0, 0.75), (-math.inf, -2.0, -2.0), (3.0, math.inf, 3.0)])
def test_joint_starts_at_zero_unless_that_is_near_a_limit(lower, upper, start):
    robot = Robot.from_dh([{'name': 'a', 'a': 1.0, 'lower': lower, 'upper': upper}])
    assert simulator(robot).q == pytest.approx([start])


@pytest.mark.parametrize('source, message', [
    ('{joint9: 1.0}', "unknown joint 'joint9' .did you mean"),
    ('{joint1: one}', "joint1 must be a finite number, not 'one'"),
    ('{joint1: .nan}', 'joint1 must be a finite number'),
    ('{joint1: true}', 'joint1 must be a finite number'),
    ('[a: 1]', 'must be a mapping'),
    ('{joint1: [', 'initial positions'),
    ('{joint1: 2001-13-45}', 'initial positions'),
    ('no/such/start.yaml', 'no file no/such/start.yaml'),
])
def test_initial_positions_that_are_none_are_refused(source, message):
    with pytest.raises(RobotError, match=message):
        initial_positions(source, robots.planar())


def test_mimic_and_passive_joints_do_not_disturb_the_driven_ones():
    robot = robots.urdf_robot('panda', ('panda_finger_joint1', 'panda_joint2'))
    sim = simulator(robot, [0.01, 0.2])
    sim.command([0.1, -0.5])
    sim.step(0.1)
    np.testing.assert_allclose(sim.q, [0.02, 0.15])
