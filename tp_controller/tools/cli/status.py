# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller status``: the status of running controllers, as a table."""

import argparse
from collections.abc import Mapping
import math
import shutil
import sys
from typing import TYPE_CHECKING

from tp_controller.control.units import with_unit
from tp_controller.errors import TpControllerError
from tp_controller.ros.client.status import ControllerStatus, TaskStatus
from tp_controller.ros.middleware import set_up_fast_dds
from tp_controller.tools.cli.command import Command
from tp_controller.tools.cli.values import positive_number
from tp_controller.untrusted.texts import plain

if TYPE_CHECKING:  # Imported with the first status: the help needs no ROS.
    from tp_controller.ros.client.status_monitor import Watch

# Cursor to the first line, and erase below it; erase the screen.
HOME = '\x1b[H\x1b[J'
CLEAR = '\x1b[2J'
# Cursor off and on.
HIDE, SHOW = '\x1b[?25l', '\x1b[?25h'
# Columns: key of the status as title, and width; the reason fills the rest of the line.
COLUMNS = (('task', 14), ('level', 8), ('error', 24), ('status', 10))
# Age of the last status from which it is shown [s].
SILENT_SECONDS = 2.0
EXAMPLES = """\
examples:
  tp_controller status                       all controllers, until Ctrl-C
  tp_controller status --once                one table
  tp_controller status --node left/tp_controller --node right/tp_controller
"""


def add_status_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument('--node', action='append', default=[],
                        help='name of a controller node, with its namespace; once for each '
                        '(default: all that are found)')
    parser.add_argument('--once', action='store_true', help='print one table and end')
    parser.add_argument('--period', type=positive_number, metavar='SECONDS',
                        help='time between two tables (default: 0.2 on a terminal, elsewhere 1)')
    parser.add_argument('--wait', type=positive_number, default=10.0, metavar='SECONDS',
                        help='how long to look for the controllers (default: 10)')


def show_status(options: argparse.Namespace) -> int:
    """
    Show the status until Ctrl-C.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the arguments that `add_status_arguments` adds.

    Returns
    -------
    int
        0.

    Raises
    ------
    TpControllerError
        No controller, or not every named one, was found.

    """
    set_up_fast_dds()
    from tp_controller.ros.client.graph import absence
    from tp_controller.ros.client.status_monitor import Watch
    with Watch(options.node) as watch:
        if not watch.wait(options.wait):
            raise TpControllerError(absence(', '.join(f'/{name}' for name in watch.missing())))
        if options.once:
            print(table(watch.statuses()))
        elif sys.stdout.isatty():
            _show_live(watch, options.period or 0.2)
        else:
            _print_tables(watch, options.period or 1.0)
    return 0


def table(heard: Mapping[str, tuple[ControllerStatus, float]], width: int | None = None) -> str:
    """
    Return the status of controllers as text.

    Parameters
    ----------
    heard : dict
        {name of a controller: (latest status, time since then [s])}
    width : int, optional
        Width of a terminal, to which lines are truncated.

    Returns
    -------
    str

    """
    lines = []
    for name, (controller, age) in heard.items():
        silent = f'no status for {age:.0f} s' if age > SILENT_SECONDS else ''
        lines += ['', f'/{name}: {silent or controller.summary}',
                  '  ' + ' '.join(f'{title:<{columns}}' for title, columns in COLUMNS) + ' reason']
        lines += map(_row, controller.tasks.values())
    return '\n'.join(plain(line.rstrip())[:width] for line in lines[1:])


def _row(task: TaskStatus) -> str:
    """Return the line of a task."""
    errors = ', '.join(_error(unit, error) for unit, error in task.errors.items())
    cells = (task.name, task.level, errors, task.status)
    reason = '; '.join(filter(None, (task.way, task.reason, *task.warnings)))
    return '  ' + ' '.join(f'{cell:<{columns}}'
                           for cell, (_, columns) in zip(cells, COLUMNS)) + f' {reason}'


def _error(unit: str, error: float) -> str:
    """Return an error with its unit; a dash if it is unknown."""
    return '-' if math.isnan(error) else with_unit(f'{error:.4f}', unit)


def _print_tables(watch: 'Watch', period: float) -> None:
    """Print tables periodically, one below the other."""
    while True:
        print(table(watch.statuses()), end='\n\n', flush=True)
        watch.listen(period)


def _show_live(watch: 'Watch', period: float) -> None:
    """Refresh a table in place, until Ctrl-C."""
    print(CLEAR + HIDE, end='')
    try:
        while True:
            size = shutil.get_terminal_size()
            lines = table(watch.statuses(), size.columns).splitlines()
            # One more line would scroll the terminal.
            print(HOME + '\n'.join(lines[:size.lines - 1]), end='', flush=True)
            watch.listen(period)
    except KeyboardInterrupt:
        print()
    finally:
        print(SHOW, end='', flush=True)


COMMAND = Command(
    'show the tasks of running controllers, live',
    'Show the tasks of running controllers, until Ctrl-C: how far each is from its goal, and '
    'what limits it.',
    EXAMPLES, add_status_arguments, show_status)
