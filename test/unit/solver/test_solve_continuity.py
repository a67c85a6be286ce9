# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Nothing jumps where bounds begin to matter, with the settings of the controller."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from problems import DEFAULTS, redistribute, SEEDS
import pytest
from reference import bounded_lexicographic
from tp_controller import Level
from tp_controller.solver.damping import FIRST


def largest_jump(path, steps=40, halvings=16):
    """Return the change of path(t) that is left where it is halved towards the steepest places."""
    times = np.linspace(0.0, 1.0, steps + 1)
    values = [path(t) for t in times]
    changes = [np.abs(b - a).max() for a, b in zip(values, values[1:])]
    left = 0.0
    for index in np.argsort(changes)[-4:]:
        a, b = times[index], times[index + 1]
        at_a, at_b = values[index], values[index + 1]
        for _ in range(halvings):
            middle = 0.5 * (a + b)
            at_middle = path(middle)
            if np.abs(at_middle - at_a).max() > np.abs(at_b - at_middle).max():
                b, at_b = middle, at_middle
            else:
                a, at_a = middle, at_middle
        left = max(left, np.abs(at_b - at_a).max())
    return left


def separated(rng, m, n):
    """Return a Jacobian whose singular values are well separated, and far from zero."""
    U = np.linalg.qr(rng.standard_normal((m, m)))[0]
    V = np.linalg.qr(rng.standard_normal((n, n)))[0][:m]
    return U @ np.diag(np.linspace(1.5, 0.7, m)) @ V


def along_a_line(seed, n=6, rows=(2, 1), mode='least_squares'):
    """
    Return levels(t) and box(t): demands and bounds change, so that bounds come and go.

    The Jacobians stay: two columns that become parallel, while all other joints are at their
    bounds, are a singularity of its own.
    """
    rng = np.random.default_rng(seed)
    Js = [separated(rng, m, n) for m in rows]
    demands = [(rng.standard_normal(m), rng.standard_normal(m)) for m in rows]
    upper = rng.uniform(0.1, 0.6, (2, n))

    def levels(t):
        return [Level(J, v + t * (w - v), mode if number == 0 else 'least_squares')
                for number, (J, (v, w)) in enumerate(zip(Js, demands))]

    def box(t):
        return upper[0] + t * (upper[1] - upper[0])
    return levels, box


@settings(max_examples=25)
@given(SEEDS, st.sampled_from([(2,), (2, 1), (2, 1, 6), (3, 2)]),
       st.sampled_from(['least_squares', 'scale']), st.sampled_from([0.0, 30.0]))
@pytest.mark.slow
def test_velocity_never_jumps_while_bounds_become_active(seed, rows, mode, h):
    levels, box = along_a_line(seed, rows=rows, mode=mode)
    options = {**DEFAULTS, 'period': 0.01, 'memory': (h,) * len(rows)}
    assert largest_jump(lambda t: redistribute(
        levels(t), -box(t), box(t), **options).velocity) < 1e-3


@settings(max_examples=15)
@given(SEEDS)
@pytest.mark.slow
def test_velocity_never_jumps_with_a_speed_cap_or_with_rows(seed):
    levels, box = along_a_line(seed, rows=(2, 1, 6))
    rng = np.random.default_rng(seed)
    row, cap = separated(rng, 1, 6), rng.uniform(0.05, 0.3, 6)
    assert largest_jump(lambda t: redistribute(
        levels(t), -box(t), box(t), speed_cap=cap, **DEFAULTS).velocity) < 1e-3
    assert largest_jump(lambda t: redistribute(
        [Level(row, lower=np.array([2.0 * t - 1.0])), *levels(t)], -box(t), box(t),
        **DEFAULTS).velocity) < 1e-3


@settings(max_examples=15)
@given(SEEDS)
@pytest.mark.slow
def test_velocity_never_jumps_where_bounds_exclude_zero(seed):
    levels, box = along_a_line(seed)
    middle = np.random.default_rng(seed).uniform(-0.5, 0.5, 6)
    assert largest_jump(lambda t: redistribute(
        levels(t), middle * (1.0 - 2.0 * t) - box(t), middle * (1.0 - 2.0 * t) + box(t),
        **DEFAULTS).velocity) < 1e-3


def test_damped_direction_does_not_jump_where_another_joint_reaches_its_bound():
    # Joint 2 is damped and has to move; joint 1 has nothing to do with it.
    J = np.diag([1.0, 0.05])

    def velocity(t):
        return redistribute([(J, [0.9 + 0.2 * t, 0.1])], [-1.0, 0.1], [1.0, 1.0],
                            **DEFAULTS).velocity
    assert largest_jump(velocity) < 1e-3


def test_relaxed_direction_does_not_jump_where_another_joint_reaches_its_bound():
    # Half of joint 1 is relaxed; joint 2 has nothing to do with it.
    levels = [([[0.01, 0.0]], [0.0]), ([[0.1, 0.0], [0.0, 1.0]], [1.0, 1.0])]

    def velocity(t):
        return redistribute(levels, [-1.0, -2.0], [1.0, 1.1 - 0.2 * t], **DEFAULTS).velocity
    assert velocity(0.0)[0] > 0.05
    assert largest_jump(velocity) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize('upper', [[9.0, 9.0, 9.0], [0.1, 0.3, 0.2], [1.0, 0.05, 1.0]])
@pytest.mark.parametrize('below', [[], [([[0.0, 1.0, 1.0]], [0.4])],
                                   [(np.eye(3), [0.1, -0.4, 0.3])]])
def test_direction_that_vanishes_and_comes_back_reversed_makes_no_jump(upper, below):
    upper = np.array(upper)

    def solution(t):
        s = 0.2 - 0.4 * t
        return redistribute([([[1.0, 0.0, 0.0], [0.0, s, 0.0]], [0.5, 0.3]), *below],
                            -upper, upper, **DEFAULTS)
    assert largest_jump(lambda t: solution(t).velocity) < 1e-3
    for t in np.linspace(0.0, 1.0, 201):
        level = solution(t).levels[0]
        assert np.linalg.norm(level.disturbance) <= level.disturbance_bound + 1e-12


@pytest.mark.slow
@given(SEEDS)
def test_regularisation_costs_the_first_level_little(seed):
    levels, box = along_a_line(seed, rows=(2, 2, 6))
    for t in (0.0, 0.5, 1.0):
        first = levels(t)[0]
        velocity = redistribute(levels(t), -box(t), box(t), **DEFAULTS).velocity
        exact = bounded_lexicographic([(first.J, first.v)], 6, -box(t), box(t))
        assert np.linalg.norm(first.J @ velocity - first.v) <= \
            np.linalg.norm(first.J @ exact - first.v) + 0.01 * np.linalg.norm(first.v)


@pytest.mark.slow
@given(SEEDS)
def test_regularised_level_is_hardly_changed_by_the_levels_below_it(seed):
    levels, box = along_a_line(seed, rows=(2, 2, 6))
    for t in (0.0, 0.5, 1.0):
        first = levels(t)[0]
        whole = redistribute(levels(t), -box(t), box(t), **DEFAULTS).velocity
        alone = redistribute([first], -box(t), box(t), **DEFAULTS).velocity
        assert np.linalg.norm(first.J @ (whole - alone)) <= 0.01 * np.linalg.norm(first.v)


def test_regularisation_costs_the_square_of_its_share():
    # Joint 1 is at its bound. s = 0.5 alone is left to joint 2, which does 0.4 at the start.
    J, bound = np.array([[1.0, 0.5]]), np.array([0.2, 5.0])
    for least in (0.01, 0.02, 0.05):
        velocity = redistribute([(J, [1.0])], -bound, bound,
                                **{**DEFAULTS, 'regularisation': least}).velocity
        exact = (1.0 - 0.2) / 0.5
        assert velocity[0] == 0.2
        # Across J, 0.8 of the motion of joint 2 is free; μ² acts on it against s² + μ². The first
        # level has a share of μ.
        squared = (FIRST * least) ** 2
        share = 0.8 * squared / (0.25 + 0.8 * squared)
        assert exact - velocity[1] == pytest.approx(share * (exact - 0.4), rel=1e-6)
