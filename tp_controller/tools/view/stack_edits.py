# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Edits of the stack of a controller, which preserve the rest of its text."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from tp_controller.errors import TpControllerError
from tp_controller.resources import load_yaml, read_source, YamlLoader
from tp_controller.ros.parameters import TASKS
from tp_controller.tasks import task_types
from tp_controller.tasks.stack_reader import is_stack
from tp_controller.tools.view.draggables import Numbers
from tp_controller.tools.view.link import Link, OnAnswer
import yaml

# Line width that keeps YAML from breaking lines.
WIDTH = 10_000


class StackChanges:
    """
    Editor of the text of a stack, one request at a time; goals, gains and tolerances stay.

    Edits during a pending request are combined, and only the last value of a key counts.

    Parameters
    ----------
    link : Link
    tell : callable
        Called with the success of a change and the reason of a failure.

    Attributes
    ----------
    numbers : dict
        {task: {key: number}}; empty if the text of the stack is not available.

    """

    def __init__(self, link: Link, tell: OnAnswer) -> None:
        self._link, self._tell = link, tell
        self._edits: dict[object, Callable[[str], str]] = {}
        self._busy = False
        self._read: object = None
        self.numbers: Numbers = {}

    def move(self, task: str, step: int) -> None:
        """Move the level of a task in the order: -1 is one up."""
        self._edits[object()] = partial(moved, task=task, step=step)

    def set_key(self, task: str, key: str, value: float) -> None:
        """Set the value of a key of a task."""
        self._edits[task, key] = partial(with_number, task=task, key=key, value=value)

    def update(self) -> None:
        """Send the pending edits, unless a request is pending."""
        if not self._edits or self._busy:
            return
        edits, self._edits = self._edits, {}
        try:
            before = text = self._text()
            for edit in edits.values():
                text = edit(text)
        except TpControllerError as error:
            self._tell(False, str(error))
            return
        if text != before:
            self._busy = True
            # A new stack resets the gains and tolerances to those in its text.
            given = {name: value for name, value in self._link.values.items()
                     if name.startswith(TASKS)}
            self._link.set_parameters({'stack': text}, partial(self._changed, given))

    def read(self) -> None:
        """Read the stack of the controller if its parameters were refreshed."""
        if self._link.values is self._read:
            return
        self._read = self._link.values
        try:
            self.numbers = numbers(self._text())
        except TpControllerError:
            self.numbers = {}

    def _text(self) -> str:
        """Return the text of the stack; raise `TpControllerError` if it is not available."""
        return stack_text(str(self._link.values.get('stack', '')))

    def _changed(self, given: dict[str, Any], worked: bool, reason: str) -> None:
        """Process the response, and restore the parameters of the tasks."""
        self._tell(worked, reason)
        if worked and given:
            self._link.set_parameters(given, self._restored)
        else:
            self._busy = False

    def _restored(self, worked: bool, reason: str) -> None:
        """Process the response of the restoration."""
        self._busy = False
        self._tell(worked, reason)


def stack_text(source: str) -> str:
    """
    Return the text of a stack.

    Parameters
    ----------
    source : str
        The value of the parameter `stack`: text, or the name of a file.

    Raises
    ------
    TpControllerError
        The file is not on this machine.

    """
    try:
        return read_source(source, is_stack)
    except (OSError, ValueError) as error:
        raise TpControllerError(f'the text of the stack is not available here: {error}') from error


def moved(text: str, task: str, step: int) -> str:
    """
    Return a stack with the level of a task moved.

    Comments above a level go with it, except those above the first.

    Parameters
    ----------
    text : str
        YAML list.
    task : str
        Name of a task; the other tasks of its level move with it.
    step : int
        Number of places: -1 is one up.

    Returns
    -------
    str
        The new text; unchanged if the level is already at the end.

    Raises
    ------
    TpControllerError
        The stack has no such task, or cannot be read.

    """
    entries = _entries(text)
    order = list(range(len(entries)))
    place = next((number for number in order if task in _names(entries[number])), None)
    if place is None:
        raise TpControllerError(f'the stack has no task {task!r}')
    order.insert(min(max(place + step, 0), len(order) - 1), order.pop(place))
    # Anchors and other syntax beyond a plain list prevent moving lines.
    return _as_written(_arranged(text, order), [entries[number] for number in order])


def numbers(text: str) -> dict[str, dict[str, float]]:
    """Return {task: {key: number}} of the keys with a numeric value, including default values."""
    kinds = task_types()
    found: dict[str, dict[str, float]] = {}
    for name, keys in (item for part in _parts(_entries(text)) for item in part.items()):
        kind = kinds.get(str(keys.get('type'))) if isinstance(keys, dict) else None
        if kind is not None:
            found[str(name)] = {key: float(value)
                                for key, value in {**kind.accepted_keys(), **keys}.items()
                                if isinstance(value, (int, float)) and not isinstance(value, bool)}
    return found


def with_number(text: str, task: str, key: str, value: float) -> str:
    """
    Return a stack with a new value of a key of a task.

    Parameters
    ----------
    text : str
        YAML list.
    task, key : str
        Task and key; a missing key is added.
    value : float
        New value.

    Returns
    -------
    str

    Raises
    ------
    TpControllerError
        The stack has no such task, or cannot be read.

    """
    entries = _entries(text)
    part = next((part for part in _parts(entries) if isinstance(part.get(task), dict)), None)
    if part is None:
        raise TpControllerError(f'the stack has no task {task!r}')
    part[task] = {**part[task], key: value}
    return _as_written(_replaced(text, task, key, value), entries)


def _as_written(text: str | None, entries: object) -> str:
    """Return a text if it parses to the entries; else dump the entries as YAML."""
    if text is not None and _parses_to(text, entries):
        return text
    return yaml.safe_dump(entries, sort_keys=False, width=WIDTH, allow_unicode=True,
                          default_flow_style=None)


def _replaced(text: str, task: str, key: str, value: float) -> str | None:
    """Return the text with a new value of a key; None if its position is unknown."""
    nodes = next((keys for name, keys in _nodes(yaml.compose(text, Loader=YamlLoader))
                  if name == task), None)
    if nodes is None or not nodes.value:
        return None
    for name, node in nodes.value:
        if name.value == key:
            return f'{text[:node.start_mark.index]}{value!r}{text[node.end_mark.index:]}'
    end = nodes.value[0][1].end_mark.index
    between = ', ' if nodes.flow_style else '\n' + ' ' * nodes.start_mark.column
    return f'{text[:end]}{between}{key}: {value!r}{text[end:]}'


def _nodes(node: yaml.Node | None) -> Iterator[tuple[str, yaml.MappingNode]]:
    """Yield the names and the keys of tasks, which may be in nested lists."""
    if isinstance(node, yaml.SequenceNode):
        for part in node.value:
            yield from _nodes(part)
    elif isinstance(node, yaml.MappingNode):
        for name, keys in node.value:
            if isinstance(keys, yaml.MappingNode):
                yield name.value, keys


def _arranged(text: str, order: Sequence[int]) -> str | None:
    """Return the lines of a text with its entries reordered; None if entries share lines."""
    root = yaml.compose(text, Loader=YamlLoader)
    nodes = root.value if isinstance(root, yaml.SequenceNode) else []
    lines = text.splitlines(keepends=True)
    if lines and not lines[-1].endswith('\n'):
        lines[-1] += '\n'
    starts = [node.start_mark.line for node in nodes]
    if len(set(starts)) < len(starts) or text.lstrip().startswith('['):
        return None
    firsts = [_with_comments(lines, start) if number else start
              for number, start in enumerate(starts)]
    ends = [*firsts[1:], len(lines)]
    return ''.join([*lines[:firsts[0]], *(
        line for number in order for line in lines[firsts[number]:ends[number]])])


def _with_comments(lines: Sequence[str], line: int) -> int:
    """Return the index of the first comment directly above a line, or that of the line."""
    while line and lines[line - 1].lstrip().startswith('#'):
        line -= 1
    return line


def _entries(text: str) -> list[Any]:
    """Return the entries of a stack."""
    entries = _read(text)
    if not isinstance(entries, list):
        raise TpControllerError('the stack is not a list of tasks')
    return entries


def _read(text: str) -> object:
    """Return the value of a YAML text."""
    try:
        return load_yaml(text)
    except ValueError as error:
        raise TpControllerError(f'the stack cannot be read: {error}') from error


def _parses_to(text: str, wanted: object) -> bool:
    """Return whether a text is valid YAML of a value."""
    try:
        return load_yaml(text) == wanted
    except ValueError:
        return False


def _names(entry: object) -> list[str]:
    """Return the names of the tasks of an entry, which may be a list."""
    return [str(name) for part in _parts([entry]) for name in part]


def _parts(entries: Sequence[object]) -> Iterator[dict[Any, Any]]:
    """Yield the mappings of tasks: entries, or their elements if several share a level."""
    for entry in entries:
        yield from (part for part in (entry if isinstance(entry, list) else [entry])
                    if isinstance(part, dict))
