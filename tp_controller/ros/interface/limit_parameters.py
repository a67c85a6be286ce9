# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Limits of the joints, and of the velocities of a base, as parameters."""

from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.node import Node
from tp_controller.control.controller import Controller
from tp_controller.errors import RobotError, SettingsError
from tp_controller.model.limits import BASE_LIMIT_KEYS, LIMIT_KEYS, LIMIT_UNITS
from tp_controller.model.robot import Robot
from tp_controller.ros.declarations.spec import LIMITS, Spec
from tp_controller.ros.parameters import declare, descriptor
from tp_controller.ros.rclpy_internals import initial_parameters

# {velocity: {key: limit}}
Limits = dict[str, dict[str, float]]

VELOCITY = '.velocity'
RAISING = 'for a higher one deactivate and clean up the node, set it, and configure'


class LimitParameters:
    """
    Parameters ``limits.<joint>.<limit>`` of the joints of a robot, and the velocities of its base.

    Their initial values are the limits of the description. Values that differ replace them, and
    are kept for the next robot.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that declares them.
    adjustable : bool
        Velocity limits can be lowered at any time.

    """

    def __init__(self, node: Node, adjustable: bool = False) -> None:
        self._node, self._adjustable = node, adjustable
        # {parameter: value in the description}
        self._described: dict[str, object] = {}

    def declare(self, robot: Robot) -> Limits:
        """
        Declare the parameters of a robot, and undeclare all others.

        Returns
        -------
        dict
            {velocity: {key: value}} of the limits that differ from those of the robot.

        Raises
        ------
        SettingsError
            The node was started with limits that the robot lacks.

        """
        specs = [self._spec(robot, row, key) for row, name in enumerate(robot.velocity_names)
                 for key in (LIMIT_KEYS if name in robot.joint_names else BASE_LIMIT_KEYS)]
        self._refuse_unknown(robot, specs)
        before = self._undeclare()
        changed = {name: value for name, value in before.items()
                   if value != self._described.get(name)}
        self._described = {spec.name: spec.default for spec in specs}
        gone = sorted(set(changed) - set(self._described))
        if gone:
            self._node.get_logger().warning('Ignoring limits of joints that the robot does not '
                                            f'have: {", ".join(gone)}')
        for spec in specs:
            if spec.name in before:
                # Values set since the start override those that the node was started with.
                self._node.declare_parameter(spec.name, changed.get(spec.name, spec.default),
                                             descriptor(spec), ignore_override=True)
        limits: Limits = {}
        for name, value in declare(self._node, specs).items():
            if value != self._described[name]:
                joint, key = name.removeprefix(LIMITS).rsplit('.', 1)
                limits.setdefault(joint, {})[key] = value
        return limits

    def check(self, given: Mapping[str, Any], controller: Controller) -> None:
        """Raise `SettingsError` if a controller refuses the velocity limits among values."""
        try:
            controller.check_velocity_limits(_velocities(given))
        except SettingsError as error:
            raise SettingsError([f'{fault}; {RAISING}' for fault in error.faults]) from error

    def apply(self, given: Mapping[str, Any], controller: Controller) -> None:
        """Apply the velocity limits among checked values."""
        controller.set_velocity_limits(_velocities(given))

    def _spec(self, robot: Robot, row: int, key: str) -> Spec:
        """Return the parameter of a limit of a velocity."""
        name, unit = robot.velocity_names[row], robot.velocity_units[row]
        adjustable = self._adjustable and key == 'velocity'
        when = '; can be lowered at any time, and raised again' if adjustable else ''
        return Spec(f'{LIMITS}{name}.{key}', float(robot.limits[key][row]),
                    f'{key} limit of {name}; changed, it replaces the one in the description'
                    f'{when}', unit + LIMIT_UNITS[key], fixed=not adjustable)

    def _refuse_unknown(self, robot: Robot, specs: Sequence[Spec]) -> None:
        """Raise `SettingsError` if the node was started with limits that a robot lacks."""
        strange = {name for name in initial_parameters(self._node)
                   if name.startswith(LIMITS)} - {spec.name for spec in specs}
        if strange:
            raise SettingsError([f'unknown parameter {", ".join(sorted(strange))}; valid: '
                                 f'{LIMITS}<joint>.{"|".join(LIMIT_KEYS)} with the driven joints '
                                 f'{", ".join(robot.joint_names)}{_base_limits(robot)}'])

    def _undeclare(self) -> dict[str, float]:
        """Undeclare all parameters; return {parameter: value}."""
        names = [LIMITS + name for name in self._node.get_parameters_by_prefix(LIMITS[:-1])]
        values = {name: self._node.get_parameter(name).value for name in names}
        for name in values:
            self._node.undeclare_parameter(name)
        return values


def robot_from(limits: LimitParameters, values: Mapping[str, Any],
               description: str | None = None, joints: Sequence[str] | None = None
               ) -> Robot | None:
    """
    Return the robot that parameters describe.

    Parameters
    ----------
    limits : LimitParameters
        Declares a parameter for each limit of each joint.
    values : dict
        Values of `ROBOT`.
    description : str, optional
        URDF from the topic.
    joints : list of str, optional
        Driven joints.

    Returns
    -------
    Robot or None
        None while there is no description.

    Raises
    ------
    RobotError, SettingsError
        The description or a limit is invalid.

    """
    if not values['robot'] and not values['robot_description'] and description is None:
        return None
    urdf: str = values['robot_description'] or description or ''

    def build(limits: Limits | None = None) -> Robot:
        options = {'joints': joints, 'limits': limits, 'base': values['base'],
                   'world_frame': values['world_frame'],
                   'xacro_arguments': values['xacro_arguments'], 'groups': values['groups']}
        if values['robot']:
            return Robot.from_file(values['robot'], **options)
        if '<' not in urdf:
            raise RobotError(f'robot_description must be URDF text, not {urdf[:40]!r}; a file '
                             'goes into the parameter robot')
        return Robot.from_urdf(urdf, **options)

    robot = build()
    replaced = limits.declare(robot)
    return build(limits=replaced) if replaced else robot


def _velocities(given: Mapping[str, Any]) -> dict[str, float]:
    """Return {velocity: limit} of the velocity limits among {parameter: value}."""
    return {name.removeprefix(LIMITS).removesuffix(VELOCITY): value
            for name, value in given.items()
            if name.startswith(LIMITS) and name.endswith(VELOCITY)}


def _base_limits(robot: Robot) -> str:
    """Return the limits of a base as the end of a list, or an empty string."""
    names = robot.velocity_names[:robot.joint_columns.start]
    if not names:
        return ''
    return f'; {LIMITS}<axis>.{"|".join(BASE_LIMIT_KEYS)} with {", ".join(names)}'
