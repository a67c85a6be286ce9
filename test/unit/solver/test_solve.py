# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The whole solver, against references that share no code with it."""

import math

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
from problems import by_loop, EXACT, SEEDS, stacks, well_conditioned
import pytest
from reference import lexicographic, null_of, random_levels, residual_norms
from tp_controller import Level, solve, SolverError
from tp_controller.solver.level import identity
from tp_controller.solver.solve import SCALINGS

# Lexicographic least squares


@pytest.mark.slow
@given(stacks())
def test_every_level_is_met_as_closely_as_the_levels_above_allow(stack):
    n, levels = stack
    assume(levels and well_conditioned(n, levels, 1e-3))
    solution = solve(levels)
    exact = lexicographic(levels, n)
    np.testing.assert_allclose(solution.velocity, exact, rtol=0,
                               atol=1e-9 * max(1.0, np.abs(exact).max()))
    np.testing.assert_allclose(residual_norms(levels, solution.velocity),
                               residual_norms(levels, exact), **EXACT)


@pytest.mark.slow
@given(stacks(max_joints=10, max_levels=4), st.sampled_from([0.0, 0.1, 1.0]),
       st.sampled_from([0.1, 1.0, math.inf]), st.booleans())
def test_no_level_is_disturbed_by_the_levels_below_it(stack, damping, region, weighted):
    n, levels = stack
    assume(levels and well_conditioned(n, levels, 1e-3))
    options = {'damping': damping, 'singular_region': region,
               'weights': np.linspace(0.5, 3.0, n) if weighted else None}
    whole = solve(levels, **options).velocity
    for count in range(1, len(levels)):
        alone = solve(levels[:count], **options).velocity
        for J, _ in levels[:count]:
            size = max(np.linalg.norm(J) * np.linalg.norm(alone), 1.0)
            assert np.linalg.norm(J @ whole - J @ alone) < 1e-9 * size


@pytest.mark.parametrize('by', [solve, by_loop])
def test_three_compatible_levels_none_of_them_a_posture_are_all_met(by):
    rng = np.random.default_rng(3)
    for rows in ([2, 2, 2], [3, 1, 2], [1, 4, 1], [1, 1, 1]):
        levels = random_levels(rng, 8, rows)
        for options in ({}, {'weights': np.ones(8)}):
            solution = by(levels, **options)
            for (J, v), level in zip(levels, solution.levels):
                np.testing.assert_allclose(J @ solution.velocity, v, **EXACT)
                assert np.linalg.norm(level.residual) < 1e-9
                assert level.rank == len(v)


def test_one_task_moves_at_the_speed_it_demands_not_at_twice_that():
    assert solve([([[1.0, 0.0]], [0.5])]).velocity == pytest.approx([0.5, 0.0])
    assert solve([([[1.0, 0.0]], [0.5])], weights=[1, 1]).velocity == pytest.approx([0.5, 0.0])


def test_conflicting_level_gives_way_and_takes_the_closest_it_can():
    # x + y = 1 first; then (x, y) = (1, 1), whose closest point on the line is (0.5, 0.5).
    solution = solve([([[1.0, 1.0]], [1.0]), (np.eye(2), [1.0, 1.0])])
    assert solution.velocity == pytest.approx([0.5, 0.5])
    assert solution.levels[1].residual == pytest.approx([0.5, 0.5])
    assert solution.levels[1].rank == 1


@given(SEEDS, st.integers(2, 20), st.floats(-1e3, 1e3))
def test_repeating_a_level_with_another_demand_changes_nothing(seed, n, offset):
    rng = np.random.default_rng(seed)
    (J, v), below = random_levels(rng, n, [n // 2, 1])
    once = solve([(J, v), below]).velocity
    twice = solve([(J, v), (J, v + offset), below]).velocity
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


def test_empty_stack_with_weights_gives_no_motion():
    assert solve([], weights=[1.0, 2.0, 3.0]).velocity.tolist() == [0.0, 0.0, 0.0]


def test_level_without_rows_leaves_the_others_as_they_are():
    rng = np.random.default_rng(1)
    first, second = random_levels(rng, 5, [2, 2])
    empty = (np.zeros((0, 5)), np.zeros(0))
    np.testing.assert_allclose(solve([empty, first, empty, second]).velocity,
                               solve([first, second]).velocity, **EXACT)


def test_closing_level_settles_exactly_what_the_others_leave_free():
    rng = np.random.default_rng(12)
    levels = random_levels(rng, 6, [2, 1])
    posture = rng.standard_normal(6)
    velocity = solve([*levels, Level.of_joints(posture)]).velocity
    free = null_of(np.concatenate([J for J, _ in levels]))
    np.testing.assert_allclose(free.T @ velocity, free.T @ posture, **EXACT)


# Weights

@pytest.mark.slow
@given(stacks(max_joints=12), SEEDS)
def test_weighted_solution_is_optimal_in_the_weighted_norm(stack, seed):
    n, levels = stack
    assume(levels and well_conditioned(n, levels, 1e-3))
    weights = np.random.default_rng(seed).uniform(0.2, 5.0, n)
    velocity = solve(levels, weights=weights).velocity
    exact = lexicographic(levels, n, weights)
    np.testing.assert_allclose(velocity, exact, rtol=0,
                               atol=1e-8 * max(1.0, np.abs(exact).max()))


@pytest.mark.slow
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


@pytest.mark.slow
@given(stacks(max_joints=8))
def test_same_levels_give_the_same_velocity_to_the_last_digit(stack):
    _, levels = stack
    one, other = solve(levels), solve([(J.copy(), v.copy()) for J, v in levels])
    assert one.velocity.tolist() == other.velocity.tolist()


def test_answer_is_no_window_into_what_was_handed_in():
    posture = np.ones(3)
    velocity = solve([Level.of_joints(posture)]).velocity
    velocity[0] = 7.0
    assert posture[0] == 1.0
    with pytest.raises(ValueError, match='read-only'):
        identity(3)[0, 0] = 2.0


# Errors

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


@pytest.mark.parametrize('weights', ['ab', [[1.0], [1.0, 2.0]]])
def test_weights_that_are_no_numbers_are_refused(weights):
    with pytest.raises(SolverError, match='weights must be 2 positive numbers'):
        solve([(np.eye(2), np.ones(2))], weights=weights)


@pytest.mark.parametrize('weights', [[1.0], [1.0, 0.0], [1.0, -1.0], [1.0, math.nan],
                                     [1.0, math.inf], [[1.0, 1.0]]])
def test_weights_that_are_not_positive_numbers_are_refused(weights):
    with pytest.raises(SolverError, match='2 positive numbers'):
        solve([(np.eye(2), np.ones(2))], weights=weights)


@pytest.mark.parametrize('weights', [[1e-300, 1e9], [1.0, 1.1e12]])
def test_weights_that_rounding_would_decide_on_are_refused(weights):
    with pytest.raises(SolverError, match='within a factor of 1e'):
        solve([(np.eye(2), np.ones(2))], weights=weights)
    assert solve([([[1.0, 1.0]], [1.0])], weights=[1.0, 0.9e12]).velocity[0] == pytest.approx(1.0)


@pytest.mark.parametrize('number', [np.float32(0.5), np.int64(1), 1])
def test_numbers_of_numpy_are_numbers(number):
    one = solve([(np.eye(2), np.ones(2))], damping=number).velocity
    np.testing.assert_allclose(one, solve([(np.eye(2), np.ones(2))],
                                          damping=float(number)).velocity)


def test_speed_cap_counts_from_what_the_first_level_uses():
    # The first level takes 0.8 of joint 1; the second may use 0.5 of joint 3, not of what it used.
    levels = [([[2.0, 1.0, 0.0]], [2.0]), ([[1.0, 0.0, 1.0]], [0.7]),
              (np.eye(3), [0.8, 0.4, -0.1])]
    solution = solve(levels, -np.ones(3), np.ones(3), scaling='redistribute',
                     speed_cap=np.full(3, 0.5))
    assert solution.velocity == pytest.approx([0.8, 0.4, -0.1])


def test_speed_cap_goes_with_redistribution_only():
    with pytest.raises(SolverError, match='speed_cap needs scaling redistribute'):
        solve([(np.eye(2), np.ones(2))], scaling='uniform', speed_cap=[1.0, 1.0])


@pytest.mark.parametrize('cap', [1.0, [1.0], [1.0, math.nan], [[1.0, 1.0]], ['a', 'b'],
                                 [-1.0, 1.0]])
def test_speed_cap_that_does_not_fit_is_refused(cap):
    with pytest.raises(SolverError, match='speed_cap'):
        solve([(np.eye(2), np.ones(2))], -np.ones(2), np.ones(2), scaling='redistribute',
              speed_cap=cap)


def test_unknown_scaling_is_refused_with_the_valid_ones():
    with pytest.raises(SolverError, match='valid: redistribute, uniform'):
        solve([(np.eye(2), np.ones(2))], scaling='clip')


@pytest.mark.parametrize('options', [
    {'damping': math.nan}, {'damping': -1.0}, {'damping': math.inf}, {'damping': 'x'},
    {'singular_region': math.nan}, {'singular_region': -0.1},
    {'release_region': math.inf}, {'release_region': -0.1}, {'regularisation': math.nan},
    {'regularisation': -0.1}, {'regularisation': True}, {'damping': [0.1]},
])
def test_options_that_make_no_sense_are_named(options):
    with pytest.raises(SolverError, match=next(iter(options))):
        solve([(np.eye(2), np.ones(2))], **options)


@pytest.mark.parametrize('h', [-1.0, np.nan, np.inf, None, np.ones(2), 'hard'])
def test_memory_that_is_no_number_is_refused(h):
    levels = [(np.eye(2), np.ones(2)), (np.eye(2), np.zeros(2))]
    with pytest.raises(SolverError, match='memory of level 2 must be a number'):
        solve(levels, period=0.01, memory=(0.0, h))
