# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Gizmos of the browser that drag goals, regions, obstacles, cones and distances."""

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
    Draggable,
    GOALS,
    GROUPS,
    OBSTACLES,
    Publish,
    REGIONS,
    SetKey,
)
from tp_controller.tools.view.parts import place
import viser

HANDLES = '/handles'
# Size of the gizmos [m].
SIZES = {GOALS: 0.22, REGIONS: 0.16, OBSTACLES: 0.16, CONES: 0.12, DISTANCES: 0.12}
# Period of messages during a drag, and time after a drag at which a gizmo follows the controller
# again [s].
SEND_PERIOD, FOLLOW_DELAY = 0.05, 1.0
# Smallest change of a pose or label position that is sent [m].
GIZMO_TOLERANCE = 1e-6
# Offset of a label as a share of the size of its gizmo.
LABEL_OFFSET = 0.5


class Gizmos:
    """
    Gizmos of all draggable elements in a scene.

    Parameters
    ----------
    scene : viser.SceneApi
    publish, set_key : callable
        Publish a message for a task; set a key of a task in the stack.
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

    def follow(self, places: Iterable[Draggable]) -> None:
        """Update the gizmos to the draggable elements of the controller."""
        now = self._clock()
        wanted = {element.name: element for element in places if self.shown[element.group]}
        # A key has no marker for a moment while the controller applies a new value.
        for name in [name for name, gizmo in self.gizmos.items() if not gizmo.in_use(now)
                     and (name not in wanted or wanted[name].grip != gizmo.grip)]:
            self.gizmos.pop(name).remove()
        for name, found in wanted.items():
            if name not in self.gizmos:
                self.gizmos[name] = Gizmo(self._scene, found, self._clock)
            self.gizmos[name].follow(found, now)

    def tips(self) -> Array:
        """Return the positions (k, 3) of the tips of all arrows [m]."""
        return np.concatenate([np.zeros((0, 3)), *(
            gizmo.tips() for gizmo in self.gizmos.values())])

    def send(self) -> None:
        """Publish dragged poses at a limited rate; the last pose is always published."""
        now = self._clock()
        for gizmo in self.gizmos.values():
            T = gizmo.due(now)
            if T is not None:
                gizmo.source.apply(T, self._publish, self._set_key)


class Gizmo:
    """
    Gizmo of one draggable element.

    Attributes
    ----------
    element : Draggable
        The element at its pose in the controller.
    grip : Grip
    handle : viser.TransformControlsHandle
    label : viser.LabelHandle

    """

    def __init__(self, scene: viser.SceneApi, found: Draggable,
                 clock: Callable[[], float]) -> None:
        self.element, self._clock = found, clock
        self._drag_time = self._send_time = -math.inf
        self._pending: Array | None = None
        self._start = found
        self._dragging = False
        self.grip = grip = found.grip
        size = SIZES[found.group]
        self.handle = scene.add_transform_controls(
            f'{HANDLES}/{found.name}', size, active_axes=grip.axes,
            disable_axes=not grip.moves, disable_sliders=not grip.planes,
            disable_rotations=not grip.turns, depth_test=False)
        place(self.handle, found.T)
        self.label = scene.add_label(f'{HANDLES}/{found.name}/label', found.title)
        self._place_label()

        # On the thread of the server, which preserves the order of the events.
        @self.handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            if event.phase == 'start':
                self.begin_drag()
                return
            self.drag(_pose_of_handle(event.target))
            if event.phase == 'end':
                self.end_drag()

    def tips(self) -> Array:
        """Return the positions (k, 3) of the tips of its arrows [m]."""
        T = _pose_of_handle(self.handle)
        return T[:3, 3] + SIZES[self.element.group] * T[:3, :3].T[list(self.grip.axes)]

    @property
    def source(self) -> Draggable:
        """Return the element that interprets a drag: the current one, or that at its start."""
        return self._start if self.element.relative else self.element

    def begin_drag(self) -> None:
        """Begin a drag."""
        self._start, self._dragging = self.element, True

    def end_drag(self) -> None:
        """End a drag."""
        self._dragging = False

    def in_use(self, now: float) -> bool:
        """Return whether a drag goes on, or ended less than `FOLLOW_DELAY` ago."""
        return self._dragging or self._pending is not None or now - self._drag_time <= FOLLOW_DELAY

    def drag(self, T: Array) -> None:
        """Store a dragged pose for publication."""
        self._drag_time, self._pending = self._clock(), T

    def follow(self, found: Draggable, now: float) -> None:
        """Move to the pose in the controller, unless a drag was recent."""
        if found.title != self.element.title:
            self.label.text = found.title
        self.element = found
        if not self.in_use(now):
            if np.abs(found.T - _pose_of_handle(self.handle)).max() > GIZMO_TOLERANCE:
                place(self.handle, found.T)
        self._place_label()

    def _place_label(self) -> None:
        """
        Place the label above the gizmo, in any orientation of it.

        The label of a single arrow is above its tip, or below an arrow that does not rise: the
        text of its line is on the other side. Its offset exceeds that of the tip, for cameras that
        look down on an arrow that points at them.
        """
        # The third row of R: the vertical in the axes of the gizmo.
        up = _pose_of_handle(self.handle)[2, :3]
        rise = LABEL_OFFSET
        if self.element.grip.single:
            rise = up[0] + LABEL_OFFSET if up[0] > STEEP_SLOPE else min(up[0], 0.0) - LABEL_OFFSET
        position = SIZES[self.element.group] * rise * up
        if np.abs(position - self.label.position).max() > GIZMO_TOLERANCE:
            self.label.position = position
        anchor: Literal['bottom-center', 'top-center'] = \
            'bottom-center' if rise > 0.0 else 'top-center'
        if anchor != self.label.anchor:
            self.label.anchor = anchor

    def due(self, now: float) -> Array | None:
        """Return the pose to publish now; None if there is none."""
        if self._pending is None or now - self._send_time < SEND_PERIOD:
            return None
        T, self._pending, self._send_time = self._pending, None, now
        return T

    def remove(self) -> None:
        """Remove the gizmo from the scene."""
        self.handle.remove()


def _pose_of_handle(handle: viser.TransformControlsHandle) -> Array:
    """Return the pose (4, 4) of a node of the scene."""
    return pose(rotation_from_quaternion(np.roll(handle.wxyz, -1)), handle.position)
