# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A level with a mask moves its joints only, and its whole Jacobian is kept below it."""

from dataclasses import replace

from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
from problems import (
    as_levels,
    hierarchies,
    misses,
    near,
    random_mask,
    redistribute,
    SEEDS,
)
import pytest
from reference import masked_lexicographic, null_of
from tp_controller import Level, solve, SolverError
from tp_controller.solver.level import check_levels
from tp_controller.solver.solution import Solution

# A tool in the plane that two joints move along x, and one along y.
TOOL = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
FIRST = np.array([True, False, True])


def level(J, v, *joints, **options):
    """Return a level that moves these joints only."""
    J = np.atleast_2d(np.asarray(J, float))
    mask = np.isin(np.arange(J.shape[1]), joints)
    return Level(J, np.atleast_1d(np.asarray(v, float)), joints=mask, **options)


@st.composite
def masked_hierarchies(draw):
    """Return (n, hierarchy of `masked_lexicographic`, lower, upper, weights)."""
    n, hierarchy, lower, upper = draw(hierarchies(max_joints=8, max_levels=4))
    rng = np.random.default_rng(draw(SEEDS))
    if draw(st.booleans()):
        lower = upper = None
    masked = [(random_mask(rng, n) if rng.random() < 0.6 else None, *each) for each in hierarchy]
    weights = 10.0 ** rng.uniform(-1.0, 1.0, n) if draw(st.booleans()) else None
    return n, masked, lower, upper, weights


def is_clear(n, hierarchy, least=1e-2):
    """Return whether no direction of a level is nearly, but not quite, left to it."""
    above = np.zeros((0, n))
    for mask, J, *_ in hierarchy:
        free = null_of(above)
        spaces = [free]
        if mask is not None and free.size:
            fixed = free[~mask]
            spaces.append(free @ null_of(fixed))
            if not _is_clear(fixed, 1.0, least):
                return False
        if not all(_is_clear(J @ space, np.linalg.norm(J), least) for space in spaces):
            return False
        above = np.concatenate([above, J]) if len(_) == 1 else above
    return True


def _is_clear(A, size, least):
    """Return whether singular values are zero or large."""
    s = np.linalg.svd(A, compute_uv=False)
    return not ((s > 1e-11 * size) & (s < least * size)).any()


def solved(hierarchy, *bounds, **options):
    """Return the solution of a hierarchy of `masked_lexicographic`."""
    levels = [replace(each, joints=mask) for (mask, *_), each in zip(
        hierarchy, as_levels([demand for _, *demand in hierarchy]))]
    return redistribute(levels, *bounds, **options)


@pytest.mark.slow
@given(masked_hierarchies())
@settings(max_examples=300)
def test_every_level_is_met_as_well_as_its_joints_can_and_no_better(problem):
    n, hierarchy, lower, upper, weights = problem
    assume(is_clear(n, hierarchy))
    expected = masked_lexicographic(hierarchy, n, lower, upper, weights)
    found = solved(hierarchy, lower, upper, weights=weights).velocity
    plain = [each[1:] for each in hierarchy]
    np.testing.assert_allclose(misses(plain, found), misses(plain, expected), rtol=0,
                               atol=1e-8)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


@pytest.mark.slow
@given(masked_hierarchies())
@settings(max_examples=100)
def test_levels_below_do_not_change_what_a_level_with_a_mask_does(problem):
    n, hierarchy, lower, upper, weights = problem
    whole = solved(hierarchy, lower, upper, weights=weights).velocity
    for count in range(1, len(hierarchy)):
        first = solved(hierarchy[:count], lower, upper, weights=weights).velocity
        size = np.linalg.norm(whole) + np.linalg.norm(first) + 1e-9
        for _, J, *demand in hierarchy[:count]:
            if len(demand) == 1:
                change = np.linalg.norm(J @ (whole - first))
                assert change <= 1e-9 * np.linalg.norm(J) * size


@pytest.mark.parametrize('weights', [None, [9.0, 1.0, 1.0]])
@pytest.mark.parametrize('scaling', ['uniform', 'redistribute'])
def test_no_other_joint_replaces_those_of_a_mask(weights, scaling):
    x = solve([replace(level(TOOL, [2.0, 1.0]), joints=FIRST)], weights=weights,
              scaling=scaling).velocity
    np.testing.assert_allclose(x, [2.0, 0.0, 1.0], atol=1e-15)


def test_joints_of_a_mask_share_the_motion_by_their_weights():
    x = solve([level([[1.0, 1.0, 1.0]], 6.0, 0, 1)], weights=[1.0, 2.0, 1e-3]).velocity
    assert x.tolist() == near([4.0, 2.0, 0.0])


def test_level_below_may_move_the_other_joints_and_those_of_the_mask_make_up_for_it():
    below = Level(np.eye(3)[1:2], np.array([5.0]))
    x = solve([replace(level(TOOL, [2.0, 1.0]), joints=FIRST), below]).velocity
    assert x.tolist() == near([-3.0, 5.0, 1.0])
    # Rows without the columns of the other joints would not notice what these do.
    cut = solve([Level(TOOL * FIRST, np.array([2.0, 1.0])), below]).velocity
    assert (TOOL @ cut).tolist() == near([7.0, 1.0])


def test_mask_without_a_joint_that_moves_the_level_leaves_it_where_it_is():
    solution = solve([level([[1.0, 0.0, 0.0]], 3.0, 1, 2), Level(np.eye(3), np.ones(3))])
    assert solution.levels[0].achieved.tolist() == near([0.0])
    assert solution.levels[0].unreachable.tolist() == near([3.0])
    # Joint 1 would move the level.
    assert solution.velocity.tolist() == near([0.0, 1.0, 1.0])


def test_mask_of_all_joints_is_none():
    assert check_levels([level(TOOL, [2.0, 1.0], 0, 1, 2)])[0].joints is None


def test_posture_with_a_mask_leaves_nothing_to_the_levels_below():
    x = solve([level(np.eye(3), [1.0, 2.0, 3.0], 0), Level(np.eye(3), np.full(3, 9.0))]).velocity
    assert x.tolist() == near([1.0, 0.0, 0.0])


def test_joint_at_its_bound_is_replaced_by_those_of_the_mask_only():
    x = redistribute([level([[1.0, 1.0, 1.0]], 5.0, 0, 1)], [-1.0, -2.0, -9.0],
                     [1.0, 2.0, 9.0]).velocity
    assert x.tolist() == near([1.0, 2.0, 0.0])


def test_bounds_that_exclude_zero_move_the_joint_outside_the_mask_and_the_mask_makes_up_for_it():
    x = redistribute([level([[1.0, 1.0]], 5.0, 0)], [-9.0, 1.0], [9.0, 2.0]).velocity
    assert x.tolist() == near([4.0, 1.0])


def test_mode_scale_keeps_the_direction_with_the_joints_of_the_mask():
    x = redistribute([replace(level(TOOL, [4.0, 2.0], mode='scale'), joints=FIRST)],
                     [-1.0, -9.0, -9.0], [1.0, 9.0, 9.0]).velocity
    assert x.tolist() == near([1.0, 0.0, 0.5])


def test_level_with_bounds_moves_the_joints_of_its_mask_only():
    row = np.array([[1.0, 1.0, 1.0]])
    limit = Level(row, lower=np.array([3.0]), upper=np.array([9.0]),
                  joints=np.array([False, True, False]))
    assert redistribute([limit]).velocity.tolist() == near([0.0, 3.0, 0.0])
    # The row is kept in full by the level below.
    x = redistribute([limit, Level(np.eye(3)[2:], np.array([-4.0]))]).velocity
    assert x.tolist() == near([2.0, 5.0, -4.0])


@given(SEEDS)
@settings(max_examples=50)
def test_curvature_counts_what_the_levels_above_balance_not_what_others_do(seed):
    rng = np.random.default_rng(seed)
    above, J = rng.standard_normal((2, 6)), rng.standard_normal((3, 6))
    joints = np.array([True, True, True, False, False, False])
    levels = [Level(above, rng.standard_normal(2)), Level(J, rng.standard_normal(3),
                                                          joints=joints)]
    found = redistribute(levels, np.full(6, -50.0), np.full(6, 50.0))
    residual = levels[1].v - J @ found.steps[1].velocity
    assume(np.linalg.norm(residual) > 1e-3)
    # Jᵀ w = J_1ᵀ μ + Eᵀ λ
    forces = np.concatenate([above, np.eye(6)[~joints]]).T
    multipliers, *_ = np.linalg.lstsq(forces, J.T @ residual, rcond=None)
    np.testing.assert_allclose(forces @ multipliers, J.T @ residual, atol=1e-8)
    h = np.linalg.norm(residual) * max(2.0, np.linalg.norm(J)) \
        + np.linalg.norm(multipliers[:2]) * max(2.0, np.linalg.norm(above))
    assert found.steps[1].bend == pytest.approx(h, rel=1e-6)


@pytest.mark.slow
@given(masked_hierarchies())
@settings(max_examples=50)
def test_what_is_unreachable_is_what_a_level_misses_without_bounds(problem):
    n, hierarchy, *_, weights = problem
    demands = [each for each in hierarchy if len(each) == 3]
    assume(is_clear(n, demands))
    solution = solved(demands, weights=weights)
    for each in solution.levels:
        np.testing.assert_allclose(each.unreachable, each.residual, rtol=0, atol=1e-8)
    # The same for a solver that returns no steps.
    solution = solved(demands)
    alone = Solution(solution.velocity, solution.hierarchy)
    for one, other in zip(alone.levels, solution.levels):
        assert one.rank == other.rank
        np.testing.assert_allclose(one.unreachable, other.unreachable, rtol=0, atol=1e-8)


@pytest.mark.parametrize('joints', [[True], [1.0, 0.0], [[True, False]], 'all', [0, 1]])
def test_mask_must_be_one_truth_value_for_each_joint(joints):
    with pytest.raises(SolverError, match='level 1: joints must be 2 of True and False'):
        solve([Level([[1.0, 1.0]], [1.0], joints=joints)])
