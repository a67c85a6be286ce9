# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robot of a recording, its configurations and the frames of its tools."""

import math
from typing import Any

import numpy as np
from tp_controller.errors import TpControllerError
from tp_controller.model.mobile_base import DEFAULT_WORLD
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, inverse_pose
from tp_controller.tasks.frame import FrameTask
from tp_controller.tasks.stack import Stack
from tp_controller.tools.recording.history import History, nearest
from tp_controller.tools.recording.motion import Moment

# Prefix of the parameters that replace limits of the description.
LIMITS = 'limits.'


def robot_of(history: History) -> Robot | None:
    """
    Return the robot of the controller with its limits; None if it is not recorded.

    Raises
    ------
    TpControllerError
        The recorded description is invalid.

    """
    given = history.parameters
    options: dict[str, Any] = {
        'joints': _names(given.get('joints', ())), 'limits': _limits(given),
        'base': _text(given, 'base', 'fixed'),
        'world_frame': _text(given, 'world_frame', DEFAULT_WORLD),
        'groups': _text(given, 'groups')}
    own = f'/{history.node}/robot_description'
    urdf: str | None = history.descriptions.get(own) or _text(given, 'robot_description')
    if not urdf and _text(given, 'robot'):
        return Robot.from_file(_text(given, 'robot'), **options,
                               xacro_arguments=given.get('xacro_arguments'))
    if not urdf:
        topic = nearest(list(history.descriptions), ['robot_description'], history.namespace)
        urdf = history.descriptions.get(topic)
    return Robot.from_urdf(urdf, **options) if urdf else None


def command_names(history: History, robot: Robot | None, count: int) -> list[str]:
    """Return the joint names in the order of the commands; numbers if unknown."""
    names = _names(history.parameters.get('command_joints', ())) \
        or _names(history.parameters.get('joints', ())) or list(robot.joint_names if robot else ())
    return list(names) if len(names) == count else [f'command {row + 1}' for row in range(count)]


def configurations(history: History, robot: Robot) -> tuple[Array, Array, Array, list[Moment]]:
    """
    Return the recorded configurations of a robot.

    Returns
    -------
    times : ndarray (T,)
        [s]
    q : ndarray (T, nq)
        [rad or m]
    passive : ndarray (T, p)
        [rad or m]
    moments : list of Moment
        Moments of the configurations.

    """
    rows = []
    for moment in history.motion.moments:
        T = _base(moment, robot)
        if T is not None and all(name in moment.joints for name in robot.joint_names):
            rows.append((moment.time,
                         robot.configuration([moment.joints[name] for name in robot.joint_names],
                                             T),
                         [moment.joints.get(name, rest) for name, rest in zip(
                             robot.passive_names, robot.passive_neutral)], moment))
    if not rows:
        return np.empty(0), np.empty((0, robot.nq)), np.empty((0, len(robot.passive_names))), []
    times, q, passive, moments = zip(*rows)
    return np.array(times), np.array(q), np.array(passive), list(moments)


def tool_frames(history: History, robot: Robot) -> dict[str, str]:
    """Return {task: frame} of the frame tasks, by priority; {} if the stack is unknown."""
    text = _text(history.parameters, 'stack')
    if not text:
        return {}
    try:
        tasks = Stack.from_yaml(text, robot).tasks
    except TpControllerError:
        # The stack is in a file of another machine, or needs other packages or obstacle files.
        return {}
    return {name: task.frame for name, task in tasks.items() if isinstance(task, FrameTask)}


def path_of(robot: Robot, frame: str, q: Array, passive: Array) -> Array:
    """Return the path of a frame (T, 3) [m]."""
    state = robot.state(q[0], passive[0])
    points = []
    for row, others in zip(q, passive):
        state.update(row, others)
        points.append(state.position(frame))
    return np.array(points)


def _base(moment: Moment, robot: Robot) -> Array | None:
    """Return the pose of the base; None if a mobile base has no recorded pose."""
    if not robot.moves:
        return np.eye(4)
    if moment.base is None:
        return None
    frame, child, T = moment.base
    carried = robot.fixed_to_base(child or robot.base_frame)
    if carried is None or frame not in ('', robot.root):
        return None
    return T.dot(inverse_pose(carried))


def _text(parameters: dict[str, Any], name: str, default: str = '') -> str:
    """Return a text parameter; the default for other types."""
    value = parameters.get(name, default)
    return value if isinstance(value, str) else default


def _names(value: object) -> list[str] | None:
    """Return the names in a parameter; None if it is empty, which means all."""
    names = [each for each in value if isinstance(each, str)] if isinstance(
        value, (list, tuple)) else []
    return names if any(names) else None


def _limits(parameters: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Return {velocity: {key: value}} of the limits of the controller."""
    limits: dict[str, dict[str, float]] = {}
    for name, value in parameters.items():
        if name.startswith(LIMITS) and isinstance(value, float) and math.isfinite(value):
            joint, _, key = name.removeprefix(LIMITS).rpartition('.')
            limits.setdefault(joint, {})[key] = value
    return limits
