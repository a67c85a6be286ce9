# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Report of a task in a cycle: its error, and the causes that limit it."""

from collections.abc import Sequence
from functools import cached_property
import math
from warnings import warn

import numpy as np
from tp_controller.control.causes import (
    BOUNDS,
    Cause,
    Causes,
    DEMAND_ROUNDING,
    FoundCauses,
    JOINTS,
    kind_of_limit,
    KINDS,
    TASK,
)
from tp_controller.control.hints import hint_of
from tp_controller.control.measures import MeasuredCycle, Measures, measures_of, NOTHING
from tp_controller.control.reasons import (
    CHOOSE_ANOTHER,
    OUT_OF_REACH,
    Statement,
    statements,
    suffice,
)
from tp_controller.control.roll_out import RollOuts
from tp_controller.control.solved_cycle import SolvedCycle
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tasks.task import Evaluation, norm, Task
from tp_controller.tasks.task_errors import out_of_reach


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
        Every error is within its tolerance, and no trajectory moves the goal.
    progress : float or None
        Share of the time of the trajectory of the task that has passed, from 0 to 1; None unless
        it follows one.
    demanded_speed, achieved_speed : float
        Norm of the demanded task velocity, and of its achieved part (over all rows;
        m/s and rad/s are added up as they are).
    fault : str
        Reason why the task failed, as a sentence; else empty.

    """

    def __init__(self, task: Task, level: int | None = None, fault: str = '',
                 cycle: 'ReportedCycle | None' = None, index: int = 0,
                 progress: float | None = None) -> None:
        self.name, self.type_name, self.bounded = task.name, task.type_name, task.bounded
        self.level, self._task, self._known_fault = level, task, fault
        # Of a task that is carried out, and its index among these.
        self._cycle, self._index = cycle, index
        self.progress = progress

    @cached_property
    def _evaluation(self) -> Evaluation | None:
        """Return the evaluation of the task; None while it does not run."""
        return None if self._cycle is None else self._cycle.evaluations[self._index]

    @cached_property
    def _measures(self) -> Measures:
        """Return the measures of the task."""
        if self._cycle is not None:
            return self._cycle.measures(self._index)
        unknown = np.full(self._task.rows, np.nan)
        return measures_of(self._task, lambda: (unknown, unknown), self._known_fault)

    @property
    def errors(self) -> tuple[tuple[float, str, float], ...]:
        """Return the norm of the error, its unit and the tolerance, for each unit."""
        return self._measures.errors

    @property
    def reached(self) -> bool:
        """Return whether every error is within its tolerance, and no trajectory goes on."""
        return self.carried_out and self.progress is None and self._measures.reached

    @property
    def demanded_speed(self) -> float:
        """Return the norm of the demanded task velocity."""
        return norm(np.add(*self._speeds))

    @property
    def wanted_speed(self) -> float:
        """Return `demanded_speed`: the former name, deprecated."""
        warn('TaskReport.wanted_speed is called demanded_speed', DeprecationWarning, stacklevel=2)
        return self.demanded_speed

    @property
    def achieved_speed(self) -> float:
        """Return the norm of the achieved part of the demanded task velocity."""
        return norm(self._speeds[0])

    @property
    def _speeds(self) -> tuple[Array, Array]:
        """Return the achieved velocity of the task and its residual; nothing unless it runs."""
        if self._cycle is None or self.fault:
            return NOTHING, NOTHING
        return self._cycle.speeds(self._index)

    @property
    def fault(self) -> str:
        """Return the reason why the task failed, as a sentence; else empty."""
        return self._measures.fault

    @property
    def carried_out(self) -> bool:
        """Return whether the report is from a cycle with the task enabled, not from a stop."""
        return self._cycle is not None

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Return the causes that limit the task, the largest share first; () if it is reached."""
        if self._cycle is None or self.reached:
            return ()
        return self._cycle.causes(self._index)

    @cached_property
    def _statements(self) -> list[Statement]:
        """Return the parts of the reason."""
        if self.fault:
            return [Statement(self.fault, (self.fault,))]
        if self._cycle is None or self._evaluation is None or self.reached:
            return []
        found = list(statements(self._evaluation, self.errors, self.causes, self._combined,
                                self._cycle.search))
        if any(OUT_OF_REACH in each.sentence for each in found) or not self._unreachable:
            return found
        return [Statement(self._unreachable, (OUT_OF_REACH,)), *found]

    def _combined(self) -> Sequence[tuple[str, str]]:
        """Return (kind, name) of what limits the task together; () if a cause alone is enough."""
        if self._cycle is None or suffice(self.causes):
            return ()
        return self._cycle.combined_causes(self._index)

    @property
    def reason(self) -> str:
        """Return the reason why the task is limited, as a sentence; empty if its demand is met."""
        return '; '.join(each.sentence for each in self._statements if each.sentence)

    @property
    def main_cause(self) -> str:
        """Return the first part of the reason without numbers; empty if there is none."""
        first = self._statements[0] if self._statements else Statement('', ('',))
        return first.phrases[0] if len(first.phrases) == 1 else first.sentence

    @property
    def phrases(self) -> tuple[str, ...]:
        """
        Return a short phrase without numbers for each cause, the largest share first.

        Causes that limit the task only together have a phrase each.
        """
        return tuple(dict.fromkeys(
            text for each in self._statements for text in each.phrases))

    @cached_property
    def _unreachable(self) -> str:
        """Return the reason why no motion can reach the goal, even a distant one; else empty."""
        return out_of_reach(self._task)

    @cached_property
    def hint(self) -> str:
        """Return the suggested change, as a sentence; empty if none is needed."""
        if self.fault:
            return 'correct its code, then enable the task again'
        if self._cycle is None or self._evaluation is None or not self.reason:
            return ''
        if self._unreachable:
            return CHOOSE_ANOTHER
        return hint_of(self._evaluation, self.causes, self._combined, self._cycle.search,
                       self._cycle.roll_outs)

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
        if self._cycle is None:
            return 'stopped'
        if self.reached:
            return 'satisfied' if self.bounded else 'reached'
        return 'limited' if self.reason else 'moving'


class ReportedCycle(MeasuredCycle):
    """
    Cycle of the tasks that are carried out, as they report it; computed on access.

    Parameters
    ----------
    robot : Robot
    solved : SolvedCycle

    """

    def __init__(self, robot: Robot, solved: SolvedCycle) -> None:
        super().__init__(solved)
        self._robot = robot

    @cached_property
    def search(self) -> Causes:
        """Return the search for causes that limit tasks."""
        solved = self._solved
        return Causes(self._robot, solved.evaluations, solved.cycle, solved.outcome, solved.place,
                      solved.options.locked)

    @cached_property
    def roll_outs(self) -> RollOuts:
        """Return the roll-outs from the cycle."""
        return RollOuts(self._robot, self._solved)

    def causes(self, index: int) -> tuple[Cause, ...]:
        """Return the causes that limit the task at an index, the largest share first."""
        if self._found is None:
            return self.search.of(self.evaluations[index])
        return tuple([Cause(*self._kind_and_name(KINDS[kind], place), share)
                      for kind, place, share in self._found[index]])

    def combined_causes(self, index: int) -> list[tuple[str, str]]:
        """Return (kind, name) of what blocks the task at an index together; [] if nothing does."""
        found = self._solved.combined_causes(index)
        if found is None:
            return self.search.combined_causes(self.evaluations[index])
        return [self._kind_and_name(KINDS[kind], place) for kind, place in found]

    @cached_property
    def _found(self) -> FoundCauses | None:
        """Return the causes that the compiled core finds; none of tasks that are reached."""
        return self._solved.causes(np.array([
            math.inf if self.measures(index).reached else DEMAND_ROUNDING * task.row_scale
            for index, task in enumerate(self._tasks)]))

    def _kind_and_name(self, kind: str, place: int) -> tuple[str, str]:
        """Return kind and name of a cause; the name is empty where it has none."""
        if place < 0:
            return kind, ''
        if kind in (TASK, BOUNDS, JOINTS):
            return kind, self._tasks[place].name
        return kind_of_limit(kind, self._robot.velocity_names[place], self._solved.options.locked)
