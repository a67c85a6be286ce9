# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Failures of tasks: exceptions, invalid evaluations and exceeded time budgets.

A type of another package can raise any exception, return any object and take any time. For types
of this package only exceptions are caught: tests check their evaluations, since checks would cost
time in every cycle.
"""

from collections.abc import Callable
import math
import time
from typing import Any, ParamSpec, TypeVar

import numpy as np
from tp_controller.errors import (
    EvaluationError,
    GoalError,
    in_words,
    SolverError,
    TpControllerError,
)
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.level import check_level
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.untrusted.calls import foreign

PACKAGE = __name__.partition('.')[0]
# Number of consecutive cycles over the time budget that make a task fail. In a single one the
# machine may have paused.
MAX_SLOW_CYCLES = 3

Given = ParamSpec('Given')
Returned = TypeVar('Returned')


def is_foreign(task: Task) -> bool:
    """Return whether the type of a task belongs to another package."""
    return type(task).__module__.partition('.')[0] != PACKAGE


def attempt(task: Task, method: Callable[Given, Returned], *arguments: Given.args,
            **options: Given.kwargs) -> Returned:
    """Return the result of a method of a task; raise `EvaluationError` on any exception."""
    try:
        with foreign:
            return method(*arguments, **options)
    except Exception as error:
        raise EvaluationError(task.name, raised(method, error)) from error


def accept(task: Task, method: Callable[Given, Returned], *arguments: Given.args,
           **options: Given.kwargs) -> Returned:
    """Return the result of a method that takes a goal; raise `GoalError` if it fails."""
    try:
        with foreign:
            return method(*arguments, **options)
    except TpControllerError:
        raise
    except Exception as error:
        raise GoalError(f'task {task.name}: {raised(method, error)}') from error


def raised(method: Callable[..., object], error: Exception) -> str:
    """Return a sentence with the names of the method and its exception."""
    return f'{getattr(method, "__name__", "it")} raised {in_words(error)}'


class CheckedEvaluator:
    """
    Evaluator that converts failures of tasks into `EvaluationError`.

    Attributes
    ----------
    budget : float
        Largest time for the evaluation of a task of another package, on the steady clock [s].

    """

    def __init__(self) -> None:
        self.budget = math.inf
        # {task: number of consecutive cycles over the budget}
        self._slow: dict[str, int] = {}

    def evaluate(self, task: Task, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` of a task, or raise `EvaluationError`."""
        began = time.perf_counter()
        evaluation = attempt(task, task.evaluate, state, now)
        if is_foreign(task):
            self._check_time(task.name, time.perf_counter() - began)
            check(task, evaluation, len(state.velocity))
        return evaluation

    def _check_time(self, name: str, took: float) -> None:
        """Raise `EvaluationError` after `MAX_SLOW_CYCLES` consecutive cycles over the budget."""
        if took <= self.budget:
            self._slow[name] = 0
            return
        self._slow[name] = self._slow.get(name, 0) + 1
        if self._slow[name] >= MAX_SLOW_CYCLES:
            self._slow[name] = 0
            raise EvaluationError(
                name, f'evaluate took more than {1e3 * self.budget:.3g} ms in {MAX_SLOW_CYCLES} '
                      f'cycles in a row, now {1e3 * took:.3g} ms')


def check(task: Task, evaluation: Evaluation, n: int) -> None:
    """
    Check the evaluation of a task, and convert the arrays of its level to floats.

    Parameters
    ----------
    task : Task
        Task that returned the evaluation.
    evaluation : Evaluation
        Object to check.
    n : int
        Number of velocities.

    Raises
    ------
    EvaluationError
        The evaluation is invalid.

    """
    if not isinstance(evaluation, Evaluation) or evaluation.task is not task:
        raise EvaluationError(task.name, 'evaluate must return an Evaluation of the task, got '
                                         f'{type(evaluation).__name__}')
    try:
        evaluation.level = check_level(evaluation.level, 'its level')
        level = task.complete(evaluation).level
    except SolverError as error:
        raise EvaluationError(task.name, str(error)) from error
    rows = len(level.J)
    if level.J.shape[1] != n:
        fault = f'its Jacobian must have {n} columns, got {level.J.shape[1]}'
    elif (level.v is None) != task.bounded:
        fault = f'its level must have {"bounds" if task.bounded else "a velocity"}'
    elif _is_vector(evaluation.error, rows):
        names: Any = evaluation.row_names
        if isinstance(names, (list, tuple)) and len(names) in (0, rows):
            return
        fault = f'row_names must be a list or tuple, with a name for each of the {rows} rows'
    else:
        fault = f'its error must be an array of {rows} finite floats'
    raise EvaluationError(task.name, fault)


def _is_vector(values: Array, size: int) -> bool:
    """Return whether `values` is an array (size,) of finite floats."""
    return isinstance(values, np.ndarray) and values.dtype == float \
        and values.shape == (size,) and bool(np.isfinite(values).all())


def out_of_reach(task: Task) -> str:
    """Return a remark if no posture of the robot reaches the goal of a task; mostly empty."""
    try:
        with foreign:
            return '' if task.goal is None else str(task.out_of_reach(task.goal))
    except Exception:
        # A failing remark of another package's task type is not a fault.
        return ''
