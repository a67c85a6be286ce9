# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Arguments of commands that read a robot and a stack, without ROS."""

import argparse
import sys


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of robot and stack to the parser of a command."""
    parser.add_argument('stack', nargs='?', default='',
                        help='the stack, as the parameter of the controller: a path, '
                        'package://<package>/<path> or YAML text (default: that of the parameter '
                        'file)')
    parser.add_argument('--robot', default='', metavar='FILE',
                        help='the robot, as the parameter: URDF, xacro, MJCF, or DH table '
                        '(.yaml); a path, package://<package>/<path>, or '
                        'robot_descriptions:<name> (default: that of the parameter file)')
    parser.add_argument('--xacro-arg', metavar='NAME:=VALUE', action='append', default=[],
                        help='an argument of the robot, a xacro; several times for several')
    parser.add_argument('--base', default='', metavar='KIND',
                        help='how the base moves (default: as in the parameter file, else fixed)')
    parser.add_argument('--params-file', metavar='FILE', action='append', default=[],
                        help='the parameter file of the node: stack, limits, settings, rate; of '
                        'several, as of the node, the last one that gives a parameter counts')
    parser.add_argument('--joints', nargs='+', metavar='JOINT',
                        help='the joints that are driven (default: as in the parameter file, else '
                        'all that move)')


def refuse(message: str) -> int:
    """Print the fault of an argument; return the exit status."""
    print(f'tp_controller: {message}', file=sys.stderr)
    return 2
