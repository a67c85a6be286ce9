# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reader of the parameter files of a controller node, without ROS."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tp_controller.control.gains import set_gain, set_tolerance
from tp_controller.control.settings import Settings
from tp_controller.errors import RobotError, SettingsError, StackError, TpControllerError
from tp_controller.model.mobile_base import DEFAULT_WORLD
from tp_controller.model.robot import Robot
from tp_controller.model.simulator import initial_positions
from tp_controller.model.spatial import Array
from tp_controller.resources import load_yaml, read_source
from tp_controller.ros.declarations.controller import PARAMETERS, SETTINGS
from tp_controller.ros.declarations.simulator import PARAMETERS as SIMULATOR_PARAMETERS
from tp_controller.ros.declarations.spec import LIMITS, Spec, TASKS
from tp_controller.tasks.stack import Stack

CONTROLLER, SIMULATOR = 'tp_controller', 'tp_simulator'
ENTRY = 'ros__parameters'
WILDCARDS = ('*', '**')
# Declared parameters of the nodes, by name.
DECLARED = {spec.name: spec for spec in PARAMETERS}
SIMULATED = {spec.name: spec for spec in SIMULATOR_PARAMETERS}
SETTING_NAMES = tuple(spec.name for spec in SETTINGS)
FAMILIES = (LIMITS, TASKS, 'qos_overrides.')


@dataclass(frozen=True)
class NodeSetup:
    """
    Robot, stack and settings of a controller node.

    Attributes
    ----------
    robot, stack, settings
        See `tp_controller.tools.check.check`.
    period : float
        Time between two cycles [s].
    around : ndarray (nq,) or None
        Initial configuration of the simulator, if it is in the file.
    ignored : tuple of str
        Parameters that a node would ignore.

    """

    robot: Robot
    stack: Stack
    settings: Settings
    period: float
    around: Array | None
    ignored: tuple[str, ...]


def node_parameters(file: str | Path, node: str) -> dict[str, Any]:
    """
    Return the parameters of a node in a parameter file.

    Parameters
    ----------
    file : str or pathlib.Path
        Its entries are names of nodes in any namespace, or wildcards.
    node : str
        Name of a node.

    Returns
    -------
    dict
        {name: value}, with a mapping for each group of parameters.

    Raises
    ------
    SettingsError
        It is not a parameter file.

    """
    try:
        content = load_yaml(read_source(file, lambda text: '\n' in text))
    except (OSError, ValueError) as error:
        raise SettingsError([f'parameter file: {error}']) from error
    found: dict[str, Any] = {}
    for name, parameters in _entries(content, ''):
        if name.rpartition('/')[2] in (node, *WILDCARDS):
            _merge(found, parameters)
    return found


def _merge(found: dict[str, Any], parameters: Mapping[str, Any]) -> None:
    """Merge parameters as ROS does: each parameter of a group by itself."""
    for name, value in parameters.items():
        if isinstance(value, dict) and isinstance(found.get(name), dict):
            _merge(found[name], value)
        else:
            found[name] = value


def _entries(content: object, prefix: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield (name, parameters) of each node; namespaces may be nested."""
    if not isinstance(content, dict):
        raise SettingsError([f'parameter file: {prefix or "it"} must be a mapping {{node: '
                             f'{{{ENTRY}: {{name: value}}}}}}'])
    for key, value in content.items():
        if key != ENTRY:
            yield from _entries(value, f'{prefix}/{key}')
        elif isinstance(value, dict):
            yield prefix, value
        else:
            raise SettingsError([f'parameter file: {ENTRY} of {prefix} must be a mapping'])


def flat(parameters: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return {name: value} with names such as ``limits.joint1.velocity``."""
    found: dict[str, Any] = {}
    for name, value in parameters.items():
        if isinstance(value, dict):
            found.update(flat(value, f'{prefix}{name}.'))
        else:
            found[f'{prefix}{name}'] = value
    return found


def read(files: Sequence[str | Path], stack: str, robot: str, base: str, rate: float | None,
         joints: Sequence[str] | None = None, xacro_arguments: Sequence[str] = ()) -> NodeSetup:
    """
    Return the robot, stack and settings of a node with parameter files.

    Parameters
    ----------
    files : sequence of str or pathlib.Path
        Parameter files; the last one that gives a parameter counts.
    stack, robot, base : str
        Parameters of these names, with precedence over those of the files; empty for those of the
        files. Without a robot for the controller, that of the simulator is used.
    rate : float or None
        The same [Hz]. If it is 0 in the files, one cycle for each joint state, the rate of the
        simulator is used.
    joints, xacro_arguments : sequence of str, optional
        The parameters of these names, with precedence; those of a xacro in the files do not
        count for another `robot`.

    Returns
    -------
    NodeSetup

    Raises
    ------
    Refused
        Lists all faults for which a node would refuse its parameters.

    """
    given, simulated = ({name: value for file in files
                         for name, value in flat(node_parameters(file, node)).items()}
                        for node in (CONTROLLER, SIMULATOR))
    given.update({name: value for name, value in (
        ('stack', stack), ('base', base), ('rate', rate),
        ('joints', joints and list(joints))) if value})
    if robot:
        given.update(robot=robot, robot_description='', xacro_arguments=[])
    if xacro_arguments:
        given.update(xacro_arguments=list(xacro_arguments))
    refused = [*_drop_refused(given, DECLARED), *_drop_refused(simulated, SIMULATED)]
    faults: list[Exception] = [SettingsError(refused)] if refused else []
    settings = _try(faults, _settings, given)
    made = _try(faults, _robot, given, simulated)
    tasks = _try(faults, _stack, given, made) if made else None
    period = settings and _period(given, simulated, settings)
    if tasks and settings:
        _try(faults, _set_task_parameters, given, tasks, settings)
    if faults or not (settings and made and tasks and period):
        raise Refused(faults)
    return NodeSetup(made, tasks, settings, period, _around(made, simulated),
                     tuple(_ignored(given, tasks)))


class Refused(TpControllerError):
    """Error for parameters that a node would refuse; `errors` has one error for each part."""

    def __init__(self, errors: list[Exception]) -> None:
        self.errors = tuple(errors)
        super().__init__('; '.join(map(str, errors)))

    @property
    def missing_file(self) -> str:
        """Return the message about a missing file; mostly empty."""
        return next((str(error) for error in self.errors
                     if isinstance(error.__cause__, OSError)), '')

    def messages(self) -> Iterator[tuple[str, str]]:
        """Yield (location, fault)."""
        for error in self.errors:
            if isinstance(error, StackError):
                for fault in error.faults:
                    line = f'line {fault.line}' if fault.line else ''
                    yield ', '.join(filter(None, (line, fault.where))), fault.message
            elif isinstance(error, SettingsError):
                for text in error.faults:
                    yield '', text
            else:
                yield '', str(error)


def _try(faults: list[Exception], method: Any, *arguments: Any) -> Any:
    """Return the result of a method; None if it raises one of our errors, which is recorded."""
    try:
        return method(*arguments)
    except TpControllerError as error:
        faults.append(error)
        return None


def _drop_refused(given: dict[str, Any], specs: Mapping[str, Spec]) -> list[str]:
    """Remove the values that a node refuses, and return their faults; `Settings` has its own."""
    faults = {name: specs[name].fault(value) for name, value in given.items()
              if name in specs and name not in SETTING_NAMES}
    for name, fault in faults.items():
        if fault:
            del given[name]
    return list(filter(None, faults.values()))


def _number(given: Mapping[str, Any], specs: Mapping[str, Spec], name: str) -> float:
    """Return a parameter, or its default, as a number."""
    return float(given.get(name, specs[name].default))


def _settings(given: Mapping[str, Any]) -> Settings:
    """Return the settings, with the period of the rate."""
    rate = _number(given, DECLARED, 'rate')
    period = 1.0 / rate if rate > 0.0 else _number(given, DECLARED, 'state_timeout')
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value
                              for name, value in given.items() if name in SETTING_NAMES}
    if values.get('weights') in ((), (1.0,)):
        # These values denote equal weights for any number of joints.
        del values['weights']
    return Settings(period=period, **values)


def _period(given: Mapping[str, Any], simulated: Mapping[str, Any], settings: Settings) -> float:
    """Return the time between two cycles [s]."""
    rate = _number(given, DECLARED, 'rate') or _number(simulated, SIMULATED, 'rate')
    return min(1.0 / rate, settings.period)


def _robot(given: Mapping[str, Any], simulated: Mapping[str, Any]) -> Robot:
    """Return the robot."""
    joints = given.get('joints')
    limits: dict[str, dict[str, float]] = {}
    for name, value in given.items():
        if name.startswith(LIMITS):
            joint, _, key = name.removeprefix(LIMITS).rpartition('.')
            limits.setdefault(joint, {})[key] = value
    options: dict[str, Any] = {
        'joints': None if joints in (None, [], ['']) else joints, 'limits': limits or None,
        'base': given.get('base', simulated.get('base', 'fixed')),
        'world_frame': given.get('world_frame', DEFAULT_WORLD), 'groups': given.get('groups')}
    for values in (given, simulated):
        if values.get('robot'):
            return Robot.from_file(values['robot'], **options, xacro_arguments=given.get(
                'xacro_arguments', values.get('xacro_arguments')))
        if values.get('robot_description'):
            return Robot.from_urdf(values['robot_description'], **options)
    raise RobotError('no robot: give --robot a file (URDF, or DH table in YAML), or the parameter '
                     'file a parameter robot')


def _around(robot: Robot, simulated: Mapping[str, Any]) -> Array | None:
    """Return the initial configuration of the simulator; None if not needed or not known."""
    if not robot.moves or 'initial_positions' not in simulated:
        return None
    try:
        return initial_positions(simulated['initial_positions'], robot)
    except RobotError:
        # The simulator may move joints that the controller does not, and reports the fault itself.
        return None


def _stack(given: Mapping[str, Any], robot: Robot) -> Stack:
    """Return the stack."""
    if not given.get('stack'):
        raise SettingsError(['no stack: name a file, or give the parameter file a parameter '
                             'stack'])
    return Stack.from_yaml(given['stack'], robot)


def _set_task_parameters(given: Mapping[str, Any], stack: Stack, settings: Settings) -> None:
    """Set the gains and tolerances of tasks from the file."""
    faults: list[str] = []
    for name, value in given.items():
        task, _, key = name.removeprefix(TASKS).partition('.')
        if not name.startswith(TASKS) or task not in stack.tasks:
            continue
        key, _, unit = key.partition('.')
        try:
            if key == 'gain':
                set_gain(stack.tasks[task], value, settings.period)
            elif key == 'tolerance':
                set_tolerance(stack.tasks[task], {unit: value} if unit else value)
        except SettingsError as error:
            faults += [f'parameter {name}: {fault}' for fault in error.faults]
    if faults:
        raise SettingsError(faults)


def _ignored(given: Mapping[str, Any], stack: Stack) -> Iterator[str]:
    """Yield the parameters that a node would ignore."""
    for name in given:
        if name.startswith(TASKS):
            task, _, key = name.removeprefix(TASKS).partition('.')
            if task not in stack.tasks or key.partition('.')[0] not in ('gain', 'tolerance'):
                yield name
        elif name not in (*DECLARED, 'use_sim_time') and not name.startswith(FAMILIES):
            yield name
