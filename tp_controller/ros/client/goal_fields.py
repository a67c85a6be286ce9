# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goal messages made from their fields."""

from collections.abc import Iterable, Mapping
from operator import attrgetter
from typing import Any

from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    QuaternionStamped,
    TwistStamped,
    Vector3Stamped,
)
from sensor_msgs.msg import JointState
from tp_controller.errors import GoalError
from tp_controller.ros import Message

# Parts of a goal, by the names that `FIELDS` lists.
Fields = Mapping[str, Any]
# Parts of a goal that each message can carry, and must, with their fields in the message.
FIELDS: dict[type, dict[str, str]] = {
    PointStamped: {'xyz': 'point'},
    Vector3Stamped: {'xyz': 'vector'},
    QuaternionStamped: {'quat_xyzw': 'quaternion'},
    PoseStamped: {'xyz': 'pose.position', 'quat_xyzw': 'pose.orientation'},
    JointState: {'joints': 'position', 'velocities': 'velocity'},
    TwistStamped: {'linear': 'twist.linear', 'angular': 'twist.angular'},
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
    if kind is JointState:
        return _joints(fields)
    message = kind()
    for name, values in fields.items():
        fill(attrgetter(allowed[name])(message), values)
    return message


def listed(fields: Iterable[str], names: Mapping[str, str] | None, word: str = ' and ') -> str:
    """Return the names of parts of a goal, as messages show them."""
    return word.join((names or {}).get(field, field) for field in fields)


def fill(part: Message, values: Iterable[float]) -> None:
    """Set the numbers of a point, vector or quaternion in their order."""
    for name, value in zip(part.get_fields_and_field_types(), values, strict=True):
        setattr(part, name, float(value))


def _joints(fields: Fields) -> JointState:
    """Return a JointState with positions or velocities, or both for the same joints."""
    positions, velocities = fields.get('joints', {}), fields.get('velocities', {})
    if positions and velocities and list(positions) != list(velocities):
        raise GoalError('positions and velocities must be for the same joints')
    return JointState(name=list(positions or velocities),
                      position=[float(value) for value in positions.values()],
                      velocity=[float(value) for value in velocities.values()])
