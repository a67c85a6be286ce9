# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Stack of tasks, highest priority first, evaluated to levels every cycle."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from tp_controller.errors import EvaluationError, Fault, StackError
from tp_controller.model.robot import Robot
from tp_controller.model.state import RobotState
from tp_controller.resources import read_source
from tp_controller.solver.level import Level
from tp_controller.tasks.stack_entries import read_entries
from tp_controller.tasks.stack_reader import is_stack, names_of, StackReader
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.task_errors import attempt, check, CheckedEvaluator, is_foreign
from tp_controller.untrusted.calls import foreign

# The tasks of each level.
Groups: TypeAlias = tuple[tuple[Task, ...], ...]
# Largest number of characters shown of an invalid stack.
MOST_SHOWN_CHARACTERS = 100


class Stack:
    """
    Prioritized tasks (lecture 2.1), of which some may share a level (slides (4), (5)).

    Parameters
    ----------
    groups : iterable of iterable of Task, or list
        The tasks of each level, the highest priority first; with a `robot` the list that YAML
        would give, such as ``[{'tool': {'type': 'pose', 'frame': 'tcp'}}]``.
    robot : Robot, optional
        Robot with the joints and frames that the tasks of a list name.
    text : str
        YAML source of the tasks, if any; that of a list is made from it.

    Attributes
    ----------
    tasks : dict
        {name: Task}, in order of priority.
    groups : tuple of tuple of Task
        The tasks of each level, the highest priority first.
    disabled : set of str
        Names of the disabled tasks.
    faults : mapping
        {name: reason} of the disabled tasks that were switched off after a failure.
    active, active_tasks, inactive : tuple
        Enabled tasks by level, enabled tasks in one sequence, and disabled tasks.
    text : str
        YAML source of the stack; empty if it has none.

    Raises
    ------
    StackError
        The groups are not lists of tasks, or a list has faults; all are named.

    """

    def __init__(self, groups: Iterable[Any], robot: Robot | None = None, text: str = '') -> None:
        if robot is not None:
            groups, text = read_entries(groups, robot)
        self.groups: Groups = _checked(groups)
        self.tasks = {task.name: task for group in self.groups for task in group}
        self.disabled: set[str] = set()
        self.faults: Mapping[str, str] = {}
        self._evaluator = CheckedEvaluator()
        self._foreign = any(map(is_foreign, self.tasks.values()))
        self.text = text
        self._arrange()

    @classmethod
    def from_yaml(cls, source: str | Path, robot: Robot) -> 'Stack':
        """
        Return the stack of a YAML list.

        Parameters
        ----------
        source : str or pathlib.Path
            YAML text, a file's path, or ``package://<package>/<path>``.
        robot : Robot
            Robot with the joints and frames that the tasks name.

        Raises
        ------
        StackError
            All faults, each with its line.

        """
        try:
            text = read_source(source, is_stack)
        except (OSError, ValueError) as error:
            raise StackError([Fault(0, '', str(error))]) from error
        return cls(StackReader(robot).read(text), text=text)

    def copy(self) -> 'Stack':
        """
        Return an equal stack, for another controller, or for later use with the same one.

        Raises
        ------
        StackError
            A controller has used tasks of the stack; see `check_owner`.

        """
        self.check_owner(None)
        stack = Stack([[task.probe() for task in group] for group in self.groups],
                      text=self.text)
        stack.disabled = set(self.disabled)
        stack._arrange()
        return stack

    def check_owner(self, owner: object) -> None:
        """
        Check whether a controller may use the tasks, which remember goals, gains and cycles.

        Parameters
        ----------
        owner : object
            Mark of the controller; tasks with this mark, or without one, may be used.

        Raises
        ------
        StackError
            Tasks belong to another controller, or to a replaced stack.

        """
        used = [task for task in self.tasks.values() if task.owner not in (None, owner)]
        if used:
            raise StackError([Fault(0, '', f'a controller has used {names_of(used)} already, and '
                                           'goals of then would stay in force: read the stack '
                                           'again, or copy() it before it is used')])

    def set_owner(self, owner: object) -> None:
        """Set the mark of a controller on the tasks; see `check_owner`."""
        for task in self.tasks.values():
            task.owner = owner

    def enable(self, name: str, enabled: bool) -> None:
        """Enable or disable a task."""
        (self.disabled.discard if enabled else self.disabled.add)(name)
        self.faults = {other: reason for other, reason in self.faults.items() if other != name}
        self._arrange()

    def switch_off(self, name: str, reason: str) -> None:
        """Disable a failed task, until it is enabled again."""
        self.enable(name, False)
        self.faults = {**self.faults, name: reason}

    def limit_time(self, budget: float) -> None:
        """Set the time budget for the evaluation of a task of another package [s]."""
        self._evaluator.budget = budget

    def inherit_goals(self, other: 'Stack') -> None:
        """
        Inherit the goals of tasks of the same name and kind from another stack.

        Tasks that were switched off after a failure are enabled again.
        """
        for name, task in self.tasks.items():
            if name in other.tasks:
                attempt(task, task.inherit_goal, other.tasks[name])
        self.disabled = (other.disabled - other.faults.keys()) & set(self.tasks)
        self._arrange()

    def start(self, state: RobotState) -> None:
        """Set the value at a `RobotState` as the default goal of every task without a goal."""
        for name, task in self.tasks.items():
            if name not in self.faults:
                attempt(task, task.start, state)

    def reset(self) -> None:
        """Drop the default goals of all tasks."""
        _attempt_all((task, task.reset) for task in self.tasks.values())

    def forget_goals(self) -> None:
        """Drop the goals of all tasks; the next start sets new default goals."""
        _attempt_all((task, task.forget_goal) for task in self.tasks.values())

    def evaluate(self, state: RobotState, now: float) -> list[list[Evaluation]]:
        """
        Return new evaluations of the active tasks at a state.

        Parameters
        ----------
        state : RobotState
            State of the robot.
        now : float
            Time [s].

        Returns
        -------
        list of list of Evaluation
            Evaluations of each group of `active`.

        Raises
        ------
        EvaluationError
            A task fails.

        """
        return [self.evaluate_tasks(group, state, now) for group in self.active]

    def evaluate_tasks(self, tasks: Sequence[Task], state: RobotState, now: float
                       ) -> list[Evaluation]:
        """Return new evaluations of some tasks; see `evaluate`."""
        if not self._foreign:
            try:
                with foreign:
                    return [task.evaluate(state, now) for task in tasks]
            except Exception:
                # The evaluation below identifies the task.
                pass
        return [self._evaluator.evaluate(task, state, now) for task in tasks]

    def check(self, evaluations: Sequence[Sequence[Evaluation]], n: int) -> None:
        """Raise `EvaluationError` if a task of any package returned an invalid evaluation."""
        for group in evaluations:
            for evaluation in group:
                check(evaluation.task, evaluation, n)

    def levels(self, state: RobotState, now: float) -> list[Level]:
        """Return the `Level` of each group of `active` at a state."""
        return levels_of(self.evaluate(state, now))

    def _arrange(self) -> None:
        """Sort the tasks into `active`, by level, and `inactive`."""
        enabled = (tuple(task for task in group if task.name not in self.disabled)
                   for group in self.groups)
        self.active = tuple(group for group in enabled if group)
        self.active_tasks = tuple(task for group in self.active for task in group)
        self.inactive = tuple(task for name, task in self.tasks.items() if name in self.disabled)


def check_type(stack: object) -> Stack:
    """Return `stack`, or raise `StackError` if it is not a `Stack`."""
    if isinstance(stack, Stack):
        return stack
    raise StackError([Fault(0, '', 'needs a Stack, such as Stack.from_yaml(text, robot), got '
                                   f'{type(stack).__name__}')])


def _checked(groups: Iterable[Iterable[Task]]) -> Groups:
    """Return the tasks of each level, or raise `StackError` for other objects."""
    try:
        found = tuple(tuple(group) for group in groups)
        if all(isinstance(task, Task) for group in found for task in group):
            return found
    except TypeError:
        # Not a list of lists.
        pass
    raise StackError([Fault(0, '', 'a stack is made of levels, each a list of tasks, such as '
                                   '[[tool], [posture]]; a list of mappings is read by '
                                   'Stack(list, robot), YAML by Stack.from_yaml(text, robot); '
                                   f'got {repr(groups)[:MOST_SHOWN_CHARACTERS]}')])


def levels_of(evaluations: Sequence[Sequence[Evaluation]]) -> list[Level]:
    """Return a level for each group of evaluations; see `Stack.evaluate`."""
    return [group[0].level if len(group) == 1 else _joined([each.level for each in group])
            for group in evaluations]


def shared_levels(before: Groups, after: Groups) -> int:
    """Return the number of upper levels that two stacks share, now and later."""
    count = 0
    for old, new in zip(before, after):
        if len(old) != len(new) or not all(map(_is_equivalent, new, old)):
            break
        count += 1
    return count


def _is_equivalent(one: Task, other: Task) -> bool:
    """Return whether two tasks have the same demand; False if the comparison fails."""
    try:
        with foreign:
            return bool(one.is_equivalent(other))
    except Exception:
        return False


def _joined(levels: Sequence[Level]) -> Level:
    """Return one level with the rows of several, either all with bounds or none."""
    J, weights = np.concatenate([level.J for level in levels]), None
    if any(level.weights is not None for level in levels):
        weights = np.concatenate([np.ones(len(level.J)) if level.weights is None
                                  else level.weights for level in levels])
    if levels[0].v is None:
        return Level(J, lower=np.concatenate([level.lower for level in levels]),
                     upper=np.concatenate([level.upper for level in levels]),
                     joints=levels[0].joints, weights=weights)
    return Level(J, np.concatenate([level.v for level in levels]), levels[0].mode,
                 joints=levels[0].joints, weights=weights)


def _attempt_all(calls: Iterable[tuple[Task, Callable[[], None]]]) -> None:
    """Call all methods, and raise the last failure."""
    failed = None
    for task, call in calls:
        try:
            attempt(task, call)
        except EvaluationError as error:
            failed = error
    if failed:
        raise failed
