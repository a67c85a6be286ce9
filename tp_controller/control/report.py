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

"""Report of a cycle: the error of every task, and the causes that limit it."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
import math
from typing import NamedTuple, Protocol
from warnings import warn

import numpy as np
from tp_controller.control.causes import Cause, Causes, residual_of
from tp_controller.control.cycle import Cycle, Outcome
from tp_controller.control.error_minimum import Place
from tp_controller.control.reasons import (
    CHOOSE_ANOTHER,
    hint_of,
    OUT_OF_REACH,
    phrase,
    Statement,
    statements,
)
from tp_controller.control.step import CycleMemory
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.solver.solution import Solution
from tp_controller.tasks.stack import Stack
from tp_controller.tasks.task import Evaluation, norm, Task
from tp_controller.tasks.task_errors import raised
from tp_controller.untrusted.calls import foreign


class Measures(NamedTuple):
    """Measures of a task in a cycle; see `TaskReport`."""

    errors: tuple[tuple[float, str, float], ...]
    reached: bool = False
    demanded_speed: float = 0.0
    achieved_speed: float = 0.0
    fault: str = ''


class TaskReport:
    """
    Report of one task in one cycle; computed on access.

    Attributes
    ----------
    name, type_name : str
    level : int or None
        From 1, the highest priority; None while the task is disabled.
    bounded : bool
        The task is an inequality task: it has bounds instead of a demand.
    errors : tuple of (float, str, float)
        Norm of the error, its unit and the tolerance, for each unit; NaN while it is disabled or
        stopped.
    reached : bool
        Every error is within its tolerance.
    demanded_speed, achieved_speed : float
        Norm of the demanded task velocity, and of its achieved part (over all rows;
        m/s and rad/s are added up as they are).
    fault : str
        Reason why the task failed, as a sentence; else empty.

    """

    def __init__(self, task: Task, evaluation: Evaluation | None = None,
                 level: int | None = None, velocity: Array | None = None,
                 causes: Causes | None = None, fault: str = '') -> None:
        self.name, self.type_name, self.bounded = task.name, task.type_name, task.bounded
        self.level, self._evaluation, self._causes = level, evaluation, causes
        self._task, self._velocity, self._known_fault = task, velocity, fault

    @cached_property
    def _measures(self) -> Measures:
        """Return the measures of the task."""
        task = self._task
        try:
            with foreign:
                return self._measure(task)
        except Exception as error:
            # A task type of another package failed in its report; the task still runs.
            return Measures(
                tuple((math.nan, unit, tolerance) for _, unit, tolerance in task.groups),
                fault=self._known_fault or raised(task.reported_errors, error))

    def _measure(self, task: Task) -> Measures:
        """Return the measures of the task; its type may raise any exception."""
        evaluation, velocity = self._evaluation, self._velocity
        if evaluation is None or velocity is None:
            # A task that does not run has no measures.
            unknown = np.full(task.rows, np.nan)
            return Measures(_as_numbers(task.reported_errors(unknown, unknown)),
                            fault=self._known_fault)
        residual = residual_of(evaluation.level, velocity) / task.row_scale
        achieved = evaluation.level.J.dot(velocity) / task.row_scale
        errors = _as_numbers(task.reported_errors(evaluation.error, residual))
        return Measures(errors, all(value <= tolerance for value, _, tolerance in errors),
                        norm(achieved + residual), norm(achieved), self._known_fault)

    @property
    def errors(self) -> tuple[tuple[float, str, float], ...]:
        """Return the norm of the error, its unit and the tolerance, for each unit."""
        return self._measures.errors

    @property
    def reached(self) -> bool:
        """Return whether every error is within its tolerance."""
        return self._measures.reached

    @property
    def demanded_speed(self) -> float:
        """Return the norm of the demanded task velocity."""
        return self._measures.demanded_speed

    @property
    def wanted_speed(self) -> float:
        """Return `demanded_speed`: the former name, deprecated."""
        warn('TaskReport.wanted_speed is called demanded_speed', DeprecationWarning, stacklevel=2)
        return self.demanded_speed

    @property
    def achieved_speed(self) -> float:
        """Return the norm of the achieved part of the demanded task velocity."""
        return self._measures.achieved_speed

    @property
    def fault(self) -> str:
        """Return the reason why the task failed, as a sentence; else empty."""
        return self._measures.fault

    @property
    def carried_out(self) -> bool:
        """Return whether the report is from a cycle with the task enabled, not from a stop."""
        return self._evaluation is not None

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Return the causes that limit the task, the largest share first; () if it is reached."""
        if self._causes is None or self._evaluation is None or self.level is None or self.reached:
            return ()
        return self._causes.of(self._evaluation)

    @cached_property
    def _statements(self) -> list[Statement]:
        """Return the parts of the reason."""
        if self.fault:
            return [Statement(self.fault, (self.fault,))]
        if self._causes is None or self._evaluation is None or self.level is None or self.reached:
            return []
        found = list(statements(self._evaluation, self.errors, self.causes, self._causes))
        if any(OUT_OF_REACH in each.sentence for each in found) or not self._unreachable:
            return found
        return [Statement(self._unreachable, (OUT_OF_REACH,)), *found]

    @property
    def reason(self) -> str:
        """Return the reason why the task is limited, as a sentence; empty if its demand is met."""
        return '; '.join(each.sentence for each in self._statements if each.sentence)

    @property
    def phrases(self) -> tuple[str, ...]:
        """
        Return a short phrase without numbers for each cause, the largest share first.

        Causes that limit the task only together, which `causes` lacks, have a phrase each.
        """
        return tuple(dict.fromkeys(
            text for each in self._statements for text in each.phrases))

    @cached_property
    def _unreachable(self) -> str:
        """Return the reason why no motion can reach the goal, even a distant one; else empty."""
        task = self._task
        try:
            with foreign:
                return '' if task.goal is None else str(task.out_of_reach(task.goal))
        except Exception:
            # A failing remark of another package's task type is not a fault.
            return ''

    @cached_property
    def hint(self) -> str:
        """Return the suggested change, as a sentence; empty if none is needed."""
        if self.fault:
            return 'correct its code, then enable the task again'
        if self._causes is None or self._evaluation is None or not self.reason:
            return ''
        return CHOOSE_ANOTHER if self._unreachable else \
            hint_of(self._evaluation, self.causes, self._causes)

    @property
    def status(self) -> str:
        """
        Return the state of the task as one word.

        ``failed``, ``disabled``, ``reached``, ``satisfied`` (bounds), ``moving`` or ``limited``;
        ``stopped`` without a cycle.
        """
        if self.fault:
            return 'failed'
        if self.level is None:
            return 'disabled'
        if self._evaluation is None:
            return 'stopped'
        if self.reached:
            return 'satisfied' if self.bounded else 'reached'
        return 'limited' if self.reason else 'moving'


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
    return (*(TaskReport(task, level=number)
              for number, group in enumerate(stack.active, 1) for task in group),
            *_disabled_reports(stack.inactive, stack.faults))


def _disabled_reports(tasks: Sequence[Task], faults: Mapping[str, str]) -> list[TaskReport]:
    """Return a `TaskReport` for each disabled task; some of them may have failed."""
    return [TaskReport(task, fault=faults.get(task.name, '')) for task in tasks]


def _as_numbers(errors: Iterable[tuple[float, str, float]]
                ) -> tuple[tuple[float, str, float], ...]:
    """Return errors as numbers; raise if they are not."""
    return tuple([(float(value), unit, float(tolerance)) for value, unit, tolerance in errors])


class SolvedCycle(Protocol):
    """Problem and outcome of a cycle, its memory, and the configuration of the robot in it."""

    @property
    def velocity(self) -> Array:
        """Return the command (n,) [rad/s or m/s]."""

    @property
    def memory(self) -> CycleMemory:
        """Return the memory for the next cycle."""

    @property
    def evaluations(self) -> Sequence[Sequence[Evaluation]]:
        """Return the evaluations of the enabled tasks, level by level."""

    @property
    def cycle(self) -> Cycle:
        """Return the problem."""

    @property
    def outcome(self) -> Outcome:
        """Return the outcome."""

    @property
    def place(self) -> Place:
        """Return the configuration."""


class Solved(NamedTuple):
    """Cycle that `step` computed; see `SolvedCycle`."""

    evaluations: Sequence[Sequence[Evaluation]]
    cycle: Cycle
    outcome: Outcome
    memory: CycleMemory
    place: Place

    @property
    def velocity(self) -> Array:
        """Return the command (n,) [rad/s or m/s]."""
        return self.memory.velocity


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

    """

    def __init__(self, robot: Robot, disabled: Sequence[Task], faults: Mapping[str, str],
                 solved: SolvedCycle) -> None:
        self._robot, self._disabled, self._faults = robot, disabled, faults
        self._solved = solved

    @cached_property
    def _solution(self) -> Solution:
        """Return the solution of the stack at the commanded velocity."""
        outcome = self._solved.outcome
        return outcome.solution.moved_to(outcome.velocity)

    @cached_property
    def _causes(self) -> Causes:
        """Return the search for causes that limit tasks."""
        solved = self._solved
        return Causes(self._robot, solved.evaluations, solved.cycle, solved.outcome, solved.place)

    @cached_property
    def tasks(self) -> tuple[TaskReport, ...]:
        """Return a `TaskReport` for every task, in order of priority, the disabled ones last."""
        velocity, causes = self._solved.outcome.velocity, self._causes
        reports = [TaskReport(evaluation.task, evaluation, number, velocity, causes)
                   for number, group in enumerate(self._solved.evaluations, 1)
                   for evaluation in group]
        return (*reports, *_disabled_reports(self._disabled, self._faults))

    @property
    def scale(self) -> float:
        """Return the smallest factor by which the limits scale a level."""
        return self._solution.scale

    @property
    def active_bounds(self) -> frozenset[str]:
        """Return the names of the inequality tasks whose bounds limit a level, or themselves."""
        return active_bounds(self._solved.evaluations, self._solution)

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
        return phrase(self._causes.limits_at(level, joint)[0],
                      self._robot.velocity_names[joint])
