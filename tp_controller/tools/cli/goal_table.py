# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals of ``tp_controller ik``, from the command line and from a table."""

from collections.abc import Mapping, Sequence
import csv
from pathlib import Path
from typing import Any, NamedTuple

from tp_controller.errors import GoalError
from tp_controller.resources import load_yaml

# Parts of a goal that are numbers in a row, in this order; other columns name joints.
POSE_PARTS = ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')


class GoalTable(NamedTuple):
    """
    Goals of several calls.

    Attributes
    ----------
    goals : dict
        {task: goals}, as many for all tasks.
    starts : list of dict
        {joint: position} where each search starts [rad or m]; empty for the start of all.
    places : list of str
        Words that begin a message about each call: file and line.

    """

    goals: dict[str, list[Any]]
    starts: list[dict[str, float]]
    places: list[str]


def parse_goals(texts: Sequence[str]) -> dict[str, Any]:
    """
    Return {task: goal} of texts such as ``tool=0.4, 0.2, 0.5``.

    A goal is a list of numbers, or a mapping of joints to positions in braces.

    Raises
    ------
    GoalError
        A text is of another form.

    """
    goals = {}
    for text in texts:
        task, equals, given = text.partition('=')
        task, given = task.strip(), given.strip()
        if task in goals:
            raise GoalError(f'two goals for task {task!r}')
        if not equals or not task or not given:
            raise GoalError(f'{text!r} is not of the form TASK=NUMBERS, such as '
                            'tool=0.4,0.2,0.5,1,0,0,0')
        try:
            goals[task] = load_yaml(given if given[0] in '[{' else f'[{given}]')
        except ValueError as error:
            raise GoalError(f'the goal of task {task!r}: {error}') from error
    return goals


def read_table(path: Path) -> GoalTable:
    """
    Return the goals of a CSV file.

    Its first line names the columns: ``<task>.x`` … ``<task>.qw`` or ``<task>.<joint>``, and
    ``start.<joint>`` for the start of a search.

    Raises
    ------
    GoalError
        The file cannot be read, or a column or number is not valid; the message has the line.

    """
    head, rows = read_lines(path)
    columns = [_column(path, name) for name in head]
    if columns and not rows:
        raise GoalError(f'{path}: has no goals below its first line')
    if not columns or len(set(columns)) < len(columns):
        raise GoalError(f'{path}: line 1 needs a name for each column, each once, such as '
                        'tool.x,tool.y,tool.z')
    _check_parts(path, columns)
    table = GoalTable({task: [] for task, _ in columns if task != 'start'},
                      [], [where for where, _ in rows])
    for where, row in rows:
        values = _values(where, columns, row)
        table.starts.append(values.get('start', {}))
        for task, goals in table.goals.items():
            goals.append(_goal(values[task]))
    return table


def read_lines(path: Path) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """
    Return the names of the columns of a CSV file, and each line that is not empty.

    A line has the words that begin a message about it, and its texts. Raises `GoalError` if the
    file cannot be read.
    """
    try:
        with path.open(newline='', encoding='utf-8-sig') as file:
            reader = csv.reader(file, skipinitialspace=True)
            head = [name.strip() for name in next(reader, [])]
            return head, [(f'{path}: line {reader.line_num}', row) for row in reader if row]
    except OSError as error:
        raise GoalError(f'{path}: {error.strerror}') from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise GoalError(f'{path}: {error}') from error


def _column(path: Path, name: str) -> tuple[str, str]:
    """Return task and part of the name of a column."""
    task, dot, part = name.partition('.')
    if not dot or not task or not part:
        raise GoalError(f'{path}: line 1: {name!r} is not of the form <task>.<part>, with a part '
                        f'of {", ".join(POSE_PARTS)} or a joint')
    return task, part


def _check_parts(path: Path, columns: Sequence[tuple[str, str]]) -> None:
    """Raise `GoalError` unless each goal has x, y, z, a quaternion, both, or joints."""
    for name in dict.fromkeys(task for task, _ in columns):
        parts = {part for task, part in columns if task == name} & set(POSE_PARTS)
        if parts not in (set(), set(POSE_PARTS), set(POSE_PARTS[:3]), set(POSE_PARTS[3:])):
            raise GoalError(f'{path}: line 1: {name} has {", ".join(sorted(parts))}; valid: x, y '
                            'and z, or qx, qy, qz and qw, or all of them, or joints')


def _values(where: str, columns: Sequence[tuple[str, str]], row: Sequence[str]
            ) -> dict[str, dict[str, float]]:
    """Return {task: {part: number}} of a line."""
    if len(row) != len(columns):
        raise GoalError(f'{where}: needs {len(columns)} numbers, got {len(row)}')
    found: dict[str, dict[str, float]] = {}
    for (task, part), text in zip(columns, row):
        try:
            found.setdefault(task, {})[part] = float(text)
        except ValueError as error:
            raise GoalError(f'{where}: {task}.{part} is not a number: {text!r}') from error
    return found


def _goal(values: Mapping[str, float]) -> list[float] | dict[str, float]:
    """Return a goal of its parts: numbers in a row, or positions by joint."""
    if set(values) <= set(POSE_PARTS):
        return [values[part] for part in POSE_PARTS if part in values]
    return dict(values)
