# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The stacked fast path gives the same answer as the loop over levels."""

from fractions import Fraction
import math
import sys

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
from problems import by_loop, DEFAULTS, EXACT, near, redistribute, SEEDS
import pytest
from reference import damped_recursion, lexicographic, null_of, random_levels
from tp_controller import Level, solve, SolverError
from tp_controller.solver.damping import CURVATURE, Damping, FIRST, TURNING
from tp_controller.solver.level import check_levels
from tp_controller.solver.min_norm import min_norm
from tp_controller.solver.solve import PrioritySolver, solve_cycle

UNDAMPED = Damping()


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


def fast(levels, n, damping, weights=None, period=0.0):
    """Return the answer of the fast path where nothing is remembered."""
    return min_norm(levels, n, damping, period, (0.0,) * len(levels), weights)


@pytest.mark.slow
@given(easy_stacks(), st.booleans(), st.sampled_from([(0.0, math.inf), (0.1, 0.1), (0.5, 0.2),
                                                      (0.3, 2.0), (0.1, math.inf)]))
def test_fast_path_agrees_with_the_recursion_wherever_it_answers(stack, closed, damped):
    n, levels, closing = stack
    damping, region = damped
    last = [Level.of_joints(closing)] if closed else []
    short = fast([Level(J, v) for J, v in levels] + last, n, Damping(damping, region))
    assume(short is not None)
    levels += [(np.eye(n), closing)] if closed else []
    long = damped_recursion(levels, n, damping, region, FIRST)
    np.testing.assert_allclose(short, long, rtol=0, atol=1e-9 * max(1.0, np.abs(long).max()))


@pytest.mark.slow
@given(easy_stacks(), st.sampled_from([(0.0, math.inf), (0.1, 0.1), (0.5, 0.2), (0.3, 2.0)]))
def test_fast_path_answers_wherever_levels_are_far_from_singular(stack, damped):
    n, levels, closing = stack
    rows, sizes = np.zeros((0, n)), []
    for J, _ in levels:
        sizes.append(np.linalg.svd(J @ null_of(rows), compute_uv=False)[-1])
        rows = np.concatenate([rows, J])
    assume(np.linalg.cond(rows) < 20.0)
    # It bounds singular values by norms of inverses, which may be off by the number of rows.
    sizes[0] /= FIRST
    assume(min(sizes) > damped[1] * len(rows) ** 0.25 and damped[1] <= 1.0 or not damped[0])
    levels = [Level(J, v) for J, v in levels]
    assert fast(levels, n, Damping(*damped)) is not None
    assert fast([*levels, Level.of_joints(closing)], n, Damping(*damped)) is not None


@pytest.mark.parametrize('weights', [None, [1.0, 100.0, 0.01, 5.0, 1.0, 30.0, 2.0]])
def test_fast_path_meets_levels_with_the_least_motion(weights):
    levels = random_levels(np.random.default_rng(5), 7, [3, 2])
    found = fast([Level(J, v) for J, v in levels], 7, UNDAMPED,
                 None if weights is None else np.array(weights))
    np.testing.assert_allclose(found, lexicographic(levels, 7, weights), rtol=0, atol=1e-12)


def test_fast_path_leaves_singular_and_damped_levels_to_the_loop():
    J = np.array([[1.0, 0.0, 0.0], [1.0, 1e-3, 0.0]])
    assert fast([Level(J, np.ones(2))], 3, UNDAMPED) is None
    assert fast([Level(J[:1], np.ones(1))] * 2, 3, UNDAMPED) is None
    assert fast([Level(np.eye(3)[:2], np.ones(2))], 3, Damping(0.1)) is None
    assert fast([Level(np.ones((4, 3)), np.ones(4))], 3, UNDAMPED) is None
    assert fast([Level.of_joints(np.ones(3))], 3, Damping(0.1, 1.5)) is None


@pytest.mark.parametrize('share', [0.99, 1.01])
def test_fast_path_knows_the_region_of_each_level(share):
    # The first level has its own; what the second one has left is s.
    region, s = 0.2, share * 0.2
    first = share * FIRST * region
    alone = [Level(np.array([[first, 0.0]]), np.ones(1))]
    both = [Level(np.array([[1.0, 0.0]]), np.zeros(1)), Level(np.array([[2.0, s]]), np.ones(1))]
    for levels in (alone, both):
        assert (fast(levels, 2, Damping(0.1, region)) is not None) == (share > 1.0)
        assert fast(levels, 2, Damping(0.0, region)) is not None


@pytest.mark.parametrize('s', [0.99, 1.01])
@pytest.mark.parametrize('options', [{'release_region': 0.02}, {'release_region': 0.2},
                                     {'damping': 0.1, 'singular_region': 0.1,
                                      'release_region': 0.05},
                                     {'damping': 0.1, 'singular_region': 0.1,
                                      'release_region': 0.15}])
def test_fast_path_leaves_relaxed_directions_to_the_loop(s, options):
    damping = Damping(**options)
    first = s * max(damping.release_region, FIRST * damping.singular_region
                    if damping.damping else 0.0)
    below = s * max(damping.release_region, damping.singular_region if damping.damping else 0.0)
    alone = [Level(np.array([[first, 0.0]]), np.ones(1))]
    both = [Level(np.array([[1.0, 0.0]]), np.zeros(1)),
            Level(np.array([[0.3, below]]), np.ones(1))]
    for levels in (alone, both):
        assert (fast(levels, 2, damping) is not None) == (s > 1.0)


def test_fast_path_is_damped_by_what_a_level_has_left_and_not_by_what_it_demands():
    # Joint 1 gives the second level most of its demand, or all; what is left of the level is weak.
    for demand in (0.7, 0.71, 5.0):
        levels = [(np.array([[1.0, 0.0]]), np.array([0.7])),
                  (np.array([[1.0, 0.05]]), np.array([demand]))]
        assert fast([Level(J, v) for J, v in levels], 2, Damping(0.1, 0.1)) is None
        # s / (s² + λ² (1 − s²/ε²)) of what the first level leaves of the demand.
        expected = 0.05 * (demand - 0.7) / (0.0025 + 0.01 * 0.75)
        assert solve(levels, damping=0.1, singular_region=0.1).velocity == near([0.7, expected])


@pytest.mark.parametrize('push, answers', [(24.0, True), (26.0, False)])
def test_fast_path_leaves_a_closing_level_to_the_loop_that_would_be_slowed(push, answers):
    # It misses what the first level holds, and pushes with as much, which bends by ‖J‖ of that.
    for size in (5.0, 0.5):
        levels = [Level(np.array([[size, 0.0]]), np.zeros(1)),
                  Level.of_joints(np.array([push, 0.0]))]
        period = 0.04 * size / (CURVATURE * max(size, TURNING))
        assert (fast(levels, 2, Damping(0.1, 0.1), period=period) is not None) == answers
        assert fast(levels, 2, Damping(0.1, 0.1)) is not None
        # What it bends is remembered by the loop alone.
        memory = solve(levels, damping=0.1, singular_region=0.1, period=period).memory
        assert (memory == (0.0, 0.0)) == answers


@pytest.mark.parametrize('share', [0.99, 1.01])
def test_fast_path_answers_as_long_as_what_is_remembered_damps_nothing(share):
    # The singular values of what each level has left.
    for levels, s in (([(np.array([[0.5, 0.0]]), np.ones(1))], [0.5]),
                      ([(np.eye(2), np.ones(2))], [1.0]),
                      ([(np.array([[1.0, 0.0]]), np.zeros(1)),
                        (np.array([[2.0, 0.3]]), np.ones(1))], [1.0, 0.3])):
        for number, value in enumerate(s):
            remembered = [0.0] * len(s)
            remembered[number] = share * value ** 2 / (CURVATURE * 0.01)
            damping = Damping(0.1, 0.1)
            curved = [damping.curvature(h, 0.01) for h in remembered]
            found = min_norm(check_levels(levels), 2, damping, 0.01, curved)
            assert (found is not None) == (share < 1.0)
            solution = solve(levels, damping=0.1, singular_region=0.1, period=0.01,
                             memory=tuple(remembered))
            if share < 1.0:
                assert solution.velocity == near(found)
                # It fades all the same.
                assert 0.0 < solution.memory[number] < remembered[number]
            elif levels[number][1].any():
                whole = solve(levels).velocity
                assert np.linalg.norm(solution.velocity - whole) > 1e-3


def test_fast_path_finds_the_bend_of_each_level_by_its_place():
    # c = κ T h = 0.04 h. The bounds above are idle, and stand in the list of what is remembered.
    options = {**DEFAULTS, 'period': 0.01}
    idle = Level(np.array([[0.0, 0.0, 1.0]]), upper=np.array([0.9]))
    first = ([[1.0, 0.0, 0.0]], [0.1])
    assert redistribute([idle, first, ([[0.0, 0.3, 0.0]], [0.02])], memory=(0.0, 0.0, 20.0),
                        **options).velocity == near([0.1, 0.3 * 0.02 / 0.8, 0.0])
    # Of a closing level s = 1.
    assert redistribute([first, (np.eye(3), [0.0, 0.4, 0.4])], memory=(0.0, 50.0),
                        **options).velocity == near([0.1, 0.2, 0.2])


def test_fast_path_refuses_what_is_no_number():
    with pytest.raises(SolverError, match='not finite'):
        solve_cycle([Level(np.eye(2)[:1], np.array([math.nan]))], None, None, PrioritySolver(2),
                    0.0)


def test_fast_path_knows_singular_values_well_enough_where_they_are_equal():
    # All are 1: by its Frobenius norm alone the inverse of three rows could be as long as √3.
    levels = [Level(np.eye(4)[3:], np.ones(1)), Level(np.eye(4)[:3], np.ones(3))]
    assert fast(levels, 4, Damping(0.1, 0.7)) is not None
    assert fast(levels, 4, Damping(0.1, 1.1)) is None


@pytest.mark.parametrize('damping, region', [
    (0.0, math.inf), (0.1, 0.1), (0.5, 2.0), (0.5, math.inf)])
def test_closing_level_is_the_same_whether_it_is_recognised_or_not(damping, region):
    rng = np.random.default_rng(8)
    for rows in ([], [2], [2, 3]):
        above = [(3.0 * J, v) for J, v in random_levels(rng, 6, rows)]
        posture = rng.standard_normal(6)
        recognised = solve([*above, (np.eye(6), posture)], damping=damping,
                           singular_region=region)
        assert recognised.hierarchy[-1].is_identity
        plain = solve_cycle([Level(J, v) for J, v in [*above, (np.eye(6), posture)]], None, None,
                            PrioritySolver(6, Damping(damping, region)), 0.0)
        np.testing.assert_allclose(recognised.velocity, plain.velocity, **EXACT)
        for one, other in zip(recognised.levels, plain.levels):
            np.testing.assert_allclose(one.residual, other.residual, **EXACT)
            assert one.rank == other.rank


@pytest.mark.solvers('python')
def test_fast_path_is_taken_with_the_settings_of_the_controller(monkeypatch):
    tried = []

    def spy(*given):
        tried.append(min_norm(*given))
        return tried[-1]
    monkeypatch.setattr(sys.modules['tp_controller.solver.solve'], 'min_norm', spy)
    levels = random_levels(np.random.default_rng(5), 7, [3, 2])
    solution = redistribute(levels, -9.0 * np.ones(7), 9.0 * np.ones(7), period=0.01, **DEFAULTS)
    assert len(tried) == 1 and solution.velocity.tolist() == tried[0].tolist()


def test_solution_of_the_fast_path_tells_what_that_of_the_loop_does():
    levels = random_levels(np.random.default_rng(6), 7, [3, 2])
    levels = [Level(J, v) for J, v in levels] + [Level.of_joints(np.ones(7))]
    short, long = solve(levels), by_loop(levels)
    np.testing.assert_allclose(short.velocity, long.velocity, **EXACT)
    for one, other in zip(short.levels, long.levels):
        assert one.rank == other.rank
        assert one.smallest_singular_value == pytest.approx(other.smallest_singular_value)
    assert [level.rank for level in short.levels] == [3, 2, 2]


# Weights of very different size

def exact_least_motion(J, v, weights):
    """Return W⁻¹ Jᵀ (J W⁻¹ Jᵀ)⁻¹ v (n,), in fractions: without rounding."""
    J, v, weights = ([list(map(Fraction, row)) for row in J.tolist()],
                     list(map(Fraction, v.tolist())), list(map(Fraction, weights.tolist())))
    rows = [[sum(a * b / w for a, b, w in zip(one, other, weights)) for other in J] + [each]
            for one, each in zip(J, v)]
    for i in range(len(rows)):
        # Positive definite: every pivot is positive.
        rows[i] = [each / rows[i][i] for each in rows[i]]
        for j in range(len(rows)):
            if j != i:
                rows[j] = [a - rows[j][i] * b for a, b in zip(rows[j], rows[i])]
    return np.array([float(sum(row[j] * z[-1] for row, z in zip(J, rows)) / weights[j])
                     for j in range(len(weights))])


@pytest.mark.slow
@pytest.mark.parametrize('decades', [2.0, 6.0, 10.0, 12.0])
@pytest.mark.parametrize('method', [solve, by_loop])
def test_least_motion_is_exact_whatever_the_weights(method, decades):
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 9))
        (J, v), = random_levels(rng, n, [int(rng.integers(1, n))])
        weights = 10.0 ** (decades * np.concatenate([[0.0, 1.0], rng.random(n - 2)]))
        expected = exact_least_motion(J, v, weights)
        np.testing.assert_allclose(method([(J, v)], weights=weights).velocity, expected, rtol=0,
                                   atol=1e-9 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize('decades', [8.0, 10.0, 12.0])
def test_no_weights_disturb_a_level_within_bounds(decades):
    for seed in range(0, 1500, 5):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 10))
        (J, v), = random_levels(rng, n, [int(rng.integers(1, n - 1))])
        weights = 10.0 ** (decades * np.concatenate([[0.0, 1.0], rng.random(n - 2)]))
        below = J[:1] + 1e-7 * rng.standard_normal((1, n)), rng.standard_normal(1)
        upper = rng.uniform(0.1, 1000.0, n)
        solution = redistribute([(J, 3.0 * v), below], -upper, upper, weights=weights)
        assert np.linalg.norm(solution.levels[0].disturbance) \
            < 1e-11 * np.linalg.norm(J) * np.linalg.norm(solution.velocity)
