# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goal messages made from their fields."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseStamped,
    Quaternion,
    QuaternionStamped,
    TwistStamped,
    Vector3,
    Vector3Stamped,
)
from sensor_msgs.msg import JointState
from tp_controller.errors import GoalError
from tp_controller.ros import Message

# Parts of a goal, by the names that `FIELDS` lists.
Fields = Mapping[str, Any]
# Parts of a goal that each message can carry, and must.
FIELDS: dict[type, tuple[str, ...]] = {
    PointStamped: ('xyz',),
    Vector3Stamped: ('xyz',),
    QuaternionStamped: ('quat_xyzw',),
    PoseStamped: ('xyz', 'quat_xyzw'),
    JointState: ('joints', 'velocities'),
    TwistStamped: ('linear', 'angular'),
}


def type_name(kind: type) -> str:
    """Return the name of a message type in the graph."""
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'


TYPES: dict[str, type] = {type_name(kind): kind for kind in FIELDS}


def make_message(task: str, kind: type, fields: Fields,
                 names: Mapping[str, str] | None = None) -> Message:
    """
    Return a goal message.

    Parameters
    ----------
    task : str
        Name for error messages.
    kind : type
        Message type.
    fields : dict
        See `client.Client.send`.
    names : dict, optional
        See `client.Client`.

    Raises
    ------
    GoalError
        `fields` does not match the parts of the message.

    """
    allowed = FIELDS[kind]
    extra = [name for name in fields if name not in allowed]
    missing = [name for name in allowed if name not in fields]
    one_is_enough = kind in (JointState, TwistStamped)
    if one_is_enough and len(missing) < len(allowed):
        missing = []
    if extra or missing:
        needed = listed(allowed, names, ' or ' if one_is_enough else ' and ')
        raise GoalError(f'task {task!r} needs {needed} ({kind.__name__}), '
                        f'got {listed(fields, names) or "nothing"}')
    return _FILL[kind](fields)


def listed(fields: Iterable[str], names: Mapping[str, str] | None, word: str = ' and ') -> str:
    """Return the names of parts of a goal, as messages show them."""
    return word.join((names or {}).get(field, field) for field in fields)


def _vector(target: Point | Vector3, values: Iterable[float]) -> None:
    """Set x, y, z of a message."""
    target.x, target.y, target.z = map(float, values)


def _quaternion(target: Quaternion, values: Iterable[float]) -> None:
    """Set x, y, z, w of a message."""
    target.x, target.y, target.z, target.w = map(float, values)


def _point(fields: Fields) -> PointStamped:
    """Return a PointStamped."""
    message = PointStamped()
    _vector(message.point, fields['xyz'])
    return message


def _direction(fields: Fields) -> Vector3Stamped:
    """Return a Vector3Stamped."""
    message = Vector3Stamped()
    _vector(message.vector, fields['xyz'])
    return message


def _orientation(fields: Fields) -> QuaternionStamped:
    """Return a QuaternionStamped."""
    message = QuaternionStamped()
    _quaternion(message.quaternion, fields['quat_xyzw'])
    return message


def _pose(fields: Fields) -> PoseStamped:
    """Return a PoseStamped."""
    message = PoseStamped()
    _vector(message.pose.position, fields['xyz'])
    _quaternion(message.pose.orientation, fields['quat_xyzw'])
    return message


def _joints(fields: Fields) -> JointState:
    """Return a JointState with positions or velocities, or both for the same joints."""
    positions, velocities = fields.get('joints', {}), fields.get('velocities', {})
    if positions and velocities and list(positions) != list(velocities):
        raise GoalError('positions and velocities must be for the same joints')
    return JointState(name=list(positions or velocities),
                      position=[float(value) for value in positions.values()],
                      velocity=[float(value) for value in velocities.values()])


def _twist(fields: Fields) -> TwistStamped:
    """Return a TwistStamped."""
    message = TwistStamped()
    _vector(message.twist.linear, fields.get('linear', (0.0, 0.0, 0.0)))
    _vector(message.twist.angular, fields.get('angular', (0.0, 0.0, 0.0)))
    return message


_FILL: dict[type, Callable[[Fields], Message]] = {
    PointStamped: _point, Vector3Stamped: _direction, QuaternionStamped: _orientation,
    PoseStamped: _pose, JointState: _joints, TwistStamped: _twist}
