# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes of the stack, goals and settings between two cycles."""

from collections.abc import Mapping
import math

from tp_controller.control.solved_cycle import SolvedCycle
from tp_controller.control.step import Commanded
from tp_controller.tasks.stack import Groups, shared_levels
from tp_controller.tasks.task import Task

NO_TRAJECTORIES: Mapping[str, float] = {}


class Changes:
    """
    Changes of the stack, a goal or a setting that take effect in the next cycle.

    Attributes
    ----------
    shared : int or None
        Number of upper levels that no change affects; None without a change.
    groups : tuple of tuple of Task or None
        Active tasks of the last cycle; None if they are the same.
    duration : float
        Time in which a change is blended in [s]; 0 applies changes at once.

    """

    def __init__(self) -> None:
        self.shared: int | None = None
        self.groups: Groups | None = None
        self.duration = 0.0
        self._goal_times: dict[str, float] = {}

    def announce(self, shared: int) -> None:
        """Announce a change that does not affect the first `shared` levels."""
        self.shared = shared if self.shared is None else min(shared, self.shared)

    def announce_task(self, task: Task, active: Groups) -> None:
        """Announce a change of a task, unless it is disabled."""
        for index, group in enumerate(active):
            if task in group:
                self.announce(index)

    def announce_goal(self, task: Task, active: Groups, now: float) -> None:
        """
        Announce a new goal, or feed-forward velocity, of a task, unless it is disabled.

        Goals that follow each other faster than changes fade out are steps of one motion; fading
        would only make the robot lag behind it. `now` is the time of the clock of the goals.
        """
        if any(task in group for group in active):
            if not abs(now - self._goal_times.get(task.name, -math.inf)) <= self.duration:
                self.announce_task(task, active)
            self._goal_times[task.name] = now

    def announce_stack(self, before: Groups, after: Groups) -> None:
        """Announce a change of the active tasks, unless they are the same."""
        shared = shared_levels(before, after)
        if shared < max(len(before), len(after)):
            self.announce(shared)
            self.groups = before if self.groups is None else self.groups

    def continued(self, last: SolvedCycle | Commanded, active: Groups
                  ) -> SolvedCycle | Commanded | None:
        """
        Return the last cycle as the next one continues it; None if a change is blended in.

        `active`: enabled tasks of each level.
        """
        if self.shared is None:
            return last
        if self.duration > 0.0 and last.memory.commanded is not None:
            return None
        memory = last.memory.for_groups(self.groups, active)
        return Commanded(memory._replace(escape=memory.escape.reset()))

    def clear(self) -> None:
        """Clear the changes, after a cycle."""
        self.shared = self.groups = None
