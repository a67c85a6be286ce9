# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Configuration that a search has found, with the reports of its tasks."""

from collections.abc import Mapping
from functools import cached_property

from tp_controller.control.task_report import TaskReport
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, read_only
from tp_controller.positions.verdict import reports_at
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.stack import Stack

# Error up to which a goal counts as reached [m or rad].
GOAL_TOLERANCE = 1e-6


class PositionSolution:
    """
    Configuration at which a stack is carried out as well as its order allows.

    Attributes
    ----------
    q : ndarray (nq,)
        Configuration, within the position limits [rad or m].
    reached : bool
        Every task with a given goal is at it, and every inequality task above these is satisfied,
        within ``GOAL_TOLERANCE``.
    attempts : int
        Number of descents.

    """

    def __init__(self, robot: Robot, stack: Stack, goals: Mapping[str, Goal], q: Array,
                 attempts: int, reached: bool, passive: Array) -> None:
        self.q, self.reached, self.attempts = read_only(q), reached, attempts
        self._robot, self._stack, self._goals, self._passive = robot, stack, goals, passive

    @cached_property
    def tasks(self) -> tuple[TaskReport, ...]:
        """
        Return a `TaskReport` for every task of the stack, in order of priority.

        It has the error at `q`, and causes and hint for what is missing, without limits of
        velocities. `TaskReport.reached` uses the tolerance of the task. Tasks that are disabled,
        or demand a velocity, are left out.
        """
        return reports_at(self._robot, self._stack, self._goals, self.q, self._passive)

    def __repr__(self) -> str:
        """Return the configuration, and whether the goals are reached."""
        return f'PositionSolution(q={self.q.tolist()}, reached={self.reached})'
