# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What of a controller can be dragged, and what a drag tells the controller."""

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
from tp_controller.ros.client.client import FIELDS, make_message
from tp_controller.tasks.aim import across
from tp_controller.tools.view.markers import pose_of
from tp_controller.tools.view.rows import quantity
from visualization_msgs.msg import Marker, MarkerArray

GOALS, REGIONS, OBSTACLES = 'goals', 'regions', 'obstacles'
CONES, DISTANCES = 'cones', 'distances'
GROUPS = (GOALS, REGIONS, OBSTACLES, CONES, DISTANCES)
OBSTACLE = 'obstacle'
# {part of a task that is drawn: (what it is, messages that it can be told by)}
PARTS: Mapping[str, tuple[str, tuple[type, ...]]] = {
    'goal': (GOALS, (PointStamped, PoseStamped, QuaternionStamped)),
    'sight': (GOALS, (Vector3Stamped,)),
    'region': (REGIONS, (PoseStamped,))}
# To how many digits keys are set: 0.1 mm, or 0.006°.
DIGITS = 4
# Of cones [rad].
NARROWEST, WIDEST = 0.01, math.pi - 0.01
# Points that are nearer to each other show no direction [m].
SAME = 1e-6

Topics = Mapping[str, Mapping[str, type]]
Numbers = Mapping[str, Mapping[str, float]]


class Publish(Protocol):
    """Publishes on a topic of a task."""

    def __call__(self, task: str, topic: str, message: Message) -> None:
        """Publish a message."""


class SetKey(Protocol):
    """Changes a key of a task in the stack."""

    def __call__(self, task: str, key: str, value: float) -> None:
        """Set a number."""


@dataclass(frozen=True)
class Grip:
    """
    How something can be taken hold of.

    Attributes
    ----------
    axes : tuple of bool
        Which of its own axes count.
    moves, planes, turns : bool
        Whether it can be moved along them, in planes of two of them, and turned about them.

    """

    axes: tuple[bool, bool, bool] = (True, True, True)
    moves: bool = True
    planes: bool = True
    turns: bool = True

    @property
    def single(self) -> bool:
        """Return whether there is one arrow, along x, and nothing else."""
        return self == ALONG_X


ALONG_X = Grip((True, False, False), planes=False, turns=False)


@dataclass(frozen=True, eq=False)
class Place(ABC):
    """
    Something that can be dragged, where the controller has it.

    Attributes
    ----------
    task, name : str
        Its task, and what it is called: the namespace of its marker.
    group : str
        One of `GROUPS`.
    marker : visualization_msgs.msg.Marker
    T : ndarray (4, 4)
        Where it is, in the root frame.
    grip : Grip
    relative : bool
        What a drag says depends on where it was when somebody took hold of it.

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
        """Return what is written beside it."""
        return self.task

    @abstractmethod
    def tell(self, T: Array, publish: Publish, set_key: SetKey) -> None:
        """Tell the controller to have it at a pose (4, 4)."""


@dataclass(frozen=True, eq=False)
class GoalPlace(Place):
    """
    The goal of a task.

    Attributes
    ----------
    kind : type
        Of the message that moves it.

    """

    kind: type

    def tell(self, T: Array, publish: Publish, set_key: SetKey) -> None:
        """Publish it as the goal."""
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


class ObstaclePlace(Place):
    """An obstacle; what is written beside it is its name."""

    @property
    def title(self) -> str:
        """Return the name of the obstacle."""
        return self.name.partition(f'{OBSTACLE}/')[2]

    def tell(self, T: Array, publish: Publish, set_key: SetKey) -> None:
        """Publish it among the obstacles."""
        publish(self.task, OBSTACLES, self.message(T))

    def message(self, T: Array) -> MarkerArray:
        """Return the obstacle at a pose."""
        marker = copy.deepcopy(self.marker)
        marker.ns, marker.id = self.title, 0
        x, y, z, w = quaternion_from_rotation(T[:3, :3]).tolist()
        point, turn = marker.pose.position, marker.pose.orientation
        point.x, point.y, point.z = T[:3, 3].tolist()
        turn.x, turn.y, turn.z, turn.w = x, y, z, w
        # It stays until somebody takes it away.
        marker.lifetime.sec = marker.lifetime.nanosec = 0
        return MarkerArray(markers=[marker])


@dataclass(frozen=True, eq=False)
class KeyPlace(Place):
    """
    A point whose place shows a key of a task; it is dragged along its x axis.

    Attributes
    ----------
    value : float
        Of the key, as the controller has it.

    """

    # The robot moves meanwhile, and with it what shows the key.
    relative = True
    key: ClassVar[str]
    unit: ClassVar[str]

    value: float

    @property
    def title(self) -> str:
        """Return the task and the value."""
        return f'{self.task}: {quantity(self.unit, self.value)}'

    def tell(self, T: Array, publish: Publish, set_key: SetKey) -> None:
        """Set the key."""
        set_key(self.task, self.key, round(self.value_at(T), DIGITS))

    @abstractmethod
    def value_at(self, T: Array) -> float:
        """Return the value of the key that a pose (4, 4) shows."""


class RimPlace(KeyPlace):
    """A point on the rim of a cone of view, as far from its axis as it is wide."""

    key = 'half_angle'
    unit = 'rad'

    def value_at(self, T: Array) -> float:
        """Return the angle between the axis of the cone and a point on its surface [rad]."""
        T_root_cone = pose_of(self.marker)
        x, y, z = T_root_cone[:3, :3].T.dot(T[:3, 3] - T_root_cone[:3, 3]).tolist()
        return min(max(math.atan2(math.hypot(x, y), z), NARROWEST), WIDEST)


class GapPlace(KeyPlace):
    """A point as far from one of two objects as both are kept apart, on the line between them."""

    key = 'distance'
    unit = 'm'

    def value_at(self, T: Array) -> float:
        """Return the distance along the line [m]."""
        return max(self.value + float(self.T[:3, 0].dot(T[:3, 3] - self.T[:3, 3])), 0.0)


def places_of(markers: Iterable[Marker], topics: Topics, numbers: Numbers) -> list[Place]:
    """
    Return what can be dragged.

    Parameters
    ----------
    markers : iterable of visualization_msgs.msg.Marker
        What is drawn of the tasks: their namespaces are ``<task>/<part>``.
    topics : mapping
        {task: {topic: message type}}
    numbers : mapping
        {task: {key: number}} of the stack.

    Returns
    -------
    list of Place

    """
    found = [place for marker in markers if marker.action == Marker.ADD and marker.id == 0
             if (place := _place_of(marker, topics, numbers)) is not None]
    # The goal of a region is where the region is.
    regions = {place.task for place in found if place.group == REGIONS}
    return [place for place in found if place.group != GOALS or place.task not in regions]


def _place_of(marker: Marker, topics: Topics, numbers: Numbers) -> Place | None:
    """Return what can be dragged of a marker, if anything."""
    task, _, part = marker.ns.partition('/')
    if part.startswith(f'{OBSTACLE}/'):
        return ObstaclePlace(task, marker.ns, OBSTACLES, marker, pose_of(marker), Grip())
    if part in KEYS:
        return KEYS[part](task, marker, numbers.get(task, {}))
    return _goal(task, part, marker, topics.get(task, {}).get('goal'))


def _goal(task: str, part: str, marker: Marker, kind: type | None) -> Place | None:
    """Return the goal of a task that is told by messages of a type, if it can be dragged."""
    group, kinds = PARTS.get(part, ('', ()))
    if kind is None or kind not in kinds:
        return None
    T = pose_of(marker)
    if part == 'sight' and len(marker.points) == 2:
        tip = marker.points[1]
        T = pose(np.eye(3), T[:3, 3] + T[:3, :3].dot((tip.x, tip.y, tip.z)))
    elif kind is PointStamped:
        # What has no orientation is dragged along the axes of the root.
        T = pose(np.eye(3), T[:3, 3])
    moves, turns = kind is not QuaternionStamped, kind in (PoseStamped, QuaternionStamped)
    return GoalPlace(task, marker.ns, group, marker, T,
                     Grip(moves=moves, planes=moves, turns=turns), kind)


def _rim(task: str, marker: Marker, numbers: Mapping[str, float]) -> Place | None:
    """Return a point on the rim of a cone of view; other cones are as wide as an error."""
    value = numbers.get(RimPlace.key)
    if value is None or len(marker.points) < 2:
        return None
    T, rim = pose_of(marker), marker.points[1]
    angle = math.atan2(rim.x, rim.z)
    # Along x the cone opens.
    turn = np.array([[math.cos(angle), 0.0, math.sin(angle)], [0.0, 1.0, 0.0],
                     [-math.sin(angle), 0.0, math.cos(angle)]])
    p = T[:3, 3] + T[:3, :3].dot((rim.x, rim.y, rim.z))
    return RimPlace(task, marker.ns, CONES, marker, pose(T[:3, :3].dot(turn), p), ALONG_X, value)


def _gap(task: str, marker: Marker, numbers: Mapping[str, float]) -> Place | None:
    """Return a point on the shortest of the lines between objects."""
    value = numbers.get(GapPlace.key)
    if value is None or len(marker.points) < 2:
        return None
    start, end = (np.array((point.x, point.y, point.z)) for point in marker.points[:2])
    way = start - end
    length = float(np.linalg.norm(way))
    if length < SAME:
        return None
    x = way / length
    T = pose(np.column_stack((x, *across(x))), end + value * x)
    return GapPlace(task, marker.ns, DISTANCES, marker, T, ALONG_X, value)


# {part of a task that is drawn: what of it shows a key of the stack}
KEYS: Mapping[str, Callable[[str, Marker, Mapping[str, float]], Place | None]] = {
    'cone': _rim, 'distance': _gap}
