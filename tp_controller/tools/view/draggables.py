# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Draggable goals, regions and obstacles, and the messages that a drag publishes."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
import copy
from dataclasses import dataclass
import math
from typing import ClassVar, Protocol

from geometry_msgs.msg import PointStamped, PoseStamped, QuaternionStamped, Vector3Stamped
import numpy as np
from tp_controller.model.spatial import Array, pose, quaternion_from_rotation
from tp_controller.ros import Message
from tp_controller.ros.client.goal_fields import FIELDS, make_message
from tp_controller.tasks.aim import across
from tp_controller.tools.view.markers import pose_of
from tp_controller.tools.view.status import quantity
from visualization_msgs.msg import Marker, MarkerArray

GOALS, REGIONS, OBSTACLES = 'goals', 'regions', 'obstacles'
CONES, DISTANCES = 'cones', 'distances'
GROUPS = (GOALS, REGIONS, OBSTACLES, CONES, DISTANCES)
OBSTACLE = 'obstacle'
# {part of a task in a marker namespace: (group, types of messages that move it)}
PARTS: Mapping[str, tuple[str, tuple[type, ...]]] = {
    'goal': (GOALS, (PointStamped, PoseStamped, QuaternionStamped)),
    'sight': (GOALS, (Vector3Stamped,)),
    'region': (REGIONS, (PoseStamped,))}
# Decimals of keys that a drag sets: 0.1 mm, or 0.006°.
KEY_DECIMALS = 4
# Limits of the half angle of a cone [rad].
MIN_HALF_ANGLE, MAX_HALF_ANGLE = 0.01, math.pi - 0.01
# Points closer than this define no direction [m].
MIN_GAP_LENGTH = 1e-6

Topics = Mapping[str, Mapping[str, type]]
Numbers = Mapping[str, Mapping[str, float]]


class Publish(Protocol):
    """Publisher on topics of tasks."""

    def __call__(self, task: str, topic: str, message: Message) -> None:
        """Publish a message."""


class SetKey(Protocol):
    """Setter of keys of tasks in the stack."""

    def __call__(self, task: str, key: str, value: float) -> None:
        """Set a number."""


@dataclass(frozen=True)
class Grip:
    """
    Degrees of freedom of a drag.

    Attributes
    ----------
    axes : tuple of bool
        Enabled axes of the dragged frame.
    moves, planes, turns : bool
        Translation along the axes, translation in planes of two axes, rotation about the axes.

    """

    axes: tuple[bool, bool, bool] = (True, True, True)
    moves: bool = True
    planes: bool = True
    turns: bool = True

    @property
    def single(self) -> bool:
        """Return whether the only degree of freedom is translation along x."""
        return self == ALONG_X


ALONG_X = Grip((True, False, False), planes=False, turns=False)


@dataclass(frozen=True, eq=False)
class Draggable(ABC):
    """
    Element of a task that can be dragged, at its pose in the controller.

    Attributes
    ----------
    task, name : str
        Its task, and its name: the namespace of its marker.
    group : str
        One of `GROUPS`.
    marker : visualization_msgs.msg.Marker
    T : ndarray (4, 4)
        Pose in the root frame.
    grip : Grip
    relative : bool
        The value that a drag sets depends on the pose at the start of the drag.

    """

    relative: ClassVar[bool] = False

    task: str
    name: str
    group: str
    marker: Marker
    T: Array
    grip: Grip

    @property
    def title(self) -> str:
        """Return the label."""
        return self.task

    @abstractmethod
    def apply(self, T: Array, publish: Publish, set_key: SetKey) -> None:
        """Move the element of the controller to a pose (4, 4)."""


@dataclass(frozen=True, eq=False)
class DraggableGoal(Draggable):
    """
    Goal of a task.

    Attributes
    ----------
    kind : type
        Type of the message that moves it.

    """

    kind: type

    def apply(self, T: Array, publish: Publish, set_key: SetKey) -> None:
        """Publish the pose as the goal."""
        publish(self.task, 'goal', self.message(T))

    def message(self, T: Array) -> Message:
        """Return the goal at a pose."""
        xyz = T[:3, 3].tolist()
        if self.kind is Vector3Stamped:
            start = self.marker.pose.position
            xyz = (T[:3, 3] - (start.x, start.y, start.z)).tolist()
        fields = {'xyz': xyz, 'quat_xyzw': quaternion_from_rotation(T[:3, :3]).tolist()}
        message = make_message(self.task, self.kind, {
            name: fields[name] for name in FIELDS[self.kind]})
        message.header.frame_id = self.marker.header.frame_id
        return message


class DraggableObstacle(Draggable):
    """Obstacle, labelled with its name."""

    @property
    def title(self) -> str:
        """Return the name of the obstacle."""
        return self.name.partition(f'{OBSTACLE}/')[2]

    def apply(self, T: Array, publish: Publish, set_key: SetKey) -> None:
        """Publish the pose of the obstacle."""
        publish(self.task, OBSTACLES, self.message(T))

    def message(self, T: Array) -> MarkerArray:
        """Return the obstacle at a pose."""
        marker = copy.deepcopy(self.marker)
        marker.ns, marker.id = self.title, 0
        x, y, z, w = quaternion_from_rotation(T[:3, :3]).tolist()
        point, turn = marker.pose.position, marker.pose.orientation
        point.x, point.y, point.z = T[:3, 3].tolist()
        turn.x, turn.y, turn.z, turn.w = x, y, z, w
        # Without a lifetime: the obstacle stays until it is deleted.
        marker.lifetime.sec = marker.lifetime.nanosec = 0
        return MarkerArray(markers=[marker])


@dataclass(frozen=True, eq=False)
class DraggableKey(Draggable):
    """
    Point whose position shows a key of a task; it is dragged along its x axis.

    Attributes
    ----------
    value : float
        Value of the key in the controller.

    """

    # The robot, and with it the point, moves during a drag.
    relative = True
    key: ClassVar[str]
    unit: ClassVar[str]

    value: float

    @property
    def title(self) -> str:
        """Return the task and the value."""
        return f'{self.task}: {quantity(self.unit, self.value)}'

    def apply(self, T: Array, publish: Publish, set_key: SetKey) -> None:
        """Set the key."""
        set_key(self.task, self.key, round(self.value_at(T), KEY_DECIMALS))

    @abstractmethod
    def value_at(self, T: Array) -> float:
        """Return the value of the key that a pose (4, 4) shows."""


class DraggableRim(DraggableKey):
    """Point on the rim of a cone of view; it sets the half angle."""

    key = 'half_angle'
    unit = 'rad'

    def value_at(self, T: Array) -> float:
        """Return the angle between the axis of the cone and a point on its surface [rad]."""
        T_root_cone = pose_of(self.marker)
        x, y, z = T_root_cone[:3, :3].T.dot(T[:3, 3] - T_root_cone[:3, 3]).tolist()
        return min(max(math.atan2(math.hypot(x, y), z), MIN_HALF_ANGLE), MAX_HALF_ANGLE)


class DraggableTilt(DraggableRim):
    """Point on the rim of the cone that an axis stays in; it sets its half angle."""

    key = 'within'


class DraggableGap(DraggableKey):
    """Point at the minimum distance from one of two objects, on the line between them."""

    key = 'distance'
    unit = 'm'

    def value_at(self, T: Array) -> float:
        """Return the distance along the line [m]."""
        return max(self.value + float(self.T[:3, 0].dot(T[:3, 3] - self.T[:3, 3])), 0.0)


def draggables_of(markers: Iterable[Marker], topics: Topics, numbers: Numbers) -> list[Draggable]:
    """
    Return the draggable elements of the markers.

    Parameters
    ----------
    markers : iterable of visualization_msgs.msg.Marker
        Markers of the tasks, with the namespaces ``<task>/<part>``.
    topics : mapping
        {task: {topic: message type}}
    numbers : mapping
        {task: {key: number}} of the stack.

    Returns
    -------
    list of Draggable

    """
    found = [place for marker in markers if marker.action == Marker.ADD and marker.id == 0
             if (place := _draggable_of(marker, topics, numbers)) is not None]
    # The goal of a region coincides with the region.
    regions = {place.task for place in found if place.group == REGIONS}
    return [place for place in found if place.group != GOALS or place.task not in regions]


def _draggable_of(marker: Marker, topics: Topics, numbers: Numbers) -> Draggable | None:
    """Return the draggable element of a marker; None if there is none."""
    task, _, part = marker.ns.partition('/')
    if part.startswith(f'{OBSTACLE}/'):
        return DraggableObstacle(task, marker.ns, OBSTACLES, marker, pose_of(marker), Grip())
    if part in KEYS:
        return KEYS[part](task, marker, numbers.get(task, {}))
    return _goal(task, part, marker, topics.get(task, {}).get('goal'))


def _goal(task: str, part: str, marker: Marker, kind: type | None) -> Draggable | None:
    """Return the goal of a task, moved by messages of a type; None if it cannot be dragged."""
    group, kinds = PARTS.get(part, ('', ()))
    if kind is None or kind not in kinds:
        return None
    T = pose_of(marker)
    if part == 'sight' and len(marker.points) == 2:
        tip = marker.points[1]
        T = pose(np.eye(3), T[:3, 3] + T[:3, :3].dot((tip.x, tip.y, tip.z)))
    elif kind is PointStamped:
        # A point has no orientation: it is dragged along the axes of the root frame.
        T = pose(np.eye(3), T[:3, 3])
    moves, turns = kind is not QuaternionStamped, kind in (PoseStamped, QuaternionStamped)
    return DraggableGoal(task, marker.ns, group, marker, T,
                         Grip(moves=moves, planes=moves, turns=turns), kind)


def _rim(task: str, marker: Marker, numbers: Mapping[str, float]) -> Draggable | None:
    """Return a point on the rim of a cone; None if its width shows an error."""
    kind = DraggableTilt if DraggableTilt.key in numbers else DraggableRim
    value = numbers.get(kind.key)
    if value is None or len(marker.points) < 2:
        return None
    T, rim = pose_of(marker), marker.points[1]
    angle = math.atan2(rim.x, rim.z)
    # The x axis points in the direction in which the cone opens.
    turn = np.array([[math.cos(angle), 0.0, math.sin(angle)], [0.0, 1.0, 0.0],
                     [-math.sin(angle), 0.0, math.cos(angle)]])
    p = T[:3, 3] + T[:3, :3].dot((rim.x, rim.y, rim.z))
    return kind(task, marker.ns, CONES, marker, pose(T[:3, :3].dot(turn), p), ALONG_X, value)


def _gap(task: str, marker: Marker, numbers: Mapping[str, float]) -> Draggable | None:
    """Return a point on the shortest line between objects."""
    value = numbers.get(DraggableGap.key)
    if value is None or len(marker.points) < 2:
        return None
    start, end = (np.array((point.x, point.y, point.z)) for point in marker.points[:2])
    difference = start - end
    length = float(np.linalg.norm(difference))
    if length < MIN_GAP_LENGTH:
        return None
    x = difference / length
    T = pose(np.column_stack((x, *across(x))), end + value * x)
    return DraggableGap(task, marker.ns, DISTANCES, marker, T, ALONG_X, value)


# {part of a task: function that returns the point that sets a key}
KEYS: Mapping[str, Callable[[str, Marker, Mapping[str, float]], Draggable | None]] = {
    'cone': _rim, 'distance': _gap}
