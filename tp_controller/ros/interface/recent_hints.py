# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Hints of the tasks that are not computed for every status."""

from collections.abc import Callable
import math

from tp_controller.control.task_report import TaskReport
from tp_controller.ros.loop.clocks import boot_time

# Least time between two hints of a task that are computed [s]: each takes as long as some cycles.
HINT_SECONDS = 1.0


class RecentHints:
    """
    Hints of the tasks, each computed at most once in `HINT_SECONDS`.

    Parameters
    ----------
    clock : callable, optional
        Returns the time [s].

    """

    def __init__(self, clock: Callable[[], float] = boot_time) -> None:
        self._clock = clock
        self._found: dict[str, tuple[float, str]] = {}

    def of(self, task: TaskReport) -> str:
        """Return the hint of a task, perhaps that of an earlier report."""
        if not task.reason:
            return ''
        found, hint = self._found.get(task.name, (-math.inf, ''))
        now = self._clock()
        if now - found >= HINT_SECONDS:
            hint = task.hint
            self._found[task.name] = now, hint
        return hint

    def forget(self) -> None:
        """Drop the hints, which were for another stack."""
        self._found.clear()
