# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller demo``: a demonstration, with its table and figures."""

import argparse
from functools import partial
import os
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from tp_controller.ros.middleware import set_up_fast_dds
from tp_controller.tools.cli.command import Command
from tp_controller.tools.cli.values import whole_number
from tp_controller.tools.demos.startup import report_if_slow

if TYPE_CHECKING:  # Imported when a demo runs: the figures take a second.
    from tp_controller.tools.demos.outcome import Outcome

# The same as in tp_controller.tools.demos.outcome and tp_controller.ros.declarations.controller,
# whose imports take a second.
FILM, NO_FILM = 'TP_CONTROLLER_FILM', 'none'
OUTPUTS = ('velocity', 'position', 'trajectory')
DEMOS = {
    'panda': 'a 7-DoF arm over ROS 2 topics (default)',
    'mobile': 'an arm on wheels carries a tray past obstacles',
    'underwater': 'a vehicle with an arm works on a panel',
    'two_arms': 'two hands carry one object',
    'drill': 'drilling, five rows, above inequality tasks',
    'failed_joint': 'a joint fails in motion, the tool arrives all the same',
    'lab1': 'null-space motion',
    'lab2': 'two tasks in both orders',
    'camera': 'a camera on five joints',
    'bounds': 'inequality tasks switch on and off',
    'weights': 'vehicle and arm share the motion',
    'forms': 'recursive and sequential form at a singularity',
}
OVER_ROS = ('panda', 'mobile', 'underwater', 'two_arms')
# Demo of `tp_controller view` without an end.
INTERACTIVE_DEMO = 'conflict'
EXAMPLES = """\
examples:
  tp_controller demo                         figures and film go to ./tp_demo/panda
  tp_controller demo --output figures
  tp_controller demo --no-film               no film: done as soon as the goals are
  tp_controller demo underwater              a vehicle with an arm, beside a riser
  tp_controller demo --view                  the same, live on a page in the browser, too
  tp_controller demo --commands position     the controller commands positions
  tp_controller demo lab2 --seed 3           exercise 2 of the lab with other random goals

The demos panda, mobile, underwater and two_arms start a controller and a simulator of their own,
which talk on this machine only, in a ROS domain of their own. The others need no ROS.
"""


def add_demo_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument('name', nargs='?', default='panda', choices=tuple(DEMOS), type=_demo,
                        help='; '.join(f'{name}: {text}' for name, text in DEMOS.items()))
    parser.add_argument('--output', type=Path, default=Path('tp_demo'), metavar='FOLDER',
                        help='where the folder with the figures goes, which has the name '
                        'of the demo (default: ./tp_demo)')
    parser.add_argument('--seed', type=whole_number, default=1,
                        help='seed of the random goals of lab2 (default: 1)')
    parser.add_argument('--commands', default='velocity', choices=OUTPUTS,
                        help='what the controller commands in demos over ROS 2: joint velocities, '
                        'or positions, alone or as trajectories (default: velocity)')
    parser.add_argument('--view', action='store_true',
                        help='show it on a page in the browser while it runs, too (demos over '
                        'ROS 2)')
    parser.add_argument('--no-film', dest='film', action='store_false',
                        help='draw no film, which needs a Chromium: the figures are there at once')


def run_demo(options: argparse.Namespace) -> int:
    """Run the named demonstration."""
    # Each demo has its own folder, or it would overwrite the figures of another.
    folder = options.output / options.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        print(f'tp_controller: --output: {error}', file=sys.stderr)
        return 2
    if not options.film:
        # All demos read this variable.
        os.environ[FILM] = NO_FILM
    if options.name not in OVER_ROS:
        outcome = _simulate(options.name, folder, options.seed)
        print(outcome)
        passed = outcome.passed
    else:
        with report_if_slow('importing the demo', partial(print, flush=True)):
            from tp_controller.tools.demos.ros_demos import run_demo as run_over_ros
            from tp_controller.tools.demos.scenarios import DEMOS as ROS_DEMOS
        set_up_fast_dds()
        passed = run_over_ros(ROS_DEMOS[options.name], folder, options.view,
                              options.commands)
    return 0 if passed else 1


def _simulate(name: str, folder: Path, seed: int) -> 'Outcome':
    """Return the outcome of a demo without ROS."""
    # Imported here: the figures take a second to import, and goals do not need them.
    from tp_controller.tools.demos.drill import drill
    from tp_controller.tools.demos.lab import lab1, lab2
    from tp_controller.tools.demos.scene import play
    from tp_controller.tools.demos.scenes import SCENES
    if name in SCENES:
        return play(name, SCENES[name](), folder)
    if name == 'lab2':
        return lab2(folder, seed)
    return {'drill': drill, 'lab1': lab1}[name](folder)


def _demo(text: str) -> str:
    """Parse the name of a demo."""
    if text == INTERACTIVE_DEMO:
        raise argparse.ArgumentTypeError(f'{text} is interactive: tp_controller view --demo '
                                         f'{text}')
    return text


COMMAND = Command(
    'run a demonstration and write its figures',
    'Run a demonstration, print a table and write figures.',
    EXAMPLES, add_demo_arguments, run_demo)
