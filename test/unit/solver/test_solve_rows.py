# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Levels with bounds, beside answers worked out by hand."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from problems import DEFAULTS, INFINITE, near, redistribute, SEEDS
import pytest
from reference import constrained_lstsq, null_of, random_levels
from tp_controller import Level, solve


def test_row_that_is_in_the_way_is_kept_and_has_the_multiplier():
    rows = Level(np.array([[1.0, 1.0]]), upper=np.array([1.0]))
    solution = redistribute([rows, (np.eye(2), [1.0, 1.0])])
    assert solution.velocity == near([0.5, 0.5])
    level = solution.levels[1]
    assert list(level.row_multipliers) == [0]
    assert level.row_multipliers[0] == near([0.5])
    assert level.limited_by == []
    assert solution.levels[0].row_multipliers == {}
    assert solution.levels[0].demand == near([1.0])


def test_row_of_its_own_moves_the_joints_only_as_far_as_it_must():
    rows = Level(np.array([[3.0, 4.0]]), lower=np.array([1.0]), upper=np.array([7.0]))
    assert redistribute([rows]).velocity == near([0.12, 0.16])
    lowered = Level(np.array([[3.0, 4.0]]), upper=np.array([-1.0]))
    assert redistribute([lowered]).velocity == near([-0.12, -0.16])
    # Joint 2 is at its bound, joint 1 does the rest.
    assert redistribute([rows], [-1.0, -1.0], [1.0, 0.1]).velocity == near([0.2, 0.1])


def test_contradicting_rows_share_the_violation():
    rows = Level(np.array([[1.0, 0.0], [1.0, 0.0]]), lower=np.array([1.0, -INFINITE]),
                 upper=np.array([INFINITE, 0.0]))
    solution = redistribute([rows, (np.eye(2), [5.0, 1.0])])
    assert solution.velocity == near([0.5, 1.0])
    level = solution.levels[0]
    assert level.residual == near([0.5, -0.5])
    assert level.row_multipliers[0] == near([-0.5, 0.5])


def test_row_of_zeros_is_met_or_not_whatever_the_joints_do():
    rows = Level(np.array([[0.0, 0.0], [0.0, 1.0]]), lower=np.array([1.0, -1.0]),
                 upper=np.array([2.0, 0.5]))
    solution = redistribute([rows, (np.eye(2), [1.0, 1.0])])
    assert solution.velocity == near([1.0, 0.5])
    assert solution.levels[0].residual == near([1.0, 0.0])


@pytest.mark.parametrize('length, turning', [(1.0, 1.0), (0.01, 50.0)])
def test_rows_that_cannot_be_met_bend_with_what_they_push_against(length, turning):
    # 0.7 is missing, and pushes against the bound above, which turns fast where it is short.
    above = Level(np.array([[length, 0.0]]), upper=np.array([0.2 * length]))
    rows = Level(np.eye(2), lower=np.array([0.9, 0.1]))
    memory = redistribute([above, rows], period=0.01).memory
    assert memory == near((0.0, 0.7 * math.hypot(1.0, turning) * (1.0 - math.exp(-0.1))))


def test_rows_that_cannot_be_met_bend_with_the_levels_that_they_push_against():
    # The level above turns by 2 for each radian.
    above = np.array([[1.0, 0.0]]), np.array([0.2])
    rows = Level(np.eye(2), lower=np.array([0.9, 0.1]))
    memory = redistribute([above, rows], period=0.01).memory
    assert memory == near((0.0, 0.7 * (1.0 + 2.0) * (1.0 - math.exp(-0.1))))


@pytest.mark.parametrize('demand', [-5.0, 0.5, 5.0])
def test_lower_row_never_worsens_a_higher_one(demand):
    least = Level(np.array([[1.0, 0.0]]), lower=np.array([1.0]))
    most = Level(np.array([[1.0, 0.0]]), upper=np.array([0.0]))
    solution = redistribute([least, most, (np.eye(2), [demand, 0.0])])
    assert solution.velocity == near([1.0, 0.0])
    solution = redistribute([most, least, (np.eye(2), [demand, 0.0])])
    assert solution.velocity == near([0.0, 0.0])
    assert [level.rank for level in solution.levels] == [0, 0, 2]


@pytest.mark.parametrize('length', [1.0, 0.1, 0.01, 1e-4])
@pytest.mark.parametrize('period', [0.0, 0.01])
def test_row_holds_against_what_is_below_however_short_it_is(length, period):
    options = {**DEFAULTS, 'period': period}
    wall = Level(np.array([[length, 0.0]]), upper=np.array([0.2 * length]))
    push = Level(np.array([[length, 0.0]]), lower=np.array([length]))
    box = np.full(2, -2.0), np.full(2, 2.0)
    for demand in (1.0, 2.0):
        memory = None
        for cycle in range(20):
            solution = redistribute([wall, (np.eye(2), [demand, demand])], *box, memory=memory,
                                    **options)
            memory = solution.memory
            assert solution.velocity[0] <= 0.2 + 1e-9
            if cycle == 0 or not period:
                assert solution.velocity == near([0.2, demand])
    solution = redistribute([push], *box, **options)
    assert solution.velocity == near([1.0, 0.0])
    # What can be met needs nobody's permission.
    assert not solution.levels[0].multipliers.any() and solution.levels[0].row_multipliers == {}


@pytest.mark.slow
@given(SEEDS, st.sampled_from([0.0, 0.01]))
def test_what_is_violated_of_rows_is_the_same_whatever_is_below(seed, period):
    rng = np.random.default_rng(seed)
    n, options = 5, {**DEFAULTS, 'period': period}
    lower = 2.0 * rng.standard_normal(4)
    rows = Level(rng.standard_normal((4, n)), lower=lower, upper=lower + rng.uniform(0.0, 1.0, 4))
    below = [Level(rng.standard_normal((3, n)), 3.0 * rng.standard_normal(3)),
             Level(np.eye(n), rng.standard_normal(n))]
    box = -rng.uniform(0.1, 1.0, n), rng.uniform(0.1, 1.0, n)
    alone = redistribute([rows], *box, **options).levels[0].residual
    for stack in ([rows, below[0]], [rows, *below]):
        residual = redistribute(stack, *box, **options).levels[0].residual
        np.testing.assert_allclose(residual, alone, rtol=0, atol=1e-6)


@pytest.mark.parametrize('share', [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize('options', [{}, DEFAULTS, {**DEFAULTS, 'period': 0.01}])
def test_rows_of_very_different_length_hold_in_one_level(share, options):
    J = np.diag([1.0, share])
    wall = Level(J, upper=np.array([0.2, 0.2 * share]))
    push = Level(J, lower=np.array([0.5, 0.5 * share]))
    box = np.full(2, -2.0), np.full(2, 2.0)
    solution = redistribute([wall, (np.eye(2), np.ones(2))], *box, **options)
    assert (wall.J @ solution.velocity <= wall.upper * (1.0 + 1e-6)).all()
    assert solution.velocity == near([0.2, 0.2])
    assert redistribute([push], *box, **options).velocity == near([0.5, 0.5])


def test_what_is_missing_counts_in_the_units_of_the_rows():
    # Two walls that contradict each other share by the squares of what their rows count.
    rows = Level(np.array([[1.0], [2.0]]), lower=np.array([1.0, -INFINITE]),
                 upper=np.array([INFINITE, 0.0]))
    # Least (1 − x)² + (2 x)².
    assert redistribute([rows]).velocity == near([0.2], rel=1e-7)


def test_rows_below_an_equality_level_give_way_to_it():
    rows = Level(np.array([[1.0, 0.0], [0.0, 1.0]]), lower=np.array([0.5, 0.5]))
    solution = redistribute([([[1.0, 0.0]], [0.2]), rows])
    assert solution.velocity == near([0.2, 0.5])
    assert solution.levels[1].residual == near([0.3, 0.0])


def test_rows_whose_bounds_coincide_are_an_equation():
    rows = Level(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), lower=np.array([0.2, -INFINITE]),
                 upper=np.array([0.2, 0.5]))
    solution = redistribute([rows, (np.eye(3), [1.0, 2.0, 0.3])])
    assert solution.velocity == near([0.2, 0.5, 0.3])
    found = solution.levels[1].row_multipliers[0]
    assert found.shape == (2,)
    assert found[1] == near(1.5)


def test_multipliers_of_rows_stay_with_their_levels_where_some_are_equations():
    equation = Level(np.array([[1.0, 0.0, 0.0]]), lower=np.array([0.2]), upper=np.array([0.2]))
    row = Level(np.array([[0.0, 1.0, 0.0]]), upper=np.array([0.5]))
    solution = redistribute([equation, row, (np.eye(3)[1:], [2.0, 0.3])])
    assert solution.velocity == near([0.2, 0.5, 0.3])
    found = solution.levels[2].row_multipliers
    assert found[1] == near([1.5])
    assert 0 not in found or found[0] == near([0.0])


def test_equation_is_met_beside_a_relaxed_direction():
    equation = Level(np.array([[0.0, 1.0, 0.0]]), lower=np.array([0.2]), upper=np.array([0.2]))
    weak = ([[0.005, 0.0, 0.0]], [0.001])
    for below in ([], [([[0.0, 0.0, 1.0]], [0.3])]):
        solution = redistribute([equation, weak, *below], -np.ones(3), np.ones(3), **DEFAULTS)
        assert solution.velocity[1] == pytest.approx(0.2, abs=1e-4)


def test_rows_without_joint_bounds_and_idle_rows_change_nothing():
    levels = random_levels(np.random.default_rng(2), 5, [2, 2])
    free = solve(levels).velocity
    rows = Level(np.eye(5), lower=np.full(5, -1e3), upper=np.full(5, 1e3))
    for position in range(3):
        stack = [*levels[:position], rows, *levels[position:]]
        np.testing.assert_allclose(redistribute(stack).velocity, free, rtol=0, atol=1e-12)


@given(SEEDS)
def test_bounds_as_rows_are_the_same_as_bounds_on_the_joints(seed):
    rng = np.random.default_rng(seed)
    levels = random_levels(rng, 5, [2, 2])
    upper = rng.uniform(0.05, 0.5, 5)
    rows = Level(np.eye(5), lower=-upper, upper=upper)
    np.testing.assert_allclose(redistribute([rows, *levels]).velocity,
                               redistribute(levels, -upper, upper).velocity, rtol=0, atol=1e-8)


@pytest.mark.parametrize('degrees', [30.0, 6.0, 5.0, 2.0, 0.5, 0.01])
def test_bounds_of_which_little_is_left_ask_for_less_instead_of_racing(degrees):
    """A row at a small angle to a task above: what is left of it is s = sin(angle)."""
    s = math.sin(math.radians(degrees))
    task = (np.array([[1.0, 0.0]]), np.array([0.0]))
    # However long the row is.
    for length in (0.01, 1.0, 50.0):
        row = Level(length * np.array([[math.sqrt(1.0 - s * s), s]]),
                    lower=np.array([0.2 * length]))
        exact = solve([task, row], scaling='redistribute').velocity
        np.testing.assert_allclose(exact, [0.0, 0.2 / s], rtol=1e-6, atol=1e-12)
        damped = solve([task, row], scaling='redistribute', damping=0.1,
                       singular_region=0.1).velocity
        # Damped as λ² (1 − (s/ε)²) with λ = ε = 0.1.
        squared = 0.01 * max(1.0 - (s / 0.1) ** 2, 0.0)
        np.testing.assert_allclose(damped, [0.0, 0.2 * s / (s * s + squared)], rtol=1e-6)
        # Above all tasks bounds are met, whatever that takes.
        first = solve([row, task], scaling='redistribute', damping=0.1, singular_region=0.1)
        assert row.J @ first.velocity == pytest.approx(0.2 * length)


DAMPED = {'scaling': 'redistribute', 'damping': 0.1, 'singular_region': 0.1}


def eased(lacking, asked, s):
    """Return the least speed v with s v + w = lacking, w ≥ 0, or v = s (100 asked + w)."""
    return min(lacking / s, s * (100.0 * asked + lacking) / (1.0 + s * s))


@pytest.mark.parametrize('together', [False, True])
@pytest.mark.parametrize('degrees', [30.0, 6.0, 5.0, 2.0, 0.5])
@pytest.mark.parametrize('length', [0.01, 1.0, 50.0])
def test_bounds_of_which_other_bounds_leave_little_ask_for_less(degrees, together, length):
    """A row at a small angle to an active one, above it or in the same level."""
    s = math.sin(math.radians(degrees))
    row, wall = length * np.array([[math.sqrt(1.0 - s * s), s]]), np.array([[1.0, 0.0]])
    lower = np.array([0.2 * length])
    levels = [Level(wall, upper=np.zeros(1)), Level(row, lower=lower)]
    if together:
        levels = [Level(np.vstack([wall, row]), lower=np.array([-np.inf, *lower]),
                        upper=np.array([0.0, np.inf]))]
    found = solve(levels, **DAMPED).velocity
    np.testing.assert_allclose(found, [0.0, eased(0.2, 0.2, s)], rtol=1e-6, atol=1e-12)
    exact = solve(levels, scaling='redistribute').velocity
    np.testing.assert_allclose(exact, [0.0, 0.2 / s], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize('limit', [0.0, 0.05, 0.15])
@pytest.mark.parametrize('degrees', [30.0, 6.0, 5.0, 2.0, 0.5])
def test_bounds_that_joints_at_their_limits_meet_in_part_ask_the_rest_for_less(degrees, limit):
    """Whatever the first joint can do it does; of the row it leaves s."""
    s = math.sin(math.radians(degrees))
    way = math.sqrt(1.0 - s * s)
    for side in (1.0, -1.0):
        lower, upper = sorted((0.2 * side, 3.0 * side))
        row = Level(np.array([[way, s]]), lower=np.array([lower]), upper=np.array([upper]))
        ends = np.array([limit, np.inf])
        found = solve([row], -ends, ends, **DAMPED).velocity
        np.testing.assert_allclose(
            side * found, [limit, eased(0.2 - way * limit, 0.2, s)], rtol=1e-6, atol=1e-12)


@pytest.mark.slow
def test_bounds_of_which_little_is_left_do_not_make_the_joints_race():
    rng, fastest = np.random.default_rng(0), np.zeros(2)
    for _ in range(200):
        task = rng.normal(size=(2, 4))
        # Three rows close to what the task has taken, some of them short of their bounds.
        rows = rng.normal(size=(3, 2)) @ task + 0.05 * rng.normal(size=(3, 4))
        lower = rng.uniform(-0.3, 0.3, 3)
        levels = [(task, np.zeros(2)), Level(rows, lower=lower, upper=lower + 0.2)]
        for index, damping in enumerate((0.0, 0.1)):
            velocity = solve(levels, scaling='redistribute', damping=damping,
                             singular_region=0.1).velocity
            np.testing.assert_allclose(task @ velocity, 0.0, atol=1e-9)
            fastest[index] = max(fastest[index], np.linalg.norm(velocity))
    assert fastest[0] > 20.0 and fastest[1] < 0.5 * fastest[0]


def test_bounds_that_cannot_be_met_do_not_make_joints_race_for_little():
    """Two ends of a link in an obstacle: turning one out of it turns the other one in."""
    ends = Level(np.array([[0.010, 0.0], [-0.009, 0.0]]), lower=np.array([0.2, 0.2]))
    demand = (np.eye(2), np.array([0.3, 0.5]))
    box = -2.0 * np.ones(2), 2.0 * np.ones(2)
    exact = redistribute([ends, demand], *box).velocity
    # The least violation, worked out: Σ (0.2 − J q̇)².
    assert exact[0] == pytest.approx(0.2 * (0.010 - 0.009) / (0.010 ** 2 + 0.009 ** 2), rel=1e-6)
    calm = redistribute([ends, demand], *box, regularisation=0.05).velocity
    # Least Σ (0.2 − J q̇)² + μ² q̇², whatever is below.
    stiff = 0.010 ** 2 + 0.009 ** 2
    assert calm[0] == pytest.approx(0.2 * (0.010 - 0.009) / (stiff + 0.05 ** 2), rel=1e-6)
    again = redistribute([ends, (np.eye(2), np.array([-1.0, 0.5]))], *box, regularisation=0.05)
    np.testing.assert_allclose(ends.J @ again.velocity, ends.J @ calm, atol=1e-9)


@pytest.mark.slow
@given(SEEDS, st.sampled_from([0.05, 0.3, 1.0]))
def test_rows_that_cannot_be_met_are_weighed_against_rest(seed, regularisation):
    """Of what the level above leaves: least Σ missed² + μ² ‖Zᵀ q̇‖²."""
    rng = np.random.default_rng(seed)
    n, upper = 4, rng.uniform(0.1, 0.5, 4)
    J, v = rng.standard_normal((1, n)), 3.0 * rng.standard_normal(1)
    rows = rng.standard_normal((2, n))[[0, 0, 1]]
    bounds = np.array([1.0, -INFINITE, 0.5]), np.array([INFINITE, 0.2, 0.7])
    levels = redistribute([(J, v), Level(rows, lower=bounds[0], upper=bounds[1])], -upper, upper,
                          regularisation=regularisation).levels
    x, Z = levels[0].velocity, null_of(J)
    values = rows @ x
    size = np.eye(3)
    exact = constrained_lstsq(
        np.block([[regularisation * Z.T, np.zeros((3, 3))], [np.zeros((3, n)), size]]),
        np.zeros(6), np.block([[np.eye(n), np.zeros((n, 3))], [rows, size]]),
        np.concatenate([-upper, bounds[0]]), np.concatenate([upper, bounds[1]]),
        np.hstack([J, np.zeros((1, 3))]), np.concatenate([x, np.clip(values, *bounds) - values]))
    np.testing.assert_allclose(levels[1].velocity, exact[:n], rtol=0, atol=1e-6)
