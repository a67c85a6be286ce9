# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inverse kinematics of a stack, in one call."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from threading import Lock
import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import GoalError, RobotError, unknown
from tp_controller.model.robot import check_robot, Robot
from tp_controller.model.spatial import Array
from tp_controller.positions.choice import CRITERIA, has_whole_turns, unwound
from tp_controller.positions.compiled import Searches
from tp_controller.positions.locked_robot import with_locks
from tp_controller.positions.options import SearchOptions
from tp_controller.positions.position_stack import PositionStack
from tp_controller.positions.random_postures import random_postures
from tp_controller.positions.search import Attempts, is_better
from tp_controller.positions.solution import GOAL_TOLERANCE, PositionSolution
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.stack import check_type, Stack
from tp_controller.tasks.task import Task
from tp_controller.tasks.task_errors import accept, attempt

# Configurations of which the nearest is chosen if the first descent finds none.
NEAREST_OF = 3


class PositionSolver:
    """
    Inverse kinematics of a stack: configurations at which its goals are reached.

    Every level has the least error that the levels above it allow, within the position limits.
    The stack is not changed, and a controller may be using it. Calls from several threads wait for
    each other; give each thread a solver of its own.

    Parameters
    ----------
    robot : Robot
    stack : Stack
        Tasks, the highest priority first. Gains are ignored. Tasks that demand or limit a
        velocity are left out, and so are disabled ones.
    locked : collection of str
        Joints, or velocities of a moving base, that stay where they are; see `Controller.lock`.
    at : array_like (nq,), optional
        Configuration at which they are locked; `Robot.neutral` by default.

    Raises
    ------
    StackError
        `stack` is not a `Stack`.
    RobotError
        A locked joint is unknown, or `at` is no configuration.

    """

    def __init__(self, robot: Robot, stack: Stack, locked: Collection[str] = (),
                 at: ArrayLike | None = None) -> None:
        robot = with_locks(check_robot(robot), locked, robot.neutral() if at is None else at)
        self._robot, self._tasks = robot, PositionStack(robot, check_type(stack))
        self._searches = Searches(robot, self._tasks)
        self._passive, self._turns = robot.passive_neutral, has_whole_turns(robot)
        self._own_goals = {
            task.name: None if task.has_default_goal else task.goal
            for task in self._tasks.stack.active_tasks}
        # Random postures, and what they were drawn for.
        self._drawn: tuple[float, ...] = ()
        self._postures = np.empty((0, robot.nq))
        # Names of the tasks with goals of the present call, and number of levels with them.
        self._named: set[str] = set()
        self._needed = 0
        self._lock = Lock()

    def __reduce__(self) -> tuple[type['PositionSolver'], tuple[Robot, Stack], dict[str, Array]]:
        """Return class, arguments and state of a copy, in this process or another."""
        with self._lock:
            for task in self._tasks.stack.active_tasks:
                self._restore(task)
            return type(self), (self._robot, self._tasks.stack), {'_passive': self._passive}

    def solve(self, goals: Mapping[str, Goal] | None = None, start: ArrayLike | None = None, *,
              attempts: int = 40, timeout: float = 0.05, seed: int = 0,
              criterion: str = 'nearest', passive: ArrayLike | None = None) -> PositionSolution:
        """
        Return a configuration at which goals are reached, or the best one that was found.

        A descent leads from `start` to where the errors are least. Until the goals are reached,
        others follow from random postures.

        Parameters
        ----------
        goals : dict, optional
            {task: goal}, as `Controller.set_goal` takes them, in the reference frame of the task;
            by default the goals in the stack. A task without a goal keeps its value at `start`.
        start : array_like (nq,), optional
            Configuration [rad or m], moved within the position limits; `Robot.neutral` by default.
        attempts : int
            Largest number of descents, 1 to 10,000.
        timeout : float
            Time after which the best configuration so far is returned [s].
        seed : int
            Seed of the random postures: calls with equal arguments have equal results unless the
            timeout ends them.
        criterion : str
            Choice among configurations that reach the goals. ``nearest``: the one that `start`
            leads to; if there is none, the nearest of three. ``manipulability`` and ``limits``:
            of all attempts the one with the largest manipulability of the first level with a
            goal, or the one that is farthest from position limits.
        passive : array_like (p,), optional
            Positions of the passive joints [rad or m]; those of the last call by default, at
            first zero, or as near to it as their limits allow.

        Returns
        -------
        PositionSolution

        Raises
        ------
        GoalError
            A task is unknown or has no position, or its goal is not valid.
        RobotError
            `start` or `passive` has the wrong shape or is not finite.
        SettingsError
            Another argument is out of range.
        EvaluationError
            A task fails.

        """
        options = SearchOptions(attempts, timeout, seed, criterion)
        with self._lock:
            end = time.perf_counter() + timeout
            begin = self._begin(goals, start, passive)
            found = self._chosen(self._search(begin, options, end), begin, criterion, end)
            return PositionSolution(self._robot, self._tasks.stack, self._goals(), found.q,
                                    found.descents, self._is_reached(found), self._passive)

    def solve_together(self, goals: Mapping[str, Sequence[Goal]], starts: Array | None,
                       options: SearchOptions, passive: ArrayLike | None = None
                       ) -> list[PositionSolution | None]:
        """
        Return the results of `solve` for many goals with the criterion ``nearest``.

        All are found in one call of the core, which other threads need not wait for. They are
        None where the core cannot do that.

        Parameters
        ----------
        goals : dict
            {task: goals}, the same number for all tasks.
        starts : ndarray (nq,) or (count, nq), or None
            Configuration for all, or for each [rad or m].
        options : SearchOptions
            Options of `solve`.
        passive : array_like (p,), optional
            See `solve`.

        """
        with self._lock:
            return self._solve_together(goals, starts, options, passive)

    def _solve_together(self, goals: Mapping[str, Sequence[Goal]], starts: Array | None,
                        options: SearchOptions, passive: ArrayLike | None
                        ) -> list[PositionSolution | None]:
        """Return the results of `solve` for many goals, or None; see `solve_together`."""
        none: list[PositionSolution | None] = [None] * len(next(iter(goals.values())))
        each_its_own = starts is not None and starts.ndim == 2
        begin = self._begin({name: given[0] for name, given in goals.items()},
                            starts[0] if starts is not None and each_its_own else starts, passive)
        if each_its_own and (self._named != self._tasks.stack.tasks.keys() or self._robot.moves):
            # Other tasks keep their values at the start, and random postures are around it.
            return none
        parsed = {name: accept(task := self._tasks.stack.tasks[name], task.parse_goals, given)
                  for name, given in goals.items()}
        if not all(isinstance(goal, np.ndarray) for given in parsed.values() for goal in given):
            return none
        begins = begin[np.newaxis]
        if starts is not None and each_its_own:
            begins = np.array([self._tasks.within_limits(each) for each in starts])
        found = self._searches.find_each(
            {name: np.array(given) for name, given in parsed.items()}, begins,
            self._random_postures(begin, options), self._needed, NEAREST_OF, options.timeout)
        if found is None:
            return none
        kept, stack = self._goals(), self._tasks.stack
        return [PositionSolution(
            self._robot, stack, kept | {name: given[index] for name, given in parsed.items()}, q,
            descents, error <= GOAL_TOLERANCE, self._passive) if descents else None
            for index, (q, descents, error) in enumerate(found)]

    def check_names(self, names: Iterable[str]) -> None:
        """Raise `GoalError` unless all are names of tasks with a position."""
        tasks = self._tasks.stack.tasks
        for name in names:
            if name not in tasks:
                raise GoalError(unknown('task with a position', name, tasks))

    def is_goal(self, name: str, goal: Goal) -> bool:
        """Return whether a task takes a goal."""
        try:
            self._parsed(name, goal)
        except GoalError:
            return False
        return True

    def _begin(self, goals: Mapping[str, Goal] | None, start: ArrayLike | None,
               passive: ArrayLike | None) -> Array:
        """Set the goals and passive positions, and return the start (nq,), within the limits."""
        if goals is not None and not isinstance(goals, Mapping):
            raise GoalError(f'goals needs a mapping, such as {{"tool": pose}}, not {goals!r}')
        robot = self._robot
        if passive is not None and not robot.passive_names and np.size(passive):
            raise RobotError('passive needs no positions: the robot has no passive joints')
        passive = self._passive if passive is None else np.array(passive, dtype=float)
        state = self._tasks.place(robot.neutral() if start is None else start, passive)
        state = self._tasks.place(self._tasks.within_limits(state.q), passive)
        self._passive = passive
        stack = self._tasks.stack
        for task in stack.active_tasks:
            self._restore(task)
        for name, goal in (goals or {}).items():
            parsed = self._parsed(name, goal)
            accept(stack.tasks[name], stack.tasks[name].set_goal, parsed, 0.0)
        self._named = set(goals or ()) or {
            name for name, goal in self._own_goals.items() if goal is not None}
        self._needed = max((level for level, group in enumerate(self._tasks.groups, 1)
                            if any(task.name in self._named for task in group)), default=0)
        stack.start(state)
        self._searches.begin(passive)
        return np.array(state.q)

    def _restore(self, task: Task) -> None:
        """Restore the goal that a task has in the stack, if a call has changed it."""
        own = self._own_goals[task.name]
        if task.goal is not own:
            attempt(task, task.forget_goal)
            if own is not None:
                attempt(task, task.set_goal, own, 0.0)

    def _parsed(self, name: str, goal: Goal) -> Goal:
        """Return the goal of a task in internal form, or raise `GoalError`."""
        self.check_names([name])
        task = self._tasks.stack.tasks[name]
        return accept(task, task.parse_goal, goal)

    def _search(self, begin: Array, options: SearchOptions, end: float) -> list[Attempts]:
        """Return configurations that meet the needed levels; if there is none, the best one."""
        needed, nearest = self._needed, options.criterion == 'nearest'
        found = self._searches.find(begin[np.newaxis], needed, 1, end)
        best, met = found[0], found if found[0].meets(needed) else []
        if not (met and nearest) and options.attempts > 1 and time.perf_counter() < end:
            others = self._searches.find(
                self._random_postures(begin, options), needed,
                NEAREST_OF if nearest else options.attempts - 1, end)
            count = 1 + others[0].descents
            met = [each._replace(descents=count)
                   for each in met + [each for each in others if each.meets(needed)]]
            if is_better(others[0].costs[:needed], best.costs[:needed]):
                best = others[0]
            best = best._replace(descents=count)
        return met or [self._searches.finish(best, end)]

    def _random_postures(self, begin: Array, options: SearchOptions) -> Array:
        """Return the configurations (attempts − 1, nq) at which later descents start."""
        given = (options.seed, options.attempts, *(begin if self._robot.moves else ()))
        if given != self._drawn:
            self._drawn = given
            self._postures = random_postures(
                self._robot, begin, np.random.default_rng(options.seed), options.attempts - 1)
        return self._postures

    def _chosen(self, found: list[Attempts], begin: Array, criterion: str, end: float
                ) -> Attempts:
        """Return the best of configurations that reach the goals, without whole turns."""
        if self._turns:
            found = [self._unwound(each, begin, end) for each in found]
        return found[0] if len(found) == 1 else min(
            found, key=lambda each: CRITERIA[criterion](self._tasks, each.q, begin))

    def _unwound(self, found: Attempts, begin: Array, end: float) -> Attempts:
        """Return a search without whole turns, finished again where it had any."""
        turned = unwound(self._tasks, found, begin)
        return turned if turned is found else self._searches.finish(turned, end)

    def _goals(self) -> dict[str, Goal]:
        """Return the present goals of all tasks."""
        return {task.name: task.goal for task in self._tasks.stack.active_tasks}

    def _is_reached(self, found: Attempts) -> bool:
        """Return whether the needed levels are met, as far as they have given goals or bounds."""
        if found.meets(self._needed):
            return True
        return all(float(np.abs(each.error).max(initial=0.0)) <= GOAL_TOLERANCE
                   for group in self._tasks.at(found.q).evaluations[:self._needed]
                   for each in group if each.task.bounded or each.task.name in self._named)


def solve_position(robot: Robot, stack: Stack, goals: Mapping[str, Goal] | None = None,
                   start: ArrayLike | None = None, locked: Collection[str] = (), **options: Any
                   ) -> PositionSolution:
    """Return the result of `PositionSolver.solve`, for one set of goals and locks; see there."""
    return PositionSolver(robot, stack, locked, start).solve(goals, start, **options)
