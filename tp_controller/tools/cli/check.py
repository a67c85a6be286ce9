# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller check``: wrong and doubtful parts of a stack, before a robot moves."""

import argparse
from functools import partial
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from tp_controller.errors import SettingsError, TpControllerError, unknown
from tp_controller.tools.cli.command import Command
from tp_controller.tools.cli.robot_arguments import add_robot_arguments, refuse
from tp_controller.tools.cli.values import positive_number, whole_count, whole_number
from tp_controller.tools.files import new_file
from tp_controller.tools.progress import progress

if TYPE_CHECKING:  # Imported with the first check: the help does not need it.
    from tp_controller.tools.check import CheckReport
# Time of a check from which an estimate is printed [s].
WORTH_AN_ESTIMATE = 2.0
EXAMPLES = """\
examples:
  tp_controller check stack.yaml --robot robot.urdf --rate 200
  tp_controller check --params-file package://tp_controller/config/demo.yaml
  tp_controller check stack.yaml --robot robot.urdf --base differential --runs 100 --jobs -1
  tp_controller check stack.yaml --robot ur.urdf.xacro --xacro-arg ur_type:=ur5e
  tp_controller check --params-file controller.yaml --params-file first.yaml
  tp_controller check --params-file controller.yaml --strict --json check.json --html check.html

Exit status: 0 nothing is wrong, 1 something is, 2 an argument is not valid.
"""


def add_check_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    add_robot_arguments(parser)
    parser.add_argument('--rate', type=positive_number, metavar='HZ',
                        help='cycles per second (default: as in the parameter file, else 100)')
    parser.add_argument('--samples', type=whole_count, default=300, metavar='N',
                        help='random configurations to look at (default: 300)')
    parser.add_argument('--runs', type=whole_number, default=20, metavar='N',
                        help='closed loops with random starts and goals (default: 20; 0: none)')
    parser.add_argument('--seconds', type=positive_number, default=15.0,
                        help='longest simulated time of one (default: 15)')
    parser.add_argument('--seed', type=whole_number, default=0,
                        help='of the random numbers; the same one gives the same result '
                        '(default: 0)')
    parser.add_argument('--jobs', type=_jobs, default=1, metavar='N',
                        help='processes; -1: as many as there are processors (default: 1)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the numbers')
    parser.add_argument('--html', type=Path, metavar='FILE', help='write one page')
    parser.add_argument('--strict', action='store_true',
                        help='end with status 1 if something is doubtful, too')
    parser.add_argument('--accept', metavar='KIND', action='append', default=[],
                        help='a kind of findings that is meant to be so; several times for '
                        'several kinds (for one task: its key accept)')


def run_check(options: argparse.Namespace) -> int:
    """
    Check a stack, and print the findings.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the arguments that `add_check_arguments` adds.

    Returns
    -------
    int
        0 if nothing is wrong, 1 if something is (or doubtful, with ``--strict``), 2 if a file is
        missing or cannot be written.

    """
    from tp_controller.tools.check.page import page_of
    from tp_controller.tools.check.parameter_file import Refused
    from tp_controller.tools.check.tables import text_of
    outputs = [path for path in (options.json, options.html) if path]
    for path in outputs:
        if not path.absolute().parent.is_dir():
            return refuse(f'{path}: there is no folder {path.parent}')
    try:
        report = _report(options)
    except Refused as error:
        return refuse(error.missing_file)
    except SettingsError as error:
        return refuse(str(error))
    print(text_of(report))
    try:
        for path, text in ((options.json, report.to_json),
                           (options.html, partial(page_of, report))):
            if path:
                with new_file(path) as file:
                    file.write(text().encode())
    except (OSError, TpControllerError) as error:
        return refuse(str(error))
    return 0 if report.passes(options.strict) else 1


def _report(options: argparse.Namespace) -> 'CheckReport':
    """Return the report; raise `Refused` for a missing file, else `SettingsError`."""
    from tp_controller.model.mobile_base import BASES
    from tp_controller.tools.check.checker import check, refused
    from tp_controller.tools.check.findings import about_parameters
    from tp_controller.tools.check.parameter_file import read, Refused
    from tp_controller.tools.check.results import check_kinds
    if options.base and options.base not in BASES:
        raise SettingsError([unknown('base', options.base, BASES)])
    check_kinds(options.accept)
    try:
        given = read(options.params_file, options.stack, options.robot, options.base,
                     options.rate, options.joints, options.xacro_arg)
    except Refused as error:
        if error.missing_file:
            raise
        return refused(error.messages(), options.rate or 0.0, options.seed)
    report = check(given.robot, given.stack, given.settings, period=given.period,
                   samples=options.samples, runs=options.runs, seconds=options.seconds,
                   seed=options.seed, jobs=options.jobs, around=given.around,
                   progress=progress, expecting=_print_time)
    return report.adding(about_parameters(given.ignored)).accepting(options.accept)


def _print_time(seconds: float) -> None:
    """Print the time that a check will take, unless it is over at once."""
    if seconds < WORTH_AN_ESTIMATE:
        return
    print(f'this takes about {seconds:.0f} s' if seconds < 100.0 else
          f'this takes about {seconds / 60.0:.0f} min: fewer --runs, --samples, or more --jobs '
          'make it shorter', file=sys.stderr)


def _jobs(text: str) -> int:
    """Parse a number of processes: from 1 on, or -1."""
    return -1 if text.strip() == '-1' else whole_count(text)


COMMAND = Command(
    'list the wrong and doubtful parts of a stack, before a robot moves',
    'List the wrong and doubtful parts of a stack, before a robot moves: at random '
    'configurations, then in closed loops with random starts and goals. No ROS is needed.',
    EXAMPLES, add_check_arguments, run_check)
