# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reader of a stack in YAML: tasks by level, or all faults with their lines."""

from collections.abc import Callable, Iterable, Mapping
import inspect
import re
import time
from typing import Any

from tp_controller.errors import Fault, in_words, StackError, suggestion, TaskError, unknown
from tp_controller.model.robot import Robot
from tp_controller.resources import YamlLoader
from tp_controller.tasks import task_types
from tp_controller.tasks.task import Task
from tp_controller.untrusted.calls import foreign
import yaml

# Valid names of tasks; they become parts of topic names.
NAME_PATTERN = re.compile(r'[A-Za-z][A-Za-z0-9_]{0,63}\Z')
# Attributes that the constructor of `Task` sets.
CONSTRUCTED = ('name', 'robot', 'rows', 'goal')
# Largest number of tasks; no robot can execute more in time.
MOST_TASKS = 100
# Time limit for reading the tasks [s]: only `self_collision` of robots with hundreds of shapes
# takes more than a second, and types of other packages may take any time.
READ_SECONDS = 10.0
LIST_FORM = 'a stack must be a list of "- name: {type: …}", the highest priority first'


class StackReader:
    """
    Reader of a YAML list into groups of tasks, which collects all faults.

    Parameters
    ----------
    robot : Robot
        Robot with the joints and frames that the tasks name.
    place : str
        Word for a line in messages.

    """

    def __init__(self, robot: Robot, place: str = 'line') -> None:
        self._robot, self._place = robot, place
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
        """Return the groups of tasks, or raise `StackError` with all faults."""
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
            others = names_of(task for task in read if not task.bounded)
            self._fault(node, '', f'inequality tasks ({names_of(bounded)}) and other tasks '
                                  f'({others}) cannot share a level')
        elif len(modes) > 1:
            self._fault(node, '', f'tasks that share a level need the same mode, not '
                                  f'{" and ".join(sorted(modes))}')
        if len({None if task.joint_mask is None else task.joint_mask.tobytes()
                for task in read}) > 1:
            self._fault(node, '', 'tasks that share a level need the same joints '
                                  f'({names_of(read)})')
        if self._bounded and 'scale' in modes:
            self._fault(node, '', f'mode scale would stop in front of the bounds of '
                                  f'{names_of(self._bounded)} above instead of sliding along '
                                  'them; use least_squares')
        self._bounded.extend(bounded)
        return read

    def _task(self, node: yaml.Node) -> Task | None:
        """Return the task of one entry, or record faults and return None."""
        self._check_effort(node)
        if not isinstance(node, yaml.MappingNode) or len(node.value) != 1:
            self._fault(node, '', LIST_FORM + _indentation(node))
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
            joined = next((word for word in lines if word.startswith('type:')), '')
            self._fault(key, name, f'{joined!r} needs a blank after the colon' if joined else
                        f'needs a type{self._valid_types(key.start_mark.line + 1)}')
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
            return f'; valid types: see {self._place} {self._types_listed}'
        self._types_listed = line
        return f'; valid: {", ".join(sorted(self._types))}'

    def _check_name(self, key: yaml.Node, name: object) -> None:
        """Record a fault if the name of a task is invalid or not unique."""
        if not isinstance(name, str) or not NAME_PATTERN.match(name):
            shown = repr(name[:80]) if isinstance(name, str) else 'a list or mapping'
            self._fault(key, '', 'the name of a task must be a letter, then letters, digits or _, '
                                 f'at most 64 in all, not {shown}')
        elif name in self._lines_of_names:
            self._fault(key, name, f'the name is used already, in {self._place} '
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


def is_stack(text: str) -> bool:
    """Return whether a text is a stack rather than the name of a file."""
    return text.startswith('- ') or any(mark in text for mark in '\n[{')


def names_of(tasks: Iterable[Task]) -> str:
    """Return the names of tasks, separated by commas."""
    return ', '.join(task.name for task in tasks)


def _first_line(error: Exception) -> str:
    """Return the message of a YAML error in one line."""
    return getattr(error, 'problem', None) or (str(error).splitlines() or ['cannot be read'])[0]


def _indentation(node: yaml.Node) -> str:
    """Return the end of a message where keys of a task stand below its name, not within."""
    if not isinstance(node, yaml.MappingNode) or len(node.value) < 2:
        return ''
    name, body = node.value[0]
    return f'; indent the keys of {name.value} by more than its name' if body.value == '' else ''
