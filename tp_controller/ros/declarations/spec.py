# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Definition of a parameter: default, description, unit and range."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
import re
from typing import Any

from tp_controller.errors import unknown
from tp_controller.model.mobile_base import BASES, DEFAULT_WORLD
from tp_controller.resources import is_number

# Constraint that ROS tools show for a parameter that cannot change.
FIXED = 'fixed while the node is configured'
# Default weights, for any number of joints.
EQUAL = [1.0]
# Values that replace the empty list, which has no type.
EMPTY: Mapping[str, list[float] | list[str]] = {
    'weights': EQUAL, 'joints': [''], 'command_joints': [''], 'locked_joints': [''],
    'xacro_arguments': ['']}
# Prefix of the joint limits.
LIMITS = 'limits.'
# Prefix of gains and tolerances of the tasks.
TASKS = 'tasks.'
# {type of a parameter in ROS: description of valid values}
EXAMPLES = {
    'DOUBLE': 'a number, such as 1.0', 'INTEGER': 'an integer, such as 1',
    'STRING': 'a string', 'BOOL': 'true or false',
    'STRING_ARRAY': 'a list of strings, such as [a, b]',
    'DOUBLE_ARRAY': 'a list of numbers, such as [1.0, 2.0]'}
# Number that YAML reads as text.
NUMBER = re.compile(r'[-+]?\d+(\.\d*)?e[-+]?\d+', re.IGNORECASE)
KINDS = {float: 'DOUBLE', int: 'INTEGER', str: 'STRING', bool: 'BOOL'}


@dataclass(frozen=True)
class Spec:
    """
    Definition of a parameter.

    Attributes
    ----------
    name : str
    default : object
    description : str
    unit : str
    lower, upper : float
        Range of a number.
    fixed : bool
        Fixed while the node is configured.
    why : str
        Origin of the range, or empty.
    valid : tuple of str
        The valid texts; any if it is empty.

    """

    name: str
    default: object
    description: str
    unit: str = ''
    lower: float = -math.inf
    upper: float = math.inf
    fixed: bool = False
    why: str = ''
    valid: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Return the type of the parameter in ROS, one of `EXAMPLES`."""
        if isinstance(self.default, (list, tuple)):
            return 'STRING_ARRAY' if isinstance(self.default[0], str) else 'DOUBLE_ARRAY'
        return KINDS[type(self.default)]

    def fault(self, value: Any) -> str:
        """Return the fault of a value in a parameter file; empty if a node accepts it."""
        if not self._fits(value):
            return wrong_type(self.name, self.kind, value)
        if self.kind in ('DOUBLE', 'INTEGER') and not self.lower <= float(value) <= self.upper:
            return out_of_range(self.name, self.lower, self.upper, value, self.why)
        if self.valid and value not in self.valid:
            return unknown(self.name, value, self.valid)
        return ''

    def _fits(self, value: object) -> bool:
        """Return whether a value has the type of the parameter; text may be a number."""
        if isinstance(self.default, (list, tuple)):
            least = 0 if self.name in EMPTY else 1
            return isinstance(value, list) and len(value) >= least and all(
                isinstance(each, str) if self.kind == 'STRING_ARRAY' else is_number(each)
                for each in value)
        if self.kind == 'DOUBLE' and isinstance(value, str):
            return NUMBER.fullmatch(value) is not None
        return is_number(value) if self.kind == 'DOUBLE' else type(value) is type(self.default)


def wrong_type(name: str, kind: str, given: object) -> str:
    """Return the fault of a value that is not of a type in ROS."""
    return f'parameter {name} must be {EXAMPLES.get(kind, kind)}, not {given!r}'


def out_of_range(name: str, lower: float, upper: float, given: object, why: str) -> str:
    """Return the fault of a number out of range, with the origin of the range."""
    return f'parameter {name} must be from {lower:g} to {upper:g}, not {given!r}' \
           + (f' ({why})' if why else '')


ROBOT = (
    Spec('robot_description', '', 'URDF text; goes before the topic of the same name',
         fixed=True),
    Spec('robot', '', 'file of the robot: URDF, xacro, MJCF, or DH table (.yaml); a path or '
         'package://<package>/<path>; or robot_descriptions:<name>; goes before '
         'robot_description', fixed=True),
    Spec('xacro_arguments', [''], 'arguments of a xacro, each name:=value', fixed=True),
    Spec('base', 'fixed', f'how the base moves ({", ".join(BASES)})', fixed=True),
    Spec('world_frame', DEFAULT_WORLD, 'name of the frame that a base moves in, the one of its '
         'odometry', fixed=True),
    Spec('groups', '', 'groups of joints that tasks name together, as YAML: '
         '{arm: [joint1, joint2]}', fixed=True),
)
