# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Uniform scaling: one factor for all joints (*lecture* 4, see docs/sources.md)."""

import math

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
from problems import EXACT, SEEDS
import pytest
from reference import random_levels
from tp_controller import Level, solve


def numbers(lower, upper):
    """Return a strategy for numbers whose squares are numbers, too."""
    return st.floats(lower, upper).map(lambda number: number if abs(number) > 1e-100 else 0.0)


def bounded(velocity, lower, upper):
    """Return the solution of joints that demand a velocity within bounds."""
    return solve([(np.eye(len(velocity)), velocity)], lower, upper)


@pytest.mark.slow
@given(st.lists(st.tuples(numbers(-1e3, 1e3), numbers(0, 10), numbers(0, 10)),
                min_size=1, max_size=8))
@example([(49.0, 1.0, 1.0)])
@example([(-49.0, 1.0, 1.0), (0.1, 1.0, 1.0)])
@example([(1.0, 2.0, 2.0), (1e-17, 1.0, 0.0)])
@example([(1.0, 2.0, 2.0), (1e-10, 1.0, 0.0)])
def test_scaled_velocities_keep_their_bounds_exactly_and_their_ratios(joints):
    velocity, lower, upper = (np.array(column) for column in zip(*joints))
    solution = bounded(velocity, -lower, upper)
    assert (solution.velocity >= -lower).all() and (solution.velocity <= upper).all()
    # What exceeds a bound by no more than rounding, relative to the fastest joint, is cut off
    # and slows nobody.
    rounding = 1e-9 * np.abs(velocity).max()
    np.testing.assert_allclose(solution.velocity, solution.scale * velocity, rtol=1e-14,
                               atol=rounding + 1e-300)
    within = ((velocity >= -lower - rounding) & (velocity <= upper + rounding)).all()
    assert within == (solution.limiting is None)
    if within:
        assert solution.scale == 1.0
    else:
        # No larger factor would do: the joint that decided is at its bound, to the last digit.
        index = solution.limiting
        assert 0.0 <= solution.scale < 1.0
        assert solution.velocity[index] == (upper if velocity[index] > 0 else -lower)[index]


def test_fast_negative_joint_is_limited_too():
    solution = bounded([0.5, -4.0], [-1.0, -1.0], [1.0, 1.0])
    assert solution.velocity == pytest.approx([0.125, -1.0])
    assert (solution.scale, solution.limiting) == (0.25, 1)


def test_each_velocity_is_compared_with_the_bound_on_its_own_side():
    assert bounded([1.0, 1.0], [-0.1, -0.1], [2.0, 2.0]).scale == 1.0
    assert bounded([-1.0, -1.0], [-2.0, -0.5], [0.1, 0.1]).velocity == pytest.approx([-0.5, -0.5])


def test_joint_that_may_not_move_stops_all():
    solution = bounded([0.5, 0.3], [-1.0, -1.0], [0.0, 1.0])
    assert solution.velocity.tolist() == [0.0, 0.0]
    assert (solution.scale, solution.limiting) == (0.0, 0)


def test_joint_that_may_not_move_and_need_not_stops_nobody():
    assert bounded([0.0, 0.3], [0.0, -1.0], [0.0, 1.0]).velocity.tolist() == [0.0, 0.3]


def test_side_without_a_bound_is_free():
    lower, upper = np.array([-math.inf, -1.0]), np.array([0.5, math.inf])
    assert bounded([-100.0, 100.0], lower, upper).velocity.tolist() == [-100.0, 100.0]
    assert bounded([1.0, 100.0], lower, upper).velocity == pytest.approx([0.5, 50.0])


@pytest.mark.slow
@given(st.lists(st.tuples(numbers(-1e3, 1e3), numbers(-10, 10), numbers(0, 10)),
                min_size=1, max_size=8))
@example([(1.0, 0.2, 0.6), (0.0, -1.0, 2.0)])
@example([(-1.0, 0.2, 0.6)])
@example([(3.0, -2.0, 0.5)])
def test_bounds_that_exclude_zero_scale_the_way_from_the_slowest_motion_they_allow(joints):
    velocity, lower, width = (np.array(column) for column in zip(*joints))
    upper = lower + width
    solution = bounded(velocity, lower, upper)
    assert (solution.velocity >= lower).all() and (solution.velocity <= upper).all()
    slowest = np.sign(lower + upper) * np.minimum(abs(lower), abs(upper))
    slowest[(lower <= 0.0) & (upper >= 0.0)] = 0.0
    way = velocity - slowest
    assert 0.0 <= solution.scale <= 1.0
    np.testing.assert_allclose(
        solution.velocity, np.clip(slowest + solution.scale * way, lower, upper), rtol=1e-9,
        atol=3e-9 * np.abs(way).max() + 1e-300)
    # No larger factor would do, if joints that brake could stand still at once.
    least, most = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
    if solution.scale < 1.0:
        beyond = slowest + min(1.0, solution.scale + 1e-6) * way
        assert (beyond > most).any() or (beyond < least).any()
    else:
        assert ((velocity >= least - 1e-8 * np.abs(way).max())
                & (velocity <= most + 1e-8 * np.abs(way).max())).all()


def test_braking_joint_is_where_uniform_scaling_begins():
    # Joint 1 must move at least 0.2; from (0.2, 0) to (1, 2) the second bound is met half way.
    solution = bounded([1.0, 2.0], [0.2, -1.0], [2.0, 1.0])
    assert solution.velocity == pytest.approx([0.6, 1.0])
    assert (solution.scale, solution.limiting) == (0.5, 1)


def test_joint_that_brakes_slows_the_others_only_if_it_has_to_turn_back():
    # Joint 1 must move at least 0.2: it cannot be as slow as demanded, whatever the other does.
    slower = bounded([0.1, 1.0], [0.2, -1.0], [0.3, 1.0])
    assert slower.velocity == pytest.approx([0.2, 1.0]) and slower.scale == 1.0
    # A quarter of the way from 0.2 to -0.6 leads to rest.
    for sign in (1.0, -1.0):
        lower, upper = sorted([sign * 0.2, sign * 0.3])
        back = bounded([sign * -0.6, 1.0], [lower, -1.0], [upper, 1.0])
        assert back.velocity == pytest.approx([sign * 0.2, 0.25])
        assert (back.scale, back.limiting) == (pytest.approx(0.25), 0)


def test_one_sided_bounds_leave_the_other_side_free():
    assert bounded([1.0, -50.0], None, np.array([0.5, 1.0])).velocity == pytest.approx(
        [0.5, -25.0])
    assert bounded([1.0, -50.0], np.array([-1.0, -1.0]), None).velocity == pytest.approx(
        [0.02, -1.0])


def test_uniform_scaling_names_the_joint_that_decided_and_its_side():
    for sign in (1.0, -1.0):
        solution = bounded([0.5, sign * 4.0], [-1.0, -1.0], [1.0, 1.0])
        level = solution.levels[0]
        assert level.multipliers.tolist() == [0.0, sign]
        assert level.limited_by == [1]
        assert level.limited_velocity.tolist() == solution.velocity.tolist()
        assert level.velocity == pytest.approx([0.5, sign * 4.0])


def test_limits_that_act_before_the_scaling_are_named_after_the_limiting_joint():
    # 10 for the sum: (5, 5) without the row, so joint 1 allows a fifth, and joint 2 up to 7.5.
    row = Level([[1.0, 0.0, 0.0]], lower=[-1.0], upper=[0.0])
    levels = [row, ([[1.0, 1.0, 0.0]], [10.0]), ([[0.0, 0.0, 1.0]], [-1.0])]
    solution = solve(levels, [-1.0, -1.5, -1.0], [1.0, 1.5, 1.0])
    assert solution.velocity == pytest.approx([0.0, 1.5, -0.2]) and solution.limiting == 1
    for level in solution.levels[1:]:
        assert level.multipliers.tolist() == [0.5, 1.0, 0.0] and level.limited_by == [1, 0]
    # With more of joint 1 joint 3 moves more, too.
    faster = solve(levels, [-1.0, -1.5, -1.0], [1.5, 1.5, 1.0])
    assert faster.velocity == pytest.approx([0.0, 1.5, -0.3])


def test_scaling_keeps_the_direction_of_every_task():
    levels = random_levels(np.random.default_rng(11), 6, [2, 2])
    free = solve(levels)
    solution = solve(levels, np.full(6, -0.1), np.full(6, 0.1))
    for level, unscaled in zip(solution.levels, free.levels):
        np.testing.assert_allclose(level.achieved, solution.scale * unscaled.achieved, **EXACT)
        assert level.scale == solution.scale < 1.0


@pytest.mark.slow
@given(SEEDS)
def test_uniform_scaling_slows_what_the_bounds_of_levels_left(seed):
    """Within them first, as if joints had no limits; then shorter, in the same direction."""
    rng = np.random.default_rng(seed)
    n = 6
    rows = Level(rng.normal(size=(2, n)), lower=-rng.uniform(0.1, 0.5, 2),
                 upper=rng.uniform(0.1, 0.5, 2))
    equality = (rng.normal(size=(3, n)), rng.normal(size=3))
    limit = rng.uniform(0.05, 0.5, n)
    plain = solve([equality], -limit, limit, scaling='uniform').scale
    for levels in ([rows, equality], [equality, rows]):
        free = solve(levels, scaling='uniform').velocity
        whole = solve(levels, scaling='redistribute').velocity
        np.testing.assert_allclose(free, whole, atol=1e-12)
        solution = solve(levels, -limit, limit, scaling='uniform')
        factor = np.min(limit / np.abs(free))
        if factor >= plain:
            np.testing.assert_allclose(solution.velocity, min(factor, 1.0) * free, atol=1e-9)
            assert solution.scale == pytest.approx(min(factor, 1.0))
        assert (np.abs(solution.velocity) <= limit).all()
        values = rows.J @ solution.velocity
        if levels[0] is rows:
            assert (values <= rows.upper + 1e-9).all() and (values >= rows.lower - 1e-9).all()
        else:
            # Bounds below never slow the level more than it is slowed alone.
            assert solution.scale >= plain - 1e-9
            J, v = equality
            np.testing.assert_allclose(J @ solution.velocity, solution.scale * v, atol=1e-9)


def test_demand_that_is_damped_is_slowed_no_more_for_the_bounds_above_it():
    # c = κ T h = 2 leaves s² / c = 1/8 of what joint 1 would do, and joint 2 nothing to wait for.
    levels = [Level(np.array([[0.0, 0.001]]), lower=np.array([1.0])), ([[0.5, 0.0]], [2.0])]
    solution = solve(levels, -np.ones(2), np.ones(2), period=0.01, memory=(0.0, 50.0),
                     singular_region=0.1)
    assert solution.velocity == pytest.approx([0.5, 1.0]) and solution.scale == 1.0


def test_bounds_of_levels_slow_nobody_more_where_a_joint_has_to_move():
    # From 0.3 on joint 1 may do 0.7 of the 2 that are demanded; the row demands more of it.
    row, equality = Level(np.array([[1.0, 0.0]]), lower=np.array([5.0])), (np.eye(2), [2.3, 1.0])
    for levels in ([equality], [row, equality], [equality, row]):
        solution = solve(levels, [0.3, -1.0], [1.0, 1.0], scaling='uniform')
        assert solution.velocity == pytest.approx([1.0, 0.35])
        assert solution.scale == pytest.approx(0.35)


def test_rows_move_joints_where_a_demand_needs_one_that_may_not_move():
    row = Level(np.array([[0.0, 1.0]]), lower=np.array([5.0]))
    solution = solve([row, ([[1.0, 0.0]], [0.5])], [0.0, -1.0], [0.0, 1.0], scaling='uniform')
    assert solution.velocity == pytest.approx([0.0, 1.0])


def test_bounds_below_an_equality_level_never_slow_it_when_all_joints_are_scaled_alike():
    # The row could be met with ten times the speed of joint 2.
    equality, row = ([[1.0, 0.0]], [0.5]), Level(np.array([[0.0, 0.1]]), lower=np.array([1.0]))
    solution = solve([equality, row], -np.ones(2), np.ones(2), scaling='uniform')
    assert solution.velocity == pytest.approx([0.5, 1.0]) and solution.scale == 1.0
    # A joint that may hardly move, or not at all, has no say in that, above as below.
    for speed in (0.1, 0.01, 0.0):
        for levels in ([equality, row], [row, equality]):
            locked = solve(levels, [-1.0, -2.0], [1.0, speed], scaling='uniform')
            assert locked.velocity == pytest.approx([0.5, speed]) and locked.scale == 1.0
