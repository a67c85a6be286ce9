# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Searches of one stack, in the compiled core (search.h) for tasks that have twins."""

from collections.abc import Mapping, Sequence
import time
from typing import Protocol, TypeAlias

import numpy as np
from tp_controller.control.compiled_step import has_twin
from tp_controller.model.compiled import Motion
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, read_only
from tp_controller.positions.choice import turning
from tp_controller.positions.descent import Descent
from tp_controller.positions.position_stack import PositionStack
from tp_controller.positions.search import Attempts, finish, nudges, search
from tp_controller.solver.compiled import core
from tp_controller.tasks.twin import CompiledTask, Twin, Watch

# Level, index in it, and goals (count, size) of tasks.
GoalRows: TypeAlias = tuple[tuple[int, int, Array], ...]


class CompiledSearch(Protocol):
    """Search in the compiled core, whose memory is used again in every call."""

    def set_tasks(self, motion: Motion, tasks: tuple[tuple[CompiledTask, ...], ...]) -> None:
        """Set the tasks of each level of a robot; raise ValueError if they do not fit."""

    def find(self, starts: Array, needed: int, seconds: float, q: Array, costs: Array
             ) -> tuple[int, int] | None:
        """
        Fill in configurations and their costs; see `tp_controller.positions.search`.

        Parameters
        ----------
        starts : ndarray (count, nq)
            Configuration at which each descent starts.
        needed : int
            Number of levels that have to be met.
        seconds : float
            Time after which the search ends [s].
        q, costs : ndarray (wanted, nq), (wanted, levels)
            Filled in.

        Returns
        -------
        tuple of (int, int) or None
            Number of configurations and of descents; None if the reference is needed.

        """

    def find_each(self, goals: GoalRows, starts: Array, others: Array, needed: int, wanted: int,
                  seconds: float, q: Array, numbers: Array) -> bool:
        """
        Fill in the nearest configuration of a search for each of many goals.

        Parameters
        ----------
        goals : tuple of (int, int, ndarray (count, size))
            Level and index in it of each task with goals, and their numbers.
        starts : ndarray (1 or count, nq)
            Configuration at which the first descent of each starts.
        others : ndarray (number, nq)
            Configurations from which others follow until the needed levels are met.
        needed, seconds
            See `find`; the time is that of each search.
        wanted : int
            Number of configurations of which the nearest is chosen.
        q : ndarray (count, nq)
            Filled in.
        numbers : ndarray (count, 2)
            Number of descents, 0 where the reference is needed, and largest error of the needed
            levels that goals and bounds have [m or rad], 0 where they are met; filled in.

        Returns
        -------
        bool
            False if the reference is needed for all.

        """

    def finish(self, seconds: float, q: Array, costs: Array) -> bool:
        """Replace q (nq,) as `Descent.finish` does; return False if the reference is needed."""


class Searches:
    """
    Searches of one stack, compiled where that is possible.

    Parameters
    ----------
    robot : Robot
    tasks : PositionStack

    """

    def __init__(self, robot: Robot, tasks: PositionStack) -> None:
        self._robot, self._tasks = robot, tasks
        self._end = 0.0
        self._descent = Descent(tasks, robot, lambda: time.perf_counter() > self._end)
        motion = robot.kinematics.motion()
        self._compiled = None
        if core is not None and motion is not None and tasks.groups \
                and all(map(has_twin, tasks.stack.active_tasks)):
            self._compiled = _CompiledTasks(robot, tasks, core.Search(
                robot.lower, robot.upper, turning(robot), nudges(robot)), motion)

    def begin(self, passive: Array) -> None:
        """Begin with the present inputs of the tasks and passive positions (p,)."""
        if self._compiled is not None:
            self._compiled.refresh(passive)

    def find(self, starts: Array, needed: int, wanted: int, end: float) -> list[Attempts]:
        """
        Return the outcome of `search`.

        Parameters
        ----------
        starts : ndarray (count, nq)
            Configuration at which each descent starts [rad or m].
        needed : int
            Number of levels that have to be met.
        wanted : int
            Number of configurations that end the search.
        end : float
            Time of ``time.perf_counter`` at which the search ends [s].

        """
        if self._compiled is not None and self._compiled.fit:
            q, costs = self._outputs(wanted)
            found = self._compiled.search.find(starts, needed, end - time.perf_counter(), q,
                                               costs)
            if found is not None:
                count, descents = found
                return [Attempts(each, its_costs, descents)
                        for each, its_costs in zip(q[:count], costs[:count].tolist())]
        self._end = end
        return search(self._tasks, self._descent, needed, starts, wanted)

    def find_each(self, goals: Mapping[str, Array], starts: Array, others: Array, needed: int,
                  wanted: int, seconds: float) -> list[tuple[Array, int, float]] | None:
        """
        Return the outcome of a search for each of many goals; None without a core.

        Each is the configuration that is nearest to the start, the number of descents, 0 where
        `find` is needed, and the largest error of the needed levels that goals and bounds have
        [m or rad], 0 where they are met.

        Parameters
        ----------
        goals : dict
            {task: goals (count, …)}.
        starts : ndarray (1 or count, nq)
            Configuration at which the first descent of each starts [rad or m].
        others : ndarray (number, nq)
            Configurations from which others follow until the needed levels are met [rad or m].
        needed, wanted
            See `find`.
        seconds : float
            Longest time of each search [s].

        """
        if self._compiled is None or not self._compiled.fit:
            return None
        rows = tuple([(level, index, given.reshape(len(given), -1))
                      for level, group in enumerate(self._tasks.groups)
                      for index, task in enumerate(group)
                      if (given := goals.get(task.name)) is not None])
        count = len(rows[0][2])
        q, numbers = np.empty((count, self._robot.nq)), np.empty((count, 2))
        if not self._compiled.search.find_each(rows, starts, others, needed, wanted, seconds, q,
                                               numbers):
            return None
        descents, errors = numbers.T
        return list(zip(read_only(q), descents.astype(int).tolist(), errors.tolist()))

    def finish(self, found: Attempts, end: float) -> Attempts:
        """Return a search whose configuration also reduces the levels that were not needed."""
        if self._compiled is not None and self._compiled.fit:
            q, costs = found.q.copy(), np.empty(len(found.costs))
            if self._compiled.search.finish(end - time.perf_counter(), q, costs):
                return Attempts(q, costs.tolist(), found.descents)
        self._end = end
        point = finish(self._tasks, self._descent, self._tasks.at(found.q))
        return Attempts(point.q, point.costs, found.descents)

    def _outputs(self, count: int) -> tuple[Array, Array]:
        """Return arrays for configurations (count, nq) and the costs of their levels."""
        return np.empty((count, self._robot.nq)), np.empty((count, len(self._tasks.groups)))


class _CompiledTasks:
    """Tasks of a stack in a search of the core; `fit`: whether all of them have twins now."""

    def __init__(self, robot: Robot, tasks: PositionStack, search: CompiledSearch,
                 motion: Motion) -> None:
        self.search, self.fit = search, False
        self._robot, self._tasks, self._motion = robot, tasks, motion
        self._watch = Watch()
        for task in tasks.stack.active_tasks:
            task.watch(self._watch)
        self._place(robot.passive_neutral)

    def _place(self, passive: Array) -> None:
        """Set the passive positions (p,), which no search changes."""
        kinematics, q = self._robot.kinematics, self._robot.neutral()
        self._passive = passive
        self._motion.move(q, kinematics.offset_at(passive),
                          kinematics.base.placement(q) if self._robot.moves else None)

    def refresh(self, passive: Array) -> None:
        """Read inputs of tasks that have changed, and set the passive positions (p,)."""
        if not np.array_equal(passive, self._passive):
            self._place(passive)
        if self._watch.changed:
            self._watch.changed = False
            twins = [[task.twin for task in group] for group in self._tasks.groups]
            self.fit = not any(None in group for group in twins)
            if self.fit:
                self.search.set_tasks(self._motion, _tasks_of(twins))


def _tasks_of(twins: Sequence[Sequence[Twin | None]]) -> tuple[tuple[CompiledTask, ...], ...]:
    """Return the compiled tasks of twins."""
    return tuple([tuple([twin.task for twin in group if twin is not None]) for group in twins])
