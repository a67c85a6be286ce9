# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Report of a cycle: its tasks, and the limits that scale it."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import count

from tp_controller.control.changes import NO_TRAJECTORIES
from tp_controller.control.reasons import phrase
from tp_controller.control.solved_cycle import SolvedCycle
from tp_controller.control.task_report import ReportedCycle, TaskReport
from tp_controller.model.robot import Robot
from tp_controller.solver.solution import Solution
from tp_controller.tasks.stack import Stack
from tp_controller.tasks.task import Evaluation, Task


class Report:
    """
    Report of one cycle: tasks, scale and limits; computed on access.

    Parameters
    ----------
    robot : Robot
    disabled : sequence of Task
    faults : mapping
        {name: reason} of the disabled tasks that failed.
    solved : SolvedCycle
    progress : mapping
        {name: share} of the tasks that follow trajectories; see `TaskReport`.

    """

    def __init__(self, robot: Robot, disabled: Sequence[Task], faults: Mapping[str, str],
                 solved: SolvedCycle, progress: Mapping[str, float] = NO_TRAJECTORIES) -> None:
        self._robot, self._disabled, self._faults = robot, disabled, faults
        self._solved, self._progress = solved, progress

    @cached_property
    def _solution(self) -> Solution:
        """Return the solution of the stack at the commanded velocity."""
        outcome = self._solved.outcome
        return outcome.solution.moved_to(outcome.velocity)

    @cached_property
    def _cycle(self) -> ReportedCycle:
        """Return the cycle as its tasks report it."""
        return ReportedCycle(self._robot, self._solved)

    @cached_property
    def tasks(self) -> tuple[TaskReport, ...]:
        """Return a `TaskReport` for every task, in order of priority, the disabled ones last."""
        cycle, index = self._cycle, count()
        return (*[TaskReport(task, level, '', cycle, next(index), self._progress.get(task.name))
                  for level, group in enumerate(self._solved.tasks, 1) for task in group],
                *_disabled_reports(self._disabled, self._faults))

    @property
    def scale(self) -> float:
        """Return the smallest factor by which the limits scale a level."""
        return self._solution.scale

    @property
    def active_bounds(self) -> frozenset[str]:
        """Return the names of the inequality tasks whose bounds limit a level, or themselves."""
        if not any(task.bounded for group in self._solved.tasks for task in group):
            # Evaluations and solution need not be decoded.
            return frozenset()
        return active_bounds(self._solved.evaluations, self._solution)

    @property
    def locked(self) -> tuple[str, ...]:
        """Return the locked joints."""
        return self._solved.options.locked

    @property
    def reached(self) -> bool:
        """Return whether every enabled task is at its goal."""
        return all(task.reached for task in self.tasks if task.level is not None)

    @property
    def limiting(self) -> str:
        """Return the limit that scales the command, as text; empty if none does."""
        joint = self._solution.limiting
        if joint is None:
            return ''
        level = next(level for level in self._solution.levels if level.limited_by)
        return phrase(self._cycle.search.limits_at(level, joint)[0],
                      self._robot.velocity_names[joint])


def active_bounds(evaluations: Sequence[Sequence[Evaluation]],
                  solution: Solution) -> frozenset[str]:
    """Return the names of the inequality tasks with a row that limits a level of a solution."""
    found = set()
    for level in solution.levels:
        for number, multipliers in level.row_multipliers.items():
            first = 0
            for evaluation in evaluations[number]:
                rows = multipliers[first:first + len(evaluation.level.J)]
                first += len(rows)
                if rows.any():
                    found.add(evaluation.task.name)
    return frozenset(found)


def stopped_reports(stack: Stack) -> tuple[TaskReport, ...]:
    """Return a `TaskReport` for every task while the robot is stopped, as `Report.tasks`."""
    return (*(TaskReport(task, number)
              for number, group in enumerate(stack.active, 1) for task in group),
            *_disabled_reports(stack.inactive, stack.faults))


def _disabled_reports(tasks: Sequence[Task], faults: Mapping[str, str]) -> list[TaskReport]:
    """Return a `TaskReport` for each disabled task; some of them may have failed."""
    return [TaskReport(task, fault=faults.get(task.name, '')) for task in tasks]
