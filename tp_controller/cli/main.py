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

"""The command ``tp_controller``."""

# argcomplete looks for this line: PYTHON_ARGCOMPLETE_OK
import argparse
from collections.abc import Sequence
from enum import Enum
import importlib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
import sys
from textwrap import wrap
from types import ModuleType
from typing import NoReturn

import argcomplete
from tp_controller.cli.check import add_check_arguments, run_check
from tp_controller.cli.goal import add_goal_arguments, send_goal
from tp_controller.cli.plot import add_plot_arguments, plot
from tp_controller.cli.plot import EXAMPLES as PLOT_EXAMPLES
from tp_controller.cli.record import add_record_arguments, record
from tp_controller.cli.record import EXAMPLES as RECORD_EXAMPLES
from tp_controller.cli.status import add_status_arguments, show_status
from tp_controller.cli.view import add_view_arguments, show_view
from tp_controller.errors import TpControllerError
from tp_controller.nodes.discovery import announce_often

EXAMPLES = """\
examples:
  tp_controller demo                     a 7-DoF arm carries out a stack of tasks, over ROS 2
  tp_controller demo mobile              an arm on wheels carries a tray past obstacles
  tp_controller demo drill               drilling, and what the other joints do besides
  tp_controller demo lab1                motion in the null space of a planar arm, no ROS needed
  tp_controller goal tool --xyz 0.4 0.2 0.5 --rpy 180 0 0 --deg
  tp_controller goal --help              how to send goals of every kind
  tp_controller status                   what the tasks of running controllers do
  tp_controller check --help             what is wrong with a stack, before a robot moves
  tp_controller view                     a robot in the browser, to pull about
  tp_controller record run               what they do, to files
  tp_controller plot run                 plots and a report of a recording
"""
HELP_WIDTH = 95
# {optional packages: what is said where one is missing}
CURES = {
    ('matplotlib', 'mpl_toolkits', 'PIL'): "the figures need it: pip install '.[plots]'",
    ('viser', 'trimesh', 'websockets'): "the page needs it: pip install '.[view]'",
    ('rosbags', 'lz4', 'backports'): "recordings need it: pip install '.[record]'",
    ('joblib',): "more than one job needs it: pip install '.[check]'",
    ('dask', 'distributed'): "the backend dask needs it: pip install 'dask[distributed]'",
    ('ray',): 'the backend ray needs it: pip install ray',
}
DEMOS = {
    'panda': 'a 7-DoF arm over ROS 2 topics (default)',
    'mobile': 'an arm on wheels carries a tray past obstacles',
    'underwater': 'a vehicle with an arm works on a panel',
    'two_arms': 'two hands carry one object',
    'drill': 'drilling, five rows, above inequality tasks',
    'lab1': 'null-space motion',
    'lab2': 'two tasks in both orders',
}
DEMO_EXAMPLES = """\
examples:
  tp_controller demo                         figures and film go to ./tp_demo/panda
  tp_controller demo --output figures
  tp_controller demo underwater              a vehicle with an arm, beside a riser
  tp_controller demo --view                  the same, live on a page in the browser, too
  tp_controller demo lab2 --seed 3           exercise 2 of the lab with other random goals

The demos panda, mobile, underwater and two_arms start a controller and a simulator of their own,
which talk on this machine only, in a ROS domain of their own. drill, lab1 and lab2 need no ROS.
"""
GOAL_EXAMPLES = """\
examples:
  tp_controller goal tool --xyz 0.4 0.2 0.5 --rpy 180 0 0 --deg
  tp_controller goal tool --xyz 0 0 0.1 --quat 0 0 0 1 --frame panda_hand_tcp
  tp_controller goal elbow --xyz 0 0 0.6 --reach 10
  tp_controller goal posture --joint panda_joint4=-2.0 --joint panda_joint6=1.8
  tp_controller goal posture --joint panda_joint4=-115 --deg
  tp_controller goal swing --velocity joint1=0.3 --for 2
  tp_controller goal carry --linear 0.1 0 0 --for 3

The same with the ros2 command:
  ros2 topic pub --once /tp_controller/elbow/goal geometry_msgs/msg/PointStamped \\
      "{point: {x: 0.0, y: 0.0, z: 0.6}}"
"""
CHECK_EXAMPLES = """\
examples:
  tp_controller check stack.yaml --robot robot.urdf --rate 200
  tp_controller check --params-file package://tp_controller/config/demo.yaml
  tp_controller check stack.yaml --robot robot.urdf --base differential --runs 100 --jobs -1
  tp_controller check --params-file controller.yaml --strict --json check.json --html check.html

Exit status: 0 nothing is wrong, 1 something is, 2 an argument is not valid.
"""
STATUS_EXAMPLES = """\
examples:
  tp_controller status                       all controllers, until Ctrl-C
  tp_controller status --once                one table
  tp_controller status --node left/tp_controller --node right/tp_controller
"""
VIEW_EXAMPLES = """\
examples:
  tp_controller view                         the Panda demo, on a page at http://127.0.0.1:8080
  tp_controller view --demo conflict         two tasks in conflict: exchange them on the page
  tp_controller view --node tp_controller    a controller that runs already
  tp_controller view --node left/tp_controller --port 9000
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='tp_controller', epilog=EXAMPLES,
        description='Prioritized velocity control of redundant robots.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--version', action=_Version)
    commands = parser.add_subparsers(dest='command', required=True, metavar='command')
    demo = commands.add_parser(
        'demo', help='run a demonstration and write its figures', epilog=DEMO_EXAMPLES,
        description='Run a demonstration, print a table and write figures.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    demo.add_argument('name', nargs='?', default='panda',
                      choices=tuple(DEMOS),
                      help='; '.join(f'{name}: {what}' for name, what in DEMOS.items()))
    demo.add_argument('--output', type=Path, default=Path('tp_demo'), metavar='FOLDER',
                      help='where the folder with the figures goes, which has the name '
                      'of the demo (default: ./tp_demo)')
    demo.add_argument('--seed', type=_seed, default=1,
                      help='seed of the random goals of lab2 (default: 1)')
    demo.add_argument('--view', action='store_true',
                      help='show it on a page in the browser while it runs, too (demos over '
                      'ROS 2)')
    demo.set_defaults(run=_demo)
    goal = commands.add_parser(
        'goal', help='send a goal to a task of a running controller', epilog=GOAL_EXAMPLES,
        description='Send a goal to a task of a running controller. What the task takes decides '
        'the message: a point needs --xyz, an orientation --rpy or --quat, a pose both.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    add_goal_arguments(goal)
    goal.set_defaults(run=send_goal)
    status = commands.add_parser(
        'status', help='show what running controllers do, live', epilog=STATUS_EXAMPLES,
        description='Show the tasks of running controllers, until Ctrl-C: how far each is from '
        'its goal, and what limits it.', formatter_class=argparse.RawDescriptionHelpFormatter)
    add_status_arguments(status)
    status.set_defaults(run=show_status)
    check = commands.add_parser(
        'check', help='say what is wrong or doubtful with a stack, before a robot moves',
        epilog=CHECK_EXAMPLES, description='Say what is wrong or doubtful with a stack, before a '
        'robot moves: at random configurations, then in closed loops with random starts and '
        'goals. No ROS is needed.', formatter_class=argparse.RawDescriptionHelpFormatter)
    add_check_arguments(check)
    check.set_defaults(run=run_check)
    view = commands.add_parser(
        'view', help='show a controller on a page in the browser, and change what it does',
        epilog=VIEW_EXAMPLES, description='Show a controller on a page in the browser: the robot, '
        'goals that can be dragged, the stack, plots. Without --node a demo is started, too.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    add_view_arguments(view)
    view.set_defaults(run=show_view)
    recording = commands.add_parser(
        'record', help='record what running controllers do', epilog=RECORD_EXAMPLES,
        description='Record all topics of running controllers, until Ctrl-C, to a folder that '
        'ros2 bag, PlotJuggler, Foxglove and tp_controller plot read.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    add_record_arguments(recording)
    recording.set_defaults(run=record)
    plots = commands.add_parser(
        'plot', help='draw what was recorded', epilog=PLOT_EXAMPLES,
        description='Draw the plots of a recording: errors with what limits the tasks, velocities '
        'against their limits, the path of the tool; and write a report that has all of them in '
        'one HTML file, with the motion to be replayed.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    add_plot_arguments(plots)
    plots.set_defaults(run=plot)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command line.

    Parameters
    ----------
    arguments : list of str, optional
        Those of the process by default.

    Returns
    -------
    int
        0 for success, 1 for failure, 2 for arguments that are not valid.

    """
    parser = make_parser()
    argcomplete.autocomplete(parser)
    options = parser.parse_args(
        _mark_numbers(sys.argv[1:] if arguments is None else arguments))
    try:
        return options.run(options)
    except TpControllerError as error:
        print(f'tp_controller: {error}', file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        return _lacks(error)
    except KeyboardInterrupt:
        print('tp_controller: interrupted', file=sys.stderr)
        return 130


def controller_node() -> int:
    """Run the controller node; see `tp_controller.nodes.controller_node`."""
    return _node('controller_node')


def simulator_node() -> int:
    """Run the simulator node; see `tp_controller.nodes.simulator_node`."""
    return _node('simulator_node')


def watchdog_node() -> int:
    """Run the watchdog node; see `tp_controller.nodes.watchdog_node`."""
    return _node('watchdog_node')


def viewer_node() -> int:
    """Run the viewer node; see `tp_controller.view.viewer_node`."""
    return _node('viewer_node', 'view')


def _node(name: str, part: str = 'nodes') -> int:
    """Run a node, whose module needs ROS already to be imported."""
    try:
        module = importlib.import_module(f'tp_controller.{part}.{name}')
    except ModuleNotFoundError as error:
        return _lacks(error)
    if {'-h', '--help'} & set(sys.argv[1:]):
        print(_node_help(name, module))
        return 0
    announce_often()
    return module.main()


def _node_help(name: str, module: ModuleType) -> str:
    """Return how a node is started, and its parameters."""
    lines = [f'usage: {name} [--ros-args -p NAME:=VALUE --params-file FILE -r FROM:=TO ...]', '',
             *wrap((module.__doc__ or '').strip(), HELP_WIDTH), '', 'parameters:']
    for spec in module.PARAMETERS:
        default = '' if isinstance(spec.default, Enum) or spec.default == '' \
            else f' (default: {spec.default})'
        unit = f' [{spec.unit}]' if spec.unit else ''
        indent = ' ' * 6
        lines += [f'  {spec.name}', *wrap(spec.description + unit + default, HELP_WIDTH,
                                          initial_indent=indent, subsequent_indent=indent)]
    return '\n'.join(lines)


def _lacks(error: ModuleNotFoundError) -> int:
    """Say which optional package is missing and how to get it; return the exit status."""
    package = (error.name or '').partition('.')[0]
    if package in ('', 'tp_controller'):
        raise error
    cure = next((cure for packages, cure in CURES.items() if package in packages),
                "this needs ROS 2: source its setup file, or pip install '.[ros]'")
    print(f'tp_controller: {package} is missing; {cure}', file=sys.stderr)
    return 1


def _seed(text: str) -> int:
    """Return a seed of the command line."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 0 on')
    return int(text)


def _mark_numbers(arguments: Sequence[str]) -> list[str]:
    """Return arguments, negative numbers with a space: argparse takes -1e-3 for an option."""
    return [f' {text}' if text.startswith('-') and _is_number(text) else text
            for text in arguments]


def _is_number(text: str) -> bool:
    """Say whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


class _Version(argparse.Action):
    """Prints the version, which takes time to find out."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS,
                         help="show program's version number and exit")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print it, and which solver runs, and end."""
        from tp_controller.solver.compiled import running
        try:
            print(f'{version("tp_controller")}, solver: {running()}')
        except PackageNotFoundError:
            print('not installed')
        parser.exit()


def _demo(options: argparse.Namespace) -> int:
    """Run the demonstration that was named."""
    # Each in a folder of its own, or one would write over the pictures of another.
    folder = options.output / options.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        print(f'tp_controller: --output: {error}', file=sys.stderr)
        return 2
    # Imported here: figures take a second to import, and goals do not need them.
    if options.name == 'drill':
        from tp_controller.demos.drill import drill
        passed = drill(folder)
    elif options.name in ('lab1', 'lab2'):
        from tp_controller.demos.lab import lab1, lab2
        passed = lab1(folder) if options.name == 'lab1' else lab2(folder, options.seed)
    else:
        from tp_controller.demos.ros_demos import run_demo
        from tp_controller.demos.scenarios import DEMOS as ROS_DEMOS
        announce_often()
        passed = run_demo(ROS_DEMOS[options.name], folder, options.view)
    return 0 if passed else 1


if __name__ == '__main__':
    sys.exit(main())
