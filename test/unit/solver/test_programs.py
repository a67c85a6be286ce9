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

"""The quadratic program of a level, and the point of a polytope that is nearest to another."""

import math
from types import SimpleNamespace

import daqp
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from reference import constrained_lstsq
from tp_controller.solver import qp as least_distance
from tp_controller.solver.qp import nearest_point, nearest_point_if_any
from tp_controller.solver.regularized_qp import regularised

SEEDS = st.integers(0, 2 ** 32 - 1)
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


def refuse(*arguments, **options):
    """Stand in for `daqp.solve` and find nothing."""
    return None, None, -1, {}


# The nearest point

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


@given(SEEDS, st.floats(-2.0, 3.0))
def test_second_method_agrees_with_the_first(seed, exponent):
    A, lower, upper, _, point = polytope_and_point(seed, exponent)
    first, multipliers = nearest_point(point, A, lower, upper)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(least_distance.daqp, 'solve', refuse)
        second, others = nearest_point(point, A, lower, upper)
    # It is given room, and how far that lets it come is a matter of how sharp the corners are.
    size = 1e-5 * (1.0 + np.linalg.norm(point)) * (1.0 + np.abs(multipliers).max())
    np.testing.assert_allclose(second, first, rtol=0, atol=size)
    assert (A @ second <= upper + 1e-7).all() and (A @ second >= lower - 1e-7).all()
    np.testing.assert_allclose(point - A.T @ others, second, rtol=0, atol=size)


@pytest.mark.parametrize('signs', [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
@pytest.mark.parametrize('push', [1.2177, 120.0])
def test_joints_that_can_only_move_together_are_no_way_out_of_their_limits(signs, push):
    A, lower = WEDGE * signs, np.array([-2.175, -2.61])
    point = np.array([push * signs[0], 0.0])
    # The wedge is open on the other side only; its sides differ by a few parts in 1e5.
    z, multipliers = nearest_point(point, A, lower, np.zeros(2))
    room = 1e-7 * (1.0 + push)
    assert (A @ z <= room).all() and (A @ z >= lower - room).all()
    assert np.linalg.norm(z) < 1e-2
    assert (multipliers > 0.0).all()
    # That way both may go, in a line.
    z, _ = nearest_point(-point, A, np.full(2, -np.inf), np.zeros(2))
    assert (A @ z <= room).all()
    assert z[0] * signs[0] == pytest.approx(-push, rel=1e-3)


def test_polytope_that_is_hardly_more_than_a_point_is_left_by_no_more_than_the_room():
    # Out of a closed loop: an arm at rest with joints at their limits.
    A = np.array([[1.085173078696e-05, 2e-17], [0.121455747478269, -1.5e-16],
                  [6e-17, 0.6144037409529498]])
    lower = np.array([0.0, -1.4289493985917e-04, -3.3e-16])
    upper = np.array([5.21805e-12, 0.0, 0.0])
    z, multipliers = nearest_point(np.array([-1.5804680637724e-04, -5.4e-16]), A, lower, upper)
    assert (A @ z <= upper + 1e-7).all() and (A @ z >= lower - 1e-7).all()
    assert np.isfinite(multipliers).all()


def test_daqp_alone_takes_the_wedge_for_empty(monkeypatch):
    # If this fails some day, the second method has lost its reason.
    calls = []
    monkeypatch.setattr(least_distance, 'nnls', lambda E, f: calls.append(E) or (
        np.zeros(E.shape[1]), 0.0))
    nearest_point(np.array([1.2177, 0.0]), WEDGE, np.array([-2.175, -2.61]), np.zeros(2))
    assert len(calls) == 1


@pytest.mark.parametrize('regularisation', [0.0, 0.0025])
def test_program_that_defeats_both_methods_moves_nothing(monkeypatch, regularisation):
    def fail(*arguments):
        raise RuntimeError('too many iterations')
    monkeypatch.setattr(least_distance, 'nnls', fail)
    program = WEDGE, np.array([-2.175, -2.61]), np.zeros(2)
    assert nearest_point(np.array([1.2177, 0.0]), *program) is None
    a, multipliers, curvature = regularised(np.ones(2), np.array([1.2177, 0.0]), *program,
                                            regularisation, 0.01)
    assert a.tolist() == multipliers.tolist() == [0.0, 0.0] and curvature == 0.0


@pytest.mark.parametrize('regularisation', [0.0, 0.0025])
@pytest.mark.parametrize('answered', [1, 3])
def test_answer_is_kept_where_a_later_program_defeats_both_methods(monkeypatch, regularisation,
                                                                   answered):
    solved = []

    def tire(*arguments, **options):
        solved.append(arguments)
        return daqp.solve(*arguments, **options) if len(solved) <= answered else refuse()
    monkeypatch.setattr(least_distance, 'daqp', SimpleNamespace(solve=tire))
    monkeypatch.setattr(least_distance, 'by_least_squares', lambda *arguments: None)
    # a_1 wants 3 and may have 1 + 0.3 a_2, which costs nothing.
    a, multipliers, _ = regularised(
        np.array([1.5, 0.0]), np.array([3.0, 0.0]), np.array([[1.0, -0.3]]),
        np.array([-np.inf]), np.array([1.0]), regularisation, 0.0)
    assert a[0] > 2.9 and multipliers[0] > 0.0


@given(SEEDS, st.floats(-3.0, 6.0))
def test_polytope_without_a_point_has_no_nearest_one(seed, exponent):
    A, lower, upper, _, point = polytope_and_point(seed, exponent)
    A = np.concatenate([A, A[:1], A[:1]])
    lower = np.concatenate([lower, [1.0, -math.inf]])
    upper = np.concatenate([upper, [math.inf, 0.5]])
    assert nearest_point_if_any(point, A, lower, upper) is None
    assert nearest_point(point, A, lower, upper) is None


def test_second_method_is_not_asked_about_nothing(monkeypatch):
    # Without a row the compiled code behind nnls writes where it must not.
    def never(*arguments):
        raise AssertionError('nnls was called')
    monkeypatch.setattr(least_distance.daqp, 'solve', refuse)
    monkeypatch.setattr(least_distance, 'nnls', never)
    free = np.full(2, math.inf)
    assert nearest_point(np.ones(2), np.eye(2), -free, free) is None


# The program of a level

@pytest.mark.parametrize('soft', [0.0, 1e-4, 0.0025, 0.5, 2.0])
@pytest.mark.parametrize('period', [0.0, 0.01, 0.25, 5.0])
@pytest.mark.parametrize('of_a_level_above', [False, True])
def test_soft_direction_that_helps_a_stiff_one_is_the_formula(soft, period, of_a_level_above):
    # a_1 wants 3 and may have 1 + ρ a_2.
    rho, squared, stiffness = 0.3, 0.0025, np.array([1.5, soft])

    def line(stiff, centre):
        """Return the best a with a_1 ≤ 1 + ρ a_2, and the multiplier."""
        if centre[0] <= 1.0 + rho * centre[1]:
            return centre, 0.0
        second = (stiff[0] * rho * (centre[0] - 1.0) + stiff[1] * centre[1]) \
            / (stiff[0] * rho ** 2 + stiff[1])
        a = np.array([1.0 + rho * second, second])
        return a, stiff[0] * (centre[0] - a[0])

    stiff = np.maximum(stiffness, squared)
    target = np.array([3.0, 0.0])
    first, multiplier = line(stiff, target)
    missed = math.sqrt(stiffness @ (first - target) ** 2)
    # A row that was 0.5 long turns twice as fast.
    pushes = 2.0 * multiplier if of_a_level_above else multiplier
    curved = period * (4.0 * missed + 16.0 * pushes)
    stiffer = np.maximum(stiff, curved)
    # Towards the target, towards the first answer, and what is left towards zero, or, in its
    # share, towards rest.
    rest = np.array([-0.4, 0.7])
    share = period * 16.0 * pushes / curved if of_a_level_above and curved else 0.0
    centre = (stiffness * target + (stiff - stiffness) * first
              + (stiffer - stiff) * share * rest) / stiffer
    second, multiplier = line(stiffer, centre)
    a, multipliers, curvature = regularised(
        stiffness, target, np.array([[1.0, -rho]]), np.array([-np.inf]), np.array([1.0]),
        squared, period, [0.5] if of_a_level_above else [], rest)
    assert curvature == pytest.approx(curved)
    np.testing.assert_allclose(a, second, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(multipliers, [multiplier], rtol=1e-9, atol=1e-9)


def test_stiff_program_is_not_regularised_at_all():
    stiffness, target = np.array([1.0, 1.0]), np.array([3.0, 1.0])
    a, multipliers, _ = regularised(stiffness, target, np.eye(2), np.full(2, -np.inf),
                                    np.array([0.5, 9.0]), 0.0025, 0.01)
    np.testing.assert_allclose(a, [0.5, 1.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(multipliers, [2.5, 0.0], rtol=0, atol=1e-12)
    # Held longer it is: what it misses and its multiplier are 2.5 each, 50 T = 2.
    a, _, _ = regularised(stiffness, target, np.eye(2), np.full(2, -np.inf),
                          np.array([0.5, 9.0]), 0.0025, 0.04)
    np.testing.assert_allclose(a, [0.5, 0.5], rtol=0, atol=1e-12)


@given(SEEDS)
def test_however_hard_it_pushes_the_answer_is_never_worse_than_rest(seed):
    rng = np.random.default_rng(seed)
    A, lower, upper, _ = polytope(rng)
    k = A.shape[1]
    lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
    # What is softer than the regularisation may be worse, by as much as that pulls.
    stiffness = 10.0 ** rng.uniform(-2.6, 1.0, k)
    target = 3.0 * rng.standard_normal(k)
    at_rest = stiffness @ target ** 2
    for period in (0.0, 0.01, 0.1, 1.0, 10.0, 1e9):
        a, _, _ = regularised(stiffness, target, A, lower, upper, 0.0025, period)
        assert stiffness @ (a - target) ** 2 <= at_rest + 1e-6
    # In the end it is rest, where anything is in the way.
    free = (A @ target <= upper).all() and (A @ target >= lower).all()
    assert free or np.abs(a).max() < 1e-3


@pytest.mark.parametrize('ratio', [1e-2, 1e-4, 1e-6])
def test_exact_program_is_met_however_soft_a_direction_is(ratio):
    # a_1 + a_2 = 0.5 is in the way of (1, 1): the soft one gives way by its stiffness.
    stiffness, target = np.array([1.0, ratio]), np.ones(2)
    a, multipliers, _ = regularised(stiffness, target, np.ones((1, 2)), np.array([-np.inf]),
                                    np.array([0.5]), 0.0, 1.0)
    multiplier = 1.5 / (1.0 + 1.0 / ratio)
    np.testing.assert_allclose(a, 1.0 - multiplier / stiffness, rtol=0, atol=1e-7)
    np.testing.assert_allclose(multipliers, [multiplier], rtol=1e-6)
