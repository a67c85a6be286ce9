# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an answer of the solver, whatever the problem."""

from typing import NamedTuple

import numpy as np
from numpy.linalg import norm
from scipy.linalg import orth
from tp_controller import SolverError


class Outcome(NamedTuple):
    """
    What became of a cycle.

    Attributes
    ----------
    velocity : ndarray (n,) or None
        None where there is no answer.
    error : str
        What was raised, other than a `SolverError`.
    not_finite, beyond : bool
        A number of the answer is not finite; a joint is beyond its bounds.
    disturbed : float
        The most that levels below change one above them, as a share of ‖J‖ ‖x‖ + ‖v‖.

    """

    velocity: np.ndarray | None = None
    error: str = ''
    not_finite: bool = False
    beyond: bool = False
    disturbed: float = 0.0


def audit(cycle, solver):
    """Return the `Outcome` of a cycle with a solver that takes it as a whole."""
    _, lower, upper, *_ = cycle
    try:
        solution = solver(cycle)
        if solution is None:
            return Outcome()
        not_finite = not all(np.isfinite(each).all() for each in numbers(solution))
        disturbed = max((disturbance(cycle, solution, solver, index)
                         for index in range(len(solution.hierarchy))), default=0.0)
    except SolverError:
        return Outcome()
    except Exception as error:
        return Outcome(error=repr(error))
    x = solution.velocity
    beyond = lower is not None and not ((lower <= x) & (x <= upper)).all()
    return Outcome(x, '', not_finite, bool(beyond), disturbed)


def numbers(solution):
    """Return all that a solution says, as arrays."""
    found = [solution.velocity, solution.whole, np.array([*solution.memory, solution.slowed])]
    for level in solution.levels:
        found += [level.achieved, level.residual, level.unreachable, level.multipliers,
                  level.disturbance, *level.row_multipliers.values(),
                  np.array([level.scale, level.disturbance_bound, level.smallest_singular_value])]
    return found


def disturbance(cycle, solution, solver, index):
    """Return what the levels below change at one, beyond what is relaxed there, as a share."""
    level, step, x = solution.hierarchy[index], solution.step(index), solution.whole
    alone = [step.velocity]
    if cycle[3].damping.off and cycle[3].scaling == 'redistribute':
        # Nothing else is to come of it if they are removed.
        removed = solver((cycle[0][:index + 1], *cycle[1:6], cycle[6][:index + 1]))
        alone += [] if removed is None else [removed.velocity]
    size, demand = norm(level.J), 0.0 if level.v is None else norm(level.v)
    return max(change(level, step, x, before)
               / (size * max(norm(x), norm(before)) + demand + 1e-300) for before in alone)


def change(level, step, x, before):
    """Return how far a level is from where it was, or by how much more beyond its bounds."""
    if level.v is None:
        return exceeded(level, x) - exceeded(level, before)
    return norm(level.J @ (x - before)) - relaxed(level, step, x)


def exceeded(level, x):
    """Return by how much a level with bounds is beyond them."""
    return norm(level.demanded(level.J @ x) - level.J @ x)


def relaxed(level, step, x):
    """Return the most that the levels below may add where some of a level is relaxed."""
    if step.relaxed is None:
        return 0.0
    sizes = np.linalg.norm(step.relaxed, axis=0)
    basis = orth(step.relaxed[:, sizes > 0.0] / sizes[sizes > 0.0], rcond=1e-9)
    return np.linalg.norm(level.J @ basis, 2) * norm(x - step.velocity)
