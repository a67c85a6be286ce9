# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Damping: near singularities, and of levels that bend while a velocity stays constant."""

import math

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
from problems import (
    as_levels,
    DEFAULTS,
    EXACT,
    hierarchies,
    near,
    redistribute,
    SEEDS,
    stacks,
    well_conditioned,
)
import pytest
from reference import damped_recursion, lexicographic, random_levels
from tp_controller import Level, solve
from tp_controller.solver.damping import CURVATURE, FIRST, MEMORY, ROW_TURNING, TURNING

# Near singularities


@given(SEEDS, st.sampled_from([1e-2, 0.1, 100.0]), st.booleans())
def test_answer_is_the_same_in_any_units_that_levels_and_settings_share(seed, unit, some):
    rng, n = np.random.default_rng(seed), 7
    levels = []
    for m in (3, 2, 1):
        # Singular values on both sides of every threshold, the first level's fifth included.
        U, V = (np.linalg.qr(rng.standard_normal((rows, m)))[0] for rows in (m, n))
        levels.append((U * 10.0 ** rng.uniform(-3.0, 0.5, m) @ V.T, rng.standard_normal(m)))
    bounds = (np.full(n, -0.5), np.full(n, 0.5)) if some else ()
    options = {'damping': 0.1, 'singular_region': 0.1, 'regularisation': 0.02}
    in_si = redistribute(levels, *bounds, **options)
    other = redistribute([(unit * J, unit * v) for J, v in levels], *bounds,
                         **{name: unit * value for name, value in options.items()})
    np.testing.assert_allclose(other.velocity, in_si.velocity, rtol=1e-6, atol=1e-6)


@given(SEEDS, st.integers(1, 8), st.integers(1, 10), st.floats(0.01, 2.0))
def test_damped_least_squares_is_the_explicit_formula(seed, m, n, damping):
    (J, v), = random_levels(np.random.default_rng(seed), n, [m])
    explicit = J.T @ np.linalg.solve(J @ J.T + damping ** 2 * np.eye(m), v)
    np.testing.assert_allclose(solve([(J, v)], damping=damping).velocity, explicit, **EXACT)


@pytest.mark.parametrize('s, gain', [
    (1e-3, 1e-3 / (1e-6 + 0.04 * (1 - 4e-6))),
    (0.25, 0.25 / (0.0625 + 0.04 * 0.75)),
    (0.5, 2.0),
    (0.8, 1.25),
])
def test_only_directions_in_the_singular_region_are_damped(s, gain):
    # λ = 0.2, region 0.5: s / (s² + λ² (1 − (s/0.5)²)) below 0.5, and 1/s from there on.
    J = np.array([[1.0, 0.0, 0.0], [0.0, s, 0.0]])
    above = (np.array([[0.0, 0.0, 1.0]]), np.zeros(1))
    velocity = solve([above, (J, [1.0, 1.0])], damping=0.2, singular_region=0.5).velocity
    assert velocity == pytest.approx([1.0, gain, 0.0], rel=1e-12)
    # The first level has a share of both.
    velocity = solve([(J, [1.0, 1.0])], damping=0.2 / FIRST, singular_region=0.5 / FIRST).velocity
    assert velocity == pytest.approx([1.0, gain, 0.0], rel=1e-12)


@pytest.mark.slow
@given(stacks(max_joints=10, max_levels=4), st.sampled_from([0.05, 0.3, 1.0]),
       st.sampled_from([0.1, 1.0, math.inf]))
def test_damped_levels_are_the_recursion_with_every_direction_damped_by_itself(stack, damping,
                                                                               region):
    n, levels = stack
    assume(levels and well_conditioned(n, levels, 1e-3))
    exact = damped_recursion(levels, n, damping, region, 1.0 if math.isinf(region) else FIRST)
    np.testing.assert_allclose(
        solve(levels, damping=damping, singular_region=region).velocity, exact, rtol=0,
        atol=1e-8 * max(1.0, np.abs(exact).max()))


def test_damping_bounds_the_velocity_near_a_singularity():
    for s in np.logspace(-12, 0, 200):
        levels = [(np.array([[1.0, 0.0]]), np.zeros(1)), (np.array([[0.0, s]]), np.ones(1))]
        velocity = solve(levels, damping=0.1, singular_region=0.1).velocity
        assert 0.0 <= velocity[1] <= 10.0 + 1e-9
        velocity = solve(levels[1:], damping=0.1, singular_region=0.1).velocity
        assert 0.0 <= velocity[1] <= 10.0 / FIRST + 1e-9


def test_damping_never_leaks_into_the_projector():
    J = np.array([[1.0, 0.0, 0.0], [0.0, 0.3 * FIRST * 0.1, 0.0]])
    levels = [(J, [0.2, 0.1]), (np.eye(3), [1.0, -1.0, 1.0])]
    upper = solve(levels[:1], damping=0.1, singular_region=0.1)
    both = solve(levels, damping=0.1, singular_region=0.1)
    np.testing.assert_allclose(J @ both.velocity, J @ upper.velocity, rtol=1e-12, atol=1e-15)
    # The damped direction is not made up for by the level below: it belongs to the first.
    assert both.velocity == pytest.approx([0.2, upper.velocity[1], 1.0])
    assert np.linalg.norm(both.levels[0].residual) > 0.05


def test_damping_of_zero_or_an_empty_region_is_no_damping():
    levels = random_levels(np.random.default_rng(2), 5, [2, 2])
    levels[0][0][1] = levels[0][0][0] + 1e-3 * levels[0][0][1]
    exact = lexicographic(levels, 5)
    for options in ({}, {'damping': 0.0, 'singular_region': 1.0},
                    {'damping': 0.5, 'singular_region': 0.0}):
        np.testing.assert_allclose(solve(levels, **options).velocity, exact, rtol=1e-8)


# What bends while a velocity stays constant: c

T = 0.01
REGION = {'damping': 0.1, 'singular_region': 0.1, 'period': T}
BOX = -np.ones(3), np.ones(3)


def remembered(h, cycles=1):
    """Return what is remembered of an h that has not changed for a number of cycles."""
    return pytest.approx(h * (1.0 - math.exp(-cycles * T / MEMORY)), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize('h', [0.0, 0.5, 7.0, 60.0])
@pytest.mark.parametrize('first', [True, False])
def test_directions_softer_than_the_level_bends_are_slowed(h, first):
    s, demand = np.array([1.0, 0.3, 0.05 if first else 0.08]), np.array([1e-3, 0.2, -0.01])
    above = [] if first else [(np.array([[0.0, 0.0, 0.0, 1.0]]), np.zeros(1))]
    J = np.hstack([np.diag(s), np.zeros((3, 1))])
    share = FIRST if first else 1.0
    damped = s ** 2 + (0.1 * share) ** 2 * np.maximum(0.0, 1.0 - (s / (0.1 * share)) ** 2)
    found = solve([*above, (J, demand)], memory=(0.0,) * len(above) + (h,), **REGION)
    # The larger of the two: c = κ T h.
    assert found.velocity[:3] == near(s * demand / np.maximum(damped, CURVATURE * T * h))


@pytest.mark.parametrize('h', [0.0, 20.0, 100.0])
def test_bend_is_a_stiffness_where_bounds_are_in_the_way(h):
    # Stiffnesses are 2.25 and 0.09, or what the level bends; a_1 may be 1 + 0.3 a_2.
    row = Level(np.array([[1.0, -0.3]]), upper=np.array([1.0]))
    s, demand = np.array([1.5, 0.3]), np.array([30.0, 0.15])
    stiff = np.maximum(s ** 2, CURVATURE * T * h)
    target, across = s * demand / stiff, np.array([1.0, -0.3])
    push = (across @ target - 1.0) / (across @ (across / stiff))
    solution = redistribute([row, (np.diag(s), demand)], memory=(0.0, h), **REGION)
    assert solution.velocity == near(target - push * across / stiff, rel=1e-6)


@pytest.mark.parametrize('h', [1.0, 20.0, 100.0])
def test_bend_makes_motions_stiff_that_do_not_move_the_level(h):
    # Joint 1 is at its bound; joint 2 could do the rest by moving across (1, 0.5).
    c = CURVATURE * T * h
    along, across = np.array([1.0, 0.5]) / math.sqrt(1.25), np.array([-0.5, 1.0]) / math.sqrt(1.25)
    stiff, target = np.array([max(1.25, c), c]), np.array([math.sqrt(1.25) / max(1.25, c), 0.0])
    bounded = np.array([along[0], across[0]])
    push = max(0.0, (bounded @ target - 0.2) / (bounded @ (bounded / stiff)))
    a = target - push * bounded / stiff
    solution = redistribute([([[1.0, 0.5]], [1.0])], [-0.2, -5.0], [0.2, 5.0], memory=(h,),
                            **REGION)
    assert solution.velocity == near(a[0] * along + a[1] * across, rel=1e-6)


@pytest.mark.parametrize('size', [5.0, TURNING, 0.5])
def test_level_bends_by_what_it_misses(size):
    # Joint 1 is at its bound, and 3 are missing.
    level = (np.array([[size, 0.0, 0.0]]), np.array([size + 3.0]))
    for scaling in ('redistribute', 'uniform'):
        solution = solve([level], *BOX, scaling=scaling, **REGION)
        # It turns by as much where its rows are short.
        expected = max(size, TURNING) * 3.0 if scaling == 'redistribute' else 0.0
        assert solution.memory == (remembered(expected),)


def test_level_bends_by_the_levels_above_that_it_pushes_against():
    # It demands 3 of joint 1, which the first level stops, and 3 of joint 2, whose bound is 1.
    level = (np.array([[5.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([3.0, 3.0]))
    for size in (4.0, 1.0):
        stopped, turns = (np.array([[size, 0.0, 0.0]]), np.zeros(1)), max(size, TURNING)
        solution = redistribute([stopped, level], *BOX, **REGION)
        missed = math.hypot(3.0, 2.0)
        # The force along joint 1 is 5 · 3, in the units of the first level a share of that.
        expected = math.sqrt(26.0) * missed + turns * 15.0 / size
        assert solution.memory == (0.0, remembered(expected))
        # Where directions are relaxed below 0.9, μ = A f / (A² + 0.45²).
        solution = redistribute([stopped, level], *BOX, release_region=0.9, **REGION)
        expected = math.sqrt(26.0) * missed + turns * size * 15.0 / (size ** 2 + 0.45 ** 2)
        assert solution.memory == (0.0, remembered(expected))
        # Uniform scaling changes nothing of that; joint 2 does what is demanded, then.
        solution = solve([stopped, level], *BOX, scaling='uniform', **REGION)
        assert solution.memory == (0.0, remembered(math.sqrt(26.0) * 3.0 + turns * 15.0 / size))


@pytest.mark.parametrize('size', [1.0, 5.0])
def test_level_that_demands_a_velocity_of_every_joint_bends_by_others_alone(size):
    stopped = (np.array([[4.0, 0.0, 0.0]]), np.zeros(1))
    closing = Level(size * np.eye(3), size * np.array([3.0, 3.0, 0.0]))
    solution = redistribute([stopped, closing], *BOX, **REGION)
    # That of other sizes is a level like others.
    own = 0.0 if size == 1.0 else size ** 2 * math.sqrt(3.0) * math.hypot(3.0, 2.0)
    assert solution.memory == (0.0, remembered(own + size ** 2 * 3.0))


@pytest.mark.parametrize('length, faster', [
    (2.0, 1.0), (ROW_TURNING, 1.0), (0.1, 10.0 * ROW_TURNING)])
def test_level_bends_by_the_rows_that_it_pushes_against(length, faster):
    # Joint 1 may have 0.5; short rows turn faster.
    row = Level(np.array([[length, 0.0, 0.0]]), upper=np.array([0.5 * length]))
    level = (np.array([[4.0, 0.0, 0.0]]), np.array([5.0]))
    solution = redistribute([row, level], *BOX, **REGION)
    expected = 4.0 * 3.0 + 4.0 * 3.0 * faster
    assert solution.memory == (0.0, remembered(expected))


def test_level_bends_by_what_rows_and_levels_above_share_of_a_force():
    row = Level(np.array([[0.0, 1.0, 0.0]]), upper=np.array([0.5]))
    stopped = (np.array([[1.0, 0.0, 0.0]]), np.zeros(1))
    level = (np.array([[1.0, 1.0, 1.0]]), np.array([4.5]))
    solution = redistribute([row, stopped, level], *BOX, **REGION)
    # 3 are missing: the row, the level and the bound of joint 3 each push back with 3.
    assert solution.velocity == near([0.0, 0.5, 1.0])
    assert solution.memory == (0.0, 0.0, remembered(TURNING * (3.0 + 3.0) + 3.0))
    # (0, 2.5) is 3.125 of an oblique row less 1.875 of joint 1, which the level stops.
    row = Level(np.array([[0.6, 0.8, 0.0]]), upper=np.array([0.4]))
    level = (np.array([[0.0, 1.0, 0.0]]), np.array([3.0]))
    solution = redistribute([row, stopped, level], *BOX, **REGION)
    assert solution.velocity == near([0.0, 0.5, 0.0])
    assert solution.memory == (0.0, 0.0, remembered(TURNING * (2.5 + 1.875) + 3.125))


def test_level_that_is_met_although_bounds_are_in_the_way_does_not_bend():
    solution = redistribute([([[1.0, 1.0]], [1.0]), ([[1.0, -1.0]], [5.0])], [-1.0, -1.0],
                            [0.2, 1.0], period=T)
    assert solution.velocity == near([0.2, 0.8])
    assert solution.memory[0] == 0.0 and solution.memory[1] > 0.0


@pytest.mark.parametrize('length, faster', [(2.0, 1.0), (0.1, 10.0 * ROW_TURNING)])
def test_rows_that_contradict_each_other_bend_by_what_they_miss(length, faster):
    J = length * np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    rows = Level(J, lower=length * np.array([1.0, -math.inf]),
                 upper=length * np.array([math.inf, 0.0]))
    solution = redistribute([rows], *BOX, **REGION)
    # Half of it each; rows are of length 1, and miss in their own units.
    pushes = length ** 2 * np.array([0.5, 0.5]) * faster
    assert solution.memory == (remembered(np.linalg.norm(pushes)),)
    # Rows that can be met push against nothing.
    met = Level(J[:1], lower=length * np.array([0.5]))
    assert redistribute([met], *BOX, **REGION).memory == (0.0,)


def test_rows_that_cannot_be_met_move_the_less_the_more_they_bend():
    # Least (1 − x)² + (2 x)², and c of a way back to rest; ROW_DAMPING has no say above levels.
    rows = Level(np.array([[1.0], [2.0]]), lower=np.array([1.0, -math.inf]),
                 upper=np.array([math.inf, 0.0]))
    for h in (0.0, 50.0, 1000.0):
        c = CURVATURE * T * h
        assert redistribute([rows], memory=(h,), **REGION).velocity == near(
            [1.0 / (5.0 + c)], rel=1e-6)


@pytest.mark.slow
@given(SEEDS, st.sampled_from([(2, 2), (1, 2, 2), (2, 1, 1, 2)]))
def test_bend_is_that_of_multipliers_found_by_least_squares(seed, rows):
    rng = np.random.default_rng(seed)
    n = 6
    levels, upper = random_levels(rng, n, rows), rng.uniform(0.05, 0.6, n)
    assume(well_conditioned(n, levels, 0.05))
    solution = redistribute(levels, -upper, upper, period=T)
    above = []
    for (J, v), level, h in zip(levels, solution.levels, solution.memory):
        x, missed = level.velocity, v - J @ level.velocity
        expected = 0.0
        if np.linalg.norm(missed) > 1e-8:
            active = np.eye(n)[np.abs(x) == upper]
            pushing = np.concatenate([active, *above])
            # Where more is in the way than there are joints, many multipliers would do.
            assume(len(pushing) <= n and (len(pushing) == 0 or np.linalg.cond(pushing) < 50.0))
            pushes = np.linalg.lstsq(pushing.T, J.T @ missed, rcond=None)[0]
            np.testing.assert_allclose(pushing.T @ pushes, J.T @ missed, rtol=0, atol=1e-6)
            sizes = [max(np.linalg.norm(A), TURNING) for A in above]
            pushes = np.split(pushes, len(active) + np.cumsum([0, *map(len, above)]))[1:-1]
            expected = max(np.linalg.norm(J), TURNING) * np.linalg.norm(missed) + sum(
                size * np.linalg.norm(push) for size, push in zip(sizes, pushes))
        assert h == pytest.approx(expected * (1.0 - math.exp(-T / MEMORY)), rel=1e-4, abs=1e-7)
        above.append(J)


def test_bend_follows_what_is_missed_and_is_forgotten_where_nothing_is():
    unmet, met = ([[4.0, 0.0, 0.0]], [5.0]), ([[4.0, 0.0, 0.0]], [2.0])
    memory = None
    for cycle in range(1, 40):
        memory = redistribute([unmet], *BOX, memory=memory, **REGION).memory
        assert memory == (remembered(4.0, cycle),)
    h = memory[0]
    while True:
        solution = redistribute([met], *BOX, memory=memory, **REGION)
        assert solution.velocity == near([8.0 / max(16.0, CURVATURE * T * h), 0.0, 0.0])
        memory, h = solution.memory, h * math.exp(-T / MEMORY)
        # What damps less than λ does, is none.
        if CURVATURE * T * h <= 0.1 ** 2:
            break
        assert memory == (pytest.approx(h, rel=1e-9),)
    assert memory == (0.0,)


def test_bend_is_forgotten_without_damping_where_it_is_less_than_the_regularisation():
    met = (np.array([[2.0, 0.0, 0.0]]), np.array([1.0]))
    # A cycle takes a tenth of it, nearly.
    for share, forgotten in ((1.0, True), (1.2, False)):
        h = share * 0.3 ** 2 / (CURVATURE * T)
        memory = redistribute([met], *BOX, period=T, regularisation=0.3, memory=(h,)).memory
        assert (memory == (0.0,)) == forgotten


@given(SEEDS)
@pytest.mark.slow
def test_where_demands_are_met_bends_come_to_nothing_and_the_answer_is_exact(seed):
    rng = np.random.default_rng(seed)
    levels = random_levels(rng, 6, [2, 2])
    assume(well_conditioned(6, levels, 0.1))
    exact = lexicographic(levels, 6)
    box = -2.0 * np.abs(exact).max() * np.ones(6), 2.0 * np.abs(exact).max() * np.ones(6)
    memory = tuple(rng.uniform(0.0, 30.0, 2))
    for _ in range(400):
        solution = redistribute(levels, *box, memory=memory, **REGION)
        memory = solution.memory
    assert memory == (0.0, 0.0)
    np.testing.assert_allclose(solution.velocity, exact, rtol=0,
                               atol=1e-9 * max(1.0, np.abs(exact).max()))


@pytest.mark.slow
@given(hierarchies(), st.sampled_from(['redistribute', 'uniform']))
def test_call_without_a_memory_is_the_same_whatever_the_period(problem, scaling):
    n, hierarchy, lower, upper = problem
    levels = as_levels(hierarchy)
    at_once = solve(levels, lower, upper, scaling=scaling, **DEFAULTS)
    assert at_once.memory == (0.0,) * len(levels)
    for period in (1e-3, 0.1, 1.0):
        timed = solve(levels, lower, upper, scaling=scaling, period=period, **DEFAULTS)
        np.testing.assert_allclose(timed.velocity, at_once.velocity, rtol=0, atol=1e-9)
        assert len(timed.memory) == len(levels) and min(timed.memory) >= 0.0


@pytest.mark.slow
@given(hierarchies(max_levels=3), SEEDS)
def test_call_without_a_period_and_damping_everywhere_remember_nothing(problem, seed):
    n, hierarchy, lower, upper = problem
    levels = as_levels(hierarchy)
    memory = tuple(np.random.default_rng(seed).uniform(0.0, 100.0, len(levels)))
    for options in (DEFAULTS, {}, {**DEFAULTS, 'singular_region': math.inf, 'period': 0.1},
                    {'damping': 0.1, 'period': 0.1}):
        plain = redistribute(levels, lower, upper, **options)
        other = redistribute(levels, lower, upper, memory=memory, **options)
        assert other.velocity.tolist() == plain.velocity.tolist()
        assert plain.memory == other.memory == (0.0,) * len(levels)


@pytest.mark.parametrize('memory', [(), (50.0,), (50.0, 0.0, 50.0)])
def test_memory_of_other_levels_counts_for_the_first_ones(memory):
    levels = [([[4.0, 0.0, 0.0]], [6.0]), ([[0.0, 5.0, 0.0]], [7.0])]
    other = redistribute(levels, *BOX, memory=memory, **REGION)
    same = redistribute(levels, *BOX, memory=(*memory[:1], 0.0, 0.0)[:2], **REGION)
    assert other.velocity.tolist() == same.velocity.tolist()
    before = memory[0] * math.exp(-T / MEMORY) if memory else 0.0
    grown = 1.0 - math.exp(-T / MEMORY)
    assert other.memory == same.memory == (near(before + 8.0 * grown), near(10.0 * grown))


def test_no_level_is_slowed_by_what_another_one_pushes_against():
    # Level 1 misses a lot; level 2 is soft, but free.
    levels = [([[1.0, 0.0, 0.0]], [30.0]), ([[0.0, 0.2, 0.0]], [0.02]), (np.eye(3), np.zeros(3))]
    memory = None
    for _ in range(20):
        solution = redistribute(levels, *BOX, memory=memory, **REGION)
        memory = solution.memory
        assert solution.velocity == near([1.0, 0.1, 0.0])
    assert memory[0] > 20.0 and memory[1] == 0.0


def reversals(goal, period, closing, remembering):
    """
    Return how often a planar arm turns back in a second that reaches for a goal, in the end.

    Its three links are 0.5 long; it is ideal, and may have 2 rad/s.
    """
    q, memory, box = np.array([0.3, 0.5, 0.4]), None, (np.full(3, -2.0), np.full(3, 2.0))
    commands = []
    for _ in range(round(12.0 / period)):
        angles = np.cumsum(q)
        x, y = 0.5 * np.cos(angles), 0.5 * np.sin(angles)
        J = np.array([[-y[joint:].sum() for joint in range(3)],
                      [x[joint:].sum() for joint in range(3)]])
        levels = [Level(J, 5.0 * (np.array(goal) - [x.sum(), y.sum()]))]
        if closing:
            levels.append(Level.of_joints(0.5 * (np.array([0.3, -0.5, 1.0]) - q)))
        solution = redistribute(levels, *box, **{**DEFAULTS, 'period': period, 'memory': memory})
        memory = solution.memory if remembering else None
        commands.append(solution.velocity)
        q = q + period * solution.velocity
    changes = np.diff(commands, axis=0)[len(commands) // 2:]
    sides = np.where(np.abs(changes) > 0.01, np.sign(changes), 0.0)
    return (sides[1:] * sides[:-1] < 0.0).sum(axis=0).max() / 6.0


@pytest.mark.parametrize('goal', [(3.0, 0.0), (1.6, 0.9), (-2.0, -2.0)])
@pytest.mark.parametrize('period', [0.02, 0.1])
@pytest.mark.parametrize('closing', [True, False])
@pytest.mark.slow
def test_arm_that_reaches_for_what_it_cannot_reach_comes_to_rest(goal, period, closing):
    assert reversals(goal, period, closing, remembering=True) == 0.0
    # Without a memory it turns back for ever.
    assert reversals(goal, period, closing, remembering=False) > 5.0
