# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller goal``: a goal message for a task."""

import argparse
import math
import sys
import time
from typing import Any, TYPE_CHECKING

from tp_controller.control.units import with_unit
from tp_controller.model.rpy import quaternion_from_rpy
from tp_controller.ros.middleware import set_up_fast_dds
from tp_controller.tools.cli.command import Command
from tp_controller.tools.cli.goal_way import add_way_arguments, is_way, way, way_fault
from tp_controller.tools.cli.values import assignment, finite_number, positive_number

if TYPE_CHECKING:  # Imported when a goal is sent: the help needs no ROS.
    from tp_controller.ros.client.client import Client

# Period of repeated velocities, which time out at the controller [s].
VELOCITY_REPEAT_SECONDS = 0.05
TURN = 2.0 * math.pi
# {part of a goal: option}
OPTIONS = {'xyz': '--xyz', 'quat_xyzw': '--rpy/--quat', 'joints': '--joint',
           'velocities': '--velocity', 'linear': '--linear', 'angular': '--angular'}
EXAMPLES = """\
examples:
  tp_controller goal tool --xyz 0.4 0.2 0.5 --rpy 180 0 0 --deg
  tp_controller goal tool --xyz 0 0 0.1 --quat 0 0 0 1 --frame panda_hand_tcp
  tp_controller goal elbow --xyz 0 0 0.6 --reach 10
  tp_controller goal posture --joint panda_joint4=-2.0 --joint panda_joint6=1.8
  tp_controller goal posture --joint panda_joint4=-115 --deg
  tp_controller goal swing --velocity joint1=0.3 --for 2
  tp_controller goal carry --linear 0.1 0 0 --for 3
  tp_controller goal elbow --xyz 0 0.1 0.6 --speed 0.1
  tp_controller goal elbow --via 0 0.1 0.6 --via 0 0.1 0.5 --xyz 0 0 0.6 --speed 0.1
  tp_controller goal tool --file poses.csv --speed 0.1

The same with the ros2 command:
  ros2 topic pub --once /tp_controller/elbow/goal geometry_msgs/msg/PointStamped \\
      "{point: {x: 0.0, y: 0.0, z: 0.6}}"
"""


def add_goal_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument('task', help='name of the task in the stack')
    parser.add_argument('--xyz', nargs=3, type=finite_number, metavar=('X', 'Y', 'Z'),
                        help='position [m], or direction')
    turn = parser.add_mutually_exclusive_group()
    turn.add_argument('--rpy', nargs=3, type=finite_number, metavar=('R', 'P', 'Y'),
                      help='orientation as roll, pitch, yaw [rad]')
    turn.add_argument('--quat', nargs=4, type=finite_number, metavar=('X', 'Y', 'Z', 'W'),
                      help='orientation as a quaternion')
    parser.add_argument('--joint', action='append', type=assignment, metavar='NAME=VALUE',
                        help='joint position [rad or m]; once for each joint')
    parser.add_argument('--velocity', action='append', type=assignment, metavar='NAME=VALUE',
                        help='joint velocity [rad/s or m/s]; once for each joint')
    parser.add_argument('--linear', nargs=3, type=finite_number, metavar=('X', 'Y', 'Z'),
                        help='linear velocity [m/s]')
    parser.add_argument('--angular', nargs=3, type=finite_number, metavar=('X', 'Y', 'Z'),
                        help='angular velocity [rad/s]')
    add_way_arguments(parser)
    parser.add_argument('--deg', action='store_true',
                        help='angles are in degrees, of --rpy and --angular, and of joints that '
                        'turn')
    parser.add_argument('--frame', default='',
                        help='frame the goal is expressed in (default: the reference frame of '
                        'the task)')
    parser.add_argument('--for', dest='repeat', type=positive_number, metavar='SECONDS',
                        help='repeat the goal for so long: velocities time out')
    parser.add_argument('--reach', type=positive_number, metavar='SECONDS',
                        help='wait until the goal is reached, at most so long; the exit status '
                        'tells whether it was')
    parser.add_argument('--node', default='tp_controller',
                        help='name of the controller node (default: tp_controller)')
    parser.add_argument('--wait', type=positive_number, default=10.0, metavar='SECONDS',
                        help='how long to look for the controller (default: 10)')


def send_goal(options: argparse.Namespace) -> int:
    """
    Send a goal.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the arguments that `add_goal_arguments` adds.

    Returns
    -------
    int
        0; 1 if the goal was not reached in time; 2 if no goal is given.

    Raises
    ------
    GoalError
        The controller or task does not exist, or the task needs other goal parts.

    """
    fault = _fault(options)
    if fault:
        print(f'tp_controller goal: {fault}', file=sys.stderr)
        return 2
    set_up_fast_dds()
    from tp_controller.ros.client.client import Client
    with Client(options.node, names=OPTIONS) as client:
        goal = _fields(options, client)
        if is_way(options):
            values, times = way(options, goal)
            client.send_trajectory(options.task, values, times, options.speed or 0.0,
                                   options.frame, options.wait)
        else:
            client.send(options.task, options.frame, options.wait, **goal)
        if options.repeat:
            _repeat(client, options.repeat)
        print(f'goal sent to task {options.task}')
        warning = client.task_status(options.task).goal_warning
        if warning:
            print(f'warning: {warning}', file=sys.stderr)
        if options.reach:
            return 0 if _reach(client, options) else 1
    return 0


def _fault(options: argparse.Namespace) -> str:
    """Return the fault of the given goal; empty if there is none."""
    if is_way(options):
        return way_fault(options)
    if not any((options.xyz, options.rpy, options.quat, options.joint, options.velocity,
                options.linear, options.angular)):
        return ('nothing to send; give --xyz, --rpy, --quat, --joint, --velocity, --linear or '
                '--angular')
    if options.rpy and not options.deg and max(map(abs, options.rpy)) > TURN:
        given = ' '.join(f'{angle:g}' for angle in options.rpy)
        return (f'--rpy {given} is in radians, and more than a turn; for degrees add --deg')
    return ''


def _fields(options: argparse.Namespace, client: 'Client') -> dict[str, Any]:
    """Return the given parts of the goal, with angles in radians."""
    angle = math.radians(1.0) if options.deg else 1.0
    quat_xyzw = options.quat
    if options.rpy:
        quat_xyzw = quaternion_from_rpy(*(angle * value for value in options.rpy))
    fields = {'xyz': options.xyz, 'quat_xyzw': quat_xyzw, 'linear': options.linear,
              'angular': options.angular and [angle * value for value in options.angular]}
    for name, values in (('joints', options.joint), ('velocities', options.velocity)):
        fields[name] = values and dict(values)
        if values and options.deg:
            from tp_controller.ros.client.remote_parameters import revolute
            turning = revolute(client, fields[name], options.wait)
            fields[name] = {joint: angle * value if joint in turning else value
                            for joint, value in values}
    return {name: value for name, value in fields.items() if value}


def _repeat(client: 'Client', duration: float) -> None:
    """Send the goal repeatedly for a duration [s]."""
    end = time.monotonic() + duration
    while time.monotonic() < end:
        client.wait(lambda: False, VELOCITY_REPEAT_SECONDS)
        client.repeat()


def _reach(client: 'Client', options: argparse.Namespace) -> bool:
    """Wait for the goal, and print its outcome."""
    reached = client.wait(lambda: client.task_status(options.task).done, options.reach)
    status = client.task_status(options.task)
    if client.stop_reason():
        print(f'not reached: {client.stop_reason()}')
        return False
    errors = ', '.join(with_unit(f'{error:.3g}', unit)
                       for unit, error in status.errors.items())
    reason = status.reason if options.task in client.task_names() \
        else f'the stack has no task {options.task} any more'
    print(f'{"reached" if reached else "not reached"}: error {errors}'
          + (f' ({reason})' if reason and not reached else ''))
    if not reached and status.hint:
        print(f'what would help: {status.hint}')
    return reached


COMMAND = Command(
    'send a goal to a task of a running controller',
    'Send a goal to a task of a running controller. What the task takes decides the message: a '
    'point needs --xyz, an orientation --rpy or --quat, a pose both.',
    EXAMPLES, add_goal_arguments, send_goal)
