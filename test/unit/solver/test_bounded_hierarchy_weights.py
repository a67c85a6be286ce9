# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Weights of rows decide which of them are missed, and change nothing where all are met."""

from dataclasses import replace

from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
from problems import hierarchies, near, redistribute, SEEDS, well_conditioned
import pytest
from reference import bounded_lexicographic
from tp_controller import Level, solve, SolverError


def weighted(hierarchy, weights):
    """Return levels with weights, and a hierarchy whose rows are longer by their roots."""
    levels, longer = [], []
    for (J, *demand), its in zip(hierarchy, weights):
        root = np.sqrt(its / its.min())
        longer.append((root[:, np.newaxis] * J, *(root * each for each in demand)))
        named = {'v': demand[0]} if len(demand) == 1 else {'lower': demand[0], 'upper': demand[1]}
        levels.append(Level(J, weights=its, **named))
    return levels, longer


@pytest.mark.slow
@given(hierarchies(max_joints=7, max_levels=3, kinds=('symmetric',)), SEEDS, st.booleans())
@settings(max_examples=200)
def test_weighted_residuals_are_least_within_bounds(problem, seed, bounded):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    rng = np.random.default_rng(seed)
    weights = [10.0 ** rng.uniform(-1.5, 1.5, len(J)) for J, *_ in hierarchy]
    levels, longer = weighted(hierarchy, weights)
    bounds = (lower, upper) if bounded else (None, None)
    expected = bounded_lexicographic(longer, n, *bounds)
    np.testing.assert_allclose(redistribute(levels, *bounds).velocity, expected, rtol=0, atol=1e-7)


@pytest.mark.parametrize('ratio', 10.0 ** np.arange(-6.0, 7.0, 2.0))
@pytest.mark.parametrize('bounds', [(), ([-2.0] * 2, [0.5, 2.0])])
def test_weights_are_exact_for_any_ratio(ratio, bounds):
    # x_1 = 0 and x_1 = 1 contradict each other; x_1 + x_2 = 1 can be met.
    J, v = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), np.array([0.0, 1.0, 1.0])
    x = redistribute([Level(J, v, weights=np.array([1.0, ratio, 1.0]))], *bounds).velocity
    best = ratio / (1.0 + ratio)
    first = min(best, 0.5) if bounds else best
    np.testing.assert_allclose(x, [first, 1.0 - first], rtol=0, atol=1e-9)


@given(SEEDS)
@settings(max_examples=50)
def test_weights_change_nothing_where_all_rows_are_met(seed):
    rng = np.random.default_rng(seed)
    J, v = rng.standard_normal((3, 6)), rng.standard_normal(3)
    below = Level(rng.standard_normal((2, 6)), rng.standard_normal(2))
    plain = solve([Level(J, v), below]).velocity
    x = solve([Level(J, v, weights=10.0 ** rng.uniform(-6.0, 6.0, 3)), below]).velocity
    np.testing.assert_allclose(x, plain, rtol=0, atol=1e-9)


def test_posture_moves_the_joints_of_little_weight():
    # A tool that both joints move alike, and a posture that both are to stay at.
    tool, stay = Level(np.ones((1, 2)), np.array([3.0])), Level(np.eye(2), np.zeros(2))
    assert solve([tool, stay]).velocity.tolist() == near([1.5, 1.5])
    x = solve([tool, replace(stay, weights=np.array([2.0, 1.0]))]).velocity
    assert x.tolist() == near([1.0, 2.0])
    solution = solve([tool, replace(stay, weights=np.array([2.0, 1.0]))])
    assert solution.levels[1].unreachable.tolist() == near([-1.0, -2.0])


def test_mode_scale_keeps_the_direction_of_the_weighted_projection():
    # Rows 1 and 2 demand 0 and 4 of joint 1, with weights 1 and 3: that is 3.
    J, v = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([0.0, 4.0, 2.0])
    x = redistribute([Level(J, v, 'scale', weights=np.array([1.0, 3.0, 1.0]))],
                     [-9.0, -1.0], [9.0, 1.0]).velocity
    assert x.tolist() == near([1.5, 1.0])


@pytest.mark.parametrize('factor', [1e-5, 1.0, 1e5])
def test_only_ratios_of_weights_matter_and_equal_ones_are_none(factor):
    J, v = np.array([[1.0], [1.0]]), np.array([0.0, 4.0])
    box = [-1.0], [1.0]
    plain = redistribute([Level(J, v)], *box, period=0.01)
    equal = redistribute([Level(J, v, weights=np.full(2, factor))], *box, period=0.01)
    assert equal.velocity.tolist() == near(plain.velocity)
    assert equal.memory == pytest.approx(plain.memory)


@pytest.mark.parametrize('weights', [[1.0], [1.0, 0.0], [1.0, -1.0], [1.0, np.nan], 'equal',
                                     [1.0, 1e13], [[1.0, 1.0]], [np.inf, 1.0]])
def test_weights_must_be_one_positive_number_for_each_row(weights):
    with pytest.raises(SolverError, match='level 1: weights must be'):
        solve([Level([[1.0], [1.0]], [1.0, 2.0], weights=weights)])
