# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The solver, against references that share no code with it."""

import math
import sys

from hypothesis import assume, example, given
from hypothesis import strategies as st
import numpy as np
import pytest
from reference import lexicographic, null_of, projector, random_levels, residual_norms
from tp_controller import Level, solve, SolverError
from tp_controller.solver.level import identity
from tp_controller.solver.min_norm import solve_stacked
from tp_controller.solver.null_space import Damping
from tp_controller.solver.solve import RANK_TOLERANCE, SCALINGS, Solver

UNDAMPED = Damping(0.0, math.inf, 0.0)
SEEDS = st.integers(0, 2 ** 32 - 1)
EXACT = {'rtol': 1e-9, 'atol': 1e-9}


@st.composite
def stacks(draw, max_joints=30, max_levels=6):
    """Return (n, levels): any mix of row counts, and levels of special structure."""
    n = draw(st.integers(1, max_joints))
    rng = np.random.default_rng(draw(SEEDS))
    levels = []
    for _ in range(draw(st.integers(0, max_levels))):
        m = draw(st.integers(0, max(1, n // 2)))
        J = rng.standard_normal((m, n))
        kind = draw(st.sampled_from(['full', 'full', 'rank deficient', 'duplicate', 'mixture',
                                     'selection', 'zero', 'tall']))
        if kind == 'rank deficient' and m > 1:
            J = rng.standard_normal((m, m // 2)) @ rng.standard_normal((m // 2, n))
        elif kind == 'duplicate' and levels:
            J = levels[draw(st.integers(0, len(levels) - 1))][0].copy()
        elif kind == 'mixture' and levels:
            above = np.concatenate([J for J, _ in levels])
            J = rng.standard_normal((m, len(above))) @ above
        elif kind == 'selection':
            J = np.eye(n)[rng.permutation(n)[:m]]
        elif kind == 'zero':
            J = np.zeros((m, n))
        elif kind == 'tall':
            J = rng.standard_normal((n + 2, n))
        levels.append((J, rng.standard_normal(len(J))))
    return n, levels


def well_conditioned(n, levels):
    """Say whether no direction of any level is nearly, but not quite, taken by those above."""
    for index, (J, _) in enumerate(levels):
        s = np.linalg.svd(J @ projector(levels[:index], n), compute_uv=False)
        size = np.linalg.norm(J)
        if ((s > 1e-11 * size) & (s < 1e-3 * size)).any():
            return False
    return True


# Lexicographic least squares

@given(stacks())
def test_every_level_is_met_as_closely_as_the_levels_above_allow(stack):
    n, levels = stack
    assume(levels and well_conditioned(n, levels))
    solution = solve(levels)
    exact = lexicographic(levels, n)
    np.testing.assert_allclose(solution.velocity, exact, rtol=0,
                               atol=1e-9 * max(1.0, np.abs(exact).max()))
    np.testing.assert_allclose(residual_norms(levels, solution.velocity),
                               residual_norms(levels, exact), **EXACT)


@given(stacks(max_joints=12), SEEDS)
def test_weighted_solution_is_optimal_in_the_weighted_norm(stack, seed):
    n, levels = stack
    assume(levels and well_conditioned(n, levels))
    weights = np.random.default_rng(seed).uniform(0.2, 5.0, n)
    velocity = solve(levels, weights=weights).velocity
    exact = lexicographic(levels, n, weights)
    np.testing.assert_allclose(velocity, exact, rtol=0,
                               atol=1e-8 * max(1.0, np.abs(exact).max()))


@given(stacks(max_joints=10, max_levels=4), st.sampled_from([0.0, 0.1, 1.0]),
       st.sampled_from([0.1, 1.0, math.inf]), st.booleans())
def test_no_level_is_disturbed_by_the_levels_below_it(stack, damping, region, weighted):
    n, levels = stack
    assume(levels and well_conditioned(n, levels))
    options = {'damping': damping, 'singular_region': region,
               'weights': np.linspace(0.5, 3.0, n) if weighted else None}
    whole = solve(levels, **options).velocity
    for count in range(1, len(levels)):
        alone = solve(levels[:count], **options).velocity
        for J, _ in levels[:count]:
            size = max(np.linalg.norm(J) * np.linalg.norm(alone), 1.0)
            assert np.linalg.norm(J @ whole - J @ alone) < 1e-9 * size


def test_three_compatible_levels_none_of_them_a_posture_are_all_met():
    rng = np.random.default_rng(3)
    for rows in ([2, 2, 2], [3, 1, 2], [1, 4, 1], [1, 1, 1]):
        levels = random_levels(rng, 8, rows)
        for options in ({}, {'weights': np.ones(8)}):
            solution = solve(levels, **options)
            for (J, v), level in zip(levels, solution.levels):
                np.testing.assert_allclose(J @ solution.velocity, v, **EXACT)
                assert np.linalg.norm(level.residual) < 1e-9
                assert level.rank == len(v)


def test_one_task_moves_at_the_speed_it_asks_for_not_at_twice_that():
    assert solve([([[1.0, 0.0]], [0.5])]).velocity == pytest.approx([0.5, 0.0])
    assert solve([([[1.0, 0.0]], [0.5])], weights=[1, 1]).velocity == pytest.approx([0.5, 0.0])


def test_conflicting_level_gives_way_and_takes_the_closest_it_can():
    # x + y = 1 first; then (x, y) = (1, 1), whose closest point on the line is (0.5, 0.5).
    solution = solve([([[1.0, 1.0]], [1.0]), (np.eye(2), [1.0, 1.0])])
    assert solution.velocity == pytest.approx([0.5, 0.5])
    assert solution.levels[1].residual == pytest.approx([0.5, 0.5])
    assert solution.levels[1].rank == 1


@given(SEEDS, st.integers(2, 20), st.floats(-1e3, 1e3))
def test_repeating_a_level_with_another_wish_changes_nothing(seed, n, wish):
    rng = np.random.default_rng(seed)
    (J, v), below = random_levels(rng, n, [n // 2, 1])
    once = solve([(J, v), below]).velocity
    twice = solve([(J, v), (J, v + wish), below]).velocity
    np.testing.assert_allclose(twice, once, rtol=1e-8, atol=1e-9 * max(1.0, abs(once).max()))


def test_level_hidden_in_the_levels_above_stays_finite():
    # What is left of the second level is rounding errors only; measured by itself it would
    # count as full rank, and its inverse would be a velocity of 1e16.
    rng = np.random.default_rng(0)
    for _ in range(50):
        J, v = rng.standard_normal((3, 6)), rng.standard_normal(3)
        mixed = rng.standard_normal((3, 3)) @ J
        solution = solve([(J, v), (mixed, rng.standard_normal(3))])
        assert np.abs(solution.velocity).max() < 100.0
        np.testing.assert_allclose(J @ solution.velocity, v, **EXACT)
        assert solution.levels[1].rank == 0
        assert solution.levels[1].smallest_singular_value < 1e-12


@pytest.mark.parametrize('levels, n', [
    ([], 0),
    ([(np.zeros((0, 3)), np.zeros(0))], 3),
    ([(np.zeros((2, 3)), np.ones(2))], 3),
    ([(np.zeros((0, 3)), np.zeros(0)), (np.zeros((1, 3)), np.ones(1))], 3),
])
def test_levels_without_a_direction_give_no_motion(levels, n):
    solution = solve(levels)
    assert solution.velocity.tolist() == [0.0] * n
    assert [level.rank for level in solution.levels] == [0] * len(levels)


def test_empty_stack_takes_the_number_of_joints_from_the_bounds():
    assert solve([], -np.ones(4), np.ones(4)).velocity.tolist() == [0.0] * 4
    assert solve([]).scale == 1.0


def test_level_without_rows_leaves_the_others_as_they_are():
    rng = np.random.default_rng(1)
    first, second = random_levels(rng, 5, [2, 2])
    empty = (np.zeros((0, 5)), np.zeros(0))
    np.testing.assert_allclose(solve([empty, first, empty, second]).velocity,
                               solve([first, second]).velocity, **EXACT)


# The two ways to the same answer

@st.composite
def easy_stacks(draw):
    """Return (n, levels, closing): independent rows, most of them well conditioned."""
    n = draw(st.integers(2, 24))
    rng = np.random.default_rng(draw(SEEDS))
    rows, left = [], n - 1
    for _ in range(draw(st.integers(1, 4))):
        if left > 0:
            rows.append(draw(st.integers(1, left)))
            left -= rows[-1]
    return n, random_levels(rng, n, rows), rng.standard_normal(n)


@given(easy_stacks(), st.booleans(), st.sampled_from([(0.0, math.inf), (0.1, 0.1), (0.5, 0.2),
                                                      (0.3, 2.0), (0.1, math.inf)]))
def test_short_way_agrees_with_the_recursion_wherever_it_answers(stack, closed, damped):
    n, levels, closing = stack
    damping, region = damped
    levels = [Level(J, v) for J, v in levels]
    if closed:
        levels.append(Level(identity(n), closing))
    short = solve_stacked(levels, n, Damping(damping, region, 0.0))
    assume(short is not None)
    # With weights, even equal ones, the recursion is taken.
    long = solve(levels, weights=np.ones(n), damping=damping, singular_region=region).velocity
    np.testing.assert_allclose(short, long, rtol=0, atol=1e-9 * max(1.0, np.abs(long).max()))


def test_short_way_answers_where_rows_are_independent():
    rng = np.random.default_rng(5)
    levels = [Level(J, v) for J, v in random_levels(rng, 7, [3, 2])]
    assert solve_stacked(levels, 7, UNDAMPED) is not None
    assert solve_stacked([*levels, Level(identity(7), np.ones(7))], 7, UNDAMPED) is not None


def test_short_way_leaves_singular_and_damped_levels_to_the_recursion():
    J = np.array([[1.0, 0.0, 0.0], [1.0, 1e-3, 0.0]])
    level = Level(J, np.ones(2))
    assert solve_stacked([level], 3, UNDAMPED) is None
    assert solve_stacked([Level(J[:1], np.ones(1))] * 2, 3, UNDAMPED) is None
    assert solve_stacked([Level(np.eye(3)[:2], np.ones(2))], 3,
                         Damping(0.1, math.inf, 0.0)) is None
    assert solve_stacked([Level(0.1 * np.eye(3)[:2], np.ones(2))], 3,
                         Damping(0.1, 0.2, 0.0)) is None
    assert solve_stacked([Level(np.ones((4, 3)), np.ones(4))], 3, UNDAMPED) is None


def test_short_way_is_not_tried_again_while_bounds_are_in_the_way(monkeypatch):
    tries = []
    monkeypatch.setattr(sys.modules['tp_controller.solver.solve'], 'solve_stacked',
                        lambda *given: tries.append(given) or solve_stacked(*given))
    rng = np.random.default_rng(5)
    levels = [Level(J, v) for J, v in random_levels(rng, 7, [3, 2])]
    free = solve(levels, scaling='redistribute').velocity
    tight, wide = 0.9 * np.abs(free).max(), 1.1 * np.abs(free).max()
    solving = Solver(7, damping=0.0, scaling='redistribute', singular_region=math.inf,
                    release_region=0.0, regularisation=0.0, period=0.0, method='recursive',
                    rank_tolerance=RANK_TOLERANCE)
    counts = []
    for bound in (wide, tight, tight, wide, wide):
        tries.clear()
        velocity = solving.solve(levels, np.full(7, -bound), np.full(7, bound)).velocity
        counts.append(len(tries))
        assert np.abs(velocity).max() <= bound
        if bound == wide:
            np.testing.assert_allclose(velocity, free, rtol=0, atol=1e-12)
    assert counts == [1, 1, 0, 0, 1]


@pytest.mark.parametrize('damping, region', [
    (0.0, math.inf), (0.1, 0.1), (0.5, 2.0), (0.5, math.inf)])
def test_closing_level_is_the_same_whether_it_is_recognised_or_not(damping, region):
    rng = np.random.default_rng(8)
    for rows in ([], [2], [2, 3]):
        above = [(3.0 * J, v) for J, v in random_levels(rng, 6, rows)]
        posture = rng.standard_normal(6)
        recognised = solve([*above, Level(identity(6), posture)], damping=damping,
                           singular_region=region)
        plain = solve([*above, (np.eye(6), posture)], damping=damping, singular_region=region)
        np.testing.assert_allclose(recognised.velocity, plain.velocity, **EXACT)
        for one, other in zip(recognised.levels, plain.levels):
            np.testing.assert_allclose(one.residual, other.residual, **EXACT)
            assert one.rank == other.rank


def test_answer_is_no_window_into_what_was_handed_in():
    posture = np.ones(3)
    velocity = solve([Level(identity(3), posture)]).velocity
    velocity[0] = 7.0
    assert posture[0] == 1.0
    with pytest.raises(ValueError, match='read-only'):
        identity(3)[0, 0] = 2.0


# Damping

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
    velocity = solve([(J, [1.0, 1.0])], damping=0.2, singular_region=0.5).velocity
    assert velocity == pytest.approx([1.0, gain, 0.0], rel=1e-12)


def test_damping_bounds_the_velocity_near_a_singularity():
    for s in np.logspace(-12, 0, 60):
        velocity = solve([([[s, 0.0]], [1.0])], damping=0.1, singular_region=0.1).velocity
        assert 0.0 <= velocity[0] <= 10.0 + 1e-9


def test_damping_never_leaks_into_the_projector():
    J = np.array([[1.0, 0.0, 0.0], [0.0, 0.03, 0.0]])
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


# Weights

@given(SEEDS, st.integers(2, 12))
def test_weighted_inverse_is_the_explicit_formula(seed, n):
    rng = np.random.default_rng(seed)
    (J, v), = random_levels(rng, n, [(n + 1) // 2])
    weights = rng.uniform(0.1, 10.0, n)
    W_inverse = np.diag(1.0 / weights)
    explicit = W_inverse @ J.T @ np.linalg.solve(J @ W_inverse @ J.T, v)
    np.testing.assert_allclose(solve([(J, v)], weights=weights).velocity, explicit,
                               rtol=1e-7, atol=1e-9 * np.abs(explicit).max())


def test_costly_joint_is_used_less():
    velocity = solve([([[1.0, 1.0]], [1.0])], weights=[1.0, 4.0]).velocity
    assert velocity == pytest.approx([0.8, 0.2])


@given(SEEDS, st.floats(1e-3, 1e3), st.sampled_from([0.0, 0.3]))
def test_only_ratios_of_weights_matter(seed, factor, damping):
    rng = np.random.default_rng(seed)
    levels = random_levels(rng, 6, [2, 2])
    weights = rng.uniform(0.5, 2.0, 6)
    np.testing.assert_allclose(
        solve(levels, weights=factor * weights, damping=damping).velocity,
        solve(levels, weights=weights, damping=damping).velocity, **EXACT)
    np.testing.assert_allclose(solve(levels, weights=np.full(6, factor), damping=damping).velocity,
                               solve(levels, damping=damping).velocity, **EXACT)


# Bounds

def bounded(velocity, lower, upper):
    """Return the solution of joints that want a velocity within bounds."""
    return solve([(np.eye(len(velocity)), velocity)], lower, upper)


@given(st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(0, 10), st.floats(0, 10)),
                min_size=1, max_size=8))
@example([(49.0, 1.0, 1.0)])
@example([(-49.0, 1.0, 1.0), (0.1, 1.0, 1.0)])
@example([(1.0, 2.0, 2.0), (1e-17, 1.0, 0.0)])
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


@given(st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(-10, 10), st.floats(0, 10)),
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
    np.testing.assert_allclose(solution.velocity - slowest, solution.scale * way, rtol=1e-9,
                               atol=3e-9 * np.abs(way).max() + 1e-300)
    # No larger factor would do.
    if solution.scale < 1.0:
        beyond = slowest + min(1.0, solution.scale + 1e-6) * way
        assert (beyond > upper).any() or (beyond < lower).any()
    else:
        assert ((velocity >= lower - 1e-8 * np.abs(way).max())
                & (velocity <= upper + 1e-8 * np.abs(way).max())).all()


def test_braking_joint_is_where_uniform_scaling_begins():
    # Joint 1 must move at least 0.2; from (0.2, 0) to (1, 2) the second bound is met half way.
    solution = bounded([1.0, 2.0], [0.2, -1.0], [2.0, 1.0])
    assert solution.velocity == pytest.approx([0.6, 1.0])
    assert (solution.scale, solution.limiting) == (0.5, 1)


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


def test_scaling_keeps_the_direction_of_every_task():
    levels = random_levels(np.random.default_rng(11), 6, [2, 2])
    free = solve(levels)
    solution = solve(levels, np.full(6, -0.1), np.full(6, 0.1))
    for level, unscaled in zip(solution.levels, free.levels):
        np.testing.assert_allclose(level.achieved, solution.scale * unscaled.achieved, **EXACT)
        assert level.scale == solution.scale < 1.0


# The sequential form

def test_sequential_form_is_the_formula_of_the_slides():
    rng = np.random.default_rng(4)
    for rows in ([2], [2, 2], [1, 2, 1], [2, 1, 1, 3]):
        levels = random_levels(rng, 7, rows)
        velocity, P = np.zeros(7), np.eye(7)
        for J, v in levels:
            velocity = velocity + P @ np.linalg.pinv(J) @ v
            P = P @ (np.eye(7) - np.linalg.pinv(J) @ J)
        np.testing.assert_allclose(solve(levels, method='sequential').velocity, velocity, **EXACT)


def test_sequential_form_keeps_the_first_priority():
    for seed in range(20):
        levels = random_levels(np.random.default_rng(seed), 7, [2, 2, 2])
        for weights in (None, np.linspace(1, 3, 7)):
            solution = solve(levels, method='sequential', weights=weights)
            np.testing.assert_allclose(levels[0][0] @ solution.velocity, levels[0][1], **EXACT)


def test_sequential_form_fails_a_second_level_that_the_recursion_meets():
    levels = [([[1.0, 0.0]], [0.0]), ([[1.0, 1.0]], [1.0])]
    assert solve(levels).velocity == pytest.approx([0.0, 1.0])
    assert solve(levels, method='sequential').velocity == pytest.approx([0.0, 0.5])


@pytest.mark.parametrize('degrees, share', [(60, 0.75), (30, 0.25), (10, 0.030)])
def test_sequential_form_carries_out_the_squared_sine_of_the_angle_between_tasks(degrees, share):
    angle = math.radians(degrees)
    J1, J2 = np.array([[1.0, 0.0]]), np.array([[math.cos(angle), math.sin(angle)]])
    levels = [(J1, [0.0]), (J2, [1.0])]
    assert J2 @ solve(levels, method='sequential').velocity == pytest.approx(share, abs=5e-4)
    assert J2 @ solve(levels).velocity == pytest.approx(1.0)


def test_both_forms_agree_where_the_tasks_are_orthogonal():
    rng = np.random.default_rng(9)
    Q = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    levels = [(Q[:2], rng.standard_normal(2)), (Q[2:4], rng.standard_normal(2)),
              (Q[4:5], rng.standard_normal(1))]
    np.testing.assert_allclose(solve(levels, method='sequential').velocity,
                               solve(levels).velocity, **EXACT)


# What the solution says about each level

@given(stacks(max_joints=9, max_levels=4), st.sampled_from([0.0, 0.2]), st.booleans())
def test_solution_tells_rank_and_smallest_singular_value_of_each_level(stack, damping, scaled):
    n, levels = stack
    assume(levels and well_conditioned(n, levels))
    bounds = (np.full(n, -0.2), np.full(n, 0.2)) if scaled else (None, None)
    solution = solve(levels, *bounds, damping=damping)
    assert len(solution.levels) == len(levels)
    for index, ((J, v), level) in enumerate(zip(levels, solution.levels)):
        s = np.linalg.svd(J @ projector(levels[:index], n), compute_uv=False)
        assert level.rank == (s > 1e-9 * np.linalg.norm(J)).sum()
        smallest = s[-1] if 0 < len(v) <= n else 0.0
        assert level.smallest_singular_value == pytest.approx(smallest, abs=1e-9)
        np.testing.assert_allclose(level.wanted, v)
        np.testing.assert_allclose(level.achieved, J @ solution.velocity, **EXACT)
        np.testing.assert_allclose(level.residual, v - J @ solution.velocity, **EXACT)
        assert level.scale == solution.scale


def test_solution_of_the_short_way_tells_the_same():
    levels = random_levels(np.random.default_rng(6), 7, [3, 2])
    levels = [Level(J, v) for J, v in levels] + [Level(identity(7), np.ones(7))]
    short, long = solve(levels), solve(levels, weights=np.ones(7))
    for one, other in zip(short.levels, long.levels):
        assert one.rank == other.rank
        assert one.smallest_singular_value == pytest.approx(other.smallest_singular_value)
    assert [level.rank for level in short.levels] == [3, 2, 2]


# Invariance

@given(SEEDS, st.permutations(range(7)))
def test_order_of_the_joints_does_not_matter(seed, order):
    order = np.array(order)
    levels = random_levels(np.random.default_rng(seed), 7, [2, 3])
    permuted = [(J[:, order], v) for J, v in levels]
    np.testing.assert_allclose(solve(permuted).velocity, solve(levels).velocity[order], **EXACT)


@given(SEEDS, st.integers(0, 5), st.floats(0.01, 100.0))
def test_unit_of_a_joint_does_not_matter_with_weights_to_match(seed, joint, factor):
    levels = random_levels(np.random.default_rng(seed), 6, [2, 2])
    units = np.ones(6)
    units[joint] = factor
    rescaled = [(J / units, v) for J, v in levels]
    velocity = solve(levels, weights=np.ones(6)).velocity
    np.testing.assert_allclose(solve(rescaled, weights=1.0 / units ** 2).velocity / units,
                               velocity, rtol=0, atol=1e-8 * np.abs(velocity).max())


@given(SEEDS, st.floats(0.01, 100.0))
def test_unit_of_a_row_does_not_matter_to_levels_that_can_be_met(seed, factor):
    levels = random_levels(np.random.default_rng(seed), 6, [2, 2])
    scale = np.array([factor, 1.0])
    rescaled = [levels[0], (levels[1][0] * scale[:, None], levels[1][1] * scale)]
    velocity = solve(levels).velocity
    np.testing.assert_allclose(solve(rescaled).velocity, velocity, rtol=0,
                               atol=1e-8 * np.abs(velocity).max())


@given(stacks(max_joints=8))
def test_same_levels_give_the_same_velocity_to_the_last_digit(stack):
    _, levels = stack
    one, other = solve(levels), solve([(J.copy(), v.copy()) for J, v in levels])
    assert one.velocity.tolist() == other.velocity.tolist()


def test_closing_level_settles_exactly_what_the_others_leave_free():
    rng = np.random.default_rng(12)
    levels = random_levels(rng, 6, [2, 1])
    posture = rng.standard_normal(6)
    velocity = solve([*levels, Level(identity(6), posture)]).velocity
    free = null_of(np.concatenate([J for J, _ in levels]))
    np.testing.assert_allclose(free.T @ velocity, free.T @ posture, **EXACT)


# Errors

@pytest.mark.parametrize('levels, message', [
    ([(np.eye(2), np.ones(3))], 'level 1: J must be'),
    ([(np.ones(2), np.ones(2))], 'level 1: J must be'),
    ([(np.eye(2), np.ones((2, 1)))], 'level 1: J must be'),
    ([(np.eye(2), np.ones(2)), (np.eye(3), np.ones(3))], r'number of joints: \[2, 3\]'),
    ([(np.eye(2), np.ones(2)), 5], 'level 2: needs J'),
    ([([[1.0, 2.0], [3.0]], [1.0, 2.0])], 'level 1: J must be'),
    ([(np.eye(2), ['a', 'b'])], 'level 1: J must be'),
    ([Level(np.eye(2))], 'level 1: needs v, or a bound'),
    ([Level(np.eye(2), np.ones(2)), Level(np.eye(2), np.ones(2), lower=np.zeros(2))],
     'level 2: has a wanted velocity v and bounds'),
    ([Level(np.eye(2), lower=np.zeros(3))], 'level 1: bounds must be 2 numbers'),
    ([Level(np.eye(2), lower=np.zeros((2, 1)))], 'level 1: the lower bound'),
    ([Level(np.eye(2), upper=['a', 'b'])], 'level 1: the upper bound'),
    ([Level(np.eye(2), lower=[0.0, 1.0], upper=[0.0, 0.5])], 'level 1: bounds need lower ≤ upper'),
    ([Level(np.eye(2), lower=[0.0, math.nan])], 'level 1: bounds need lower ≤ upper'),
    ([Level(np.eye(2), lower=[0.0, math.inf])], 'level 1: bounds need lower ≤ upper'),
    ([Level(np.eye(2), upper=[0.0, -math.inf])], 'level 1: bounds need lower ≤ upper'),
    ([Level(np.eye(2), np.ones(2), mode='scaled')], "level 1: unknown mode.*mean 'scale'"),
    ([Level(np.eye(2), lower=np.zeros(2), mode='scale')], 'level 1: bounds have no direction'),
    ([Level(np.eye(2), lower=np.zeros(2)), (np.eye(2), np.ones(2)),
      Level(np.eye(2), np.ones(2), 'scale')], 'level 3: mode scale .* bounds of level 1 above'),
])
def test_levels_that_do_not_fit_together_are_refused(levels, message):
    with pytest.raises(SolverError, match=message):
        solve(levels)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('n, m', [(4, 1), (4, 4), (2, 5)])
def test_numbers_that_are_not_finite_are_refused(bad, n, m):
    good = (np.eye(n)[:1], np.ones(1))
    J, v = np.ones((m, n)), np.ones(m)
    v[-1] = bad
    spoilt = J.copy()
    spoilt[0, -1] = bad
    for level in ((J, v), (np.zeros((m, n)), v), (spoilt, np.ones(m))):
        with np.errstate(invalid='ignore'), pytest.raises(SolverError, match='not finite'):
            solve([good, level])


@pytest.mark.parametrize('lower, upper, message', [
    ([-1.0, -1.0], [1.0], 'joints: bounds must be 2 numbers'),
    ([-1.0] * 3, [1.0] * 3, 'joints: bounds must be 2 numbers'),
    ([-1.0], None, 'bounds must be 2 numbers'),
    (-1.0, 1.0, 'joints: the lower bound must be'),
    (None, [[1.0, 1.0]], 'joints: the upper bound must be'),
    ([0.1, -1.0], [0.0, 1.0], 'lower ≤ upper'),
    ([-1.0, math.nan], [1.0, 1.0], 'lower ≤ upper'),
    ([-1.0, -1.0], [math.nan, 1.0], 'lower ≤ upper'),
    ([-1.0, math.inf], None, 'lower ≤ upper'),
    (None, [1.0, -math.inf], 'lower ≤ upper'),
])
@pytest.mark.parametrize('scaling', SCALINGS)
def test_bounds_that_do_not_fit_are_refused(lower, upper, message, scaling):
    with pytest.raises(SolverError, match=message):
        solve([(np.eye(2), np.ones(2))], lower, upper, scaling=scaling)


@pytest.mark.parametrize('levels, message', [
    (5, 'levels must be a sequence of Level or .J, v., not 5'),
    (None, 'levels must be a sequence'),
    ([(1j * np.eye(2), np.ones(2))], 'level 1: J must be .m, n.: complex'),
    ([(1e160 * np.eye(2), np.ones(2))], 'level 1: .* beyond 1e.100'),
    ([(np.eye(2), 1e160 * np.ones(2))], 'level 1: .* beyond 1e.100'),
])
def test_what_are_no_levels_is_named(levels, message):
    with pytest.raises(SolverError, match=message):
        solve(levels)


@pytest.mark.parametrize('weights', ['ab', [[1.0], [1.0, 2.0]]])
def test_weights_that_are_no_numbers_are_refused(weights):
    with pytest.raises(SolverError, match='weights must be 2 positive numbers'):
        solve([(np.eye(2), np.ones(2))], weights=weights)


@pytest.mark.parametrize('number', [np.float32(0.5), np.int64(1), 1])
def test_numbers_of_numpy_are_numbers(number):
    one = solve([(np.eye(2), np.ones(2))], damping=number).velocity
    np.testing.assert_allclose(one, solve([(np.eye(2), np.ones(2))],
                                          damping=float(number)).velocity)


def test_speed_cap_goes_with_redistribution_only():
    with pytest.raises(SolverError, match='speed_cap needs scaling redistribute'):
        solve([(np.eye(2), np.ones(2))], scaling='uniform', speed_cap=[1.0, 1.0])


@pytest.mark.parametrize('cap', [1.0, [1.0], [1.0, math.nan], [[1.0, 1.0]], ['a', 'b'],
                                 [-1.0, 1.0]])
def test_speed_cap_that_does_not_fit_is_refused(cap):
    with pytest.raises(SolverError, match='speed_cap'):
        solve([(np.eye(2), np.ones(2))], -np.ones(2), np.ones(2), scaling='redistribute',
              speed_cap=cap)


def test_the_sequential_form_refuses_bounds_and_redistribution():
    rows = Level(np.eye(2), upper=np.ones(2))
    with pytest.raises(SolverError, match='sequential goes with scaling uniform'):
        solve([(np.eye(2), np.ones(2))], method='sequential', scaling='redistribute')
    with pytest.raises(SolverError, match='method sequential knows no levels with bounds'):
        solve([rows, (np.eye(2), np.ones(2))], method='sequential', scaling='uniform')


@given(SEEDS)
def test_uniform_scaling_slows_what_the_bounds_of_levels_left(seed):
    """Within them first, as if joints had no limits; then shorter, in the same direction."""
    rng = np.random.default_rng(seed)
    n = 6
    rows = Level(rng.normal(size=(2, n)), lower=-rng.uniform(0.1, 0.5, 2),
                 upper=rng.uniform(0.1, 0.5, 2))
    wish = (rng.normal(size=(3, n)), rng.normal(size=3))
    limit = rng.uniform(0.05, 0.5, n)
    plain = solve([wish], -limit, limit, scaling='uniform').scale
    for levels in ([rows, wish], [wish, rows]):
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
            # Bounds below never slow a wish more than it is slowed alone.
            assert solution.scale >= plain - 1e-9
            np.testing.assert_allclose(wish[0] @ solution.velocity, solution.scale * wish[1],
                                       atol=1e-9)


def test_bounds_below_a_wish_never_slow_it_when_all_joints_are_slowed_alike():
    # The row could be met with ten times the speed of joint 2.
    wish, row = ([[1.0, 0.0]], [0.5]), Level(np.array([[0.0, 0.1]]), lower=np.array([1.0]))
    solution = solve([wish, row], -np.ones(2), np.ones(2), scaling='uniform')
    assert solution.velocity == pytest.approx([0.5, 1.0]) and solution.scale == 1.0
    # A joint that may not move at all has no say in that.
    locked = solve([wish, row], [-1.0, 0.0], [1.0, 0.0], scaling='uniform')
    assert locked.velocity.tolist() == [0.0, 0.0]


@pytest.mark.parametrize('weights', [[1.0], [1.0, 0.0], [1.0, -1.0], [1.0, math.nan],
                                     [1.0, math.inf], [[1.0, 1.0]]])
def test_weights_that_are_not_positive_numbers_are_refused(weights):
    with pytest.raises(SolverError, match='2 positive numbers'):
        solve([(np.eye(2), np.ones(2))], weights=weights)


def test_unknown_method_and_scaling_are_refused_with_the_valid_ones():
    with pytest.raises(SolverError, match='did you mean.*recursive'):
        solve([(np.eye(2), np.ones(2))], method='recursiv')
    with pytest.raises(SolverError, match='valid: redistribute, uniform'):
        solve([(np.eye(2), np.ones(2))], scaling='clip')


@pytest.mark.parametrize('options', [
    {'damping': math.nan}, {'damping': -1.0}, {'damping': math.inf}, {'damping': 'x'},
    {'singular_region': math.nan}, {'singular_region': -0.1}, {'rank_tolerance': -1.0},
    {'release_region': math.inf}, {'release_region': -0.1}, {'regularisation': math.nan},
    {'regularisation': -0.1}, {'regularisation': True}, {'damping': [0.1]},
])
def test_options_that_make_no_sense_are_named(options):
    with pytest.raises(SolverError, match=next(iter(options))):
        solve([(np.eye(2), np.ones(2))], **options)


def test_level_may_hold_lists():
    assert solve([Level([[1.0, 1.0]], [1.0])]).velocity == pytest.approx([0.5, 0.5])


def test_empty_stack_with_weights_gives_no_motion():
    assert solve([], weights=[1.0, 2.0, 3.0]).velocity.tolist() == [0.0, 0.0, 0.0]
