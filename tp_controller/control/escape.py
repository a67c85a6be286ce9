# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Escape from singularities at which the robot rests exactly."""

from collections.abc import Callable

import numpy as np
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


class Escape:
    """
    Nudge of a robot that rests exactly at a singularity although a task is not reached.

    Example: a straight arm that is to retract. To first order no joint velocity moves the tool
    along the arm, so the damped solution is to rest. The least deviation from the singularity
    changes that. A nudge provides it: a few milliradians of motion in the null space of the level
    and those above. If it does not help, for example because the goal is out of reach, it is tried
    twice more, and then not again until something changes.

    Parameters
    ----------
    n : int
        Number of joints.

    """

    def __init__(self, n: int) -> None:
        self._nudge = Transition(NUDGE_SECONDS)
        self._random = np.random.default_rng(0)
        self._n = n
        self._tries = self._upper = 0
        self._still_since: float | None = None

    def reset(self) -> None:
        """Allow new nudges, after a change of the stack, a goal or a setting."""
        self._tries = self._upper = 0

    def levels(self, solution: Solution, now: float,
               solve: Callable[[list[Level]], Solution]) -> list[Level] | None:
        """
        Return levels that leave the singularity and replace those solved; None if not needed.

        Parameters
        ----------
        solution : Solution
            Solution of this cycle.
        now : float
            Time of a clock that is never set back [s].
        solve : callable (list of Level) -> Solution
            Solver of levels.

        """
        if self._upper:
            # Without the levels below: they may demand to stay at the singularity.
            upper = kept_above(solution.hierarchy, self._upper)
            levels = self._nudge.levels(upper, solve(upper).velocity, now)
            if levels is not None:
                return levels
            self._upper = 0
        if self._tries >= MOST_NUDGES:
            return None
        velocity = solution.velocity
        if velocity.dot(velocity) > STUCK_SPEED * STUCK_SPEED:
            self._still_since = None
            return None
        if self._still_since is None:
            self._still_since = now
        if now - self._still_since < STUCK_SECONDS:
            return None
        for index, level in enumerate(solution.hierarchy):
            if level.v is not None and norm(level.v) > LEAST_DEMAND \
                    and self._is_singular(solution, index):
                direction = self._random.standard_normal(self._n)
                self._upper = index + 1
                self._nudge.begin(NUDGE_SPEED * direction / norm(direction), now, self._upper)
                self._tries += 1
                self._still_since = None
                return self.levels(solution, now, solve)
        return None

    def _is_singular(self, solution: Solution, index: int) -> bool:
        """Return whether a level is at a singularity of its own, with an unreachable demand."""
        alone = solution.singular_values_alone(index)
        return bool(alone[-1] <= SINGULAR_RATIO * alone[0]) \
            and norm(solution.levels[index].unreachable) > LEAST_DEMAND
