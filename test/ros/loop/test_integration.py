# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Velocities that become positions: limits hold for the positions, and they never run away."""

from types import SimpleNamespace

import numpy as np
import pytest
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import VelocityLimits
from tp_controller.ros.loop.integration import Integration, RESTING_LEAD, stopping_distance

# A fast and a slow joint, and one without an acceleration limit.
LIMITS = {'lower': np.array([-3.0, -1.0, -np.inf]), 'upper': np.array([3.0, 1.0, np.inf]),
          'velocity': np.array([2.0, 0.5, 1.0]), 'acceleration': np.array([10.0, 1.0, np.inf]),
          'jerk': np.full(3, np.inf)}
# The last joint keeps no limit.
JERK = np.array([100.0, 20.0, np.inf])
RATES = 20.0, 100.0, 1000.0


def integration(rate=100.0, lead=0.2, **limits):
    """Return the integration for three joints."""
    return Integration({**LIMITS, **limits}, 1.0 / rate, 0.1, lead)


class Drive:
    """Drives that follow positions, late by a first-order lag; measured with noise."""

    def __init__(self, rate, lag, noise=0.0):
        self.dt, self.noise = 1.0 / rate, noise
        self.share = 1.0 - np.exp(-self.dt / lag) if lag else 1.0
        self.q, self.random = np.zeros(3), np.random.default_rng(0)

    def measure(self):
        """Return measured positions."""
        return self.q + self.noise * self.random.standard_normal(3)

    def go(self, positions):
        """Move for one period."""
        self.q = self.q + self.share * (positions - self.q)


def reach(demand, rate):
    """Yield velocities that approach a demand within the acceleration limits."""
    velocity = np.zeros(3)
    change = LIMITS['acceleration'] / rate
    while True:
        velocity = velocity + np.clip(demand() - velocity, -change, change)
        yield velocity


@pytest.mark.parametrize('rate', RATES)
def test_positions_are_the_integral_of_velocities(rate):
    subject, random = integration(rate), np.random.default_rng(1)
    velocities = reach(lambda: random.uniform(-1.0, 1.0, 3) * LIMITS['velocity'], rate)
    positions = expected = before = np.zeros(3)
    for velocity in (next(velocities) for _ in range(50)):
        interval = random.uniform(0.5, 1.0) / rate
        change = LIMITS['acceleration'] * interval
        velocity = np.clip(velocity, before - change, before + change)
        before, positions = subject.advance(velocity, before, positions, np.zeros(3), interval)
        expected = expected + interval * velocity
        np.testing.assert_allclose(before, velocity, atol=1e-12)
        np.testing.assert_allclose(positions, expected, atol=1e-12)


def test_time_is_made_up_for_a_late_cycle_but_not_for_a_pause_or_a_clock_that_was_set():
    assert integration(100.0).interval(0.018) == 0.018
    assert integration(1000.0).interval(0.018) == 0.018
    assert integration(100.0).interval(3.0) == pytest.approx(0.02)
    assert integration(100.0).interval(-1.0) == 0.0
    # A cycle for each joint state, at any rate: the period is the timeout.
    assert integration(10.0).interval(3.0) == pytest.approx(0.1)


def test_velocities_change_within_the_acceleration_limits_whatever_is_demanded():
    subject, random, velocity = integration(), np.random.default_rng(2), np.zeros(3)
    positions, change = np.zeros(3), LIMITS['acceleration'] * 0.01
    for _ in range(300):
        before = velocity
        velocity, positions = subject.advance(
            random.choice([-1.0, 0.0, 1.0], 3) * LIMITS['velocity'], before, positions,
            random.uniform(-0.5, 0.5, 3), 0.01)
        assert (np.abs(velocity - before) <= change + 1e-12).all()


def test_positions_do_not_pass_limits_and_a_joint_outside_comes_back():
    subject = integration(acceleration=np.full(3, np.inf))
    _, positions = subject.advance(np.array([2.0, 0.5, 1.0]), np.zeros(3),
                                   np.array([2.999, 0.9999, 50.0]), np.zeros(3), 0.01)
    np.testing.assert_allclose(positions, [3.0, 1.0, 50.01])
    velocity, positions = subject.advance(np.array([2.0, -0.5, 0.0]), np.zeros(3),
                                          np.array([3.02, 1.02, 0.0]), np.zeros(3), 0.01)
    np.testing.assert_allclose(positions, [3.02, 1.015, 0.0])
    np.testing.assert_allclose(velocity, [0.0, -0.5, 0.0], atol=1e-9)


@pytest.mark.parametrize('lead', [0.0, 0.2])
@pytest.mark.parametrize('rate', RATES)
def test_positions_stop_before_the_bound_if_the_robot_is_blocked(rate, lead):
    subject, positions, velocity = integration(rate, lead), np.zeros(3), np.zeros(3)
    velocities, change = reach(lambda: LIMITS['velocity'], rate), LIMITS['acceleration'] / rate
    blocked, fastest = None, np.zeros(3)
    for cycle in range(round(6.0 * rate)):
        # At full speed the robot is blocked.
        q = positions if cycle < 2.0 * rate else blocked
        blocked = q
        before = velocity
        velocity, positions = subject.advance(next(velocities), before, positions,
                                              positions - q, 1.0 / rate)
        fastest = np.maximum(fastest, velocity)
        assert (np.abs(velocity - before) <= change + 1e-9).all()
        assert (np.abs(positions - q) <= subject.largest_lead + 1e-9).all()
        if np.abs(positions).max() > 2.5:
            positions, blocked = positions - 2.5, q - 2.5
    assert (positions - blocked > 0.5 * RESTING_LEAD).all() and (np.abs(velocity) < 1e-3).all()
    assert (fastest > 0.99 * LIMITS['velocity'])[[0, 2]].all()


@pytest.mark.parametrize('lag', [0.02, 0.05, 0.1, 0.15])
@pytest.mark.parametrize('rate', [100.0, 1000.0])
def test_a_robot_that_follows_with_lag_and_noise_is_never_slowed_down(rate, lag):
    wide = {'lower': np.full(3, -np.inf), 'upper': np.full(3, np.inf)}
    subject, drive = integration(rate, **wide), Drive(rate, lag, noise=1e-3)
    random, goal = np.random.default_rng(3), [LIMITS['velocity']]
    velocities = reach(lambda: goal[0], rate)
    positions = before = np.zeros(3)
    for cycle in range(round(10.0 * rate)):
        if cycle % round(rate) == 0:
            goal[0] = random.choice([-1.0, 0.1, 1.0], 3) * LIMITS['velocity']
        velocity = next(velocities)
        before, positions = subject.advance(velocity, before, positions,
                                            positions - drive.measure(), 1.0 / rate)
        np.testing.assert_allclose(before, velocity, atol=1e-9)
        drive.go(positions)


@pytest.mark.parametrize('lead, late', [(0.0, 0.0), (0.2, 0.2)])
def test_a_steady_error_of_the_drives_slows_nothing_down_at_full_speed(lead, late):
    subject, full = integration(lead=lead), LIMITS['velocity']
    ahead = late * full + 0.0199
    velocity, _ = subject.advance(full, full, np.zeros(3), ahead, 0.01)
    np.testing.assert_array_equal(velocity, full)
    velocity, _ = subject.advance(full, full, np.zeros(3), ahead + 0.01, 0.01)
    assert (velocity < full).all()


def test_all_joints_wait_for_one_that_is_blocked():
    subject = integration(acceleration=np.full(3, np.inf))
    ahead = np.array([0.0, subject.largest_lead[1] - 0.005, 0.0])
    velocity, _ = subject.advance(np.array([1.0, 0.4, -0.8]), np.zeros(3), np.zeros(3), ahead,
                                  0.01)
    np.testing.assert_allclose(velocity, 0.25 * np.array([1.0, 0.4, -0.8]), atol=1e-9)
    # Back to the measured positions there is nothing to wait for.
    velocity, _ = subject.advance(np.array([1.0, -0.4, -0.8]), np.zeros(3), np.zeros(3), ahead,
                                  0.01)
    np.testing.assert_allclose(velocity, [1.0, -0.4, -0.8])


def test_joints_brake_each_with_its_own_limit_and_stay_within_the_position_limits():
    subject, positions = integration(), np.array([0.0, 0.9, 0.0])
    velocity = np.array([-2.0, 0.5, 1.0])
    limits = subject.stop(velocity, 4.0)
    np.testing.assert_allclose(limits.deceleration, [10.0, 1.0, 4.0])
    taken = np.zeros(3)
    for _ in range(60):
        taken = taken + 0.01 * (velocity != 0.0)
        velocity, positions = subject.brake(velocity, positions, limits, 0.01)
    assert not velocity.any() and positions[1] == 1.0
    np.testing.assert_allclose(taken[[0, 2]], [0.2, 0.25], atol=0.011)
    # v²/2a, less half a period.
    np.testing.assert_allclose(positions[[0, 2]], [-0.19, 0.12], atol=0.006)


def test_without_a_limit_joints_brake_at_once_and_no_stop_takes_longer_than_two_seconds():
    subject = integration(acceleration=np.array([0.1, 10.0, np.inf]))
    velocity = np.array([2.0, 0.5, 1.0])
    limits = subject.stop(velocity, 0.0)
    np.testing.assert_allclose(limits.deceleration, [1.0, 10.0, np.inf])
    stopped, positions = subject.brake(velocity, np.zeros(3), limits, 0.01)
    assert stopped[2] == 0.0 and positions[2] == 0.0
    # A clock that stands still changes nothing.
    same, positions = subject.brake(velocity, np.zeros(3), limits, 0.0)
    np.testing.assert_array_equal(same, velocity)
    np.testing.assert_array_equal(positions, np.zeros(3))


@pytest.mark.parametrize('gain', [5.0, 20.0])
def test_stopping_distance_is_that_of_steps_of_a_period(gain):
    random = np.random.default_rng(4)
    speed, limit = random.uniform(0.0, 2.0, 20), random.uniform(0.5, 20.0, 20)
    expected = []
    for v, a in zip(speed, limit):
        distance = 0.0
        while v > a / gain:
            distance += 0.01 * v
            v -= 0.01 * a
        expected.append(distance + v / gain)
    np.testing.assert_allclose(stopping_distance(speed, limit, 0.01, gain), expected, rtol=1e-9)


def smooth(demand, rate):
    """Yield velocities that approach a demand within the limits of acceleration and jerk."""
    values = {**LIMITS, 'lower': np.full(3, -np.inf), 'upper': np.full(3, np.inf), 'jerk': JERK}
    limits, before = VelocityLimits(SimpleNamespace(limits=values), 1.0 / rate, 10.0), np.zeros(3)
    motion = JointMotion(np.zeros(3), before, 1.0 / rate, (), 0.0, np.zeros(3), 1.0 / rate)
    while True:
        velocity = np.clip(demand(), *limits.box(motion._replace(demand=demand())))
        motion = motion._replace(velocity=velocity,
                                 acceleration=(velocity - motion.velocity) * rate)
        yield velocity


def jerks(velocities, rate):
    """Return the largest second differences of velocities (T, 3), from rest."""
    return np.abs(np.diff([np.zeros(3), np.zeros(3), *velocities], n=2, axis=0)).max(0) * rate ** 2


@pytest.mark.parametrize('rate', RATES)
def test_demands_within_the_jerk_limits_pass_as_they_are(rate):
    subject, random, goal = integration(rate, jerk=JERK), np.random.default_rng(5), [np.zeros(3)]
    positions = before = np.zeros(3)
    for cycle, velocity in zip(range(round(5.0 * rate)), smooth(lambda: goal[0], rate)):
        if cycle % round(0.3 * rate) == 0:
            goal[0] = random.uniform(-1.0, 1.0, 3) * LIMITS['velocity']
        # As far ahead as no velocity has to be lower for.
        ahead = np.sign(velocity) * (0.2 * LIMITS['velocity'] + RESTING_LEAD - 1e-9)
        before, _ = subject.advance(velocity, before, positions, ahead, 1.0 / rate)
        np.testing.assert_allclose(before, velocity, atol=1e-12)


def test_all_joints_wait_for_one_that_is_late_within_the_jerk_limits():
    wide = {'lower': np.full(3, -np.inf), 'upper': np.full(3, np.inf)}
    subject, (q, positions, before) = integration(jerk=JERK, **wide), np.zeros((3, 3))
    for _, velocity in zip(range(500), smooth(lambda: LIMITS['velocity'], 100.0)):
        before, positions = subject.advance(velocity, before, positions, positions - q, 0.01)
        # The second joint does not go faster than that.
        q = q + np.minimum(0.01 * np.array([2.0, 0.2, 1.0]), positions - q)
    np.testing.assert_allclose(before, 0.4 * LIMITS['velocity'], rtol=0.01)


@pytest.mark.parametrize('rate', RATES)
def test_stop_keeps_the_jerk_limits_from_any_motion(rate):
    for seconds in (0.05, 0.1, 0.3, 1.5):
        subject, positions, before = integration(rate, jerk=JERK), np.full(3, -0.9), np.zeros(3)
        taken = []
        for _, velocity in zip(range(round(seconds * rate)),
                               smooth(lambda: LIMITS['velocity'], rate)):
            before, positions = subject.advance(velocity, before, positions, np.zeros(3),
                                                1.0 / rate)
            taken.append(before)
        stop, moving, limit = subject.stop(before, 0.0), before[:2], LIMITS['acceleration'][:2]
        while len(taken) < 6.0 * rate:
            before, positions = subject.brake(before, positions, stop, 1.0 / rate)
            taken.append(before)
        assert not before.any() and (jerks(taken, rate) <= JERK * (1.0 + 1e-9))[:2].all()
        changes = np.abs(np.diff(taken, axis=0)) * rate
        assert (changes.max(0) <= LIMITS['acceleration'] * (1.0 + 1e-9)).all()
        # They stop as soon as they can: within v/a + a/j, and the time to end an acceleration.
        after = np.array(taken[round(seconds * rate):])
        assert (after >= -1e-9).all()
        longest = moving / limit + 3.0 * limit / JERK[:2]
        assert ((after > 0.0).sum(0)[:2] <= longest * rate + 2.0).all()


@pytest.mark.parametrize('turns', [False, True])
def test_no_stop_takes_longer_than_two_seconds_whatever_the_jerk_limit(turns):
    subject = integration(jerk=np.array([1.0, 1e-3, np.inf]),
                          acceleration=np.array([np.inf, 0.1, 1.0]),
                          lower=np.full(3, -np.inf), upper=np.full(3, np.inf))
    velocity, positions = np.zeros(3) if turns else np.array([1.8, 0.5, 1.0]), np.zeros(3)
    # A joint that turns back accelerates most where it is slowest.
    for cycle in range(1000 if turns else 30):
        demand = LIMITS['velocity'] if not turns or cycle > 100 else -LIMITS['velocity']
        velocity, positions = subject.advance(demand, velocity, positions, np.zeros(3), 0.01)
        if cycle > 100 and velocity[0] > 0.0:
            break
    stop = subject.stop(velocity, 0.0)
    for _ in range(200):
        velocity, positions = subject.brake(velocity, positions, stop, 0.01)
    assert not velocity.any()


@pytest.mark.parametrize('lead', [0.0, 0.2])
@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('jerk', [JERK, 20.0 * JERK])
def test_positions_stop_before_the_bound_within_the_jerk_limits(rate, lead, jerk):
    wide = {'lower': np.full(3, -np.inf), 'upper': np.full(3, np.inf)}
    for seconds in (0.1, 0.3, 2.0):
        subject, positions, before = integration(rate, lead, jerk=jerk, **wide), *np.zeros((2, 3))
        taken, blocked = [], None
        for cycle, velocity in zip(range(round(6.0 * rate)),
                                   smooth(lambda: LIMITS['velocity'], rate)):
            blocked = positions if cycle < seconds * rate else blocked
            before, positions = subject.advance(velocity, before, positions, positions - blocked,
                                                1.0 / rate)
            taken.append(before)
            assert (np.abs(positions - blocked) <= subject.largest_lead + 1e-9).all()
        assert (jerks(taken, rate) <= jerk * (1.0 + 1e-6))[:2].all()
        # None goes back, nor stops early.
        assert (np.array(taken)[:, :2] >= -1e-6).all()
        assert (positions - blocked > 0.95 * subject.largest_lead).any()
