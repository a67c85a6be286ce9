# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller plot``: plots of a recording, and a report with all of them."""

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys
from typing import TYPE_CHECKING, TypeAlias

from tp_controller.errors import in_words, TpControllerError
from tp_controller.tools.cli.command import Command
from tp_controller.tools.extras import install_command
from tp_controller.tools.progress import progress
from tp_controller.untrusted.texts import plain

if TYPE_CHECKING:  # Imported with the first recording: the help does not need it.
    from tp_controller.model.robot import Robot
    from tp_controller.tools.recording.history import History

    MaybeRobot: TypeAlias = Robot | None

EXAMPLES = """\
examples:
  tp_controller plot run1                    plots and report go to ./tp_plots/run1
  tp_controller plot run1 --output report
  tp_controller plot run2 --node left/tp_controller
  tp_controller plot run1/run1.mcap          one file, as of a recording that was cut off

Recordings of tp_controller record and of ros2 bag record are read (MCAP, SQLite), without ROS.
"""


def add_plot_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument('bag', type=Path, metavar='BAG',
                        help='recording: a folder, or one file of it')
    parser.add_argument('--output', type=Path, metavar='FOLDER',
                        help='where plots and report go (default: ./tp_plots/<name of BAG>)')
    parser.add_argument('--node', default='',
                        help='name of the controller node, with its namespace (default: the only '
                        'one in the recording)')


def plot(options: argparse.Namespace) -> int:
    """
    Draw the plots of a recording and write the report.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the arguments that `add_plot_arguments` adds.

    Returns
    -------
    int
        0, or 2 if the output folder cannot be created.

    Raises
    ------
    TpControllerError
        The recording contains no controller.

    """
    from tp_controller.tools.recording.history import History
    from tp_controller.tools.recording.pictures import draw
    from tp_controller.tools.recording.reader import Bag
    from tp_controller.tools.recording.report import summary, write_report
    bag = Bag(options.bag)
    name = bag.path.resolve().name
    folder = options.output or Path('tp_plots') / name
    with progress(bag.size, f'reading {name}') as bar:
        history = History(bag, options.node, bar.advance)
    _check(history, bag.path, bag.remarks)
    remarks = bag.remarks
    robot = _robot(history, remarks)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        print(f'tp_controller: --output: {error}', file=sys.stderr)
        return 2
    with progress(1, 'drawing'):
        plots = list(draw(history, robot, folder, remarks))
    page = folder / 'report.html'
    write_report(page, history, robot, plots, title=name, remarks=remarks,
                 replay=_replay(history, robot, remarks))
    if history.tasks:
        print(summary(history))
    for remark in remarks:
        print(f'tp_controller: {plain(remark)}', file=sys.stderr)
    print('\nWritten:')
    for path in (*(path for _, path in plots), page):
        print(f'  {path}')
    return 0


def _check(history: 'History', path: Path, remarks: Sequence[str]) -> None:
    """Raise an error if a recording contains no controller."""
    if history.node or history.commands:
        return
    if not history.counts:
        raise TpControllerError('; '.join((f'{path} has no messages', *remarks)))
    topics = sorted(history.counts)
    raise TpControllerError(
        f'{path} has nothing of a controller: neither ~/status nor velocity commands; its topics: '
        f'{", ".join(topics[:10])}{" …" if len(topics) > 10 else ""}')


def _robot(history: 'History', remarks: list[str]) -> 'MaybeRobot':
    """Return the robot; None, with a remark, if it is unknown."""
    from tp_controller.tools.recording.robots import robot_of
    if not history.node:
        remarks.append('no status of a controller: the history of its tasks is unknown')
    try:
        robot = robot_of(history)
    except TpControllerError as error:
        remarks.append(f'the robot is not known: {error}')
        return None
    if robot is None:
        remarks.append('no description of the robot: no limits, no path of its tool, no replay')
    return robot


def _replay(history: 'History', robot: 'MaybeRobot', remarks: list[str]) -> str:
    """Return the page with the motion; empty, with a remark, if it is impossible."""
    if robot is None:
        return ''
    try:
        from tp_controller.tools.view.replay import replay_page
    except ModuleNotFoundError as error:
        remarks.append(f"no replay: {error.name} is missing; {install_command('view')}")
        return ''
    try:
        return replay_page(history, robot)
    except Exception as error:
        # Arbitrary recorded data may be impossible to show.
        remarks.append(f'no replay: {in_words(error)}')
        return ''


COMMAND = Command(
    'plot a recording',
    'Draw the plots of a recording: errors with the causes of limits, velocities against their '
    'limits, the path of the tool; and write a report that has all of them in one HTML file, '
    'with the motion to be replayed.',
    EXAMPLES, add_plot_arguments, plot)
