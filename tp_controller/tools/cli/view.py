# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller view``: a running controller, or a demo, on a page in the browser."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
import os
from pathlib import Path
import shlex
import shutil
import sys
import tempfile
from typing import NoReturn, TYPE_CHECKING

from tp_controller.errors import TpControllerError
from tp_controller.resources import load_yaml, package_share
from tp_controller.ros.middleware import set_up_fast_dds
from tp_controller.tools.cli.command import Command
from tp_controller.tools.cli.demo import DEMOS as ALL_DEMOS
from tp_controller.tools.cli.demo import OUTPUTS
from tp_controller.tools.demos.processes import (
    ended_by_sigterm,
    NodeProcess,
    own_domain,
    start_nodes,
)
from tp_controller.tools.demos.startup import end_of, missing, report_if_slow, Startup

if TYPE_CHECKING:  # Imported with the page: other commands need neither it nor ROS.
    from tp_controller.tools.demos.scenarios import Goal
    import viser
    Step = Goal | list[Goal]

LOCAL = '127.0.0.1'
CONTROLLER = 'tp_controller'
# {name: parameter file of the nodes}
DEMOS = {'panda': 'demo', 'conflict': 'conflict', 'mobile': 'mobile', 'underwater': 'underwater',
         'two_arms': 'two_arms', 'camera': 'camera', 'bounds': 'bounds'}
# Demos that are computed without nodes, and played.
PLAYED = ('weights', 'forms', 'failed_joint')
LESSONS = ('camera', 'bounds', *PLAYED)
# Timeout of the response to a goal, on a busy machine [s].
GOAL_RESPONSE_SECONDS = 120.0
# Demos of `tp_controller demo` alone.
WITHOUT_PAGE = tuple(name for name in ALL_DEMOS if name not in (*DEMOS, *PLAYED))
# Variables that connect another terminal to the nodes of a demo.
DOMAIN = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
# Keys of a goal in a file that are also options of `tp_controller goal`.
GOAL_OPTIONS = ('xyz', 'rpy', 'linear', 'angular', 'for')
EXAMPLES = """\
examples:
  tp_controller view                         the Panda demo, on a page at http://127.0.0.1:8080
  tp_controller view --demo conflict         two tasks in conflict: exchange them on the page
  tp_controller view --demo failed_joint     a lesson: question, answer, and runs that are played
  tp_controller view --node tp_controller    a controller that runs already
  tp_controller view --node left/tp_controller --port 9000
"""


def add_view_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument('--node', help='name of the controller node, with its namespace, that is '
                       'shown (default: a demo is started)')
    shown.add_argument('--demo', choices=(*DEMOS, *PLAYED), type=_demo, default='panda',
                       help='the demo that is started (default: panda)')
    parser.add_argument('--commands', default='velocity', choices=OUTPUTS,
                        help='what the controller of a demo with nodes commands: joint '
                        'velocities, or positions, alone or as trajectories (default: velocity)')
    parser.add_argument('--host', default=LOCAL,
                        help='address that the page is shown at (default: 127.0.0.1, which only '
                        'this machine can reach; whoever can reach it can move the robot)')
    parser.add_argument('--port', type=_port, default=0,
                        help='port of the page (default: the first that is free from 8080 on)')


def show_view(options: argparse.Namespace) -> NoReturn:
    """
    Show the page until Ctrl-C.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the arguments that `add_view_arguments` adds.

    Raises
    ------
    TpControllerError
        The port is taken, the address is not one of this machine, or a node of the demo does
        not start.

    """
    if options.node is None and options.demo in PLAYED and options.commands != OUTPUTS[0]:
        raise TpControllerError(f'--commands: {options.demo} is computed without nodes')
    set_up_fast_dds()
    with report_if_slow('importing the page', _tell):
        from tp_controller.tools.view.server import address, exposure, open_server
    with ExitStack() as stack:
        server = open_server(options.host, options.port)
        stack.callback(server.stop)
        print(f'page: {address(server)}  (Ctrl-C ends it)', flush=True)
        if exposure(options.host):
            print(f'warning: {exposure(options.host)}', file=sys.stderr)
        if options.node is None:
            _show_lesson(server, options.demo)
        goals: 'list[Step]' = []
        nodes: list[NodeProcess] = []
        if options.node is None:
            nodes = _start_demo(stack, _file(options.demo, ''), options.commands)
            goals = load_yaml(_file(options.demo, '_goals').read_text())
            print(_how_to_send(_at_once(goals[-1])[0]), flush=True)
        _show(stack, server, options.node or CONTROLLER, nodes,
              _at_once(goals[0]) if goals else [])


def _show_lesson(server: 'viser.ViserServer', name: str) -> None:
    """Show the question of a demo; play its runs until Ctrl-C if it has no nodes."""
    if name not in LESSONS:
        return
    with report_if_slow('importing the demo', _tell):
        from tp_controller.tools.demos.scene_page import add_question, show_scene
        from tp_controller.tools.demos.scenes import SCENES
    scene = SCENES[name]()
    if name in PLAYED:
        show_scene(server, scene)
    add_question(server.gui, scene)


def _start_demo(stack: ExitStack, parameters: Path, output: str) -> list[NodeProcess]:
    """Start the nodes of a demo in their own ROS domain."""
    all_started = stack.enter_context(ended_by_sigterm())
    environment = stack.enter_context(own_domain())
    # The page runs in this process, which must be in the same domain.
    os.environ.update(environment)
    nodes = start_nodes(stack, parameters, environment, stack.enter_context(_log_folder()),
                        output)
    all_started()
    return nodes


@contextmanager
def _log_folder() -> Iterator[Path]:
    """Create a folder, which is kept if an error names a file in it."""
    folder = Path(tempfile.mkdtemp(prefix='tp_view_'))
    needed = False
    try:
        yield folder
    except TpControllerError:
        needed = True
        raise
    finally:
        if not needed:
            shutil.rmtree(folder)


def _file(demo: str, ending: str) -> Path:
    """Return the file of a demo with an ending of the name."""
    return package_share() / 'config' / f'{DEMOS[demo]}{ending}.yaml'


def _at_once(step: 'Step') -> 'list[Goal]':
    """Return the goals of a step, which is one goal or several."""
    return step if isinstance(step, list) else [step]


def _how_to_send(goal: 'Goal') -> str:
    """Return the shell commands that send a goal from another terminal."""
    words = [*_this_command(), 'goal', goal['task']]
    for key in GOAL_OPTIONS:
        if key in goal:
            values = goal[key] if isinstance(goal[key], list) else [goal[key]]
            words += [f'--{key}', *map(str, values)]
    variables = ' '.join(f'{name}={shlex.quote(os.environ[name])}' for name in DOMAIN)
    return ('to send goals, paste into another terminal:\n'
            f'  export {variables}\n  {shlex.join(words)}')


def _this_command() -> list[str]:
    """Return the words that run this command in any folder and environment."""
    if os.path.basename(sys.argv[0]) == 'tp_controller':
        return [os.path.abspath(sys.argv[0])]
    return [sys.executable, '-m', 'tp_controller']


def _show(stack: ExitStack, server: 'viser.ViserServer', controller: str,
          nodes: Sequence[NodeProcess], goals: 'list[Goal]') -> NoReturn:
    """Show a controller on the page of a server, and send goals once its nodes run."""
    # The startup time includes the following imports.
    startup = Startup(nodes, _tell)
    with report_if_slow('importing the client', _tell):
        from tp_controller.ros.client.client import Client
        from tp_controller.tools.demos.scenarios import goal_fields
        from tp_controller.tools.view.link import Link
        from tp_controller.tools.view.page import Page
    client = stack.enter_context(Client(controller))
    page = Page(server, Link(client))
    if nodes:
        startup.wait(lambda: missing(client), page.turn)
    for goal in goals:
        client.send(goal['task'], wait=GOAL_RESPONSE_SECONDS, **goal_fields(goal))
    alive = list(nodes)
    while True:
        page.turn()
        for node in [node for node in alive if not node.running()]:
            alive.remove(node)
            print(end_of(node), file=sys.stderr, flush=True)


def _tell(line: str) -> None:
    """Print a line, unbuffered."""
    print(line, flush=True)


def _demo(text: str) -> str:
    """Parse the name of a demo."""
    if text in WITHOUT_PAGE:
        raise argparse.ArgumentTypeError(f'{text} is computed without nodes, with a film in place '
                                         f'of a page: tp_controller demo {text}')
    return text


def _port(text: str) -> int:
    """Parse a port number."""
    if not text.isdecimal() or not 1 <= int(text) <= 65535:
        raise argparse.ArgumentTypeError(f'{text!r} is not a port: a whole number from 1 to 65535')
    return int(text)


COMMAND = Command(
    'show and operate a controller on a page in the browser',
    'Show a controller on a page in the browser: the robot, goals that can be dragged, the '
    'stack, plots. Without --node a demo is started, too.',
    EXAMPLES, add_view_arguments, show_view)
