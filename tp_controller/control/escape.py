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

"""Leaving a singularity that the robot is exactly at."""

from collections.abc import Callable

import numpy as np
from tp_controller.control.transition import kept_above, Transition
from tp_controller.solver.level import Level
from tp_controller.solver.solution import Solution
from tp_controller.tasks.task import norm

# A joint slower than this stands still, and a task velocity below it is not worth a motion.
STILL = 1e-3
WANTED = 1e-2
# A singular value below this, relative to the largest one, is one that the robot stands on.
SINGULAR = 1e-6
# Speed and duration of a nudge [rad/s, s], and how often it is tried.
SPEED = 0.02
DURATION = 1.0
TRIES = 3
# How long the robot has to have stood still before [s].
PATIENCE = 0.2


class Escape:
    """
    Moves a robot a little that rests exactly at a singularity, although a task is not reached.

    Example: a straight arm that is to retract. To first order no joint velocity moves the tool
    along the arm, so the damped solution is to rest. The least deviation changes that. Here a
    nudge does: a few milliradians of motion in the null space of the level and those above.
    If it does not help, because the goal is out of reach, say, it is tried twice more. Then it is
    not tried again until something changes.

    Parameters
    ----------
    n : int
        Number of joints.

    """

    def __init__(self, n: int) -> None:
        self._nudge = Transition(DURATION)
        self._random = np.random.default_rng(0)
        self._n = n
        self._tries = self._upper = 0
        self._still_since: float | None = None

    def reset(self) -> None:
        """Say that something has changed, so that it is worth trying again."""
        self._tries = self._upper = 0

    def levels(self, solution: Solution, now: float,
               solve: Callable[[list[Level]], Solution]) -> list[Level] | None:
        """
        Return levels that leave the singularity, in place of those solved; None if not needed.

        Parameters
        ----------
        solution : Solution
            Of this cycle.
        now : float
            On a clock that is never set back [s].
        solve : callable (list of Level) -> Solution
            Carries levels out.

        """
        if self._upper:
            # Without the levels below, which may demand to stay where they are.
            upper = kept_above(solution.hierarchy, self._upper)
            levels = self._nudge.levels(upper, solve(upper).velocity, now)
            if levels is not None:
                return levels
            self._upper = 0
        if self._tries >= TRIES:
            return None
        velocity = solution.velocity
        if velocity.dot(velocity) > STILL * STILL:
            self._still_since = None
            return None
        if self._still_since is None:
            self._still_since = now
        if now - self._still_since < PATIENCE:
            return None
        for index, level in enumerate(solution.hierarchy):
            if level.v is not None and norm(level.v) > WANTED and self._stuck(solution, index):
                direction = self._random.standard_normal(self._n)
                self._upper = index + 1
                self._nudge.begin(SPEED * direction / norm(direction), now, self._upper)
                self._tries += 1
                self._still_since = None
                return self.levels(solution, now, solve)
        return None

    def _stuck(self, solution: Solution, index: int) -> bool:
        """Say whether a level stands on a singularity of its own."""
        alone = solution.singular_values_alone(index)
        return bool(alone[-1] <= SINGULAR * alone[0]) \
            and norm(solution.levels[index].unreachable) > WANTED
