# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The quadratic program of a level, and the point of a polytope that is nearest to another."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from problems import redistribute, SEEDS
import pytest
from reference import constrained_lstsq
from tp_controller import Level
from tp_controller.solver.active_set import ActiveSet
from tp_controller.solver.qp import nearest, nearest_point, regularised

# Two joints that can only move together, both at their limits: as good as one row, twice.
WEDGE = np.array([[0.2537, 15.3156], [-0.1816, -10.9633]])


def polytope(rng):
    """Return A, lower and upper: some sides missing, some points within."""
    k, r = rng.integers(1, 8), rng.integers(1, 14)
    A, inside = rng.standard_normal((r, k)), rng.standard_normal(k)
    lower, upper = A @ inside - rng.uniform(0.0, 1.0, r), A @ inside + rng.uniform(0.0, 1.0, r)
    side = rng.integers(0, 5, r)
    return (A, np.where(side == 0, -np.inf, lower), np.where(side == 1, np.inf, upper), inside)


def polytope_and_point(seed, exponent):
    """Return what `polytope` does, and a point at a distance of about 10 ** exponent."""
    rng = np.random.default_rng(seed)
    drawn = polytope(rng)
    return *drawn, 10.0 ** exponent * rng.standard_normal(drawn[0].shape[1])


# The nearest point

@pytest.mark.solvers('python')
@given(SEEDS, st.floats(-2.0, 3.0))
def test_nearest_point_is_the_one_of_an_independent_method(seed, exponent):
    A, lower, upper, inside, point = polytope_and_point(seed, exponent)
    z, multipliers = nearest_point(point, A, lower, upper)
    exact = constrained_lstsq(np.eye(len(point)), point, A, lower, upper,
                              np.zeros((0, len(point))), inside)
    size = 1.0 + np.linalg.norm(point)
    np.testing.assert_allclose(z, exact, rtol=0, atol=1e-8 * size)
    np.testing.assert_allclose(point - A.T @ multipliers, z, rtol=0, atol=1e-8 * size)
    assert (multipliers[A @ z < upper - 1e-8 * size] <= 0.0).all()
    assert (multipliers[A @ z > lower + 1e-8 * size] >= 0.0).all()


@pytest.mark.parametrize('signs', [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
@pytest.mark.parametrize('push', [1.2177, 120.0])
def test_joints_that_can_only_move_together_do_not_leave_their_limits(signs, push):
    A, lower = WEDGE * signs, np.array([-2.175, -2.61])
    point = np.array([push * signs[0], 0.0])
    tolerance = 1e-6 * (1.0 + push)
    # The wedge is open on the other side only; its sides differ by a few parts in 1e5.
    found = nearest_point(point, A, lower, np.zeros(2))
    if found is not None:
        assert (A @ found[0] <= tolerance).all() and (A @ found[0] >= lower - tolerance).all()
        assert np.linalg.norm(found[0]) < 1e-2
    # That way both may go, in a line.
    z, _ = nearest_point(-point, A, np.full(2, -np.inf), np.zeros(2))
    assert (A @ z <= tolerance).all()
    assert z[0] * signs[0] == pytest.approx(-push, rel=1e-3)
    # As rows of a level they hold as well, for their length.
    solution = redistribute([Level(A, lower=lower, upper=np.zeros(2)), (np.eye(2), point)])
    assert (A @ solution.velocity <= 16.0 * tolerance).all()
    assert (A @ solution.velocity >= lower - 16.0 * tolerance).all()


@pytest.mark.parametrize('seed', range(20))
def test_first_of_the_joints_that_stop_a_motion_together_is_the_one_that_counts(seed):
    motion = np.random.default_rng(seed).uniform(0.1, 1.0, 6)
    still = np.linalg.svd(motion[np.newaxis])[2][1:]
    # Rounding alone would choose another one for some of these motions.
    solution = redistribute([(still, np.zeros(5)), (motion[np.newaxis], np.ones(1))],
                            -np.ones(6), np.zeros(6))
    multipliers = solution.levels[1].multipliers
    assert multipliers[0] > 0.0 and not multipliers[1:].any()


@pytest.mark.solvers('python')
def test_polytope_that_is_hardly_more_than_a_point_is_left_by_no_more_than_the_tolerance():
    # Out of a closed loop: an arm at rest with joints at their limits.
    A = np.array([[1.085173078696e-05, 2e-17], [0.121455747478269, -1.5e-16],
                  [6e-17, 0.6144037409529498]])
    lower = np.array([0.0, -1.4289493985917e-04, -3.3e-16])
    upper = np.array([5.21805e-12, 0.0, 0.0])
    z, multipliers = nearest_point(np.array([-1.5804680637724e-04, -5.4e-16]), A, lower, upper)
    assert (A @ z <= upper + 1e-6).all() and (A @ z >= lower - 1e-6).all()
    assert np.isfinite(multipliers).all()


@pytest.mark.solvers('python')
@given(SEEDS, st.floats(-3.0, 6.0))
def test_polytope_without_a_point_has_no_nearest_one(seed, exponent):
    A, lower, upper, _, point = polytope_and_point(seed, exponent)
    A = np.concatenate([A, A[:1], A[:1]])
    lower = np.concatenate([lower, [1.0, -math.inf]])
    upper = np.concatenate([upper, [math.inf, 0.5]])
    assert nearest_point(point, A, lower, upper) is None


@pytest.mark.solvers('python')
@pytest.mark.parametrize('size', [1e-6, 1e-3, 1.0])
def test_bounds_that_contradict_each_other_by_their_own_size_leave_no_point(size):
    # However small, they differ by more than rounding.
    A, lower, upper = np.ones((2, 1)), size * np.array([-1.0, 1.0]), size * np.array([0.5, 2.0])
    assert nearest_point(np.zeros(1), A, lower, upper) is None
    # By less than a tolerance they do not.
    upper[0] = size * (1.0 - 1e-8)
    assert nearest_point(np.zeros(1), A, lower, upper)[0] == pytest.approx(size, rel=1e-6)


@pytest.mark.solvers('python')
@pytest.mark.parametrize('ratio', [1e4, 1e8, 1e12])
def test_program_far_stiffer_in_one_direction_goes_as_far_there_as_its_bounds_allow(ratio):
    for seed in range(50):
        rng = np.random.default_rng(seed)
        Q = np.linalg.qr(rng.standard_normal((6, 6)))[0]
        stiffness, centre, bounds = np.ones(6), np.zeros(6), rng.uniform(0.2, 0.8, 6)
        stiffness[0], centre[0] = ratio, 3.0
        a, _ = nearest(stiffness, centre, Q, -bounds, bounds)
        # |Q a| ≤ bounds allows a_0 = most; the others may gain their whole cost.
        most = np.abs(Q[:, 0]) @ bounds
        assert most - bounds @ bounds / (2.0 * ratio * (3.0 - most)) - 1e-9 <= a[0] <= most + 1e-9


@pytest.mark.solvers('python')
@given(SEEDS, st.floats(1e-6, 1e6))
def test_program_is_the_nearest_point_in_its_own_metric(seed, unit):
    rng = np.random.default_rng(seed)
    A, lower, upper, inside = polytope(rng)
    stiffness, centre = 10.0 ** rng.uniform(-2.0, 1.0, len(inside)), 3.0 * inside
    a, multipliers = nearest(unit * stiffness, centre, A, lower, upper)
    exact = constrained_lstsq(np.diag(np.sqrt(stiffness)), np.sqrt(stiffness) * centre, A, lower,
                              upper, np.zeros((0, len(inside))), inside)
    np.testing.assert_allclose(a, exact, rtol=0, atol=1e-7)
    np.testing.assert_allclose(stiffness * (centre - a), A.T @ multipliers / unit, rtol=0,
                               atol=1e-7)


def tire(monkeypatch, answered):
    """Let no program be solved any more after some of them."""
    left, solved = [answered], ActiveSet.solve

    def solve_some(self, tolerance):
        left[0] -= 1
        return solved(self, tolerance) if left[0] >= 0 else None
    monkeypatch.setattr(ActiveSet, 'solve', solve_some)


@pytest.mark.solvers('python')
def test_program_that_rounding_defeats_moves_nothing(monkeypatch):
    tire(monkeypatch, 0)
    program = np.eye(2), np.full(2, -1.0), np.ones(2)
    assert nearest_point(np.array([3.0, 0.0]), *program) is None
    assert regularised(np.ones(2), np.array([3.0, 0.0]), *program, 0.01, np.zeros(2)) is None
    assert regularised(np.ones(2), np.array([3.0, 0.0]), *program, 0.0, np.zeros(2)) is None
    # Where bounds exclude zero, from where they allow it.
    solution = redistribute([([[1.0, 1.0]], [3.0])], [0.2, -1.0], [0.5, 1.0])
    assert solution.velocity.tolist() == [0.2, 0.0]
    assert not solution.levels[0].multipliers.any()


@pytest.mark.solvers('python')
@pytest.mark.parametrize('regularisation', [0.0, 0.0025])
@pytest.mark.parametrize('answered', [1, 2])
def test_answer_is_kept_where_a_later_program_is_defeated(monkeypatch, regularisation, answered):
    tire(monkeypatch, answered)
    # a_1 demands 3 and may have 1 + 0.3 a_2, which costs nothing.
    a, multipliers = regularised(
        np.array([1.5, 0.0]), np.array([3.0, 0.0]), np.array([[1.0, -0.3]]),
        np.array([-np.inf]), np.array([1.0]), regularisation, np.array([3.0, 0.0]))
    # What is exact is finished without another program.
    assert a[0] > 2.7 if regularisation else a[0] == pytest.approx(3.0, abs=1e-12)
    assert (multipliers[0] > 0.0) == (regularisation > 0.0)


# The program of a level

@pytest.mark.solvers('python')
@pytest.mark.parametrize('soft', [0.0, 1e-4, 0.0025, 0.5, 2.0])
@pytest.mark.parametrize('start', [[0.0, 0.0], [1.0, 0.7], [2.0, 4.0]])
def test_soft_direction_that_helps_a_stiff_one_is_the_formula(soft, start):
    # a_1 demands 3 and may have 1 + ρ a_2.
    rho, stiffness, target = 0.3, np.array([1.5, soft]), np.array([3.0, 0.2])
    # What is missing to 0.0025 pulls to where it began.
    stiff = np.maximum(stiffness, 0.0025)
    centre = (stiffness * target + (stiff - stiffness) * start) / stiff
    across = np.array([1.0, -rho])
    push = max(0.0, (across @ centre - 1.0) / (across @ (across / stiff)))
    found = centre - push * across / stiff
    a, multipliers = regularised(stiffness, target, np.array([[1.0, -rho]]), np.array([-np.inf]),
                                 np.array([1.0]), 0.0025, np.array(start))
    np.testing.assert_allclose(a, found, rtol=0, atol=1e-9)
    np.testing.assert_allclose(multipliers, [push], rtol=1e-9, atol=1e-9)


@pytest.mark.solvers('python')
def test_stiff_program_is_not_regularised_at_all():
    stiffness, target = np.array([1.0, 1.0]), np.array([3.0, 1.0])
    a, multipliers = regularised(stiffness, target, np.eye(2), np.full(2, -np.inf),
                                 np.array([0.5, 9.0]), 0.0025, np.array([-7.0, 7.0]))
    np.testing.assert_allclose(a, [0.5, 1.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(multipliers, [2.5, 0.0], rtol=0, atol=1e-12)


@pytest.mark.solvers('python')
@given(SEEDS, st.sampled_from([1e-4, 0.0025, 0.1, 10.0]))
def test_answer_is_never_worse_than_where_it_began(seed, least):
    rng = np.random.default_rng(seed)
    A, lower, upper, inside = polytope(rng)
    stiffness = np.where(rng.random(len(inside)) < 0.4, 0.0,
                         10.0 ** rng.uniform(-5.0, 1.0, len(inside)))
    target = 3.0 * rng.standard_normal(len(inside))

    def missed(a):
        return stiffness @ (a - target) ** 2
    a, _ = regularised(stiffness, target, A, lower, upper, least, inside)
    assert missed(a) <= missed(inside) + 1e-8
    # Nor than with one step more of the same, where that began.
    again, _ = regularised(stiffness, target, A, lower, upper, least, a)
    assert missed(again) <= missed(a) + 1e-8


@pytest.mark.solvers('python')
@given(SEEDS, st.sampled_from([0.0, 0.0025]))
def test_target_that_is_allowed_is_the_answer_if_it_began_there(seed, least):
    rng = np.random.default_rng(seed)
    A, lower, upper, inside = polytope(rng)
    stiffness = np.where(rng.random(len(inside)) < 0.4, 0.0, 1.0)
    a, multipliers = regularised(stiffness, inside, A, lower, upper, least, inside)
    np.testing.assert_allclose(a, inside, rtol=0, atol=1e-9)
    np.testing.assert_allclose(multipliers, 0.0, rtol=0, atol=1e-9)


@pytest.mark.solvers('python')
@given(SEEDS)
def test_exact_program_is_that_of_an_independent_method(seed):
    rng = np.random.default_rng(seed)
    A, lower, upper, inside = polytope(rng)
    stiffness = np.where(rng.random(len(inside)) < 0.4, 0.0, 1.0)
    target = 3.0 * rng.standard_normal(len(inside))
    a, multipliers = regularised(stiffness, target, A, lower, upper, 0.0, inside)
    exact = constrained_lstsq(np.diag(stiffness), stiffness * target, A, lower, upper,
                              np.zeros((0, len(inside))), inside)
    np.testing.assert_allclose(stiffness * a, stiffness * exact, rtol=0, atol=1e-8)
    np.testing.assert_allclose(A.T @ multipliers, stiffness * (target - a), rtol=0, atol=1e-5)


@pytest.mark.solvers('python')
@pytest.mark.parametrize('ratio', [1e-2, 1e-4, 1e-6])
def test_exact_program_is_met_however_soft_a_direction_is(ratio):
    # a_1 + a_2 = 0.5 is in the way of (1, 1): the soft one gives way by its stiffness.
    stiffness, target = np.array([1.0, ratio]), np.ones(2)
    a, multipliers = regularised(stiffness, target, np.ones((1, 2)), np.array([-np.inf]),
                                 np.array([0.5]), 0.0, np.zeros(2))
    multiplier = 1.5 / (1.0 + 1.0 / ratio)
    np.testing.assert_allclose(a, 1.0 - multiplier / stiffness, rtol=0, atol=1e-7)
    np.testing.assert_allclose(multipliers, [multiplier], rtol=1e-6)
