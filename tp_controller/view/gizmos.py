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

"""Goals, regions and obstacles that can be dragged in the browser."""

from collections.abc import Callable, Iterable, Mapping
import copy
from dataclasses import dataclass
import math
import time
from typing import Protocol

from geometry_msgs.msg import PointStamped, PoseStamped, QuaternionStamped, Vector3Stamped
import numpy as np
from tp_controller.model.spatial import (
    Array,
    pose,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from tp_controller.nodes import Message
from tp_controller.nodes.client import FIELDS, make_message
from tp_controller.view.markers import pose_of
from tp_controller.view.parts import place
import viser
from visualization_msgs.msg import Marker, MarkerArray

HANDLES = '/handles'
GOALS, REGIONS, OBSTACLES = 'goals', 'regions', 'obstacles'
OBSTACLE = 'obstacle'
# Size of what is dragged [m].
SIZES = {GOALS: 0.22, REGIONS: 0.16, OBSTACLES: 0.16}
# Time between two messages while something is dragged, and after which it goes where the
# controller says that it is [s].
PERIOD, PATIENCE = 0.05, 1.0
SAME = 1e-6
# {part of a task that is drawn: (what it is, messages that it can be told by)}
PARTS: Mapping[str, tuple[str, tuple[type, ...]]] = {
    'goal': (GOALS, (PointStamped, PoseStamped, QuaternionStamped)),
    'sight': (GOALS, (Vector3Stamped,)),
    'region': (REGIONS, (PoseStamped,))}

Topics = Mapping[str, Mapping[str, type]]


class Publish(Protocol):
    """Publishes on a topic of a task."""

    def __call__(self, task: str, topic: str, message: Message) -> None:
        """Publish a message."""


@dataclass(frozen=True, eq=False)
class Place:
    """
    Something that can be dragged, where the controller has it.

    Attributes
    ----------
    task, name : str
        Its task, and what it is called: the namespace of its marker.
    group : str
        ``goals``, ``regions`` or ``obstacles``.
    kind : type
        Of the message that moves it.
    marker : visualization_msgs.msg.Marker
    T : ndarray (4, 4)
        Where it is, in the root frame.

    """

    task: str
    name: str
    group: str
    kind: type
    marker: Marker
    T: Array

    @property
    def title(self) -> str:
        """Return what is written beside it: the name of an obstacle, else of its task."""
        return self.name.partition(f'{OBSTACLE}/')[2] or self.task

    def message(self, T: Array) -> tuple[str, Message]:
        """Return the topic and the message that move it to a pose."""
        if self.group == OBSTACLES:
            return OBSTACLES, self._obstacle(T)
        xyz = T[:3, 3].tolist()
        if self.kind is Vector3Stamped:
            start = self.marker.pose.position
            xyz = (T[:3, 3] - (start.x, start.y, start.z)).tolist()
        fields = {'xyz': xyz, 'quat_xyzw': quaternion_from_rotation(T[:3, :3]).tolist()}
        message = make_message(self.task, self.kind, {
            name: fields[name] for name in FIELDS[self.kind]})
        message.header.frame_id = self.marker.header.frame_id
        return 'goal', message

    def _obstacle(self, T: Array) -> MarkerArray:
        """Return the obstacle at a pose."""
        marker = copy.deepcopy(self.marker)
        marker.ns, marker.id = self.name.partition(f'{OBSTACLE}/')[2], 0
        x, y, z, w = quaternion_from_rotation(T[:3, :3]).tolist()
        point, turn = marker.pose.position, marker.pose.orientation
        point.x, point.y, point.z = T[:3, 3].tolist()
        turn.x, turn.y, turn.z, turn.w = x, y, z, w
        # It stays until somebody takes it away.
        marker.lifetime.sec = marker.lifetime.nanosec = 0
        return MarkerArray(markers=[marker])


class Gizmos:
    """
    What can be dragged, in a scene.

    Parameters
    ----------
    scene : viser.SceneApi
    publish : callable
        Sends a message for a task.
    clock : callable
        Returns a time [s].

    Attributes
    ----------
    shown : dict
        {group: whether it can be dragged}
    gizmos : dict
        {name: Gizmo}

    """

    def __init__(self, scene: viser.SceneApi, publish: Publish,
                 clock: Callable[[], float] = time.monotonic) -> None:
        self._scene, self._publish, self._clock = scene, publish, clock
        self.shown = dict.fromkeys((GOALS, REGIONS, OBSTACLES), True)
        self.gizmos: dict[str, Gizmo] = {}

    def follow(self, places: Iterable[Place]) -> None:
        """Have what can be dragged where the controller has it, and nothing else."""
        now = self._clock()
        wanted = {place.name: place for place in places if self.shown[place.group]}
        for name in [name for name, gizmo in self.gizmos.items()
                     if name not in wanted or wanted[name].kind is not gizmo.place.kind]:
            self.gizmos.pop(name).remove()
        for name, found in wanted.items():
            if name not in self.gizmos:
                self.gizmos[name] = Gizmo(self._scene, found, self._clock)
            self.gizmos[name].follow(found, now)

    def send(self) -> None:
        """Send what was dragged, not too often; what was dragged last is sent in any case."""
        now = self._clock()
        for gizmo in self.gizmos.values():
            T = gizmo.due(now)
            if T is not None:
                self._publish(gizmo.place.task, *gizmo.place.message(T))


class Gizmo:
    """
    What is dragged as one.

    Attributes
    ----------
    place : Place
        Where the controller has it.
    handle : viser.TransformControlsHandle

    """

    def __init__(self, scene: viser.SceneApi, found: Place, clock: Callable[[], float]) -> None:
        self.place, self._clock = found, clock
        self._touched = self._sent = -math.inf
        self._dragged: Array | None = None
        turns = found.group != GOALS or found.kind in (PoseStamped, QuaternionStamped)
        moves = found.kind is not QuaternionStamped
        self.handle = scene.add_transform_controls(
            f'{HANDLES}/{found.name}', SIZES[found.group], disable_axes=not moves,
            disable_sliders=not moves, disable_rotations=not turns, depth_test=False)
        place(self.handle, found.T)
        scene.add_label(f'{HANDLES}/{found.name}/label', found.title, anchor='bottom-center',
                        position=(0.0, 0.0, 0.5 * SIZES[found.group]))

        # On the thread of the server, so that the order of the events is kept.
        @self.handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            self.drag(_pose_of_handle(event.target))

    def drag(self, T: Array) -> None:
        """Take a pose that somebody has dragged it to."""
        self._touched, self._dragged = self._clock(), T

    def follow(self, found: Place, now: float) -> None:
        """Go where the controller has it, unless it was dragged a moment ago."""
        self.place = found
        if now - self._touched > PATIENCE and self._dragged is None:
            if np.abs(found.T - _pose_of_handle(self.handle)).max() > SAME:
                place(self.handle, found.T)

    def due(self, now: float) -> Array | None:
        """Return the pose that is to be sent now, if there is one."""
        if self._dragged is None or now - self._sent < PERIOD:
            return None
        T, self._dragged, self._sent = self._dragged, None, now
        return T

    def remove(self) -> None:
        """Take it out of the scene."""
        self.handle.remove()


def places_of(markers: Iterable[Marker], topics: Topics) -> list[Place]:
    """
    Return what can be dragged.

    Parameters
    ----------
    markers : iterable of visualization_msgs.msg.Marker
        What is drawn of the tasks: their namespaces are ``<task>/<part>``.
    topics : mapping
        {task: {topic: message type}}

    Returns
    -------
    list of Place

    """
    found = [place for marker in markers if marker.action == Marker.ADD and marker.id == 0
             if (place := _place_of(marker, topics)) is not None]
    # The goal of a region is where the region is.
    regions = {place.task for place in found if place.group == REGIONS}
    return [place for place in found if place.group != GOALS or place.task not in regions]


def _place_of(marker: Marker, topics: Topics) -> Place | None:
    """Return what can be dragged of a marker, if anything."""
    task, _, part = marker.ns.partition('/')
    kind = topics.get(task, {}).get('goal')
    if part.startswith(f'{OBSTACLE}/'):
        return Place(task, marker.ns, OBSTACLES, MarkerArray, marker, pose_of(marker))
    group, kinds = PARTS.get(part, ('', ()))
    if kind not in kinds:
        return None
    T = pose_of(marker)
    if part == 'sight' and len(marker.points) == 2:
        tip = marker.points[1]
        T = pose(np.eye(3), T[:3, 3] + T[:3, :3].dot((tip.x, tip.y, tip.z)))
    elif kind is PointStamped:
        # What has no orientation is dragged along the axes of the root.
        T = pose(np.eye(3), T[:3, 3])
    return Place(task, marker.ns, group, kind, marker, T)


def _pose_of_handle(handle: viser.TransformControlsHandle) -> Array:
    """Return the pose (4, 4) of a node of the scene."""
    return pose(rotation_from_quaternion(np.roll(handle.wxyz, -1)), handle.position)
