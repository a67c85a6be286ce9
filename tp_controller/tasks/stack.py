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

"""Stack of tasks: a YAML list, highest priority first, evaluated to levels every cycle."""

from collections.abc import Callable, Iterable, Mapping, Sequence
import inspect
from pathlib import Path
import re
import time
from typing import Any, TypeAlias

import numpy as np
from tp_controller.errors import (
    EvaluationError,
    Fault,
    in_words,
    StackError,
    suggestion,
    TaskError,
    unknown,
)
from tp_controller.foreign import foreign
from tp_controller.model.robot import Robot
from tp_controller.model.state import RobotState
from tp_controller.resources import read_source, YamlLoader
from tp_controller.solver.level import Level
from tp_controller.tasks import task_types
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.task_errors import attempt, check, CheckedEvaluator, is_foreign
import yaml

# Valid names of tasks; they become parts of topic names.
NAME_PATTERN = re.compile(r'[A-Za-z][A-Za-z0-9_]{0,63}\Z')
# The tasks of each level.
Groups: TypeAlias = tuple[tuple[Task, ...], ...]
# Attributes that the constructor of `Task` sets.
CONSTRUCTED = ('name', 'units', 'gain', 'groups', 'mode', 'goal')
# Largest number of tasks; no robot can execute more in time.
MOST_TASKS = 100
# Time limit for reading the tasks [s]: only `self_collision` of robots with hundreds of shapes
# takes more than a second, and types of other packages may take any time.
READ_SECONDS = 10.0
# Largest number of characters shown of an invalid stack.
MOST_SHOWN_CHARACTERS = 100
LIST_FORM = 'a stack must be a list of "- name: {type: …}", the highest priority first'


class Stack:
    """
    Prioritized tasks.

    Parameters
    ----------
    groups : iterable of iterable of Task
        The tasks of each level, the highest priority first; `from_yaml` reads them.
    text : str
        YAML source of the tasks, if any.

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
        The groups are not lists of tasks.

    """

    def __init__(self, groups: Iterable[Iterable[Task]], text: str = '') -> None:
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
        return cls(_Reader(robot).read(text), text)

    def copy(self) -> 'Stack':
        """
        Return an equal stack, for another controller, or for later use with the same one.

        Raises
        ------
        StackError
            A controller has used tasks of the stack; see `check_owner`.

        """
        self.check_owner(None)
        stack = Stack([[task.probe() for task in group] for group in self.groups], self.text)
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
            raise StackError([Fault(0, '', f'a controller has used {_names(used)} already, and '
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
        if not self._foreign:
            try:
                with foreign:
                    return [[task.evaluate(state, now) for task in group]
                            for group in self.active]
            except Exception:
                # The evaluation below identifies the task.
                pass
        return [[self._evaluator.evaluate(task, state, now) for task in group]
                for group in self.active]

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
                                   '[[tool], [posture]]; YAML is read by Stack.from_yaml(text, '
                                   f'robot); got {repr(groups)[:MOST_SHOWN_CHARACTERS]}')])


def is_stack(text: str) -> bool:
    """Return whether a text is a stack rather than the name of a file."""
    return text.startswith('- ') or any(mark in text for mark in '\n[{')


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
    J = np.concatenate([level.J for level in levels])
    if levels[0].v is None:
        return Level(J, lower=np.concatenate([level.lower for level in levels]),
                     upper=np.concatenate([level.upper for level in levels]))
    return Level(J, np.concatenate([level.v for level in levels]), levels[0].mode)


class _Reader:
    """Reader of a YAML list into groups of tasks, which collects all faults."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._types = task_types()
        self._faults: list[Fault] = []
        self._lines_of_names: dict[str, int] = {}
        # Line of the fault that lists the valid types; the list is long. 0: not listed yet.
        self._types_listed = 0
        # Inequality tasks read so far.
        self._bounded: list[Task] = []
        # Number of entries read, and time at which reading ends [s].
        self._entries, self._deadline = 0, time.monotonic() + READ_SECONDS

    def read(self, text: str) -> list[list[Task]]:
        """Return the groups of tasks."""
        try:
            root = yaml.compose(text, Loader=YamlLoader)
        except yaml.YAMLError as error:
            mark = getattr(error, 'problem_mark', None)
            line = mark.line + 1 if mark else 1
            raise StackError([Fault(line, '', f'not valid YAML: {_first_line(error)}')]) from error
        if not isinstance(root, yaml.SequenceNode):
            self._fault(root, '', LIST_FORM)
            groups = []
        else:
            groups = [self._group(node) for node in root.value]
        if self._faults:
            raise StackError(self._faults)
        return groups

    def _group(self, node: yaml.Node) -> list[Task]:
        """Return the tasks of one entry, which may be a list of tasks of one level."""
        entries = node.value if isinstance(node, yaml.SequenceNode) else [node]
        if not entries:
            self._fault(node, '', 'a level needs at least one task')
        tasks = [self._task(entry) for entry in entries]
        # A fault refuses the stack anyway.
        read = [task for task in tasks if task is not None]
        bounded = [task for task in read if task.bounded]
        modes = {task.mode for task in read}
        if 0 < len(bounded) < len(read):
            others = _names(task for task in read if not task.bounded)
            self._fault(node, '', f'inequality tasks ({_names(bounded)}) and other tasks '
                                  f'({others}) cannot share a level')
        elif len(modes) > 1:
            self._fault(node, '', f'tasks that share a level need the same mode, not '
                                  f'{" and ".join(sorted(modes))}')
        if self._bounded and 'scale' in modes:
            self._fault(node, '', f'mode scale would stop in front of the bounds of '
                                  f'{_names(self._bounded)} above instead of sliding along '
                                  'them; use least_squares')
        self._bounded.extend(bounded)
        return read

    def _task(self, node: yaml.Node) -> Task | None:
        """Return the task of one entry, or record faults and return None."""
        self._check_effort(node)
        if not isinstance(node, yaml.MappingNode) or len(node.value) != 1:
            self._fault(node, '', LIST_FORM)
            return None
        (key, body), = node.value
        name = key.value
        self._check_name(key, name)
        if not isinstance(body, yaml.MappingNode):
            self._fault(body, str(name), 'needs a mapping such as {type: pose, frame: …}')
            return None
        values, lines = self._values(body, name)
        kind = values.pop('type', None)
        if 'type' not in lines:
            self._fault(key, name, f'needs a type{self._valid_types(key.start_mark.line + 1)}')
        elif not isinstance(kind, str) or kind not in self._types:
            self._faults.append(Fault(
                lines['type'], str(name), f'unknown type {suggestion(kind, self._types)}'
                                          f'{self._valid_types(lines["type"])}'))
        else:
            return self._build(self._types[kind], name, key, values, lines)
        return None

    def _check_effort(self, node: yaml.Node) -> None:
        """Raise `StackError` if there are too many tasks, or reading them takes too long."""
        self._entries += 1
        if self._entries > MOST_TASKS:
            self._fault(node, '', f'more than {MOST_TASKS} tasks')
        elif time.monotonic() > self._deadline:
            self._fault(node, '', f'the tasks above took more than {READ_SECONDS:g} s to read')
        else:
            return
        raise StackError(self._faults)

    def _valid_types(self, line: int) -> str:
        """Return the valid types as the end of a message; the full list only once."""
        if self._types_listed:
            return f'; valid types: see line {self._types_listed}'
        self._types_listed = line
        return f'; valid: {", ".join(sorted(self._types))}'

    def _check_name(self, key: yaml.Node, name: object) -> None:
        """Record a fault if the name of a task is invalid or not unique."""
        if not isinstance(name, str) or not NAME_PATTERN.match(name):
            shown = repr(name[:80]) if isinstance(name, str) else 'a list or mapping'
            self._fault(key, '', 'the name of a task must be a letter, then letters, digits or _, '
                                 f'at most 64 in all, not {shown}')
        elif name in self._lines_of_names:
            self._fault(key, name, 'the name is used already, in line '
                                   f'{self._lines_of_names[name]}')
        else:
            self._lines_of_names[name] = key.start_mark.line + 1

    def _values(self, body: yaml.MappingNode,
                name: object) -> tuple[dict[str, Any], dict[str, int]]:
        """Return {key: value} and {key: line} of a mapping."""
        values: dict[str, Any] = {}
        lines: dict[str, int] = {}
        constructor = yaml.constructor.SafeConstructor()
        for key, value in body.value:
            if not isinstance(key, yaml.ScalarNode) or key.value == '<<':
                self._fault(key, str(name), 'a key must be a word; merging (<<) is not supported')
                continue
            if key.value in lines:
                self._fault(key, f'{name}, {key.value}', 'the key is given twice')
            lines[key.value] = value.start_mark.line + 1
            try:
                built = constructor.construct_object(value, deep=True)
                # Messages show values; repr fails for a number of thousands of digits.
                repr(built)
                values[key.value] = built
            except (yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError,
                    ArithmeticError) as error:
                # PyYAML does not wrap the errors of invalid dates and numbers.
                self._fault(value, f'{name}, {key.value}', _first_line(error))
        return values, lines

    def _build(self, task_type: type[Task], name: str, key: yaml.Node, values: dict[str, Any],
               lines: dict[str, int]) -> Task | None:
        """Return a task of a type, or record the faults of its keys and return None."""
        missing: list[str] = []
        try:
            with foreign:
                accepted, described = task_type.accepted_keys(), task_type.described_keys()
                missing = self._check_keys(name, key, accepted, described, values, lines)
                # Missing keys are passed as None, so that faults of other keys are found too.
                make: Callable[..., Task] = task_type
                task = make(self._robot, name, **dict.fromkeys(missing), **values)
                if all(hasattr(task, attribute) for attribute in CONSTRUCTED):
                    return task
            self._fault(key, name, f'type {task_type.type_name}: its constructor must call that '
                                   'of Task')
        except TaskError as error:
            own_line = key.start_mark.line + 1
            self._faults.extend(
                Fault(lines.get(fault_key, own_line), f'{name}, {fault_key}', message)
                for fault_key, message in error.faults if fault_key not in missing)
        except Exception as error:
            # A type of another package may raise any exception.
            self._fault(key, name, f'type {task_type.type_name}: {in_words(error)}')
        return None

    def _check_keys(self, name: str, key: yaml.Node, accepted: Mapping[str, Any],
                    described: Mapping[str, str], values: dict[str, Any],
                    lines: Mapping[str, int]) -> list[str]:
        """Remove keys that the type does not accept, and return the missing ones."""
        for other in set(values) - set(accepted):
            self._faults.append(Fault(lines[other], name,
                                      unknown('key', other, ['type', *accepted])))
            del values[other]
        # Keys with an unreadable value have a fault already.
        missing = [needed for needed, default in accepted.items()
                   if default is inspect.Parameter.empty and needed not in values]
        for needed in missing:
            if needed not in lines:
                self._fault(key, name, f'needs the key {needed!r}: {described[needed]}')
        return missing

    def _fault(self, node: yaml.Node | None, where: str, message: str) -> None:
        """Record a fault at the line of a YAML node."""
        line = node.start_mark.line + 1 if node is not None else 1
        self._faults.append(Fault(line, where, message))


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


def _names(tasks: Iterable[Task]) -> str:
    """Return the names of tasks, separated by commas."""
    return ', '.join(task.name for task in tasks)


def _first_line(error: Exception) -> str:
    """Return the message of a YAML error in one line."""
    return getattr(error, 'problem', None) or (str(error).splitlines() or ['cannot be read'])[0]
