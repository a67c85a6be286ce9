# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compare the recursive and the sequential form: how well lower levels are met.

Run as ``python benchmarks/forms.py``. The recursive form is section 2.2 of *lecture*, which the
solver uses; the sequential form is (50) and (51) of *slides*. The sources are listed in
docs/sources.md, the results in docs/sequential.md.
"""

import math
from pathlib import Path

import numpy as np
from scipy.linalg import null_space
from tp_controller import Level, Robot, solve, Stack
from tp_controller.solver.sequential import sequential

SEED = 0
STATES = 500
PANDA = Path(__file__).resolve().parent.parent / 'config' / 'robots' / 'panda.yaml'
PANDA_STACK = """
- position: {type: position, frame: panda_hand_tcp}
- direction: {type: orientation, frame: panda_hand_tcp, axes: xy}
- elbow: {type: position, frame: panda_link4, axes: z}
- joint1: {type: joint, joints: panda_joint1}
"""
ANGLES = (90, 60, 30, 10)
# {name: function (levels, n) -> velocities (n,)}
FORMS = {'recursive': lambda levels, n: solve(levels).velocity, 'sequential': sequential}


def exact(levels, n):
    """
    Return the joint velocities (n,) that are optimal level by level.

    Written from the definition: each level is a least-squares problem in the null space of all
    rows above it, stacked.
    """
    x, rows = np.zeros(n), np.zeros((0, n))
    for J, v in levels:
        free = null_space(rows, rcond=1e-9) if len(rows) else np.eye(n)
        if free.size:
            x = x + free @ np.linalg.lstsq(J @ free, v - J @ x, rcond=1e-9)[0]
        rows = np.concatenate([rows, J])
    return x


def velocities(levels, n):
    """Return what each of the `FORMS` commands the joints (n,)."""
    levels = [Level(J, v) for J, v in levels]
    return [form(levels, n) for form in FORMS.values()]


def excess(levels, n):
    """Return, for each form and level, (‖v − J ζ‖ − optimum) / ‖v‖."""
    best = exact(levels, n)
    return [[(np.linalg.norm(v - J @ zeta) - np.linalg.norm(v - J @ best)) / np.linalg.norm(v)
             for J, v in levels] for zeta in velocities(levels, n)]


def random_states(rng):
    """Yield levels with 2, 2, 2 and 1 rows for seven joints, all entries Gaussian."""
    for _ in range(STATES):
        yield [(rng.standard_normal((rows, 7)), rng.standard_normal(rows))
               for rows in (2, 2, 2, 1)]


def panda_states(rng):
    """Yield the levels of the Panda at random positions, with Gaussian task velocities."""
    robot = Robot.from_file(PANDA)
    state = robot.state(robot.neutral())
    tasks = Stack.from_yaml(PANDA_STACK, robot).tasks.values()
    for _ in range(STATES):
        state.update(rng.uniform(robot.lower, robot.upper))
        yield [(task.jacobian(state), rng.standard_normal(task.rows)) for task in tasks]


def share_of_second_task(degrees):
    """Return which part of a second task of one row is executed, for each form."""
    angle = math.radians(degrees)
    levels = [(np.array([[1.0, 0.0]]), np.zeros(1)),
              (np.array([[math.cos(angle), math.sin(angle)]]), np.ones(1))]
    J, _ = levels[1]
    return [float(J[0] @ zeta) for zeta in velocities(levels, 2)]


def projector_fault(degrees):
    """Return ‖M − M²‖ of M = P₁ (I − J₂⁺ J₂), which would be zero for a projector."""
    angle = math.radians(degrees)
    P = [np.eye(3) - np.outer(row, row)
         for row in (np.array([1.0, 0.0, 0.0]), np.array([math.cos(angle), math.sin(angle), 0.0]))]
    M = P[0] @ P[1]
    return np.linalg.norm(M - M @ M, 2)


def print_excess():
    """Print median and 95th percentile of the excess residual."""
    print('| stack | form | level 1 | level 2 | level 3 | level 4 |')
    print('|---|---|---|---|---|---|')
    rng = np.random.default_rng(SEED)
    for name, states in (('random', random_states(rng)), ('Panda', panda_states(rng))):
        values = np.array([excess(levels, 7) for levels in states])
        for form, column in zip(FORMS, values.transpose(1, 2, 0)):
            cells = [f'{_short(np.median(level))} / {_short(np.percentile(level, 95))}'
                     for level in column]
            print(f'| {name} | {form} | {" | ".join(cells)} |')


def print_angles():
    """Print what the angle between the rows of two tasks costs."""
    print('| angle between the rows | recursive | sequential | sin² | ‖M − M²‖ |')
    print('|---|---|---|---|---|')
    for degrees in ANGLES:
        shares = share_of_second_task(degrees)
        print(f'| {degrees}° | {shares[0]:.3f} | {shares[1]:.3f} | '
              f'{math.sin(math.radians(degrees)) ** 2:.3f} | {projector_fault(degrees):.3f} |')


def _short(value):
    """Return a number for the table; below 1e-9 it is rounding."""
    return '< 1e-9' if abs(value) < 1e-9 else f'{value:.2f}'


if __name__ == '__main__':
    print_excess()
    print()
    print_angles()
