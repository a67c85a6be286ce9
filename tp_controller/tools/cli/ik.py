# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller ik``: configurations at which the goals of a stack are reached."""

import argparse
from collections.abc import Iterable, Sequence
import json
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from tp_controller.errors import GoalError, RobotError, TpControllerError, unknown
from tp_controller.tools.cli.command import Command
from tp_controller.tools.cli.goal_table import GoalTable, parse_goals, read_table
from tp_controller.tools.cli.robot_arguments import add_robot_arguments, refuse
from tp_controller.tools.cli.values import (
    assignment,
    positive_number,
    whole_count,
    whole_number,
)
from tp_controller.tools.files import new_file
from tp_controller.tools.progress import progress

if TYPE_CHECKING:  # Imported with the first solution: the help does not need it.
    from tp_controller.model.robot import Robot
    from tp_controller.positions.solution import PositionSolution
    from tp_controller.tasks.stack import Stack
# Goals that are solved between two steps of the progress bar.
STEP = 200
EXAMPLES = """\
examples:
  tp_controller ik stack.yaml --robot robot.urdf --goal tool=0.4,0.2,0.5,1,0,0,0
  tp_controller ik stack.yaml --robot robot.urdf --goal tool=0.4,0.2,0.5 --start joint4=-2
  tp_controller ik --params-file controller.yaml --csv goals.csv --output found.csv

A goal is x,y,z, a quaternion qx,qy,qz,qw, both, or {joint: position, …}, in m and rad. A table
(--csv) has a line for each search, and columns tool.x, tool.y, … or posture.joint4; start.joint4
is where it starts.

Exit status: 0 all goals are reached, 1 some are not, 2 an argument is not valid.
"""


def add_ik_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    add_robot_arguments(parser)
    goals = parser.add_mutually_exclusive_group()
    goals.add_argument('--goal', action='append', default=[], metavar='TASK=NUMBERS',
                       help='goal of a task; once for each (default: the goals in the stack)')
    goals.add_argument('--csv', type=Path, metavar='FILE', help='goals of many searches')
    parser.add_argument('--start', action='append', default=[], type=assignment,
                        metavar='JOINT=POSITION',
                        help='position where the search starts, or where a joint that is not '
                        'driven stands; once for each joint (default: as near to zero as the '
                        'limits allow)')
    parser.add_argument('--attempts', type=whole_count, default=40, metavar='N',
                        help='most descents of a search: the first from the start, the others '
                        'from random postures (default: 40)')
    parser.add_argument('--timeout', type=positive_number, default=1.0, metavar='SECONDS',
                        help='longest time of a search (default: 1)')
    parser.add_argument('--seed', type=whole_number, default=0, help='of the random postures '
                        '(default: 0)')
    parser.add_argument('--criterion', default='nearest',
                        choices=('nearest', 'manipulability', 'limits'),
                        help='which of several solutions: the nearest to the start, that where '
                        'the first task can move best, or that farthest from position limits '
                        '(default: nearest)')
    parser.add_argument('--jobs', type=whole_count, metavar='N',
                        help='threads (default: as many as there are processors)')
    parser.add_argument('--output', type=Path, metavar='FILE',
                        help='write the configurations as a table (.csv), or all results (.json)')


def run_ik(options: argparse.Namespace) -> int:
    """
    Search for configurations, and print them.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the arguments that `add_ik_arguments` adds.

    Returns
    -------
    int
        0 if all goals are reached, 1 if some are not, 2 if an argument is not valid.

    """
    from tp_controller.positions.solve_position import solve_position
    from tp_controller.tools.check.parameter_file import read, Refused
    if options.output and options.output.suffix not in ('.csv', '.json'):
        return refuse(f'{options.output}: needs the ending .csv or .json')
    if options.output and not options.output.absolute().parent.is_dir():
        return refuse(f'{options.output}: there is no folder {options.output.parent}')
    try:
        given = read(options.params_file, options.stack, options.robot, options.base, None,
                     options.joints, options.xacro_arg)
        driven, passive = _divided(given.robot, dict(options.start))
        chosen = {'attempts': options.attempts, 'timeout': options.timeout, 'seed': options.seed,
                  'criterion': options.criterion, 'passive': passive}
        table = read_table(options.csv) if options.csv else None
        goals = table.goals if table else parse_goals(options.goal)
        if not goals:
            _check_stack_has_goals(given.stack)
        if table:
            found = _solve(given.robot, given.stack, table, driven, options.jobs or -1, chosen)
        else:
            start = _start(given.robot, driven)
            _note_outside(given.robot, driven.items())
            found = [solve_position(given.robot, given.stack, goals, start, **chosen)]
    except Refused as error:
        return refuse('; '.join(' '.join(filter(None, each)) for each in error.messages()))
    except TpControllerError as error:
        return refuse(str(error))
    print(_text(given.robot, found))
    if options.output:
        write = _csv if options.output.suffix == '.csv' else _json
        try:
            with new_file(options.output) as file:
                file.write(write(given.robot, found).encode())
        except (OSError, TpControllerError) as error:
            return refuse(str(error))
    return 0 if all(each.reached for each in found) else 1


def _check_stack_has_goals(stack: 'Stack') -> None:
    """Raise `GoalError` if every task of a stack would keep its value at the start."""
    tasks = [task for task in stack.active_tasks if task.has_position]
    if not any(task.bounded or task.is_objective or task.goal is not None for task in tasks):
        names = ', '.join(task.name for task in tasks) or 'none'
        raise GoalError('no task has a goal, neither in the stack nor by --goal or --csv; tasks '
                        f'that take one: {names}')


def _solve(robot: 'Robot', stack: 'Stack', table: GoalTable, common: dict[str, float],
           jobs: int, chosen: dict[str, Any]) -> list['PositionSolution']:
    """Return the results for all goals of a table; a `GoalError` has the line."""
    import numpy as np
    from tp_controller.positions.solve_position import solve_position
    from tp_controller.positions.solve_positions import GoalOfManyError, solve_positions
    starts = np.array([_start(robot, {**common, **own}) for own in table.starts]).reshape(
        -1, robot.nq)
    _note_outside(robot, (each for own in table.starts for each in {**common, **own}.items()))
    if not table.goals:
        return [solve_position(robot, stack, None, start, **chosen) for start in starts]
    found: list[PositionSolution] = []
    with progress(len(table.starts), 'solving') as bar:
        for first in range(0, len(table.starts), STEP):
            part = slice(first, first + STEP)
            try:
                found += solve_positions(
                    robot, stack, {task: goals[part] for task, goals in table.goals.items()},
                    starts[part], jobs=jobs, **chosen)
            except GoalOfManyError as error:
                raise GoalError(f'{table.places[first + error.number]}: {error.__cause__}') \
                    from error
            bar.advance(len(starts[part]))
    return found


def _divided(robot: 'Robot', positions: dict[str, float]) -> tuple[dict[str, float], Any]:
    """Return the given positions of driven joints, and those (p,) of all passive ones."""
    passive = robot.passive_neutral.copy()
    for row, name in enumerate(robot.passive_names):
        passive[row] = positions.pop(name, passive[row])
    for name in positions:
        if name not in robot.coordinate_names:
            raise RobotError(unknown('joint', name,
                                     [*robot.coordinate_names, *sorted(robot.passive_names)]))
    return positions, passive


def _start(robot: 'Robot', positions: dict[str, float]) -> Any:
    """Return the configuration (nq,) with some joints at given positions."""
    q = robot.neutral()
    for name, position in positions.items():
        if name not in robot.coordinate_names:
            raise RobotError(unknown('joint', name, robot.coordinate_names))
        q[robot.coordinate_names.index(name)] = position
    return q


def _note_outside(robot: 'Robot', starts: Iterable[tuple[str, float]]) -> None:
    """Print a note for each (joint, position) of starts outside the position limits, once."""
    for name, position in dict.fromkeys(starts):
        if name not in robot.joint_names:
            continue
        row = robot.joint_index(name)
        for word, limit, beyond in (('lower', robot.lower[row], position < robot.lower[row]),
                                    ('upper', robot.upper[row], position > robot.upper[row])):
            if beyond:
                print(f'tp_controller: the start of {name}, {position:.6g}, is beyond its {word} '
                      f'position limit: the search begins at {limit:.6g}', file=sys.stderr)


def _text(robot: 'Robot', found: Sequence['PositionSolution']) -> str:
    """Return the results as text: in full for a single one, else a line for each."""
    if len(found) != 1:
        return '\n'.join([*(_line(number, each) for number, each in enumerate(found, 1)),
                          f'{sum(each.reached for each in found)} of {len(found)} reached'])
    each, = found
    width = max(map(len, robot.coordinate_names))
    lines = [f'{name:{width}} {value: .6f}' for name, value in zip(robot.coordinate_names, each.q)]
    for task in each.tasks:
        lines += ['', f'{task.name}: {task.status}, '
                      + ', '.join(f'error {error:.3g} {unit}' for error, unit, _ in task.errors)]
        lines += [f'  {text}' for text in (task.reason, task.hint and f'hint: {task.hint}')
                  if text]
    return '\n'.join([*lines, '', 'reached' if each.reached else 'not reached'])


def _line(number: int, each: 'PositionSolution') -> str:
    """Return the result of one of several goals as a line."""
    missing = next((f'{task.name}: {task.reason}' for task in each.tasks if task.reason), '')
    return f'{number:5} reached' if each.reached else f'{number:5} not reached  {missing}'.rstrip()


def _csv(robot: 'Robot', found: Sequence['PositionSolution']) -> str:
    """Return the configurations as a table with a line for each."""
    rows = [('reached', *robot.coordinate_names),
            *((int(each.reached), *map(repr, each.q.tolist())) for each in found)]
    return ''.join(','.join(map(str, row)) + '\n' for row in rows)


def _json(robot: 'Robot', found: Sequence['PositionSolution']) -> str:
    """Return all results as JSON."""
    return json.dumps([{
        'reached': each.reached, 'attempts': each.attempts,
        'q': dict(zip(robot.coordinate_names, each.q.tolist())),
        'tasks': [{
            'name': task.name, 'status': task.status,
            'errors': {unit: error for error, unit, _ in task.errors},
            'causes': [cause._asdict() for cause in task.causes],
            'reason': task.reason, 'hint': task.hint} for task in each.tasks],
    } for each in found], indent=1) + '\n'


COMMAND = Command(
    'find the configuration at which the goals of a stack are reached',
    'Find the configuration at which the goals of a stack are reached (inverse kinematics), or '
    'the nearest one with the reason. No ROS is needed.',
    EXAMPLES, add_ik_arguments, run_ik)
