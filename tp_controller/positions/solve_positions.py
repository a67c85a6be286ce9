# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inverse kinematics of many goals, on several threads."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import GoalError, RobotError, SettingsError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.positions.options import options_of
from tp_controller.positions.solution import PositionSolution
from tp_controller.positions.solve_position import PositionSolver
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.stack import Stack

# Share of the goals left that all threads take in their next calls, so that they end at about the
# same time; and largest number of goals of a call: while its results are made, others may wait.
SHARE, MOST_GOALS_OF_A_CALL = 0.5, 200


class GoalOfManyError(GoalError):
    """Refusal of one of several goals; ``number`` is its number, from 0."""

    def __init__(self, number: int, error: GoalError) -> None:
        self.number = number
        super().__init__(f'goal {number}: {error}')


def solve_positions(robot: Robot, stack: Stack, goals: Mapping[str, Sequence[Goal]],
                    start: ArrayLike | None = None, jobs: int = -1, **options: Any
                    ) -> list[PositionSolution]:
    """
    Return the results of `PositionSolver.solve` for many goals; each is that of a single call.

    Parameters
    ----------
    robot : Robot
        Robot of the tasks.
    stack : Stack
        Tasks; see `PositionSolver`.
    goals : dict
        {task: goals}, one for each result, such as an array (N, 7) or (N, 4, 4) for poses.
    start : array_like (nq,) or (N, nq), optional
        Configuration for all, or for each, where the first descent starts [rad or m].
    jobs : int
        Number of threads; −1: one for each processor.
    **options
        Other arguments of `PositionSolver.solve`, the same for all.

    Returns
    -------
    list of PositionSolution
        In the order of the goals.

    Raises
    ------
    GoalError
        The numbers of goals differ, or a goal is not valid, with its number, from 0; see
        `PositionSolver.solve`.
    RobotError, SettingsError
        See there.

    """
    goals = _lists(goals)
    count = len(next(iter(goals.values())))
    options_of({name: value for name, value in options.items() if name != 'passive'})
    if not count:
        PositionSolver(robot, stack).check_names(goals)
    try:
        starts = None if start is None else np.asarray(start, dtype=float)
    except (TypeError, ValueError) as error:
        raise RobotError(f'start needs configurations: {error}') from error
    if starts is not None and starts.ndim == 2 and len(starts) != count:
        raise RobotError(f'start needs one configuration, or {count}, got {len(starts)}')
    if not isinstance(jobs, (int, np.integer)) or isinstance(jobs, bool) or jobs == 0 or jobs < -1:
        raise SettingsError([f'jobs must be a whole number from 1, or -1, not {jobs!r}'])
    threads = len(os.sched_getaffinity(0)) if jobs == -1 else jobs
    chunks = list(_chunks(count, threads))
    # Each thread takes the next one; a solver takes as long to make as several goals.
    left, found = iter(chunks), dict[range, list[PositionSolution]]()

    def work() -> None:
        solver = PositionSolver(robot, stack)
        for chunk in left:
            found[chunk] = _solve(solver, goals, starts, chunk, options)

    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(work) for _ in range(min(threads, len(chunks)))]:
            done.result()
    return [each for chunk in chunks for each in found[chunk]]


def _chunks(count: int, threads: int) -> Iterator[range]:
    """Yield the numbers of the goals of each call."""
    first = 0
    while first < count:
        size = int(np.clip(SHARE * (count - first) / threads, 1, MOST_GOALS_OF_A_CALL))
        yield range(first, min(first + size, count))
        first += size


def _solve(solver: PositionSolver, goals: Mapping[str, Sequence[Goal]], starts: Array | None,
           chunk: range, options: dict[str, Any]) -> list[PositionSolution]:
    """Return the results for some of the goals."""
    first = chunk.start

    def started(index: int | slice) -> Array | None:
        return starts if starts is None or starts.ndim < 2 else starts[index]

    checked = options_of({name: value for name, value in options.items() if name != 'passive'})
    found: list[PositionSolution | None] = [None] * len(chunk)
    if checked.criterion == 'nearest':
        with suppress(GoalError):
            found = solver.solve_together(
                {name: given[first:chunk.stop] for name, given in goals.items()},
                started(slice(first, chunk.stop)), checked, options.get('passive'))
    return [each or _solve_row(solver, goals, started(index), index, options)
            for index, each in zip(chunk, found)]


def _solve_row(solver: PositionSolver, goals: Mapping[str, Sequence[Goal]], start: Array | None,
               index: int, options: dict[str, Any]) -> PositionSolution:
    """Return the result for one of the goals; a `GoalError` has its number."""
    try:
        return solver.solve({name: given[index] for name, given in goals.items()}, start,
                            **options)
    except GoalError as error:
        for name, given in goals.items():
            if solver.is_goal(name, given):
                shape = np.shape(given)
                raise GoalError(
                    f'the goals of task {name!r} need a list or array with one goal for each '
                    f'result, such as one of shape (N, {", ".join(map(str, shape))}), not a '
                    f'single goal of shape {shape}') from error
        raise GoalOfManyError(index, error) from error


def _lists(goals: Mapping[str, Sequence[Goal]]) -> dict[str, Sequence[Goal]]:
    """Return the goals of each task, as many for all tasks, or raise `GoalError`."""
    if not isinstance(goals, Mapping):
        raise GoalError(f'goals need a mapping of tasks to sequences of goals, such as '
                        f'{{"tool": poses}}, not {goals!r}')
    found = dict[str, Any]()
    for name, given in goals.items():
        if isinstance(given, (Mapping, str)) or not isinstance(given, Iterable) \
                or isinstance(given, np.ndarray) and given.ndim == 0:
            raise GoalError(f'the goals of task {name!r} need a sequence, not {given!r}')
        found[name] = given if isinstance(given, np.ndarray) else list(given)
    if len({len(given) for given in found.values()}) != 1:
        raise GoalError('goals needs one number of goals for all tasks, got '
                        + (', '.join(f'{name}: {len(given)}' for name, given in found.items())
                           or 'no task'))
    return found
