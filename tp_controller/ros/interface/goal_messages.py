# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Conversion of goal messages to arrays, with one entry for each type of goal."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
from tp_controller.tasks.obstacle_goals import ALL_OBSTACLES
from tp_controller.tasks.task import Task
from visualization_msgs.msg import Marker, MarkerArray

# A goal for obstacles, by their names, and the frame that it is in.
Parts = list[tuple[str, dict[str, Any]]]
Named = dict[str, float] | list[float] | None

# Numbers of messages: of points [m], directions, quaternions xyzw, and twists [m/s and rad/s].
POINT = attrgetter('point.x', 'point.y', 'point.z')
DIRECTION = attrgetter('vector.x', 'vector.y', 'vector.z')
QUATERNION = attrgetter('quaternion.x', 'quaternion.y', 'quaternion.z', 'quaternion.w')
POSE = attrgetter('pose.position.x', 'pose.position.y', 'pose.position.z', 'pose.orientation.x',
                  'pose.orientation.y', 'pose.orientation.z', 'pose.orientation.w')
TWIST = attrgetter('twist.linear.x', 'twist.linear.y', 'twist.linear.z', 'twist.angular.x',
                   'twist.angular.y', 'twist.angular.z')


@dataclass(frozen=True)
class GoalMessage:
    """
    Message type and topic of a type of goal.

    Attributes
    ----------
    kind : type
        Message type.
    topic : str
        Last part of the topic, after the name of the task.
    goal, feed_forward : callable
        Return the goal, or the feed-forward velocity, of a message; None if it has none.
    framed : bool
        The frame of the header is the one that the goal is expressed in.
    parts : callable
        Returns (frame, goal) for each part of a message whose parts have frames of their own;
        None for a message with one goal.

    """

    kind: type
    topic: str
    goal: Callable[[Message], Any]
    feed_forward: Callable[[Message], Any]
    framed: bool
    parts: Callable[[Message], Parts] | None = None


def _nothing(message: Message) -> None:
    """Return None: the message has no such content."""
    return None


def _named(names: Sequence[str], values: Sequence[float], what: str) -> Named:
    """Return {joint: value}, the values alone without names, or None without values."""
    if not len(values):
        return None
    if not names:
        return list(values)
    if len(names) != len(values):
        raise GoalError(f'{len(names)} joints with {len(values)} {what}')
    given = dict(zip(names, values))
    if len(given) < len(names):
        raise GoalError(f'a joint is named twice: {", ".join(names)}')
    return given


def _joint_positions(message: JointState) -> Named:
    """Return positions by joint [rad or m]."""
    return _named(message.name, message.position, 'positions')


def _joint_velocities(message: JointState) -> Named:
    """Return velocities by joint [rad/s or m/s]."""
    return _named(message.name, message.velocity, 'velocities')


def _obstacles(message: MarkerArray) -> Parts:
    """
    Return (frame, {name: obstacle}) for each frame of a `MarkerArray`.

    The name of an obstacle is its namespace, or namespace/id if the id is not 0.

    Raises
    ------
    GoalError
        A marker is not a valid obstacle; the whole message is ignored then.

    """
    placed: dict[str, tuple[str, dict[str, Any] | None]] = {}
    cleared = False
    for marker in message.markers:
        name = marker.ns if marker.ns and not marker.id else '/'.join(
            filter(None, (marker.ns, str(marker.id))))
        if marker.action == Marker.DELETEALL:
            placed, cleared = {}, True
        elif marker.action == Marker.DELETE:
            placed[name] = '', None
        elif marker.action == Marker.ADD:
            placed[name] = marker.header.frame_id, _obstacle(name, marker)
        else:
            raise GoalError(f'obstacle {name}: unknown action {marker.action}; valid: 0 (add or '
                            'modify), 2 (delete), 3 (delete all)')
    parts: dict[str, dict[str, Any]] = {}
    for name, (frame, obstacle) in placed.items():
        parts.setdefault(frame, {})[name] = obstacle
    return [*([('', {ALL_OBSTACLES: None})] if cleared else []), *parts.items()]


def _obstacle(name: str, marker: Marker) -> dict[str, Any]:
    """Return a marker as a goal for one obstacle."""
    size = marker.scale.x, marker.scale.y, marker.scale.z
    shape: dict[str, Any]
    if marker.type == Marker.CUBE:
        shape = {'box': list(size)}
    elif marker.type == Marker.SPHERE and size[0] == size[1] == size[2]:
        shape = {'sphere': 0.5 * size[0]}
    elif marker.type == Marker.CYLINDER and size[0] == size[1]:
        shape = {'cylinder': [0.5 * size[0], size[2]]}
    elif marker.type in (Marker.SPHERE, Marker.CYLINDER):
        raise GoalError(f'obstacle {name}: a sphere or cylinder must be round, got the scale '
                        f'{", ".join(f"{each:g}" for each in size)}')
    else:
        raise GoalError(f'obstacle {name}: unknown type {marker.type}; valid: 1 (cube), '
                        '2 (sphere), 3 (cylinder)')
    obstacle = {'shape': shape, 'at': POSE(marker)}
    lifetime = marker.lifetime.sec + 1e-9 * marker.lifetime.nanosec
    # Without a lifetime the obstacle exists until it is deleted.
    return {**obstacle, 'lifetime': lifetime} if lifetime else obstacle


GOALS = {
    'point': GoalMessage(PointStamped, 'goal', POINT, _nothing, True),
    'direction': GoalMessage(Vector3Stamped, 'goal', DIRECTION, _nothing, True),
    'quaternion': GoalMessage(QuaternionStamped, 'goal', QUATERNION, _nothing, True),
    'pose': GoalMessage(PoseStamped, 'goal', POSE, _nothing, True),
    'joints': GoalMessage(JointState, 'goal', _joint_positions, _joint_velocities, False),
    'joint_velocities': GoalMessage(JointState, 'goal', _joint_velocities, _nothing, False),
    'obstacles': GoalMessage(MarkerArray, 'obstacles', _nothing, _nothing, True, _obstacles),
}
FEED_FORWARD = {
    'twist': GoalMessage(TwistStamped, 'twist', _nothing, TWIST, True),
}


def messages_of(task: Task | type[Task]) -> list[GoalMessage]:
    """
    Return the goal messages that a task accepts.

    Parameters
    ----------
    task : Task or type
        A task, or a type of tasks: where keys determine the goals, those of the default keys.

    Returns
    -------
    list of GoalMessage
        One for each topic of the task.

    """
    entries = (GOALS.get(task.goal_type or ''), FEED_FORWARD.get(task.feed_forward_type or ''))
    return [entry for entry in entries if entry is not None]
