# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What a level leaves free: relaxed directions, and what that costs it."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from problems import DEFAULTS, near, redistribute, SEEDS
import pytest
from reference import null_of, random_levels
from tp_controller import Level, solve
from tp_controller.solver.null_space import decompose, null_space, remaining


def weak_problem(seed, n=6):
    """Return levels whose singular values lie in, around and below `release_region`."""
    rng = np.random.default_rng(seed)
    levels = []
    for m in rng.integers(1, 4, 4):
        U = np.linalg.qr(rng.standard_normal((m, m)))[0]
        V = np.linalg.qr(rng.standard_normal((n, n)))[0][:m]
        levels.append((U @ np.diag(10.0 ** rng.uniform(-3.5, 0.5, m)) @ V,
                       0.3 * rng.standard_normal(m)))
    return levels, rng.uniform(0.05, 1.0, n)


def check_disturbance(levels, bounds, indices, **options):
    """Compare what the levels below change, by leaving them out, with what is said of it."""
    options = {**DEFAULTS, 'regularisation': 0.0, **options}
    whole = redistribute(levels, *bounds, **options)
    for index in indices:
        alone = redistribute(levels[:index + 1], *bounds, **options)
        J, level = np.asarray(levels[index][0]), whole.levels[index]
        changed = J @ (whole.velocity - alone.velocity)
        assert np.linalg.norm(level.disturbance) <= level.disturbance_bound + 1e-9
        assert np.linalg.norm(changed) <= level.disturbance_bound + 1e-7


@pytest.mark.slow
@given(SEEDS, st.booleans())
def test_relaxed_directions_of_the_first_level_are_disturbed_by_no_more_than_the_bound(seed,
                                                                                       tight):
    levels, upper = weak_problem(seed)
    check_disturbance(levels, (-upper, upper) if tight else (None, None), [0])


@pytest.mark.slow
@given(SEEDS, st.booleans())
def test_relaxed_directions_of_any_level_are_disturbed_by_no_more_than_the_bound(seed, tight):
    levels, upper = weak_problem(seed)
    check_disturbance(levels, (-upper, upper) if tight else (None, None), range(4))


@pytest.mark.slow
@given(SEEDS)
def test_disturbance_bound_holds_with_weights_too(seed):
    levels, upper = weak_problem(seed)
    check_disturbance(levels, (-upper, upper), [0], weights=[1.0, 4.0, 1.0, 9.0, 1.0, 0.5])


def test_disturbance_bound_of_a_level_whose_direction_another_has_relaxed():
    # The second level sees what is left of the first one's weak direction, 0.12 of it.
    levels = [([[0.009, 0.0]], [0.0]), ([[0.1, 0.0]], [0.0]), (np.eye(2), [1.0, 1.0])]
    level = redistribute(levels, -np.ones(2), np.ones(2), **DEFAULTS).levels[1]
    assert 0.0 < np.linalg.norm(level.disturbance) <= level.disturbance_bound


@pytest.mark.parametrize('damping', [0.05, 0.1, 0.2])
@pytest.mark.parametrize('s, share', [(0.02, 0.0), (0.01, 0.0), (0.005, 0.5), (0.0025, 0.84375),
                                      (0.001, 0.972), (1e-6, 1.0)])
def test_nothing_is_relaxed_above_the_region_and_more_and_more_below_it(damping, s, share):
    # k = t² (3 − 2 t) is kept, t = s / 0.01.
    levels = [([[s, 0.0]], [0.0]), (np.eye(2), [1.0, 1.0])]
    solution = solve(levels, release_region=0.01)
    # What is left of the direction, undamped.
    assert solution.velocity == near([1.0 if share else 0.0, 1.0])
    # With damping the level below follows the direction by the share that is relaxed.
    damped = solve(levels, release_region=0.01, damping=damping)
    free = 1.0 / (1.0 + damping ** 2)
    assert damped.velocity == near([min(share, free), free])
    level = damped.levels[0]
    assert level.disturbance == near([s * damped.velocity[0]])
    assert level.disturbance_bound == near(
        s * np.linalg.norm(damped.velocity) if share else 0.0)


def test_directions_are_those_of_what_is_left_and_what_is_left_moves_no_level():
    rng = np.random.default_rng(7)
    for rows in ([2, 3], [4, 2, 1], [1, 1, 1], [3, 9]):
        Z, above = None, np.zeros((0, 7))
        for J, v in random_levels(rng, 7, rows):
            level = Level(J, v)
            directions = decompose(level, Z)
            U, s, Q = directions.U, directions.s, directions.Q
            P = null_of(above)
            np.testing.assert_allclose(s, np.linalg.svd(J @ P, compute_uv=False)[:len(s)],
                                       rtol=1e-9)
            assert len(s) == np.linalg.matrix_rank(J @ P) == directions.rank
            assert directions.smallest == (s[-1] if len(J) <= Q.shape[1] else 0.0)
            assert directions.size == near(np.linalg.norm(J))
            np.testing.assert_allclose(J @ Q[:, :len(s)], U * s, rtol=0, atol=1e-12)
            np.testing.assert_allclose(Q.T @ Q, np.eye(Q.shape[1]), rtol=0, atol=1e-12)
            Z, above = remaining(directions), np.concatenate([above, J])
            assert Z.shape[1] == 7 - np.linalg.matrix_rank(above)
            np.testing.assert_allclose(above @ Z, 0.0, rtol=0, atol=1e-12)
            np.testing.assert_allclose(Z.T @ Z, np.eye(Z.shape[1]), rtol=0, atol=1e-12)


def test_recursion_is_the_one_of_lecture_section_2_2():
    rng = np.random.default_rng(3)
    levels = random_levels(rng, 7, [2, 3, 4])
    zeta, P = np.zeros(7), np.eye(7)
    steps = solve(levels).steps
    for (J, v), step in zip(levels, steps):
        inverse = np.linalg.pinv(J @ P, rcond=1e-9)
        zeta, P = zeta + inverse @ (v - J @ zeta), P - inverse @ (J @ P)
        np.testing.assert_allclose(step.velocity, zeta, rtol=0, atol=1e-9)
        assert step.directions.rank == np.linalg.matrix_rank(inverse)


def test_null_space_of_levels_is_what_moves_none_of_them_whatever_was_relaxed():
    rng = np.random.default_rng(3)
    levels = [Level(np.diag([1.0, 1e-4, 0.0, 0.0])[:2], np.zeros(2)),
              Level(rng.standard_normal((1, 4)), np.zeros(1))]
    Z = null_space(levels, 4)
    assert Z.shape == (4, 1)
    np.testing.assert_allclose(np.concatenate([level.J for level in levels]) @ Z, 0.0, rtol=0,
                               atol=1e-12)
    assert np.linalg.norm(Z) == near(1.0)


def test_what_two_levels_above_relax_is_left_to_the_levels_below_both():
    # s = 0.6 δ keeps k = 0.648; the last level follows g² / λ² = (1 − k) / k of its demand.
    levels = [([[0.012, 0.0, 0.0]], [0.0]), ([[0.0, 1.0, 0.0]], [0.0]), (np.eye(3), np.ones(3))]
    assert redistribute(levels, **DEFAULTS).velocity == near([0.352 / 0.648, 0.0, 1.0])


def test_what_a_level_below_gets_of_a_relaxed_direction_grows_smoothly():
    shares = []
    for s in np.linspace(0.021, 0.001, 101):
        levels = [([[s, 0.0]], [0.0]), (np.eye(2), [1.0, 0.0])]
        shares.append(redistribute(levels, **{**DEFAULTS, 'release_region': 0.02}).velocity[0])
    assert shares[0] == near(0.0) and shares[-1] == near(1.0, rel=0.01)
    assert (np.diff(shares) >= -1e-12).all()
    # Over the half of the region in which k falls from 1 to 1/2, not in a small part of it.
    assert np.diff(shares).max() < 0.08


def test_bound_of_the_disturbance_counts_the_strongest_direction_that_is_relaxed():
    levels = [(np.diag([0.5, 0.008, 0.0005]), np.zeros(3)), (np.eye(3), np.ones(3))]
    level = solve(levels, release_region=0.01).levels[0]
    assert level.disturbance == near([0.0, 0.008, 0.0005])
    assert level.disturbance_bound == near(0.008 * math.sqrt(2.0))


def test_disturbance_is_told_where_bounds_are_in_the_way_as_well():
    # Joint 1 is wholly relaxed; the bound on joint 2 has nothing to do with that.
    levels = [([[0.0005, 0.0], [0.0, 1.0]], [0.0, 2.0]), (np.eye(2), [0.4, 0.0])]
    for upper in (9.0, 1.0):
        level = redistribute(levels, np.full(2, -upper), np.full(2, upper),
                             release_region=0.01).levels[0]
        assert level.disturbance == near([0.0002, 0.0])
        assert level.disturbance_bound == near(0.0002)


@pytest.mark.parametrize('s', [0.0005, 0.003, 0.006, 0.009])
@pytest.mark.parametrize('below', [[], [([[0.0, 1.0, 0.0, 0.0]], [0.3])],
                                   [(np.eye(4), [0.5, 0.3, 0.2, 0.0])]])
def test_relaxed_direction_is_left_alone_by_a_bound_it_has_nothing_to_do_with(s, below):
    levels = [([[s, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]], [0.002, 2.0]), *below]
    free = solve(levels, **DEFAULTS).velocity
    bounded = redistribute(levels, -np.ones(4), np.array([1.0, 1.0, 1.0, 0.1]), **DEFAULTS)
    np.testing.assert_allclose(bounded.velocity, [*free[:3], 0.1], rtol=0, atol=1e-9)
