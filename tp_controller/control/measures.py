# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Measures of the tasks in a cycle: errors in each unit, and whether they are at their goals."""

from collections.abc import Callable, Iterable
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np
from tp_controller.control.causes import residual_of
from tp_controller.control.solved_cycle import SolvedCycle
from tp_controller.model.spatial import Array
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.task_errors import raised
from tp_controller.untrusted.calls import foreign

# Residual for tasks that do not report it.
NOTHING = np.zeros(0)


class Measures(NamedTuple):
    """Measures of a task in a cycle; see `TaskReport`."""

    errors: tuple[tuple[float, str, float], ...]
    reached: bool
    fault: str


class MeasuredCycle:
    """
    Measures of the tasks in a cycle, by their index; computed on access.

    Parameters
    ----------
    solved : SolvedCycle

    """

    def __init__(self, solved: SolvedCycle) -> None:
        self._solved = solved
        self._tasks = [task for group in solved.tasks for task in group]
        self._measured: dict[int, Measures] = {}

    @cached_property
    def evaluations(self) -> list[Evaluation]:
        """Return the evaluation of each task."""
        return [each for group in self._solved.evaluations for each in group]

    def measures(self, index: int) -> Measures:
        """Return the measures of the task at an index."""
        if index not in self._measured:
            task, error = self._tasks[index], self._solved.errors[index]
            self._measured[index] = measures_of(task, lambda: (
                error, NOTHING if _reports_its_error(task) else self.speeds(index)[1]))
        return self._measured[index]

    def by_name(self) -> dict[str, Measures]:
        """Return the measures of each task by its name."""
        return {task.name: self.measures(index) for index, task in enumerate(self._tasks)}

    def speeds(self, index: int) -> tuple[Array, Array]:
        """Return the achieved velocity of the task at an index, and its residual."""
        level, velocity = self.evaluations[index].level, self._solved.velocity
        scale = self._tasks[index].row_scale
        return level.J.dot(velocity) / scale, residual_of(level, velocity) / scale


def measures_of(task: Task, inputs: Callable[[], tuple[Array, Array]], fault: str = ''
                ) -> Measures:
    """Return the measures of a task with the inputs of `reported_errors`."""
    try:
        with foreign:
            errors = _as_numbers(task.reported_errors(*inputs()))
    except Exception as error:
        # A task type of another package failed in its report; the task still runs.
        return Measures(
            tuple((math.nan, unit, tolerance) for _, unit, tolerance in task.groups),
            False, fault or raised(task.reported_errors, error))
    return Measures(errors, all(value <= tolerance for value, _, tolerance in errors), fault)


def _reports_its_error(task: Task) -> bool:
    """Return whether a task reports its error alone, as most types do."""
    return type(task).reported_errors is Task.reported_errors \
        and 'reported_errors' not in task.__dict__


def _as_numbers(errors: Iterable[tuple[float, str, float]]
                ) -> tuple[tuple[float, str, float], ...]:
    """Return errors as numbers; raise if they are not."""
    return tuple([(float(value), unit, float(tolerance)) for value, unit, tolerance in errors])
