# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Entry points of ``tp_controller`` and its nodes."""

# argcomplete looks for this line: PYTHON_ARGCOMPLETE_OK
import argparse
from collections.abc import Sequence
import importlib
from importlib.metadata import PackageNotFoundError, version
import os
import select
import signal
import sys
from typing import NoReturn

import argcomplete
from tp_controller.errors import SolverError, TpControllerError
from tp_controller.ros.signals import END_SIGNALS, SignalWatch
from tp_controller.tools.cli import (
    check,
    demo,
    goal,
    ik,
    plot,
    record,
    status,
    teleop,
    view,
)
from tp_controller.tools.extras import install_command
from tp_controller.untrusted.texts import plain

EXAMPLES = """\
examples:
  tp_controller demo                     a 7-DoF arm carries out a stack of tasks, over ROS 2
  tp_controller demo mobile              an arm on wheels carries a tray past obstacles
  tp_controller demo drill               drilling, with lower tasks in the null space
  tp_controller demo failed_joint        a joint fails in motion, the tool arrives all the same
  tp_controller demo lab1                motion in the null space of a planar arm, no ROS needed
  tp_controller goal tool --xyz 0.4 0.2 0.5 --rpy 180 0 0 --deg
  tp_controller goal --help              how to send goals of every kind
  tp_controller status                   the tasks of running controllers
  tp_controller check --help             the faults of a stack, before a robot moves
  tp_controller ik --help                inverse kinematics of a stack
  tp_controller view                     a robot in the browser, to pull about
  tp_controller teleop carry             a task driven with the keyboard
  tp_controller record run               the topics of controllers, to files
  tp_controller plot run                 plots and a report of a recording
"""
COMMANDS = {
    'demo': demo.COMMAND, 'goal': goal.COMMAND, 'status': status.COMMAND, 'check': check.COMMAND,
    'ik': ik.COMMAND, 'view': view.COMMAND,
    'teleop': teleop.COMMAND, 'record': record.COMMAND, 'plot': plot.COMMAND}
# {optional packages: (reason, extra that contains them)}
EXTRAS = {
    ('matplotlib', 'mpl_toolkits', 'PIL'): ('the figures need it', 'plots'),
    ('viser', 'trimesh', 'websockets'): ('the page needs it', 'view'),
    ('rosbags', 'lz4', 'backports'): ('recordings need it', 'record'),
}
# Longest error that is printed [characters].
LONGEST_PRINTED_ERROR = 20_000
INTERRUPTED, OUTPUT_CLOSED = 128 + signal.SIGINT, 128 + signal.SIGPIPE


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='tp_controller', epilog=EXAMPLES,
        description='Prioritized velocity control of redundant robots.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--version', action=_Version)
    commands = parser.add_subparsers(dest='command', required=True, metavar='command')
    for name, command in COMMANDS.items():
        command.add_to(commands, name)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command line.

    Parameters
    ----------
    arguments : list of str, optional
        Arguments; those of the process by default.

    Returns
    -------
    int
        0 for success, 1 for failure, 2 for invalid arguments.

    """
    parser = make_parser()
    argcomplete.autocomplete(parser)
    try:
        options = parser.parse_args(
            _mark_numbers(sys.argv[1:] if arguments is None else arguments))
    except TpControllerError as error:
        return _refuse(error)
    # The first Ctrl-C raises an exception, which waits for C code to return.
    watch = SignalWatch(END_SIGNALS, INTERRUPTED)
    watch.start()
    try:
        status = options.run(options)
        # What is left in the buffer may find no reader, either.
        sys.stdout.flush()
        return status
    except TpControllerError as error:
        return _refuse(error)
    except BrokenPipeError:
        if not _output_closed():
            raise
        return OUTPUT_CLOSED
    except ModuleNotFoundError as error:
        return _report_missing(error)
    except KeyboardInterrupt:
        print('tp_controller: interrupted', file=sys.stderr)
        return INTERRUPTED
    finally:
        watch.close()


def _output_closed() -> bool:
    """Return whether the reader of the output has ended, as head does; drop what it left."""
    output, pipe = sys.stdout.fileno(), select.poll()
    pipe.register(output, 0)
    if not any(events & select.POLLERR for _, events in pipe.poll(0)):
        return False
    # The rest would be flushed at exit.
    os.dup2(os.open(os.devnull, os.O_WRONLY), output)
    return True


def controller_node() -> int:
    """Run the controller node; see `tp_controller.ros.controller_node`."""
    return _node('controller_node')


def simulator_node() -> int:
    """Run the simulator node; see `tp_controller.ros.simulator_node`."""
    return _node('simulator_node')


def watchdog_node() -> int:
    """Run the watchdog node; see `tp_controller.ros.watchdog_node`."""
    return _node('watchdog_node')


def viewer_node() -> int:
    """Run the viewer node; see `tp_controller.tools.view.viewer_node`."""
    return _node('viewer_node', 'tools.view')


def teleop_node() -> int:
    """Run the teleop node; see `tp_controller.tools.teleop.teleop_node`."""
    return _node('teleop_node', 'tools.teleop')


def _node(name: str, part: str = 'ros') -> int:
    """Run a node, whose module imports ROS."""
    try:
        module = importlib.import_module(f'tp_controller.{part}.{name}')
    except TpControllerError as error:
        return _refuse(error)
    except ModuleNotFoundError as error:
        return _report_missing(error)
    return module.main()


def _refuse(error: TpControllerError) -> int:
    """Print an error; return the exit status, 2 for an unavailable solver."""
    print(f'tp_controller: {plain(str(error), LONGEST_PRINTED_ERROR, lines=True)}',
          file=sys.stderr)
    return 2 if isinstance(error, SolverError) else 1


def _report_missing(error: ModuleNotFoundError) -> int:
    """Print the missing optional package and its installation; return the exit status."""
    package = (error.name or '').partition('.')[0]
    if package in ('', 'tp_controller'):
        raise error
    hint = next((f'{reason}: {install_command(extra)}'
                 for packages, (reason, extra) in EXTRAS.items() if package in packages),
                f'this needs ROS 2: source its setup file, or {install_command("ros")}')
    print(f'tp_controller: {package} is missing; {hint}', file=sys.stderr)
    return 1


def _mark_numbers(arguments: Sequence[str]) -> list[str]:
    """Return arguments with a space before negative numbers: else -1e-3 is an option."""
    return [f' {text}' if text.startswith('-') and _is_number(text) else text
            for text in arguments]


def _is_number(text: str) -> bool:
    """Return whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


class _Version(argparse.Action):
    """Action that prints the version, determined only on demand."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS,
                         help="show program's version number and exit")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print the version and the active solver, and exit."""
        from tp_controller.solver.compiled import fallback_reason, running
        try:
            print(f'{version("tp_controller")}, solver: {running()}')
        except PackageNotFoundError:
            print('not installed')
        if fallback_reason():
            print(f'tp_controller: {fallback_reason()}', file=sys.stderr)
        parser.exit()


if __name__ == '__main__':
    sys.exit(main())
