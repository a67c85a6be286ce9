# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller teleop``: a task driven with the keyboard."""

import argparse
import sys
import time
from typing import TYPE_CHECKING

from tp_controller.ros.middleware import set_up_fast_dds
from tp_controller.tools.cli.command import Command
from tp_controller.tools.cli.values import positive_number
from tp_controller.untrusted.texts import plain

if TYPE_CHECKING:  # Imported with the first key: the help needs no ROS.
    from tp_controller.ros.client.client import Client
    from tp_controller.tools.teleop.key_map import KeyMap
    from tp_controller.tools.teleop.keyboard import Keyboard

# Entry of the parameter file.
TELEOP = 'tp_teleop'
# Time between two twists [s].
TWIST_PERIOD = 0.02
# Carriage return, and erase to the end of the line.
NEW_LINE = '\r\x1b[K'
# Columns of the line of the status.
STATUS_COLUMNS = 79
ZERO = (0.0, 0.0, 0.0)
EXAMPLES = """examples:
  tp_controller teleop carry                        along the axes of the reference of the task
  tp_controller teleop carry --frame panda_hand_tcp --linear 0.05
  tp_controller teleop carry --keys azerty.yaml     other keys

A key moves for 0.15 s, and for as long as it is repeated while it is pressed.
"""


def add_teleop_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument('task', help='name of a task of the type twist')
    parser.add_argument('--keys', metavar='FILE',
                        help='parameter file with other keys, speeds or times than '
                        'config/teleop/keyboard.yaml of this package')
    parser.add_argument('--linear', type=positive_number, metavar='SPEED',
                        help='speed of the keys [m/s] (default: 0.1, or that of the file)')
    parser.add_argument('--angular', type=positive_number, metavar='SPEED',
                        help='angular speed of the keys [rad/s] (default: 0.5, or that of the '
                        'file)')
    parser.add_argument('--frame',
                        help='frame of the robot along whose axes the keys move (default: the '
                        'reference of the task)')
    parser.add_argument('--node', default='tp_controller',
                        help='name of the controller node, with its namespace')
    parser.add_argument('--wait', type=positive_number, default=10.0, metavar='SECONDS',
                        help='how long to look for the controller (default: 10)')


def drive_by_keys(options: argparse.Namespace) -> int:
    """
    Drive a task with the keys of the terminal, until q or Ctrl-C.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the arguments that `add_teleop_arguments` adds.

    Returns
    -------
    int
        0.

    Raises
    ------
    TpControllerError
        The file of the keys is faulty, or there is no terminal, no such controller or task, or
        the task takes no twists.

    """
    set_up_fast_dds()
    from tp_controller.ros.client.client import Client
    from tp_controller.tools.teleop.keyboard import Keyboard, keys_of
    keys, terminal = _keys(options), sys.stdin.fileno()
    with keys_of(terminal), Client(options.node) as client:
        # The answer tells whether the task takes twists in this frame.
        client.send(options.task, keys.frame, options.wait, linear=ZERO, angular=ZERO)
        print(keys.text, flush=True)
        try:
            _drive(client, options.task, keys.frame, Keyboard(keys), terminal)
        except KeyboardInterrupt:
            pass
        finally:
            # The zeros of the beginning, acknowledged before the client closes.
            client.repeat()
            print(flush=True)
    return 0


def _keys(options: argparse.Namespace) -> 'KeyMap':
    """Return the keys of the file, with the speeds and the frame of the arguments."""
    from tp_controller.tools.check.parameter_file import node_parameters
    from tp_controller.tools.teleop.key_map import key_map, KEYBOARD
    given = {'linear': options.linear, 'angular': options.angular, 'frame': options.frame}
    return key_map(node_parameters(options.keys or KEYBOARD, TELEOP))._replace(
        **{name: value for name, value in given.items() if value is not None})


def _drive(client: 'Client', task: str, frame: str, keyboard: 'Keyboard', terminal: int) -> None:
    """Send twists until a key ends the command."""
    from tp_controller.tools.teleop.keyboard import read_keys
    from tp_controller.tools.teleop.messages import twist_message
    shown = ''
    while True:
        keys = read_keys(terminal, TWIST_PERIOD)
        now = time.monotonic()
        if keys is None or not all(keyboard.press(key, now) for key in keys):
            return
        twist = keyboard.drive.command(now)
        if twist is not None:
            client.publish(task, 'twist', twist_message(twist, frame))
        client.catch_up()
        text = _status(client, task, keyboard, now)
        if text != shown:
            print(NEW_LINE + text, end='', flush=True)
            shown = text


def _status(client: 'Client', task: str, keyboard: 'Keyboard', now: float) -> str:
    """Return the state of keys and task in one line."""
    scaling = keyboard.drive.scaling
    state = 'driving' if keyboard.drive.closed(now) else 'waiting for a key'
    outcome = client.stop_reason() or client.task_status(task).reason
    line = f'{scaling.linear:.3f} m/s, {scaling.angular:.2f} rad/s  {state}  {outcome}'
    return plain(line.rstrip())[:STATUS_COLUMNS]


COMMAND = Command(
    'drive a task of a running controller with the keyboard',
    'Drive a task of the type twist with the keys of this terminal.',
    EXAMPLES, add_teleop_arguments, drive_by_keys)
