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

"""From one stack to another while the robot moves."""

import math

from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level


class Transition:
    """
    Blends in a change of the stack, of a goal or of a setting, so that the velocity has no jump.

    A change is announced, and takes effect in the next cycle.

    At a change the velocity differs from the one before by an offset. The offset is added to the
    new velocity and fades out. The sum is the demand of a closing level, below the levels that the
    old and the new stack share: those are carried out exactly. The bounds are the same.

    Parameters
    ----------
    duration : float
        Time until the offset has gone [s]; 0 lets changes act at once.

    """

    def __init__(self, duration: float) -> None:
        self.duration = duration
        self._offset: Array | None = None
        self._began = 0.0
        self._shared = 0
        self._announced: int | None = None
        self._goal_times: dict[str, float] = {}

    def announce(self, shared: int) -> None:
        """Announce a change that leaves this many of the upper levels as they are."""
        self._announced = shared if self._announced is None else min(shared, self._announced)

    def announce_goal(self, name: str, level: int, now: float) -> None:
        """
        Announce a new goal, or feed-forward velocity, of a task on a level, from 0.

        Goals that follow each other faster than changes fade out are the steps of one motion,
        and fading would only make the robot lag behind it. `now` is of the clock of the goals.
        """
        if not abs(now - self._goal_times.get(name, -math.inf)) <= self.duration:
            self.announce(level)
        self._goal_times[name] = now

    def pending(self) -> int | None:
        """Return how many upper levels the announced changes leave as they are; None if none."""
        shared, self._announced = self._announced, None
        return shared

    def begin(self, offset: Array, began: float, shared: int) -> None:
        """
        Let an offset fade out from now on, in place of one that still does.

        Parameters
        ----------
        offset : ndarray (n,)
            Velocity before the change − velocity after it.
        began : float
            Time of the velocity before, on a clock that is never set back [s].
        shared : int
            How many of the upper levels the change leaves as they are.

        """
        self._shared = min(shared, self._shared) if self.active(began) else shared
        self._offset, self._began = offset, began

    def active(self, now: float) -> bool:
        """Return whether an offset still fades out."""
        return self._offset is not None and now - self._began < self.duration

    def levels(self, levels: list[Level], velocity: Array, now: float) -> list[Level] | None:
        """
        Return the levels of the transition to `velocity`; None where it is over.

        Parameters
        ----------
        levels : list of Level
            Of the new stack.
        velocity : ndarray (n,)
            That carries them out.
        now : float
            [s]

        """
        if self._offset is None or not self.active(now):
            return None
        share = (now - self._began) / self.duration
        left = 1.0 - share * share * (3.0 - 2.0 * share)
        return kept_above(levels, self._shared) + [
            Level.of_joints(velocity + left * self._offset)]


def kept_above(levels: list[Level], count: int) -> list[Level]:
    """
    Return the first `count` levels, and the bounds that follow them at once.

    Bounds are there for safety: they apply as soon as they are in the stack. Those farther down
    are below tasks, which they must not disturb.
    """
    while count < len(levels) and levels[count].v is None:
        count += 1
    return levels[:count]
