# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The velocities that joints may have, from their velocity, position and acceleration limits."""

import math
from types import SimpleNamespace

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, SettingsError, Stack
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import VelocityLimits
from tp_controller.model.limits import LIMIT_KEYS

SEEDS = st.integers(0, 2 ** 32 - 1)
PERIODS = st.floats(1e-3, 0.05)
SHARES = st.floats(0.02, 1.0)
STRATEGIES = ('upper', 'lower', 'alternating', 'random', 'extremes', 'change of mind')


def limits_of(lower, upper, velocity, acceleration, period=0.01, gain=None):
    """Return `VelocityLimits` of joints with these limits; gain 1/period by default."""
    robot = SimpleNamespace(limits=dict.fromkeys(LIMIT_KEYS, np.full(len(lower), math.inf)) | {
        'lower': np.array(lower, float), 'upper': np.array(upper, float),
        'velocity': np.array(velocity, float), 'acceleration': np.array(acceleration, float)})
    return VelocityLimits(robot, period, 1.0 / period if gain is None else gain)


def at(limits, q, previous, elapsed, pending=(), duration=0.0):
    """Return the bounds at positions, after commands; pending ones are (delay, n)."""
    return limits.at(JointMotion(q, previous, elapsed, tuple(pending), duration))


def stopping_distance(speed, acceleration, period, gain):
    """Return how far a joint moves until it stands, command by command, from the definition."""
    distance = 0.0
    while speed > acceleration / gain * (1.0 + 1e-12):
        distance += speed * period
        speed -= acceleration * period
    # From here on along v = g d, which takes the joint just to the limit.
    return distance + speed / gain


def settled(limits, q, period, up=True):
    """Return the bound on the velocities at `q` that the acceleration has no part in."""
    previous = np.zeros(len(q))
    for _ in range(100000):
        bounds = at(limits, q, previous, period)
        reached = bounds.upper if up else bounds.lower
        if (reached == previous).all():
            return reached
        previous = reached
    raise AssertionError('the bound did not settle')


def chosen(strategy, bounds, step, rng):
    """Return velocities between bounds."""
    lower, upper = bounds.lower, bounds.upper
    share = {'upper': 1.0, 'lower': 0.0, 'alternating': step % 2,
             'random': rng.uniform(0.0, 1.0, len(lower)),
             'extremes': rng.integers(0, 2, len(lower)),
             'change of mind': (step // 40) % 2}[strategy]
    return np.where(share == 1.0, upper, lower + share * (upper - lower))


@pytest.mark.slow
@given(SEEDS, PERIODS, SHARES, st.sampled_from(STRATEGIES), st.booleans(), st.booleans())
def test_no_choice_within_the_bounds_leaves_a_limit(seed, period, share, strategy, hurried, some):
    rng = np.random.default_rng(seed)
    n = 6
    middle, reach = rng.uniform(-2.0, 2.0, n), 10.0 ** rng.uniform(-3.0, 0.5, n)
    lower, upper = middle - reach, middle + reach
    velocity, acceleration = 10.0 ** rng.uniform(-1, 1, n), 10.0 ** rng.uniform(-0.5, 2.0, n)
    if some:
        acceleration[rng.integers(0, 2, n) == 0] = math.inf
        lower[0], upper[1] = -math.inf, math.inf
    limits = limits_of(lower, upper, velocity, acceleration, period, share / period)
    q, previous = middle + rng.uniform(-1.0, 1.0, n) * reach, np.zeros(n)
    elapsed = period
    for step in range(250):
        bounds = at(limits, q, previous, elapsed)
        assert (bounds.lower <= bounds.upper).all()
        command = chosen(strategy, bounds, step, rng)
        assert (np.abs(command) <= velocity).all()
        assert (np.abs(command - previous) <= acceleration * elapsed + 1e-12 * velocity).all()
        elapsed = period * rng.uniform(0.05, 1.0) if hurried else period
        q, previous = q + command * elapsed, command
        assert (q <= upper + 1e-12).all() and (q >= lower - 1e-12).all()


@pytest.mark.slow
@given(SEEDS, PERIODS, st.sampled_from(STRATEGIES))
def test_joints_without_an_acceleration_limit_keep_their_ranges_too(seed, period, strategy):
    rng = np.random.default_rng(seed)
    lower, upper = np.array([-1.0, -math.inf, -0.001]), np.array([0.5, 2.0, math.inf])
    velocity = np.array([3.0, 10.0, 0.3])
    limits = limits_of(lower, upper, velocity, [math.inf] * 3, period)
    q, previous = np.zeros(3), np.zeros(3)
    for step in range(250):
        bounds = at(limits, q, previous, period)
        assert (bounds.lower <= bounds.upper).all()
        command = chosen(strategy, bounds, step, rng)
        assert (np.abs(command) <= velocity).all()
        q, previous = q + command * period, command
        assert (q <= upper + 1e-12).all() and (q >= lower - 1e-12).all()


@given(st.floats(0.0, 3.0), st.floats(0.5, 50.0), st.floats(2e-3, 0.05))
@example(0.0, 1.0, 0.01)
@example(3e-4, 1.0, 0.01)
@example(1.0, 2.0, 0.05)
def test_full_gain_is_the_exact_discrete_stopping_distance(distance, acceleration, period):
    # METHOD: u = d / (a T²), M = floor((√(1 + 8u) − 1) / 2), v = a T (M/2 + u / (M + 1)).
    u = distance / (acceleration * period ** 2)
    M = math.floor((math.sqrt(1.0 + 8.0 * u) - 1.0) / 2.0)
    exact = acceleration * period * (M / 2.0 + u / (M + 1.0))
    limits = limits_of([-50.0], [0.0], [1e3], [acceleration], period)
    assert settled(limits, np.array([-distance]), period) == pytest.approx(
        exact, rel=1e-9, abs=1e-12)
    mirrored = limits_of([0.0], [50.0], [1e3], [acceleration], period)
    assert settled(mirrored, np.array([distance]), period, up=False) == pytest.approx(
        -exact, rel=1e-9, abs=1e-12)


@given(st.floats(1e-6, 3.0), st.floats(0.5, 50.0), st.floats(2e-3, 0.05), SHARES)
@example(0.1, 5.0, 0.01, 0.5)
def test_allowed_speed_stops_within_the_distance(distance, acceleration, period, share):
    gain = share / period
    limits = limits_of([-1e5], [0.0], [1e4], [acceleration], period, gain)
    speed = float(settled(limits, np.array([-distance]), period)[0])
    needed = stopping_distance(speed, acceleration, period, gain)
    assert needed == pytest.approx(distance, rel=1e-8)


def test_stopping_distance_worked_out_by_hand():
    # T = 0.1, a = 1, g = 10: from 0.3 the joint moves 0.03 + 0.02 + 0.01 until it stands.
    limits = limits_of([-1.0], [1.0], [2.0], [1.0], 0.1, 10.0)
    assert settled(limits, np.array([1.0 - 0.06]), 0.1) == pytest.approx(0.3)
    # g = 5: below a/g = 0.2 by v = 5 d; from 0.3 it moves 0.03 and then 0.2 / 5.
    limits = limits_of([-1.0], [1.0], [2.0], [1.0], 0.1, 5.0)
    assert settled(limits, np.array([1.0 - 0.02]), 0.1) == pytest.approx(0.1)
    assert settled(limits, np.array([1.0 - 0.07]), 0.1) == pytest.approx(0.3)
    assert settled(limits, np.array([0.0]), 0.1, up=False) == pytest.approx(
        -settled(limits, np.array([0.0]), 0.1))


def test_without_acceleration_limits_the_speed_is_proportional_to_the_distance():
    limits = limits_of([-1.0] * 3, [1.0] * 3, [2.0] * 3, [math.inf] * 3, 0.01, 4.0)
    bounds = at(limits, np.array([0.75, -0.9, 0.0]), np.zeros(3), 0.01)
    assert bounds.upper == pytest.approx([1.0, 2.0, 2.0])
    assert bounds.lower == pytest.approx([-2.0, -0.4, -2.0])


def test_joint_without_an_acceleration_limit_beside_one_that_has_one():
    limits = limits_of([-1.0] * 2, [1.0] * 2, [2.0] * 2, [math.inf, 10.0], 0.01, 4.0)
    bounds = at(limits, np.array([0.75, 0.0]), np.array([0.0, 0.5]), 0.01)
    assert bounds.upper == pytest.approx([1.0, 0.6])
    assert bounds.lower == pytest.approx([-2.0, 0.4])


def test_velocity_may_change_as_far_as_the_time_since_the_last_command_allows():
    limits = limits_of([-10.0], [10.0], [5.0], [20.0], 0.01)
    for elapsed, change in ((0.01, 0.2), (0.004, 0.08), (7.0, 0.2)):
        bounds = at(limits, np.zeros(1), np.array([1.0]), elapsed)
        assert bounds.upper == pytest.approx(1.0 + change, abs=1e-7)
        assert bounds.lower == pytest.approx(1.0 - change, abs=1e-7)


def test_infinite_limits_do_not_get_in_the_way():
    infinite = [math.inf]
    bounds = at(limits_of([-math.inf], infinite, [3.0], infinite), np.zeros(1), np.zeros(1), 0.01)
    assert (bounds.lower[0], bounds.upper[0]) == (-3.0, 3.0)
    limits = limits_of([-math.inf], infinite, [3.0], [5.0])
    assert settled(limits, np.array([1e9]), 0.01) == 3.0
    assert settled(limits, np.array([-1e9]), 0.01, up=False) == -3.0


# Commands that take effect late

def late_joints(rng, some):
    """Return lower, upper, velocity and acceleration limits of six joints, and positions."""
    n = 6
    middle, reach = rng.uniform(-2.0, 2.0, n), 10.0 ** rng.uniform(-3.0, 0.5, n)
    velocity, acceleration = 10.0 ** rng.uniform(-1, 1, n), 10.0 ** rng.uniform(-0.5, 2.0, n)
    if some:
        acceleration[rng.integers(0, 2, n) == 0] = math.inf
    return (middle - reach, middle + reach, velocity, acceleration), \
        middle + rng.uniform(-1.0, 1.0, n) * reach


@pytest.mark.slow
@given(SEEDS, PERIODS, SHARES, st.sampled_from(STRATEGIES), st.booleans(), st.integers(0, 3),
       st.integers(0, 3))
@example(0, 0.05, 1.0, 'extremes', True, 2, 0)
def test_commands_no_later_than_expected_lead_no_joint_past_a_limit(seed, period, share, strategy,
                                                                    some, delay, spare):
    rng = np.random.default_rng(seed)
    joints, q = late_joints(rng, some)
    lower, upper, velocity, acceleration = joints
    limits = limits_of(*joints, period, share / period)
    commands = [np.zeros(6)] * 8
    for step in range(200):
        bounds = at(limits, q, commands[0], period, commands[:delay + spare], period)
        if not spare:
            # What is allowed in time can be reached now: no limit contradicts another.
            reached = bounds.settled
            assert (bounds.lower <= reached.upper + 1e-9 * velocity).all()
            assert (bounds.upper >= reached.lower - 1e-9 * velocity).all()
        command = chosen(strategy, bounds, step, rng)
        assert (np.abs(command) <= velocity * (1.0 + 1e-9)).all()
        assert (np.abs(command - commands[0]) <= acceleration * period + 1e-12 * velocity).all()
        commands = [command, *commands[:-1]]
        q = q + period * commands[delay]
        assert (q <= upper + 1e-12).all() and (q >= lower - 1e-12).all()


@pytest.mark.parametrize('accelerated', [False, True])
@pytest.mark.parametrize('delay', [1, 2, 3])
@pytest.mark.parametrize('share', [0.3, 0.5, 1.0])
def test_a_joint_that_obeys_sooner_than_expected_does_not_stop_and_go(share, delay, accelerated):
    period, acceleration = 0.05, 40.0 if accelerated else math.inf
    limits = limits_of(*(np.array([each]) for each in (-1.0, 1.0, 2.0, acceleration)), period,
                       share / period)
    q, commands, speeds = np.zeros(1), [np.zeros(1)] * delay, []
    for _ in range(80):
        command = at(limits, q, commands[0], period, commands, period).upper
        commands = [command, *commands[:-1]]
        q = q + period * command
        speeds.append(float(command[0]))
    fastest = int(np.argmax(speeds))
    falling = np.diff(speeds[fastest:])
    # It brakes once, and never speeds up again by what could be felt.
    assert falling.max() < 0.05 and 0.9 < q[0] <= 1.0


@pytest.mark.slow
@given(SEEDS, PERIODS, st.floats(0.02, 0.2), st.sampled_from(STRATEGIES), st.booleans(),
       st.integers(1, 2), st.booleans())
def test_delays_and_cycles_may_change_if_the_gain_leaves_a_margin(seed, period, share, strategy,
                                                                  some, delay, is_late):
    """Commands take from 0 to `delay` periods to act, and one cycle may be a period late."""
    rng = np.random.default_rng(seed)
    joints, q = late_joints(rng, some)
    limits = limits_of(*joints, period, share / period)
    commands, acting, arrivals, late = [np.zeros(6)] * 3, np.zeros(6), [], -1
    if is_late:
        late = rng.integers(100)
    now, last, elapsed = 0.0, 0.0, period
    for step in range(200):
        bounds = at(limits, q, commands[0], elapsed, commands[:delay + is_late], period)
        commands = [chosen(strategy, bounds, step, rng), *commands[:-1]]
        last = max(last, now + delay * period * rng.choice([0.0, 1.0, rng.random()]))
        arrivals.append((last, commands[0]))
        elapsed = period * (2.0 if step == late else rng.choice([1.0, rng.uniform(0.05, 1.0)]))
        end = now + elapsed
        while now < end:
            until = min(end, arrivals[0][0]) if arrivals else end
            q, now = q + acting * (until - now), until
            if arrivals and arrivals[0][0] <= now:
                acting = arrivals.pop(0)[1]
        assert (q <= joints[1] + 1e-12).all() and (q >= joints[0] - 1e-12).all()


@pytest.mark.slow
@given(SEEDS, PERIODS, SHARES, st.sampled_from(['upper', 'lower', 'change of mind']),
       st.integers(1, 3), st.integers(1, 3))
def test_counting_too_few_commands_is_no_worse_than_counting_none(seed, period, share, strategy,
                                                                  delay, counted):
    beyond = []
    for count in (0, min(counted, delay)):
        rng = np.random.default_rng(seed)
        joints, q = late_joints(rng, False)
        limits = limits_of(*joints, period, share / period)
        commands, farthest = [np.zeros(6)] * 4, np.zeros(6)
        for step in range(200):
            bounds = at(limits, q, commands[0], period, commands[:count], period)
            commands = [chosen(strategy, bounds, step, rng), *commands[:-1]]
            q = q + period * commands[delay]
            farthest = np.maximum(farthest, np.maximum(q - joints[1], joints[0] - q))
        beyond.append(farthest.max())
    assert beyond[1] <= beyond[0] + 1e-9


def test_distance_that_counts_is_the_one_where_pending_commands_lead():
    # g = 4 /s; two commands of up to 10 ms each lead 5 mm further up, 15 mm down, or to and fro.
    limits = limits_of([-1.0] * 3, [1.0] * 3, [9.0] * 3, [math.inf] * 3, 0.01, 4.0)
    pending = np.array([[0.25, -1.0, 1.0], [0.25, -0.5, -1.0]])
    bounds = at(limits, np.full(3, 0.9), np.zeros(3), 0.01, pending, 0.01)
    assert bounds.upper == pytest.approx([4.0 * 0.095, 4.0 * 0.1, 4.0 * 0.09])
    assert bounds.lower == pytest.approx([-4.0 * 1.9, -4.0 * 1.885, -4.0 * 1.89])
    # Where they may, or may not, lead outside, or back inside, the joint is to stop there; where
    # it is outside in any case it comes back.
    bounds = at(limits, np.array([0.998, 1.01, 1.02]), np.zeros(3), 0.01, pending, 0.01)
    assert bounds.upper == pytest.approx([-0.0, 0.0, -4.0 * 0.01])


# Where limits contradict each other

@pytest.mark.slow
@given(SEEDS, st.sampled_from(STRATEGIES), st.booleans(), SHARES)
def test_joint_outside_its_range_is_led_back_at_a_bounded_speed(seed, strategy, accelerated,
                                                                share):
    rng = np.random.default_rng(seed)
    n, period = 6, 0.01
    lower, upper, velocity = -np.ones(n), np.ones(n), rng.uniform(0.5, 8.0, n)
    acceleration = np.full(n, rng.uniform(5.0, 50.0) if accelerated else math.inf)
    limits = limits_of(lower, upper, velocity, acceleration, period, share / period)
    side = np.array([1.0, -1.0] * 3)
    q, previous = side * (1.0 + rng.uniform(0.0, 0.3, n)), np.zeros(n)
    slowest = np.minimum(0.2 * velocity, 1.0)
    for step in range(6000):
        bounds = at(limits, q, previous, period)
        assert (bounds.lower <= bounds.upper).all()
        demanded = np.where(side > 0.0, -bounds.upper, bounds.lower)
        outside = side * q > 1.0
        assert (demanded[outside] <= slowest[outside] + 1e-12).all()
        # As slowly as it may: never outwards, and inwards unless it is about there.
        command = np.where(outside, -side * demanded, chosen(strategy, bounds, step, rng))
        assert (side * command)[outside].max(initial=0.0) <= 0.0
        assert (np.abs(command) <= velocity).all()
        assert (np.abs(command - previous) <= acceleration * period + 1e-12).all()
        q, previous = q + command * period, command
        if (np.abs(q) <= 1.0 + 1e-6).all():
            break
    assert (np.abs(q) <= 1.0 + 1e-6).all()


@pytest.mark.slow
@pytest.mark.parametrize('side', [1.0, -1.0])
@pytest.mark.parametrize('width', [0.02, 0.1, 0.5])
def test_joint_that_comes_back_from_outside_stops_at_the_other_end(width, side):
    """It needs longer to brake than its range is wide, unless it comes back more slowly."""
    period, a, fastest = 0.01, 0.5, 10.0
    limits = limits_of([0.0], [width], [fastest], [a], period)
    for strategy in STRATEGIES:
        q, previous, rng = 0.5 * width * (1.0 + side) + side * np.ones(1), np.zeros(1), \
            np.random.default_rng(0)
        for step in range(3000):
            bounds = at(limits, q, previous, period)
            velocity = chosen(strategy, bounds, step, rng)
            q, previous = q + period * velocity, velocity
            # The other end is never passed, nor is this one once it is inside.
            assert (q[0] >= -1e-9) if side > 0.0 else (q[0] <= width + 1e-9)
        assert -1e-9 <= q[0] <= width + 1e-9


def test_joint_far_outside_has_to_come_back_at_a_fifth_of_its_speed_and_one_at_most():
    limits = limits_of([-1.0] * 2, [1.0] * 2, [2.0, 30.0], [math.inf] * 2)
    bounds = at(limits, np.array([1.5, 1.5]), np.zeros(2), 0.01)
    assert bounds.upper == pytest.approx([-0.4, -1.0])
    assert bounds.lower == pytest.approx([-2.0, -30.0])
    bounds = at(limits, np.array([-1.5, -1.002]), np.zeros(2), 0.01)
    assert bounds.lower == pytest.approx([0.4, 0.2])


@given(st.floats(0.0, 1.0), st.floats(-2.0, 2.0), st.floats(-5.0, 5.0), st.floats(0.01, 50.0),
       PERIODS, SHARES)
@example(0.0, 0.5, -0.36, 0.1, 0.01, 1.0)
@example(0.0, 0.5, 0.0, 50.0, 0.01, 1.0)
def test_bounds_never_cross_wherever_a_joint_is_and_however_fast(width, q, previous, acceleration,
                                                                 period, share):
    limits = limits_of([0.0], [width], [2.0], [acceleration], period, share / period)
    bounds = at(limits, np.array([q]), np.array([previous]), period)
    assert bounds.lower <= bounds.upper
    free = limits_of([0.0], [width], [2.0], [math.inf], period, share / period)
    bounds = at(free, np.array([q]), np.array([previous]), period)
    assert bounds.lower <= bounds.upper


def test_acceleration_is_kept_where_the_limits_contradict_each_other():
    limits = limits_of([-1.0] * 3, [1.0] * 3, [2.0] * 3, [10.0] * 3, 0.01)
    # Too fast; too close to the limit to stop; and outside while moving outwards.
    bounds = at(limits, np.array([0.0, 1.0, 1.2]), np.array([3.0, 1.0, 0.5]), 0.01)
    assert bounds.upper == pytest.approx([2.9, 0.9, 0.4])
    assert bounds.lower == pytest.approx([2.9, 0.9, 0.4])


# Names

def test_limit_that_sets_a_bound_is_named():
    limits = limits_of([-1.0] * 4, [1.0] * 4, [2.0] * 4, [100.0, 100.0, 100.0, 10.0], 0.01, 10.0)
    q, previous = np.array([0.0, 0.95, -0.95, 0.0]), np.array([2.0, 0.0, 0.0, 0.5])
    bounds = at(limits, q, previous, 0.01)
    assert bounds.upper == pytest.approx([2.0, 0.5, 1.0, 0.6])
    assert bounds.lower == pytest.approx([1.0, -1.0, -0.5, 0.4])
    assert bounds.limits(0, True) == ['velocity limit']
    assert bounds.limits(0, False) == ['acceleration limit']
    assert bounds.limits(1, True) == ['upper position limit']
    assert bounds.limits(1, False) == ['acceleration limit']
    assert bounds.limits(2, False) == ['lower position limit']
    assert bounds.limits(2, True) == ['acceleration limit']
    assert bounds.limits(3, True) == ['acceleration limit']
    assert bounds.limits(3, False) == ['acceleration limit']


def test_limit_is_named_without_acceleration_limits_and_outside_the_range():
    limits = limits_of([-1.0] * 3, [1.0] * 3, [2.0] * 3, [math.inf] * 3, 0.01, 10.0)
    bounds = at(limits, np.array([0.95, 1.5, -1.5]), np.zeros(3), 0.01)
    assert bounds.limits(0, False) == ['velocity limit']
    assert bounds.limits(0, True) == ['upper position limit']
    assert bounds.limits(1, True) == ['upper position limit']
    assert bounds.limits(2, False) == ['lower position limit']


def test_limits_that_say_the_same_are_all_named():
    # Braking leaves 10 /s times 0.2 rad, as much as the speed limit; the window of a joint that
    # rests leaves 200 rad/s² for 10 ms.
    limits = limits_of([-1.0], [1.0], [2.0], [200.0], 0.01, 10.0)
    bounds = at(limits, np.array([0.8]), np.zeros(1), 0.01)
    assert bounds.limits(0, True) == ['velocity limit', 'upper position limit',
                                      'acceleration limit']


def test_bound_that_no_speed_alone_sets_has_a_name_as_well():
    # Joint 1 is too fast to keep its limit: 1.9 rad/s is the least it can have. Joint 2 is far
    # outside of its range, and has to come back.
    limits = limits_of([-1.0] * 2, [1.0] * 2, [2.0] * 2, [10.0, math.inf], 0.01, 10.0)
    bounds = at(limits, np.array([0.99, -9.0]), np.array([2.0, 0.0]), 0.01)
    assert bounds.upper[0] == pytest.approx(1.9)
    assert bounds.limits(0, True) == ['acceleration limit']
    for up in (True, False):
        assert bounds.limits(1, up)


@pytest.mark.parametrize('names, upper', [
    ([], 0.5), (['velocity limit'], 0.5), (['upper position limit'], 1.0),
    (['lower position limit'], 0.5), (['acceleration limit'], 0.5),
    (['upper position limit', 'acceleration limit'], 2.0),
    (['upper position limit', 'velocity limit', 'acceleration limit'], math.inf)])
def test_bounds_without_a_limit_are_set_by_the_next_one(names, upper):
    limits = limits_of([-1.0] * 2, [1.0] * 2, [2.0] * 2, [100.0] * 2, 0.01, 10.0)
    bounds = at(limits, np.array([0.95, 0.95]), np.zeros(2), 0.01)
    without = bounds.without(0, names)
    assert without.upper == pytest.approx([upper, 0.5])
    assert bounds.upper == pytest.approx([0.5, 0.5])
    if 'acceleration limit' not in names:
        assert without.lower == pytest.approx([-1.0, -1.0])


# Limits that change


def fast_controller(**limits):
    """Return a controller of the planar arm whose first joint moves as fast as it may."""
    robot = Robot.from_file(robots.PLANAR_DH, limits={'joint1': limits})
    stack = Stack.from_yaml('- swing: {type: joint, joints: joint1, target: [3], gain: 5}', robot)
    return Controller(robot, stack, Settings(period=0.01, blend=0.0))


def test_a_lowered_velocity_limit_acts_from_the_next_cycle_on():
    controller = fast_controller()
    assert controller.update(np.zeros(3), 0.0).velocity[0] == pytest.approx(1.0)
    controller.set_velocity_limits({'joint1': 0.25})
    assert controller.update(np.zeros(3), 0.01).velocity[0] == pytest.approx(0.25)
    assert controller.velocity_limits.tolist() == [0.25, 1.0, 1.0]
    controller.set_velocity_limits({'joint1': 1.0})
    assert controller.update(np.zeros(3), 0.02).velocity[0] == pytest.approx(1.0)


def test_a_raised_velocity_limit_is_blended_in_as_a_setting_is():
    controller = fast_controller()
    controller.settings = Settings(period=0.01, blend=10.0)
    controller.set_velocity_limits({'joint1': 0.25})
    for cycle in range(3):
        controller.update(np.zeros(3), 0.01 * cycle)
    controller.set_velocity_limits({'joint1': 1.0})
    assert controller.update(np.zeros(3), 0.03).velocity[0] < 0.3


def test_other_settings_and_a_new_stack_leave_a_lowered_limit_in_force():
    controller = fast_controller(acceleration=5.0)
    controller.set_velocity_limits({'joint1': 0.25})
    controller.settings = Settings(period=0.01, blend=0.0, damping=0.2)
    controller.replace_stack(Stack.from_yaml(controller.stack.text, controller.robot))
    speeds = [controller.update(np.zeros(3), 0.01 * cycle).velocity[0] for cycle in range(20)]
    assert max(speeds) == pytest.approx(0.25)


@pytest.mark.parametrize('limits, told', [
    ({'joint1': 0.0}, 'velocity limit of joint1 must be above 0 and at most 1 rad/s'),
    ({'joint1': 1.1}, 'at most 1 rad/s, that of the robot, not 1.1'),
    ({'joint1': math.nan}, 'not nan'), ({'joint1': '0.5'}, "not '0.5'"),
    ({'joint2': 0.5, 'joint9': 0.5}, "unknown velocity 'joint9'")])
def test_velocity_limits_that_cannot_be_leave_all_as_they_were(limits, told):
    controller = fast_controller()
    with pytest.raises(SettingsError, match=told):
        controller.set_velocity_limits(limits)
    assert controller.velocity_limits.tolist() == [1.0, 1.0, 1.0]
