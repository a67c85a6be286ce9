# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Ways of ``tp_controller goal``: through points or the lines of a table."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tp_controller.errors import GoalError
from tp_controller.tools.cli.goal_table import POSE_PARTS, read_lines
from tp_controller.tools.cli.values import finite_number, positive_number

# Column with the time from the start [s].
TIME = 't'


def add_way_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a way to the parser of the command."""
    parser.add_argument('--via', action='append', nargs=3, type=finite_number,
                        metavar=('X', 'Y', 'Z'),
                        help='point on the way to --xyz [m]; once for each, in their order')
    parser.add_argument('--file', type=Path, metavar='CSV',
                        help='goals on the way, a line for each: columns x, y, z, qx, qy, qz, qw, '
                        'or joints; column t for times from the start [s]')
    pace = parser.add_mutually_exclusive_group()
    pace.add_argument('--speed', type=positive_number, metavar='SPEED',
                      help='largest speed on a straight line, or a smooth way through several '
                      'goals [m/s, or rad/s without a position]')
    pace.add_argument('--duration', type=positive_number, metavar='SECONDS',
                      help='time of the straight line to one goal, in place of its speed')


def is_way(options: argparse.Namespace) -> bool:
    """Return whether a goal is to be sent as a trajectory."""
    return bool(options.via or options.file or options.speed or options.duration)


def way_fault(options: argparse.Namespace) -> str:
    """Return the fault of the options of a way; empty if there is none."""
    given = any((options.xyz, options.rpy, options.quat, options.joint))
    if options.velocity or options.linear or options.angular or options.repeat:
        return 'velocities have no way: leave out --speed, --duration, --via and --file'
    if options.file and (given or options.via):
        return '--file has all goals: leave out the others'
    if options.via and not options.xyz:
        return '--via is on the way to a point: give --xyz'
    if not options.file and not given:
        return '--speed and --duration need a goal: give --xyz, --rpy, --quat, --joint or --file'
    if options.duration and (options.via or options.file):
        return '--duration is for one goal; for several give --speed, or times in a --file'
    if options.via and not options.speed:
        return '--via needs a --speed'
    return ''


def way(options: argparse.Namespace, goal: Mapping[str, Any]
        ) -> tuple[list[dict[str, Any]], list[float] | None]:
    """
    Return the goals of a way, and their times.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the command.
    goal : dict
        Parts of its goal, if there is one.

    Returns
    -------
    values : list of dict
        Parts of each goal; see `Client.send`.
    times : list of float or None
        Times from the start [s]; None for a way at a speed.

    Raises
    ------
    GoalError
        The file cannot be read, or has neither times nor a speed.

    """
    if not options.file:
        values = [{**goal, 'xyz': point} for point in options.via or ()]
        return [*values, dict(goal)], [options.duration] if options.duration else None
    values, times = read_way(options.file)
    if (times is None) == (options.speed is None):
        raise GoalError(f'{options.file}: needs a column {TIME} or --speed, one of them')
    return values, times


def read_way(path: Path) -> tuple[list[dict[str, Any]], list[float] | None]:
    """
    Return goals and times of a CSV file; its first line names the columns.

    Raises
    ------
    GoalError
        The file cannot be read, or a column or number is not valid; the message has the line.

    """
    head, rows = read_lines(path)
    if not rows:
        raise GoalError(f'{path}: has no goals below its first line')
    _check_columns(path, head)
    lines = [dict(zip(head, _numbers(where, row, len(head)))) for where, row in rows]
    times = [line.pop(TIME) for line in lines] if TIME in head else None
    return [_parts(line) for line in lines], times


def _check_columns(path: Path, head: Sequence[str]) -> None:
    """Raise `GoalError` unless each goal has x, y, z, a quaternion, both, or joints."""
    parts = set(head) - {TIME}
    poses = parts & set(POSE_PARTS)
    whole = poses in (set(POSE_PARTS), set(POSE_PARTS[:3]), set(POSE_PARTS[3:])) and \
        poses == parts
    if not parts or '' in parts or len(set(head)) < len(head) or (poses and not whole):
        raise GoalError(f'{path}: line 1: needs x, y and z, or qx, qy, qz and qw, or all of them, '
                        f'or joints, and {TIME} for times; got {", ".join(head)}')


def _numbers(where: str, row: Sequence[str], count: int) -> list[float]:
    """Return the numbers of a line, or raise `GoalError`."""
    if len(row) != count:
        raise GoalError(f'{where}: needs {count} numbers, got {len(row)}')
    try:
        return [finite_number(text) for text in row]
    except argparse.ArgumentTypeError as error:
        raise GoalError(f'{where}: {error}') from error


def _parts(line: Mapping[str, float]) -> dict[str, Any]:
    """Return the parts of the goal of a line; see `Client.send`."""
    if not set(line) & set(POSE_PARTS):
        return {'joints': dict(line)}
    found = {'xyz': [line[part] for part in POSE_PARTS[:3] if part in line],
             'quat_xyzw': [line[part] for part in POSE_PARTS[3:] if part in line]}
    return {name: values for name, values in found.items() if values}
