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

"""Goals, regions, obstacles, cones and distances that can be dragged in the browser."""

from collections.abc import Callable, Iterable
import math
import time
from typing import Literal

import numpy as np
from tp_controller.model.spatial import Array, pose, rotation_from_quaternion
from tp_controller.tasks.sketch import STEEP_SLOPE
from tp_controller.tools.view.draggables import (
    CONES,
    DISTANCES,
    GOALS,
    GROUPS,
    OBSTACLES,
    Place,
    Publish,
    REGIONS,
    SetKey,
)
from tp_controller.tools.view.parts import place
import viser

HANDLES = '/handles'
# Size of what is dragged [m].
SIZES = {GOALS: 0.22, REGIONS: 0.16, OBSTACLES: 0.16, CONES: 0.12, DISTANCES: 0.12}
# Time between two messages while something is dragged, and after which it goes where the
# controller says that it is, or away [s].
PERIOD, PATIENCE = 0.05, 1.0
SAME = 1e-6
# How far a label is from what is dragged, for its size.
CLEAR = 0.5


class Gizmos:
    """
    What can be dragged, in a scene.

    Parameters
    ----------
    scene : viser.SceneApi
    publish, set_key : callable
        Sends a message for a task; changes a key of a task in the stack.
    clock : callable
        Returns a time [s].

    Attributes
    ----------
    shown : dict
        {group: whether it can be dragged}
    gizmos : dict
        {name: Gizmo}

    """

    def __init__(self, scene: viser.SceneApi, publish: Publish, set_key: SetKey,
                 clock: Callable[[], float] = time.monotonic) -> None:
        self._scene, self._publish, self._set_key = scene, publish, set_key
        self._clock = clock
        self.shown = dict.fromkeys(GROUPS, True)
        self.gizmos: dict[str, Gizmo] = {}

    def follow(self, places: Iterable[Place]) -> None:
        """Have what can be dragged where the controller has it, and nothing else."""
        now = self._clock()
        wanted = {place.name: place for place in places if self.shown[place.group]}
        # What shows a number is not drawn for a moment while the controller takes another one.
        for name in [name for name, gizmo in self.gizmos.items() if not gizmo.in_use(now)
                     and (name not in wanted or wanted[name].grip != gizmo.grip)]:
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
                gizmo.source.tell(T, self._publish, self._set_key)


class Gizmo:
    """
    What is dragged as one.

    Attributes
    ----------
    place : Place
        Where the controller has it.
    grip : Grip
    handle : viser.TransformControlsHandle
    label : viser.LabelHandle

    """

    def __init__(self, scene: viser.SceneApi, found: Place, clock: Callable[[], float]) -> None:
        self.place, self._clock = found, clock
        self._touched = self._sent = -math.inf
        self._dragged: Array | None = None
        self._taken = found
        self._in_hand = False
        self.grip = grip = found.grip
        size = SIZES[found.group]
        self.handle = scene.add_transform_controls(
            f'{HANDLES}/{found.name}', size, active_axes=grip.axes,
            disable_axes=not grip.moves, disable_sliders=not grip.planes,
            disable_rotations=not grip.turns, depth_test=False)
        place(self.handle, found.T)
        self.label = scene.add_label(f'{HANDLES}/{found.name}/label', found.title)
        self._place_label()

        # On the thread of the server, so that the order of the events is kept.
        @self.handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            if event.phase == 'start':
                self.take()
                return
            self.drag(_pose_of_handle(event.target))
            if event.phase == 'end':
                self.leave()

    @property
    def source(self) -> Place:
        """Return what says what a drag means: where it is now, or was when it was taken."""
        return self._taken if self.place.relative else self.place

    def take(self) -> None:
        """Take hold of it."""
        self._taken, self._in_hand = self.place, True

    def leave(self) -> None:
        """Leave it where it is."""
        self._in_hand = False

    def in_use(self, now: float) -> bool:
        """Return whether somebody holds it, or dragged it a moment ago."""
        return self._in_hand or self._dragged is not None or now - self._touched <= PATIENCE

    def drag(self, T: Array) -> None:
        """Take a pose that somebody has dragged it to."""
        self._touched, self._dragged = self._clock(), T

    def follow(self, found: Place, now: float) -> None:
        """Go where the controller has it, unless it was dragged a moment ago."""
        if found.title != self.place.title:
            self.label.text = found.title
        self.place = found
        if not self.in_use(now):
            if np.abs(found.T - _pose_of_handle(self.handle)).max() > SAME:
                place(self.handle, found.T)
        self._place_label()

    def _place_label(self) -> None:
        """
        Have the label above what is dragged, however that is turned.

        That of a single arrow is above its tip, or below an arrow that does not rise: the text of
        the line that it is on is on the other side. It is further off than the tip, for cameras
        that look down on an arrow that points at them.
        """
        # The third row of R: up, in the axes of what is dragged.
        up = _pose_of_handle(self.handle)[2, :3]
        rise = CLEAR
        if self.place.grip.single:
            rise = up[0] + CLEAR if up[0] > STEEP_SLOPE else min(up[0], 0.0) - CLEAR
        position = SIZES[self.place.group] * rise * up
        if np.abs(position - self.label.position).max() > SAME:
            self.label.position = position
        anchor: Literal['bottom-center', 'top-center'] = \
            'bottom-center' if rise > 0.0 else 'top-center'
        if anchor != self.label.anchor:
            self.label.anchor = anchor

    def due(self, now: float) -> Array | None:
        """Return the pose that is to be sent now, if there is one."""
        if self._dragged is None or now - self._sent < PERIOD:
            return None
        T, self._dragged, self._sent = self._dragged, None, now
        return T

    def remove(self) -> None:
        """Take it out of the scene."""
        self.handle.remove()


def _pose_of_handle(handle: viser.TransformControlsHandle) -> Array:
    """Return the pose (4, 4) of a node of the scene."""
    return pose(rotation_from_quaternion(np.roll(handle.wxyz, -1)), handle.position)
