# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Escape from singularities at which the robot rests exactly."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dnrm2
from tp_controller.control.transition import kept_above, Transition
from tp_controller.solver.level import Level
from tp_controller.solver.solution import Solution
from tp_controller.tasks.task import norm

# Joint speed below which the robot counts as stuck [rad/s or m/s].
STUCK_SPEED = 1e-3
# Task velocity above which an unmet demand justifies a nudge, in the units of the task.
LEAST_DEMAND = 1e-2
# Singular value, relative to the largest one, below which the robot is exactly at a singularity.
SINGULAR_RATIO = 1e-6
# Speed [rad/s or m/s], duration [s] and largest number of nudges.
NUDGE_SPEED = 0.02
NUDGE_SECONDS = 1.0
MOST_NUDGES = 3
# Time at rest before a nudge [s].
STUCK_SECONDS = 0.2


class Escape(NamedTuple):
    """
    Nudge of a robot that rests exactly at a singularity although a task is not reached.

    Example: a straight arm that is to retract. To first order no joint velocity moves the tool
    along the arm, so the damped solution is to rest. The least deviation from the singularity
    changes that. A nudge provides it: a few milliradians of motion in the null space of the level
    and those above. If it does not help, for example because the goal is out of reach, it is tried
    twice more, and then not again until something changes.

    Attributes
    ----------
    tries : int
        Number of nudges since the last change.
    nudges : int
        Number of all nudges; each has its own direction.
    still_since : float or None
        Time since which the robot is at rest [s]; None while it moves.
    upper : int
        Number of upper levels that the present nudge leaves alone; 0 without one.
    nudge : Transition
        The present nudge.

    """

    tries: int = 0
    nudges: int = 0
    still_since: float | None = None
    upper: int = 0
    nudge: Transition = Transition()

    def reset(self) -> 'Escape':
        """Return the same with new nudges allowed, after a change of stack, goal or setting."""
        return self._replace(tries=0, upper=0)

    def levels(self, solution: Solution, now: float, solve: Callable[[list[Level]], Solution]
               ) -> tuple['Escape', list[Level] | None]:
        """
        Return the escape of the next cycle, and the levels that leave the singularity.

        The levels replace those solved; None if not needed.

        Parameters
        ----------
        solution : Solution
            Solution of this cycle.
        now : float
            Time of a clock that is never set back [s].
        solve : callable (list of Level) -> Solution
            Solver of levels.

        """
        if self.upper:
            # Without the levels below: they may demand to stay at the singularity.
            upper = kept_above(solution.hierarchy, self.upper)
            levels = self.nudge.levels(upper, solve(upper).velocity, now)
            if levels is not None:
                return self, levels
            return self._replace(upper=0).levels(solution, now, solve)
        if self.tries >= MOST_NUDGES:
            return self, None
        velocity = solution.velocity
        # For small arrays BLAS itself is three times as fast as numpy.
        if dnrm2(velocity) > STUCK_SPEED:
            return self if self.still_since is None else self._replace(still_since=None), None
        if self.still_since is None:
            return self._replace(still_since=now), None
        if now - self.still_since < STUCK_SECONDS:
            return self, None
        for index, level in enumerate(solution.hierarchy):
            if level.v is not None and norm(level.v) > LEAST_DEMAND \
                    and _is_singular(solution, index):
                return self._begun(index + 1, len(velocity), now).levels(solution, now, solve)
        return self, None

    def _begun(self, upper: int, n: int, now: float) -> 'Escape':
        """Return the escape with a new nudge of n joints, below so many upper levels."""
        direction = np.random.default_rng(self.nudges).standard_normal(n)
        nudge = Transition().begin(NUDGE_SPEED * direction / norm(direction), now, NUDGE_SECONDS,
                                   upper)
        return Escape(self.tries + 1, self.nudges + 1, None, upper, nudge)


def _is_singular(solution: Solution, index: int) -> bool:
    """Return whether a level is at a singularity of its own, with an unreachable demand."""
    level = solution.levels[index]
    alone = level.singular_values_alone
    return bool(alone[-1] <= SINGULAR_RATIO * alone[0]) \
        and norm(level.unreachable) > LEAST_DEMAND
