# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Random problems for the solver, and helpers that solve them."""

from dataclasses import replace
from functools import partial
import math
import sys
from unittest import mock

from hypothesis import strategies as st
import numpy as np
import pytest
from reference import projector
from tp_controller import Level, solve
from tp_controller.solver import compiled
from tp_controller.solver.damping import Damping
from tp_controller.solver.level import check_bounds, check_levels
from tp_controller.solver.solve import PrioritySolver

SEEDS = st.integers(0, 2 ** 32 - 1)
EXACT = {'rtol': 1e-9, 'atol': 1e-9}
DEFAULTS = {'damping': 0.1, 'singular_region': 0.1, 'release_region': 0.02,
            'regularisation': 0.02}
INFINITE = math.inf


def near(expected, rel=1e-9):
    """Return a comparison that forgives what the solver may be off."""
    return pytest.approx(expected, rel=rel, abs=1e-9)


def by_loop(levels, *bounds, **options):
    """Return what `solve` does without its fast path."""
    with mock.patch.multiple(sys.modules['tp_controller.solver.solve'],
                             core_for=partial(compiled.core_for, fast=False),
                             min_norm=lambda *given: None):
        return solve(levels, *bounds, **options)


def redistribute(levels, lower=None, upper=None, **options):
    """Return the solution with the bounds kept level by level."""
    return solve(levels, lower, upper, scaling='redistribute', **options)


def as_levels(hierarchy):
    """Return the hierarchy of the reference as that of the solver."""
    return [Level(J, demand[0]) if len(demand) == 1 else
            Level(J, lower=demand[0], upper=demand[1]) for J, *demand in hierarchy]


def misses(hierarchy, x):
    """Return what each level misses: ‖v − J x‖, or by how much J x exceeds its bounds."""
    return np.array([np.linalg.norm(J @ x - (demand[0] if len(demand) == 1
                                             else np.clip(J @ x, *demand)))
                     for J, *demand in hierarchy])


@st.composite
def stacks(draw, max_joints=30, max_levels=6):
    """Return (n, levels): any mix of row counts, and levels of special structure."""
    n = draw(st.integers(1, max_joints))
    rng = np.random.default_rng(draw(SEEDS))
    levels = []
    for _ in range(draw(st.integers(0, max_levels))):
        m = draw(st.integers(0, max(1, n // 2)))
        J = rng.standard_normal((m, n))
        kind = draw(st.sampled_from(['full', 'full', 'rank deficient', 'duplicate', 'mixture',
                                     'selection', 'zero', 'tall']))
        if kind == 'rank deficient' and m > 1:
            J = rng.standard_normal((m, m // 2)) @ rng.standard_normal((m // 2, n))
        elif kind == 'duplicate' and levels:
            J = levels[draw(st.integers(0, len(levels) - 1))][0].copy()
        elif kind == 'mixture' and levels:
            above = np.concatenate([J for J, _ in levels])
            J = rng.standard_normal((m, len(above))) @ above
        elif kind == 'selection':
            J = np.eye(n)[rng.permutation(n)[:m]]
        elif kind == 'zero':
            J = np.zeros((m, n))
        elif kind == 'tall':
            J = rng.standard_normal((n + 2, n))
        levels.append((J, rng.standard_normal(len(J))))
    return n, levels


def random_box(rng, n, kind):
    """Return lower and upper (n,) of one kind, or of a different kind for every joint."""
    lower, upper = np.empty(n), np.empty(n)
    kinds = ('symmetric', 'one-sided', 'zero', 'beside zero', 'fixed')
    for joint in range(n):
        own = kinds[rng.choice(5, p=[0.6, 0.1, 0.1, 0.15, 0.05])] if kind == 'mixed' else kind
        a, b = rng.uniform(0.02, 0.6, 2)
        low, high = {'symmetric': (-a, a), 'one-sided': (-a, INFINITE), 'zero': (0.0, b),
                     'beside zero': (a, a + b), 'fixed': (a, a)}[own]
        if rng.random() < 0.5:
            low, high = -high, -low
        lower[joint], upper[joint] = low, high
    return lower, upper


def structured(rng, kind, J, above, pick):
    """
    Return the J of a level of some kind; J (m, n) itself where it is of none of these.

    It may repeat those above; `pick` chooses one of so many.
    """
    m, n = J.shape
    if kind == 'rank deficient' and m > 1:
        return rng.standard_normal((m, m // 2)) @ rng.standard_normal((m // 2, n))
    if kind == 'duplicate' and above:
        return above[pick(len(above))].copy()
    if kind == 'mixture' and above:
        rows = np.concatenate(above)
        return rng.standard_normal((m, len(rows))) @ rows / math.sqrt(max(1, len(rows)))
    if kind == 'selection':
        return np.eye(n)[rng.permutation(n)[:m]]
    if kind == 'tall':
        return rng.standard_normal((n + 1, n))
    return np.eye(n) if kind == 'posture' else J


@st.composite
def hierarchies(draw, max_joints=10, max_levels=5, rows=True, kinds=('symmetric', 'mixed')):
    """Return (n, hierarchy, lower, upper): levels of all structures, most of them in conflict."""
    n = draw(st.integers(2, max_joints))
    rng = np.random.default_rng(draw(SEEDS))
    hierarchy = []
    for _ in range(draw(st.integers(1, max_levels))):
        m = draw(st.integers(1, max(1, n // 2)))
        J = rng.standard_normal((m, n))
        kind = draw(st.sampled_from(['full', 'full', 'full', 'rank deficient', 'duplicate',
                                     'mixture', 'selection', 'tall', 'posture']))
        J = structured(rng, kind, J, [each[0] for each in hierarchy],
                       lambda count: draw(st.integers(0, count - 1)))
        if rows and draw(st.sampled_from([True, False, False])):
            hierarchy.append((J, *random_rows(rng, len(J))))
        else:
            hierarchy.append((J, rng.standard_normal(len(J))))
    return n, hierarchy, *random_box(rng, n, draw(st.sampled_from(kinds)))


def random_rows(rng, m):
    """Return bounds (m,), (m,) of which some are far, near, one-sided or out of reach."""
    lower = rng.uniform(-1.0, 0.5, m)
    upper = lower + rng.uniform(0.1, 1.0, m)
    side = rng.integers(0, 3, m)
    return np.where(side == 0, -INFINITE, lower), np.where(side == 1, INFINITE, upper)


def scaled_hierarchy(rng, decades):
    """
    Return (n, hierarchy, lower, upper) whose rows and columns differ by powers of ten.

    Half of the levels have bounds; most of these can be met, and then in many ways.
    """
    n = int(rng.integers(3, 13))
    units, inside = 10.0 ** rng.uniform(0.0, decades, n), rng.uniform(-1.0, 1.0, n)
    hierarchy = []
    for _ in range(rng.integers(1, 5)):
        m = int(rng.integers(1, n // 2 + 1))
        J, size = rng.standard_normal((m, n)), 10.0 ** rng.uniform(0.0, decades, m)
        if rng.random() < 0.5:
            lower, upper = random_rows(rng, m)
            demand = lower + J @ inside, upper + J @ inside
        else:
            demand = J @ inside + rng.choice([0.0, 1.0, 3.0]) * rng.standard_normal(m),
        hierarchy.append((size[:, np.newaxis] * J / units, *(size * each for each in demand)))
    bounds = units * rng.uniform(0.3, 1.5, n)
    return n, hierarchy, -bounds, bounds


def dynamics(rng, legs=4):
    """
    Return (n, hierarchy, lower, upper) of a body and its forces on the ground, in the plane.

    The first level are the equations of motion, as rows whose bounds are equal, beside friction
    cones. The second one tracks accelerations. Forces cost nothing, and far less than an
    acceleration is at stake where they move the heavy body.
    """
    mass, moving, forces = 57.0, 6, 2 * legs
    M = np.diag([mass, mass, 9.0, 0.5, 0.5, 0.5])[:3]
    M[:, 3:] = 0.3 * rng.standard_normal((3, 3))
    at_ground = np.zeros((3, forces))
    at_ground[0, 0::2] = at_ground[1, 1::2] = 1.0
    at_ground[2] = rng.uniform(-0.4, 0.4, forces)
    cones = np.kron(np.eye(legs), [[1.0, -0.6], [-1.0, -0.6]])
    weight = np.array([0.0, -9.81 * mass, 0.0])
    rows = np.block([[M, -at_ground], [np.zeros((forces, moving)), cones]])
    least = np.append(weight, np.full(forces, -INFINITE))
    most = np.append(weight, np.zeros(forces))
    sizes = np.array([0.02, 0.02, 0.02, 12.0, 12.0, 12.0])
    tracking = np.hstack([np.diag(sizes), np.zeros((moving, forces))])
    lower = np.append(np.full(moving, -50.0), np.tile([-INFINITE, 0.0], legs))
    upper = np.append(np.full(moving, 50.0), np.full(forces, INFINITE))
    return (moving + forces, [(rows, least, most), (tracking, sizes * rng.uniform(-30, 30, 6))],
            lower, upper)


def well_conditioned(n, hierarchy, least=1e-2):
    """Say whether no direction of any level is nearly, but not quite, taken by those above."""
    above = []
    for J, *_ in hierarchy:
        s = np.linalg.svd(J @ projector(above, n), compute_uv=False)
        size = np.linalg.norm(J)
        if ((s > 1e-11 * size) & (s < least * size)).any():
            return False
        above.append((J, None))
    return True


# Cycles of the compiled core

OPTIONS = {
    'default': [Damping(0.1, 0.1, 0.02, 0.02)],
    'exact': [Damping()],
    'others': [Damping(0.1, math.inf, 0.0, 0.02), Damping(0.3, 0.3, 0.1, 0.0),
               Damping(0.0, math.inf, 0.1, 0.1)]}


def structured_level(rng, n, above):
    """Return a level of one of many kinds, which conflicts with those above or repeats them."""
    m = int(rng.integers(0, max(1, n // 2) + 1))
    J = rng.standard_normal((m, n))
    kind = rng.choice(['full', 'full', 'full', 'rank deficient', 'duplicate', 'mixture',
                       'selection', 'tall', 'posture', 'weak', 'zero'])
    J = structured(rng, kind, J, [each.J for each in above], rng.integers)
    if kind == 'weak' and m:
        U, s, V_T = np.linalg.svd(J, full_matrices=False)
        s[-1] = 10.0 ** rng.uniform(-4.0, -0.5)
        J = U * s @ V_T
    elif kind == 'zero':
        J = np.zeros((m, n))
    if len(J) and rng.random() < 0.25:
        lower, upper = random_rows(rng, len(J))
        return Level(J, lower=lower, upper=upper)
    mode = 'scale' if rng.random() < 0.2 and not any(each.v is None for each in above) \
        else 'least_squares'
    return Level(J, rng.standard_normal(len(J)) * 10.0 ** rng.uniform(-1.5, 0.5), mode)


def random_cycle(seed, settings):
    """Return what `solve_cycle` takes, of random shapes, bounds and options."""
    rng = np.random.default_rng(seed)
    n, levels = int(rng.integers(1, 13)), []
    for _ in range(int(rng.integers(0, 6))):
        levels.append(structured_level(rng, n, levels))
    lower, upper = random_box(rng, n, str(rng.choice(['symmetric', 'mixed'])))
    if rng.random() < 0.15:
        lower = upper = None
    weights = 10.0 ** rng.uniform(-1.0, 1.0, n) if rng.random() < 0.3 else None
    scaling = 'uniform' if rng.random() < 0.25 else 'redistribute'
    options = PrioritySolver(n, settings[rng.integers(len(settings))], weights, scaling)
    cap = rng.uniform(0.05, 0.5, n) if scaling == 'redistribute' and rng.random() < 0.3 else None
    remembered = rng.uniform(0.0, 3.0, len(levels)) * (rng.random(len(levels)) < 0.5)
    return (check_levels(levels), lower, upper, options, 0.01 if rng.random() < 0.7 else 0.0, cap,
            tuple(remembered.tolist()) if rng.random() < 0.6 else ())


def masked_cycle(seed, settings):
    """Return a random cycle in which half of the levels have masks, and half weights."""
    levels, *others = random_cycle(seed, settings)
    rng, n = np.random.default_rng([seed, 2]), others[2].n
    levels = [replace(level, joints=random_mask(rng, n)) if rng.random() < 0.5 else level
              for level in levels]
    return [replace(level, weights=10.0 ** rng.uniform(-2.0, 2.0, len(level.J)))
            if rng.random() < 0.5 else level for level in levels], *others


def random_mask(rng, n):
    """Return a mask (n,) that leaves out a few or many joints; None: it would leave out none."""
    joints = rng.random(n) < rng.choice([0.3, 0.6, 0.9])
    return None if joints.all() else joints


# Hard cycles: rows and levels that repeat each other, units, weights and bounds of all sizes

FEATURES = ('repeated', 'nearly repeated', 'row units', 'joint units', 'weights', 'fixed joints',
            'bounds beside zero', 'inequalities', 'empty', 'one joint')
SETTINGS = ('exact', 'defaults', 'uniform', 'speed cap', 'memory')


def features_of(seed):
    """Return the features of a problem, one to four."""
    rng = np.random.default_rng([seed, 0])
    return set(rng.choice(FEATURES, rng.integers(1, 5), replace=False).tolist())


def repetition(rng, above, m, offset):
    """Return the J of a level above, or m of all rows above, each but for a relative offset."""
    if rng.random() < 0.5:
        J = above[rng.integers(len(above))]
    else:
        rows = np.concatenate(above)
        J = rows[rng.integers(0, len(rows), m)]
        if rng.random() < 0.3:
            J = rng.standard_normal((m, m)) @ J
    return J + offset * np.linalg.norm(J, axis=1, keepdims=True) * rng.standard_normal(J.shape)


def hard_J(rng, n, above, features):
    """Return the J (m, n) of a level with some features; it may repeat those `above`."""
    m = 0 if 'empty' in features and rng.random() < 0.3 else int(rng.integers(1, n // 2 + 2))
    J = rng.standard_normal((m, n))
    repeats = sorted(features & {'repeated', 'nearly repeated'})
    if repeats and any(map(len, above)) and rng.random() < 0.6:
        nearly = rng.choice(repeats) == 'nearly repeated'
        J = repetition(rng, above, m, 10.0 ** rng.uniform(-12.0, -3.0) if nearly else 0.0)
    elif rng.random() < 0.1:
        J = np.eye(n)
    if 'row units' in features:
        spread = rng.choice([0.0, 3.0]) * rng.uniform(-1.0, 1.0, (len(J), 1))
        J = J * 10.0 ** (rng.uniform(-6.0, 6.0) + spread)
    return J


def hard_level(rng, J, features, scaled):
    """Return a level of J, with bounds or a demand that suit its size; mode scale if it may."""
    size, m = np.linalg.norm(J, axis=1), len(J)
    if 'inequalities' in features and rng.random() < 0.5:
        lower, upper = random_rows(rng, m)
        return Level(J, lower=lower * size, upper=upper * size)
    return Level(J, size * rng.standard_normal(m) * 10.0 ** rng.uniform(-1.5, 0.7),
                 'scale' if scaled and rng.random() < 0.1 else 'least_squares')


def hard_problem(seed):
    """Return levels, lower, upper and weights with the features of a seed; None: none of them."""
    rng, features = np.random.default_rng([seed, 1]), features_of(seed)
    n, levels = 1 if 'one joint' in features else int(rng.integers(2, 11)), []
    for _ in range(int(rng.integers(1, 7))):
        J = hard_J(rng, n, [level.J for level in levels], features)
        levels.append(hard_level(rng, J, features, all(each.v is not None for each in levels)))
    lower, upper = random_box(rng, n, 'mixed' if 'bounds beside zero' in features else 'symmetric')
    if 'fixed joints' in features:
        fixed = (rng.random(n) < 0.4) & np.isfinite(lower)
        lower = np.where(fixed & (lower < 0.0) & (rng.random(n) < 0.5), 0.0, lower)
        upper = np.where(fixed, lower, upper)
    unit = 10.0 ** rng.uniform(-6.0, 6.0, n) if 'joint units' in features else np.ones(n)
    levels = [replace(level, J=level.J * unit) for level in levels]
    weights = None
    if 'weights' in features:
        decades = rng.choice([4.0, 10.0, 12.0])
        weights = 10.0 ** (decades * np.append(rng.random(n - 1), 1.0) - 0.5 * decades)
    if rng.random() < 0.15:
        return levels, None, None, weights
    return levels, lower / unit, upper / unit, weights


def hard_cycle(seed, setting):
    """Return what `solve_cycle` takes: the problem of a seed with one of the `SETTINGS`."""
    levels, lower, upper, weights = hard_problem(seed)
    n, rng = levels[0].J.shape[1], np.random.default_rng([seed, 2])
    options = PrioritySolver(n, Damping() if setting == 'exact' else OPTIONS['default'][0],
                             weights, 'uniform' if setting == 'uniform' else 'redistribute')
    cap, memory = None, ()
    if setting == 'speed cap':
        widest = 1.0 if lower is None else np.maximum(np.abs(lower), np.abs(upper))
        cap = widest * rng.uniform(0.05, 0.8, n)
    elif setting == 'memory':
        memory = tuple((10.0 ** rng.uniform(-3.0, 2.0, len(levels))).tolist())
    if lower is not None:
        lower, upper = check_bounds(lower, upper, n, 'joints')
    return (check_levels(levels), lower, upper, options, 0.0 if setting == 'exact' else 0.01, cap,
            memory)
