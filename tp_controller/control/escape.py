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

"""The way out of a singularity that the robot stands on exactly."""

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
    Nudges a robot that stands still exactly on a singularity, although a task wants to move.

    A straight arm that is to come straight back is the example: no joint velocity moves the tool
    that way, to first order, and the damped solution is to stand still. The least deviation
    changes that, and noise would bring it about; the nudge does, a few milliradians of motion
    that the level and those above do not feel. If it does not help, the arm is at a goal out of
    reach, say, it is tried twice more and then not again until something changes.

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
        self._still_since = None

    def levels(self, solution: Solution, now: float,
               solve: Callable[[list[Level]], Solution]) -> list[Level] | None:
        """
        Return levels that lead out, in place of the ones that were solved; None if need not.

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
            # Without the levels below, which may want to stay where they are.
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
