# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Levels within bounds: against the reference, and by their optimality conditions."""


from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
import numpy as np
from problems import (
    as_levels,
    DEFAULTS,
    dynamics,
    hierarchies,
    INFINITE,
    misses,
    near,
    redistribute,
    scaled_hierarchy,
    SEEDS,
    well_conditioned,
)
import pytest
from reference import bounded_lexicographic, constrained_lstsq, null_of, random_levels
from scipy.optimize import linprog, lsq_linear
from tp_controller import Level, solve

# The reference itself, on cases worked out by hand


def test_reference_knows_the_answers_that_can_be_worked_out_by_hand():
    box = -np.ones(2), np.ones(2)
    one = np.array([[1.0, 1.0]])
    cases = [
        # Both joints at their bounds; joint 1 at its bound, joint 2 does the rest.
        ([(one, [3.0])], *box, [1.0, 1.0]),
        ([(np.array([[2.0, 1.0]]), [2.5])], *box, [1.0, 0.5]),
        # Σ = 1 first, then (2, 0): the nearest point of the line within the bounds.
        ([(one, [1.0]), (np.eye(2), [2.0, 0.0])], *box, [1.0, 0.0]),
        # Bounds that exclude zero: x_1 ≥ 0.5, and the least motion.
        ([], [0.5, -1.0], [1.0, 1.0], [0.5, 0.0]),
        ([(one, [0.0])], [0.5, -1.0], [1.0, 1.0], [0.5, -0.5]),
        # A row Σ ≤ 1 that is met, contradicting rows that meet half way, and their priority.
        ([(one, [-INFINITE], [1.0]), (np.eye(2), [1.0, 1.0])], *box, [0.5, 0.5]),
        ([(np.array([[1.0, 0.0], [1.0, 0.0]]), [0.6, -INFINITE], [INFINITE, 0.0])], *box,
         [0.3, 0.0]),
        ([(np.array([[1.0, 0.0]]), [0.6], [INFINITE]),
          (np.array([[1.0, 0.0]]), [-INFINITE], [0.0]), (np.eye(2), [0.9, 0.9])], *box,
         [0.6, 0.9]),
        # The level above demands Σ = 0, so that of x_2 ≥ 2 only 1 is possible.
        ([(one, [0.0]), (np.array([[0.0, 1.0]]), [2.0], [3.0]), (np.eye(2), [5.0, 0.0])], *box,
         [-1.0, 1.0]),
    ]
    for hierarchy, lower, upper, answer in cases:
        hierarchy = [tuple(np.array(part, float) for part in level) for level in hierarchy]
        x = bounded_lexicographic(hierarchy, 2, lower, upper)
        np.testing.assert_allclose(x, answer, rtol=0, atol=1e-12)
    weighted = bounded_lexicographic([(one, np.ones(1))], 2, *box, weights=[1.0, 4.0])
    np.testing.assert_allclose(weighted, [0.8, 0.2], rtol=0, atol=1e-12)


@pytest.mark.slow
@given(SEEDS, st.integers(1, 8), st.integers(1, 10))
def test_reference_agrees_with_bounded_least_squares_of_one_level(seed, m, n):
    rng = np.random.default_rng(seed)
    J, v = rng.standard_normal((m, n)), 3.0 * rng.standard_normal(m)
    lower = rng.uniform(-1.0, 0.3, n)
    upper = lower + rng.uniform(0.1, 1.0, n)
    x = bounded_lexicographic([(J, v)], n, lower, upper)
    other = lsq_linear(J, v, (lower, upper), method='bvls', tol=1e-15).x
    np.testing.assert_allclose(J @ x, J @ other, rtol=0, atol=1e-9)


# Against the reference

def check_against_reference(n, hierarchy, lower, upper, weights=None, tolerance=1e-8):
    solution = redistribute(as_levels(hierarchy), lower, upper, weights=weights)
    velocity = solution.velocity
    assert np.isfinite(velocity).all()
    assert (velocity >= lower).all() and (velocity <= upper).all()
    exact = bounded_lexicographic(hierarchy, n, lower, upper, weights)
    np.testing.assert_allclose(misses(hierarchy, velocity), misses(hierarchy, exact), rtol=0,
                               atol=tolerance)
    np.testing.assert_allclose(velocity, exact, rtol=0,
                               atol=1e-6 * max(1.0, np.abs(exact).max()))


@pytest.mark.slow
@settings(max_examples=150)
@given(hierarchies(rows=False))
def test_every_level_comes_as_near_as_the_bounds_and_the_levels_above_allow(problem):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    check_against_reference(n, hierarchy, lower, upper)


@pytest.mark.slow
@settings(max_examples=150)
@given(hierarchies())
def test_levels_with_bounds_are_met_or_violated_least_in_the_order_of_priority(problem):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    check_against_reference(n, hierarchy, lower, upper)


@pytest.mark.slow
@given(hierarchies(max_joints=7), SEEDS)
def test_weights_decide_what_is_left_within_the_bounds(problem, seed):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    weights = np.random.default_rng(seed).uniform(0.3, 4.0, n)
    check_against_reference(n, hierarchy, lower, upper, weights)


@settings(max_examples=40)
@given(hierarchies(max_joints=40, max_levels=6))
@pytest.mark.slow
def test_large_hierarchies_are_solved_as_well(problem):
    n, hierarchy, lower, upper = problem
    assume(n > 12 and well_conditioned(n, hierarchy, 1e-3))
    check_against_reference(n, hierarchy, lower, upper, tolerance=1e-8)


def check_misses(n, hierarchy, lower, upper):
    """Check that every level misses as much as in the reference, in its own units."""
    velocity = redistribute(as_levels(hierarchy), lower, upper).velocity
    exact = bounded_lexicographic(hierarchy, n, lower, upper)
    for (J, *_), missed, least in zip(hierarchy, misses(hierarchy, velocity),
                                      misses(hierarchy, exact)):
        size = np.linalg.norm(J * np.abs(exact))
        assert missed == pytest.approx(least, rel=1e-7, abs=1e-9 * size)


@pytest.mark.slow
@given(SEEDS, st.floats(0.0, 3.0))
@example(0, 4.0)
@example(626, 3.0)
@example(153, 2.0)
def test_units_of_rows_and_joints_do_not_decide_what_levels_miss(seed, decades):
    check_misses(*scaled_hierarchy(np.random.default_rng(seed), decades))


@pytest.mark.parametrize('seed', range(5))
def test_forces_that_cost_nothing_do_what_little_they_can_for_accelerations(seed):
    check_misses(*dynamics(np.random.default_rng(seed)))


def test_joint_that_moves_a_bound_by_next_to_nothing_does_not_race_for_it():
    # Joint 3 costs the second level nothing, and would allow joint 1 more at 1e11 times its speed.
    levels = [Level(np.array([[1.0, 0.0, 1e-11]]), upper=np.ones(1), lower=-np.ones(1)),
              Level(np.eye(3)[:2], np.array([3.0, 3.0]))]
    solution = redistribute(levels, [-9.0, -1.0, -INFINITE], [9.0, 1.0, INFINITE])
    np.testing.assert_allclose(solution.velocity, [1.0, 1.0, 0.0], rtol=0, atol=1e-9)


@pytest.mark.slow
@given(SEEDS, st.sampled_from([0.0, 1e-14, 1e-10, 1e-7, 1e-4]), st.booleans())
def test_near_rank_loss_the_answer_is_finite_and_within_bounds_and_priorities(seed, gap, exact):
    rng = np.random.default_rng(seed)
    n = 6
    (J, v), other = random_levels(rng, n, [2, 2])
    near = (J + gap * rng.standard_normal(J.shape), v + rng.standard_normal(2))
    upper = rng.uniform(0.05, 1.0, n)
    options = {} if exact else DEFAULTS
    solution = redistribute([(J, v), near, other, (np.eye(n), np.ones(n))], -upper, upper,
                            **options)
    assert (np.abs(solution.velocity) <= upper).all()
    if exact:
        np.testing.assert_allclose(
            np.linalg.norm(J @ solution.velocity - v),
            misses([(J, v)], bounded_lexicographic([(J, v)], n, -upper, upper))[0], rtol=0,
            atol=1e-7)


def test_bounds_that_exclude_zero_are_kept_without_any_level():
    assert redistribute([], [0.2, -0.5, -1.0], [0.5, -0.1, 1.0]).velocity == near(
        [0.2, -0.1, 0.0])
    empty = (np.zeros((0, 2)), np.zeros(0))
    assert redistribute([empty], [0.2, -0.5], [0.5, -0.1]).velocity == near([0.2, -0.1])


def test_what_one_joint_cannot_do_the_others_do():
    solution = redistribute([([[1.0, 1.0]], [1.0])], [-1.0, -1.0], [0.2, 1.0])
    assert solution.velocity == near([0.2, 0.8])
    assert solution.levels[0].residual == near([0.0])
    # The posture gives way before the task does.
    stack = [Level(np.array([[1.0, 1.0]]), np.ones(1)), Level.of_joints(np.array([0.9, -2.0]))]
    assert redistribute(stack, -np.ones(2), np.ones(2)).velocity == near([1.0, 0.0])


@pytest.mark.parametrize('excess', [1e-4, 1e-6, 1e-9])
def test_the_least_excess_is_redistributed_too(excess):
    solution = redistribute([([[1.0, 1.0]], [1.0])], [-1.0, -1.0], [0.5 - excess, 1.0])
    assert solution.velocity[0] == 0.5 - excess
    assert abs(solution.levels[0].residual[0]) < 1e-11


@pytest.mark.slow
@given(hierarchies(rows=False, max_levels=3))
def test_a_missing_side_is_an_infinite_one(problem):
    n, hierarchy, _, upper = problem
    upper = np.maximum(upper, 0.0)
    one = redistribute(hierarchy, None, upper).velocity
    other = redistribute(hierarchy, np.full(n, -INFINITE), upper).velocity
    assert one.tolist() == other.tolist()


# The optimality conditions, on the answer alone

def check_optimality(n, hierarchy, lower, upper, tolerance=1e-7):
    """Check every level: feasible, and stationary with multipliers of the right sign."""
    solution = redistribute(as_levels(hierarchy), lower, upper)
    if not misses(hierarchy, solution.velocity)[[len(level) == 3 for level in hierarchy]].any():
        free = solve([level for level in hierarchy if len(level) == 2]
                     or [(np.zeros((0, n)), np.zeros(0))]).velocity
        if np.abs(free - solution.velocity).max() < 1e-9:
            # Nothing is in the way of anything.
            assert not any(level.limited_by or level.row_multipliers for level in solution.levels)
            return
    rows_above, relaxed = np.zeros((0, n)), {}
    for index, ((J, *demand), level) in enumerate(zip(hierarchy, solution.levels)):
        x, multipliers = level.velocity, level.multipliers
        assert (x >= lower).all() and (x <= upper).all()
        gradient = multipliers.copy()
        size = 1.0 + np.abs(multipliers).max()
        if len(demand) == 1:
            gradient += J.T @ (J @ x - demand[0])
        for above, (least, most) in relaxed.items():
            values = hierarchy[above][0] @ x
            assert (values >= least - 1e-9).all() and (values <= most + 1e-9).all()
        if len(demand) == 2:
            values = J @ x
            relaxed[index] = (np.minimum(demand[0], values), np.maximum(demand[1], values))
        for above, found in level.row_multipliers.items():
            assert above <= index and above in relaxed and len(found) == len(hierarchy[above][0])
            values = hierarchy[above][0] @ x
            least, most = relaxed[above]
            assert (values[found > tolerance] >= most[found > tolerance] - 1e-8).all()
            assert (values[found < -tolerance] <= least[found < -tolerance] + 1e-8).all()
            gradient += hierarchy[above][0].T @ found
            size += np.abs(found).max()
        if len(demand) == 2:
            violation = values - np.clip(values, *demand)
            found = level.row_multipliers.get(index, np.zeros(len(J)))
            np.testing.assert_allclose(found, violation, rtol=0, atol=tolerance * size)
        free = null_of(rows_above)
        assert np.abs(free.T @ gradient).max(initial=0.0) < tolerance * size
        assert (x[multipliers > tolerance] == upper[multipliers > tolerance]).all()
        assert (x[multipliers < -tolerance] == lower[multipliers < -tolerance]).all()
        if len(demand) == 1:
            rows_above = np.concatenate([rows_above, J])


@pytest.mark.slow
@settings(max_examples=100)
@given(hierarchies(rows=False, kinds=('symmetric', 'mixed', 'zero', 'beside zero')))
def test_multipliers_prove_that_every_level_is_optimal(problem):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    check_optimality(n, hierarchy, lower, upper)


@pytest.mark.slow
@settings(max_examples=100)
@given(hierarchies(kinds=('symmetric', 'zero', 'beside zero', 'one-sided')))
def test_multipliers_prove_that_levels_with_bounds_are_violated_least(problem):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    check_optimality(n, hierarchy, lower, upper)


@pytest.mark.slow
@given(hierarchies(max_joints=6, kinds=('mixed', 'fixed')))
def test_multipliers_count_joints_at_their_bounds(problem):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    check_optimality(n, hierarchy, lower, upper)


# With regularisation

@given(SEEDS, st.integers(1, 6), st.sampled_from([0.0, 0.02, 0.2, 2.0]))
def test_first_level_is_never_carried_out_worse_than_by_the_step_cut_off(seed, m, regularisation):
    rng = np.random.default_rng(seed)
    (J, v), = random_levels(rng, 6, [m])
    lower = rng.uniform(-0.6, 0.2, 6)
    upper = lower + rng.uniform(0.1, 0.6, 6)
    velocity = redistribute([(J, v)], lower, upper, regularisation=regularisation).velocity
    cut = np.clip(np.linalg.pinv(J) @ v, lower, upper)
    assert np.linalg.norm(v - J @ velocity) <= np.linalg.norm(v - J @ cut) + 1e-9


@pytest.mark.slow
@given(SEEDS, st.sampled_from([(2,), (6,), (3, 2), (2, 2, 6)]))
def test_bound_that_only_just_begins_to_matter_changes_next_to_nothing(seed, rows):
    rng = np.random.default_rng(seed)
    levels = random_levels(rng, 6, rows)
    assume(well_conditioned(6, levels, 0.1))
    # Each level in turn reaches a bound with the last bit.
    for level in solve(levels, **DEFAULTS).levels:
        fastest = np.abs(level.velocity).max()
        before, after = (redistribute(levels, np.full(6, -bound), np.full(6, bound),
                                      **DEFAULTS).velocity
                         for bound in (fastest * (1.0 + 1e-7), fastest * (1.0 - 1e-7)))
        # What is soft moves by the excess over μ² at most, a few thousand times as far.
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-3 * fastest)


# Priority

@pytest.mark.slow
@settings(max_examples=100)
@given(hierarchies(kinds=('symmetric', 'mixed', 'beside zero')))
def test_no_level_is_changed_by_the_levels_below_it(problem):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    levels = as_levels(hierarchy)
    whole = redistribute(levels, lower, upper).velocity
    for count in range(1, len(levels)):
        alone = redistribute(levels[:count], lower, upper).velocity
        for J, *demand in hierarchy[:count]:
            if len(demand) == 1:
                size = max(1.0, np.linalg.norm(J) * np.linalg.norm(alone))
                assert np.linalg.norm(J @ (whole - alone)) < 1e-9 * size
        np.testing.assert_array_less(misses(hierarchy[:count], whole),
                                     misses(hierarchy[:count], alone) + 1e-9)


# Idle bounds, and invariance

@pytest.mark.slow
@given(hierarchies(rows=False, max_levels=4), st.sampled_from([{}, DEFAULTS, {'damping': 0.3}]),
       st.booleans())
def test_bounds_that_are_idle_change_nothing(problem, options, barely):
    n, hierarchy, _, _ = problem
    assume(well_conditioned(n, hierarchy))
    free = solve(hierarchy, **options)
    largest = np.abs(free.velocity).max() + 1e-3
    if options or not barely:
        # No level is to meet them on the way either, or it costs the regularisation's share.
        largest = max(largest, *(np.abs(level.velocity).max() + 1e-3 for level in free.levels))
    bounded = redistribute(hierarchy, np.full(n, -largest), np.full(n, largest), **options)
    np.testing.assert_allclose(bounded.velocity, free.velocity, rtol=0, atol=1e-9 * largest)
    assert bounded.scale == near(1.0) and bounded.limiting is None
    assert all(not level.limited_by for level in bounded.levels)


@pytest.mark.slow
@given(hierarchies(rows=False, max_levels=4))
def test_bounds_that_only_levels_on_the_way_meet_cost_little(problem):
    n, hierarchy, _, _ = problem
    assume(well_conditioned(n, hierarchy, 0.1))
    free = solve(hierarchy, **DEFAULTS).velocity
    largest = np.full(n, np.abs(free).max() * (1.0 + 1e-9) + 1e-12)
    bounded = redistribute(hierarchy, -largest, largest, **DEFAULTS).velocity
    for J, v in hierarchy:
        assert np.linalg.norm(J @ bounded - v) <= \
            np.linalg.norm(J @ free - v) + 0.01 * np.linalg.norm(v)


@pytest.mark.slow
@given(hierarchies(rows=False, max_levels=4), st.sampled_from([{}, DEFAULTS, {'damping': 0.3}]),
       st.floats(0.1, 2.0))
def test_joint_that_is_limited_leaves_joints_it_has_nothing_to_do_with_alone(problem, options,
                                                                             demand):
    # One more joint, at its bound: the levels have to be solved within the bounds.
    n, hierarchy, _, _ = problem
    assume(well_conditioned(n, hierarchy))
    free = solve(hierarchy, **options).velocity
    extended = [(np.block([[J, np.zeros((len(J), 1))], [np.zeros((1, n)), np.eye(1)]]),
                 np.append(v, demand)) for J, v in hierarchy]
    upper = np.append(np.full(n, np.abs(free).max() * 1e3 + 1.0), 0.05)
    velocity = redistribute(extended, -upper, upper, **options).velocity
    assert velocity[-1] == near(0.05)
    np.testing.assert_allclose(velocity[:-1], free, rtol=0,
                               atol=1e-8 * max(1.0, np.abs(free).max()))


@pytest.mark.slow
@given(hierarchies(max_joints=8), SEEDS)
def test_order_of_the_joints_and_frame_and_size_of_the_rows_do_not_matter(problem, seed):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    rng = np.random.default_rng(seed)
    before = redistribute(as_levels(hierarchy), lower, upper).velocity
    order = rng.permutation(n)
    permuted = [(J[:, order], *demand) for J, *demand in hierarchy]
    velocity = redistribute(as_levels(permuted), lower[order], upper[order]).velocity
    np.testing.assert_allclose(velocity, before[order], rtol=0, atol=1e-6)
    turned = []
    for J, *demand in hierarchy:
        size = rng.uniform(0.3, 3.0)
        if len(demand) == 1:
            Q = size * np.linalg.qr(rng.standard_normal((len(J), len(J))))[0]
            turned.append((Q @ J, Q @ demand[0]))
        else:
            turned.append((size * J, size * demand[0], size * demand[1]))
    velocity = redistribute(as_levels(turned), lower, upper).velocity
    np.testing.assert_allclose(velocity, before, rtol=0, atol=1e-6)


@pytest.mark.slow
@given(hierarchies(max_levels=4), st.sampled_from([{}, DEFAULTS]))
def test_same_problem_gives_the_same_velocity_to_the_last_digit(problem, options):
    n, hierarchy, lower, upper = problem
    cap = np.full(n, 0.3)
    one = redistribute(as_levels(hierarchy), lower, upper, speed_cap=cap, **options)
    copies = [tuple(part.copy() for part in level) for level in hierarchy]
    other = redistribute(as_levels(copies), lower.copy(), upper.copy(), speed_cap=cap.copy(),
                         **options)
    assert one.velocity.tolist() == other.velocity.tolist()


@pytest.mark.slow
@given(hierarchies(max_joints=8), st.sampled_from([1e-3, 1e3]), st.sampled_from([0.0, 0.05]))
def test_unit_of_length_does_not_matter(problem, unit, regularisation):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    options = {'singular_region': 0.1, 'damping': 0.1, 'regularisation': regularisation}
    before = redistribute(as_levels(hierarchy), lower, upper, **options).velocity
    measured = [tuple(unit * part for part in level) for level in hierarchy]
    options = {key: unit * value for key, value in options.items()}
    velocity = redistribute(as_levels(measured), lower, upper, **options).velocity
    np.testing.assert_allclose(velocity, before, rtol=0, atol=1e-6)


@pytest.mark.slow
@given(hierarchies(), st.sampled_from([{}, DEFAULTS]), st.booleans(),
       st.sampled_from([1.0, 1e-6, 1e3, 1e6]), st.sampled_from([1.0, 1e-3, 1e3]))
def test_answer_is_finite_and_within_the_bounds_whatever_the_conditions(problem, options, capped,
                                                                        unit, speed):
    n, hierarchy, lower, upper = problem
    if capped:
        options = {**options, 'speed_cap': np.full(n, 0.1)}
    hierarchy = [(unit * J, *(unit * speed * demand for demand in rest))
                 for J, *rest in hierarchy]
    solution = redistribute(as_levels(hierarchy), lower, upper, **options)
    assert np.isfinite(solution.velocity).all()
    assert (solution.velocity >= lower).all() and (solution.velocity <= upper).all()
    for level in solution.levels:
        assert (level.velocity >= lower).all() and (level.velocity <= upper).all()
        assert 0.0 <= level.scale <= 1.0
        for value in (level.unreachable, level.disturbance, level.multipliers):
            assert np.isfinite(value).all()


# Weights: what is left after all levels

@given(SEEDS, st.sampled_from([(3, 2), (6,), (2, 2, 2), (3, 3, 7), (9, 2)]),
       st.sampled_from([{}, DEFAULTS, {'damping': 0.1}]), st.booleans())
def test_weights_have_no_say_in_how_well_levels_are_carried_out(seed, rows, options, bounded):
    rng = np.random.default_rng(seed)
    n = 7
    levels, weights = random_levels(rng, n, rows), 10.0 ** rng.uniform(-4.0, 4.0, n)
    upper = rng.uniform(0.05, 0.6, n)
    box = (-upper, upper) if bounded else (None, None)
    equal = redistribute(levels, *box, **options).velocity
    weighted = redistribute(levels, *box, weights=weights, **options).velocity
    for J, v in levels:
        size = np.linalg.norm(v) + np.linalg.norm(J) * np.linalg.norm(equal)
        np.testing.assert_allclose(J @ weighted, J @ equal, rtol=0, atol=1e-12 * size)
    cost = weights / weights.max()
    assert cost @ weighted ** 2 <= cost @ equal ** 2 + 1e-12 * equal @ equal


@pytest.mark.slow
@given(hierarchies(max_joints=8, rows=False), SEEDS, st.booleans(), st.booleans())
def test_weighted_motion_is_least_among_those_that_do_the_same_for_every_level(problem, seed,
                                                                               bounded, damped):
    n, hierarchy, lower, upper = problem
    assume(well_conditioned(n, hierarchy))
    if not bounded:
        lower, upper = np.full(n, -INFINITE), np.full(n, INFINITE)
    weights = 10.0 ** np.random.default_rng(seed).uniform(-1.0, 1.0, n)
    velocity = redistribute(hierarchy, lower, upper, weights=weights,
                            **(DEFAULTS if damped else {})).velocity
    least = constrained_lstsq(np.diag(np.sqrt(weights)), np.zeros(n), np.eye(n), lower, upper,
                              np.concatenate([J for J, _ in hierarchy]), velocity)
    np.testing.assert_allclose(velocity, least, rtol=0,
                               atol=1e-7 * max(1.0, np.abs(velocity).max()))


@pytest.mark.parametrize('weights, velocity', [(None, [0.3, 0.3]), ([1.0, 5.0], [0.5, 0.1]),
                                               ([7.0, 1.0], [0.075, 0.525])])
def test_what_moves_no_level_is_shared_by_weights_within_the_bounds(weights, velocity):
    # Σ = 0.6 of two joints; what another level damps or relaxes makes no difference.
    stack = [([[1.0, 1.0, 0.0]], [0.6]), ([[0.0, 0.0, 1e-3]], [1.0])]
    for options in ({}, DEFAULTS):
        found = redistribute(stack[:2 if options else 1], -np.ones(3), np.ones(3),
                             weights=None if weights is None else [*weights, 1.0], **options)
        assert found.velocity[:2] == near(velocity)
        # Nor does what moves least undo what the second level got.
        assert found.velocity[2] == near(1e-3 / (1e-6 + 0.01 * (1.0 - 1e-4)) if options else 0.0)
    tight = redistribute(stack[:1], -np.ones(3), [0.4, 0.25, 1.0],
                         weights=None if weights is None else [*weights, 1.0])
    first = np.clip(velocity[0], 0.35, 0.4)
    assert tight.velocity == near([first, 0.6 - first, 0.0])


# Mode scale

def direction_problem(seed, n=6, rows=(2, 2)):
    """Return levels of mode scale that the bounds slow, and the bounds."""
    rng = np.random.default_rng(seed)
    levels = [Level(J, v, 'scale') for J, v in random_levels(rng, n, rows)]
    return levels, -rng.uniform(0.02, 0.4, n), rng.uniform(0.02, 0.4, n)


def largest_share(levels, lower, upper, above=()):
    """Return the largest s with J x = s v within the bounds, `above` = [(J, J x)] kept."""
    J, v = levels[-1].J, levels[-1].v
    A = np.hstack([J, -v[:, None]])
    b = np.zeros(len(v))
    for rows, values in above:
        A = np.concatenate([A, np.hstack([rows, np.zeros((len(rows), 1))])])
        b = np.concatenate([b, values])
    found = linprog(np.append(np.zeros(J.shape[1]), -1.0), A_eq=A, b_eq=b,
                    bounds=[*zip(lower, upper), (0.0, 1.0)])
    return found.x[-1] if found.status == 0 else None


@pytest.mark.slow
@given(SEEDS, st.sampled_from([(1,), (2,), (3,), (5,), (2, 2)]), st.sampled_from([{}, DEFAULTS]))
def test_mode_scale_keeps_the_direction_and_slows_as_little_as_possible(seed, rows, options):
    levels, lower, upper = direction_problem(seed, rows=rows)
    s = np.linalg.svd(levels[0].J, compute_uv=False)
    assume(s[-1] > 0.15)
    level = redistribute(levels, lower, upper, **options).levels[0]
    np.testing.assert_allclose(level.achieved, level.scale * level.demand, rtol=0,
                               atol=1e-8 if not options else 1e-6)
    best = largest_share(levels[:1], lower, upper)
    # The regularisation costs a little speed.
    assert level.scale == pytest.approx(best, abs=1e-8 if not options else 1e-2)
    assert level.scale <= best + 1e-8
    wider = redistribute(levels, 1.2 * lower, 1.5 * upper, **options).levels[0]
    assert wider.scale >= level.scale - 1e-9
    if level.scale < 1.0 - 1e-9:
        assert level.limited_by


@pytest.mark.slow
def test_lower_level_of_mode_scale_is_the_largest_share_that_the_levels_above_leave():
    found = 0
    for seed in range(60):
        levels, lower, upper = direction_problem(seed, rows=(1, 2))
        solution = redistribute(levels, lower, upper)
        above = [(levels[0].J, levels[0].J @ solution.velocity)]
        resting = [levels[0], Level(levels[1].J, 0.0 * levels[1].v)]
        # Where the first level moves the second whatever it does, there is no direction to keep.
        if largest_share(resting, lower, upper, above) is not None:
            found += 1
            best = largest_share(levels, lower, upper, above)
            np.testing.assert_allclose(solution.levels[1].achieved, best * levels[1].v, rtol=0,
                                       atol=1e-7)
    assert found > 15


def test_mode_scale_worked_out_by_hand():
    # (2, 1) within 0.5: scaled to a quarter, where least squares would give (0.5, 0.5).
    demand = np.array([2.0, 1.0])
    box = np.full(2, -0.5), np.full(2, 0.5)
    solution = redistribute([Level(np.eye(2), demand, 'scale')], *box)
    assert solution.velocity == near([0.5, 0.25])
    assert (solution.scale, solution.limiting) == (near(0.25), 0)
    assert redistribute([Level(np.eye(2), demand)], *box).velocity == near([0.5, 0.5])
    # Three joints for two directions: the third makes up for the first, and nothing is scaled.
    J = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    solution = redistribute([Level(J, np.array([0.9, 0.4]), 'scale')], np.full(3, -0.5),
                            np.array([0.2, 0.5, 1.0]))
    assert solution.velocity == near([0.2, 0.4, 0.7])
    assert solution.scale == near(1.0)


@given(SEEDS, st.floats(-3.0, 0.0), st.sampled_from([0.0, 20.0]))
def test_damped_level_of_mode_scale_is_slowed_along_the_way_it_has_without_bounds(
        seed, exponent, h):
    # As many rows as joints, one of them weak: no joint can make up for another.
    rng = np.random.default_rng(seed)
    U, V = (np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(2))
    J, v = U @ np.diag([1.0, 0.8, 10.0 ** exponent]) @ V, rng.standard_normal(3)
    options = {**DEFAULTS, 'period': 0.01, 'memory': (h,)}
    free = redistribute([(J, v)], **options).velocity
    level = Level(J, v, 'scale')
    np.testing.assert_allclose(redistribute([level], **options).velocity, free, rtol=0,
                               atol=1e-9 * np.abs(free).max())
    upper = rng.uniform(0.1, 0.5, 3) * np.abs(free).max()
    slowed = redistribute([level], -upper, upper, **options).velocity
    share = np.min(upper / np.abs(free))
    np.testing.assert_allclose(slowed, min(share, 1.0) * free, rtol=0,
                               atol=1e-6 * np.abs(free).max())


def test_level_that_keeps_its_direction_is_damped_once():
    # Joint 1 gives it 0.01; of the rest it has s = 0.05 with λ = ε = 0.1: s / ε² times 0.002.
    first = ([[1.0, 0.0, 0.0]], [0.01])
    J, v = np.array([[1.0, 0.05, 0.0]]), np.array([0.012])
    for mode in ('least_squares', 'scale'):
        assert redistribute([first, Level(J, v, mode)], **DEFAULTS).velocity == near(
            [0.01, 0.05 / 0.01 * 0.002, 0.0])


@given(SEEDS)
def test_mode_makes_no_difference_where_nothing_is_in_the_way(seed):
    rng = np.random.default_rng(seed)
    first, (J, v) = random_levels(rng, 5, [2, 3])
    J = (J.T * [1.0, 0.1, 0.01]).T
    velocities = [redistribute([first, Level(J, v, mode)], **DEFAULTS).velocity
                  for mode in ('least_squares', 'scale')]
    np.testing.assert_allclose(*velocities, rtol=1e-9, atol=1e-9)


@given(SEEDS, st.sampled_from([0.0, 5.0, 50.0]), st.sampled_from([0.02, 0.5]))
def test_level_of_one_row_has_but_one_direction_to_keep(seed, h, regularisation):
    rng = np.random.default_rng(seed)
    J, v, upper = 3.0 * rng.standard_normal((1, 5)), rng.standard_normal(1), np.full(5, 0.05)
    options = {**DEFAULTS, 'regularisation': regularisation, 'period': 0.01, 'memory': (h,)}
    scaled = redistribute([Level(J, v, 'scale')], -upper, upper, **options)
    plain = redistribute([Level(J, v)], -upper, upper, **options)
    np.testing.assert_allclose(scaled.velocity, plain.velocity, rtol=0, atol=1e-9)
    assert scaled.memory == (near(plain.memory[0], rel=1e-6),)


def test_scaled_level_that_cannot_be_brought_to_rest_gets_what_it_demands_all_the_same():
    # Level 1 moves it by 0.5, joint 2 can take 0.2 of that away; the last level is too fast.
    levels = [([[1.0, 0.0, 0.0]], [0.5]), Level(np.array([[1.0, 1.0, 0.0]]), np.array([2.0]),
                                                'scale'), (np.eye(3), [0.0, 0.0, 5.0])]
    solution = redistribute(levels, [-1.0, -0.2, -1.0], [1.0, 1.6, 1.0])
    assert solution.velocity == near([0.5, 1.5, 1.0])


# Speed cap

@given(SEEDS, st.sampled_from([{}, DEFAULTS]), st.floats(0.0, 0.5))
@example(0, {}, 0.0)
def test_speed_cap_binds_the_levels_below_the_first_alone(seed, options, cap):
    rng = np.random.default_rng(seed)
    levels = random_levels(rng, 6, [2, 2, 6])
    upper = rng.uniform(0.2, 1.0, 6)
    capped = redistribute(levels, -upper, upper, speed_cap=np.full(6, cap), **options)
    first = redistribute(levels[:1], -upper, upper, speed_cap=np.full(6, cap), **options)
    J = levels[0][0]
    # Regularised, the levels below have a say in how the first one is met, but hardly in how well.
    np.testing.assert_allclose(J @ capped.velocity, J @ first.velocity, rtol=0,
                               atol=0.03 if options else 1e-8)
    used = np.abs(capped.levels[0].velocity)
    assert (np.abs(capped.velocity) <= np.maximum(cap, used) + 1e-12).all()
    assert (np.abs(capped.velocity) <= upper).all()


def test_speed_cap_worked_out_by_hand():
    levels = [([[1.0, 0.0, 0.0]], [0.9]), ([[1.0, 1.0, 0.0]], [3.0]), (np.eye(3), np.ones(3))]
    solution = redistribute(levels, -np.ones(3), np.ones(3), speed_cap=[0.5, 0.5, 0.5])
    assert solution.velocity == near([0.9, 0.5, 0.5])
    assert solution.levels[1].limited_by == [1]
    # One level alone has all of the speed.
    solution = redistribute(levels[2:], -np.ones(3), np.ones(3), speed_cap=[0.5, 0.5, 0.5])
    assert solution.velocity == near([1.0, 1.0, 1.0])


def test_speed_cap_holds_without_bounds_too():
    levels = [([[1.0, 0.0]], [0.9]), (np.eye(2), np.ones(2))]
    rows = Level(np.eye(2), lower=np.full(2, -9.0))
    for stack in (levels, [rows, *levels]):
        assert redistribute(stack, speed_cap=[0.5, 0.5]).velocity == near([0.9, 0.5])


@pytest.mark.parametrize('side', [1.0, -1.0])
def test_speed_cap_gives_way_to_bounds_that_exclude_it(side):
    lower, upper = sorted([np.full(2, 0.8 * side), np.full(2, 1.0 * side)], key=sum)
    demand = np.full(2, 0.5 * side)
    solution = redistribute([(np.eye(2)[:1], demand[:1]), (np.eye(2), demand)], lower, upper,
                            speed_cap=[0.5, 0.5])
    assert solution.velocity == near([0.8 * side] * 2)
