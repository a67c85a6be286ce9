# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compare levels that use some joints only with an oracle, and with columns of zeros.

Run as ``python benchmarks/masks.py``; ``--stacks 1000`` for a first impression. Random stacks of
one to four levels on 3 to 10 joints; three fifths of the levels have a mask of their joints, half
weights of their rows from 1e-2 to 1e2, and half of the stacks weights of the joints from 0.1 to
10. The oracle is written from the definition, by numpy alone: sets of columns, null spaces of
stacked rows, and least squares.

The first table has the worst of all stacks: the velocities and the residuals of all levels beside
those of the oracle, how much the levels below change a level (the part of J x that changes once
they are removed), and how far a single level moves the joints outside its mask. Stacks with a
direction that is nearly, but not quite, left to a level are drawn again: for them rounding
decides what is a null space.

The second table has the same stacks with zeros in the columns of the other joints in place of
masks, as in packages whose tasks have one matrix: how many levels are disturbed by those below,
as a share of their demand.

The third table drives the tool of a mobile arm to goals near and far, for 10 s at 100 Hz, with a
base that is to move last: how far the base drives, and how far the tool ends from its goal.
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

from _robots import load_robot
import numpy as np
from tp_controller import Controller, Level, Settings, solve, Stack

STACKS = 20_000
# Relative singular values that count as zero, and those above which a direction is clear.
ZERO, CLEAR = 1e-9, 1e-2
# Share of the demand from which a level counts as disturbed.
DISTURBED = 1e-6
# Start of the mobile arm: base, torso and arm; distances of its goals [m].
START = 0.0, 0.0, 0.0, 0.15, 0.0, -0.8, 0.0, 1.6, 0.0, -0.8, 0.0
NEAR, FAR = 0.1, 2.0
PERIOD, CYCLES = 0.01, 1000
BASE = 3
# {way to use the base last: keys of the task, weight of the base, tasks below}
WAYS = {
    'no choice': ('', 1.0, ''),
    'weight of the base 20': ('', 20.0, ''),
    'weight of the base 1e4': ('', 1e4, ''),
    'a level that keeps the base still': (
        '', 1.0, '- stand: {type: twist, frame: base_link, axes: [x, y, rz]}\n'),
    'excluded_joints: base': (', excluded_joints: base', 1.0, ''),
}


class Case(NamedTuple):
    """Random stack: levels, and weights of the joints (n,) or None."""

    levels: list[Level]
    weights: np.ndarray | None

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return self.levels[0].J.shape[1]


class Worst(NamedTuple):
    """Worst relative differences of a stack."""

    velocity: float
    residual: float
    leak: float
    outside: float


def draw(random: np.random.Generator) -> Case:
    """Return a random stack."""
    n = int(random.integers(3, 11))
    levels = []
    for _ in range(random.integers(1, 5)):
        m = int(random.integers(1, n // 2 + 1))
        J = random.standard_normal((m, n))
        if random.random() < 0.2:
            # Two rows that agree.
            J[-1] = J[0]
        joints = random.random(n) < random.choice([0.4, 0.7, 0.9])
        masked = random.random() < 0.6 and not joints.all()
        weights = 10.0 ** random.uniform(-2.0, 2.0, m) if random.random() < 0.5 else None
        levels.append(Level(J, random.standard_normal(m), joints=joints if masked else None,
                            weights=weights))
    return Case(levels, 10.0 ** random.uniform(-1.0, 1.0, n) if random.random() < 0.5 else None)


# The oracle

def null_of(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (n, k) of the null space of rows."""
    if not rows.size or not rows.any():
        return np.eye(rows.shape[1])
    _, s, V_T = np.linalg.svd(rows)
    return V_T[np.count_nonzero(s > ZERO * s[0]):].T


def shortest(x: np.ndarray, F: np.ndarray, origin: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return x + F y with the least Σ root_j² (x_j − origin_j)²."""
    y = np.linalg.lstsq(root[:, np.newaxis] * F, root * (origin - x), rcond=None)[0]
    return x + F @ y


def roots(level: Level) -> np.ndarray:
    """Return the roots of the weights of the rows of a level (m,)."""
    return np.ones(len(level.J)) if level.weights is None else np.sqrt(level.weights)


def columns(F: np.ndarray, joints: np.ndarray | None) -> np.ndarray:
    """Return the motions in the span of F that move the joints of a mask only."""
    return F if joints is None or not F.size else F @ null_of(F[~joints])


def oracle(case: Case) -> np.ndarray:
    """Return the velocity (n,) of a stack."""
    n = case.n
    root = np.ones(n) if case.weights is None else np.sqrt(case.weights)
    x, own, rows = np.zeros(n), np.zeros(n), np.zeros((0, n))
    for level in case.levels:
        J, joints, F = level.J, level.joints, null_of(rows)
        if joints is not None:
            x = shortest(x, F, own, root)
        origin, F = x, columns(F, joints)
        rooted = roots(level)
        x = x + F @ np.linalg.lstsq(rooted[:, np.newaxis] * (J @ F), rooted * (level.v - J @ x),
                                    rcond=ZERO)[0]
        rows = np.concatenate([rows, J])
        if joints is not None:
            x = shortest(x, columns(null_of(rows), joints), origin, root)
            own = own + x - origin
    return shortest(x, null_of(rows), own, root)


def is_clear(case: Case) -> bool:
    """Return whether every direction is clearly left to a level, or not at all."""
    rows = np.zeros((0, case.n))
    for level in case.levels:
        F = null_of(rows)
        parts = [(level.J @ each, np.linalg.norm(level.J))
                 for each in (F, columns(F, level.joints))]
        if level.joints is not None:
            parts.append((F[~level.joints], 1.0))
        for A, size in parts:
            s = np.linalg.svd(A, compute_uv=False) / size
            if ((s > 1e-3 * ZERO) & (s < CLEAR)).any():
                return False
        rows = np.concatenate([rows, level.J])
    return True


# Measurements

def velocity(levels: Sequence[Level], weights: np.ndarray | None) -> np.ndarray:
    """Return what the package answers, (n,)."""
    return solve(levels, weights=weights, scaling='redistribute').velocity


def changes(levels: Sequence[Level], kept: Sequence[np.ndarray], weights: np.ndarray | None
            ) -> list[float]:
    """Return how much the levels below change each level with the Jacobian in `kept`."""
    x, found = velocity(levels, weights), []
    for count in range(1, len(levels)):
        before = velocity(levels[:count], weights)
        size = max(np.linalg.norm(x), np.linalg.norm(before))
        found += [float(np.linalg.norm(J @ (x - before)) / (np.linalg.norm(J) * size + 1e-300))
                  for J in kept[:count]]
    return found


def compare(case: Case) -> Worst:
    """Return the worst differences of a stack."""
    x, expected = velocity(*case), oracle(case)
    size = 1.0 + float(np.linalg.norm(expected))
    residuals = [abs(np.linalg.norm(roots(level) * (level.v - level.J @ x))
                     - np.linalg.norm(roots(level) * (level.v - level.J @ expected)))
                 for level in case.levels]
    first = case.levels[0]
    outside = 0.0 if first.joints is None else float(
        np.abs(velocity([first], case.weights)[~first.joints]).max())
    return Worst(float(np.abs(x - expected).max()) / size, float(max(residuals)) / size,
                 max(changes(case.levels, [level.J for level in case.levels], case.weights),
                     default=0.0), outside / size)


def disturbances(case: Case) -> list[float]:
    """Return how much the levels below change each level whose columns are zeros."""
    cut = [Level(level.J if level.joints is None else level.J * level.joints, level.v,
                 weights=level.weights)
           for level in case.levels]
    x, found = velocity(cut, case.weights), []
    for count, level in enumerate(case.levels[:-1], 1):
        if level.joints is not None:
            before = velocity(cut[:count], case.weights)
            found.append(float(np.linalg.norm(level.J @ (x - before)) / np.linalg.norm(level.v)))
    return found


def drive(way: str, distance: float) -> tuple[float, float]:
    """Return how far the base drives, and how far the tool ends from its goal [m]."""
    keys, weight, below = WAYS[way]
    robot = load_robot('mobile arm')
    weights = (weight,) * BASE + (1.0,) * (robot.n - BASE)
    stack = Stack.from_yaml(f'- tool: {{type: position, frame: tool, gain: 2.0{keys}}}\n{below}',
                            robot)
    controller = Controller(robot, stack, Settings(period=PERIOD, weights=weights))
    q = np.array(START)
    controller.update(q, 0.0)
    goal = robot.state(q).position('tool') + np.array([distance, 0.05, 0.0])
    controller.set_goal('tool', goal, 0.0)
    driven = 0.0
    for cycle in range(1, CYCLES + 1):
        x = controller.update(q, PERIOD * cycle).velocity
        driven += PERIOD * float(np.linalg.norm(x[:2]))
        q = robot.integrate(q, x, PERIOD)
    return driven, float(np.linalg.norm(robot.state(q).position('tool') - goal))


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--stacks', type=int, default=STACKS)
    parser.add_argument('--seed', type=int, default=0)
    options = parser.parse_args()
    random, found, cut, again = np.random.default_rng(options.seed), [], [], 0
    while len(found) < options.stacks:
        case = draw(random)
        if not is_clear(case):
            again += 1
            continue
        found.append(compare(case))
        cut += disturbances(case)
    print(f'{len(found)} stacks, {again} drawn again; the worst, relatively:\n')
    for name, values in zip(('velocity beside the oracle', 'residuals beside the oracle',
                             'change by the levels below', 'joints outside a mask'),
                            np.array(found).T):
        print(f'  {name:28} {values.max():8.1e}')
    shares = np.array(cut)
    disturbed = np.count_nonzero(shares > DISTURBED)
    print(f'\nwith columns of zeros {disturbed} of {len(shares)} levels are disturbed, in the '
          f'median by {100.0 * np.median(shares):.0f} % of their demand, in a tenth by '
          f'{100.0 * np.quantile(shares, 0.9):.0f} % or more')
    print(f'\nbase drives, tool ends from its goal [mm], goals at {NEAR:g} m and {FAR:g} m\n')
    for way in WAYS:
        print(f'  {way:34}', *[f'{1e3 * driven:8.1f} {1e3 * error:8.2f}' for driven, error in (
            drive(way, distance) for distance in (NEAR, FAR))])


if __name__ == '__main__':
    main()
