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

"""Sketches of tasks in a scene of the browser, without ROS."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from tp_controller.model.shapes import Box, Cylinder, Shape, Sphere
from tp_controller.model.spatial import Array
from tp_controller.tasks.sketch import Arrow, Body, Cone, Dot, Path, Sketch, Triad
from tp_controller.tools.view.parts import add_part, Colour, Part, place
import viser

TASKS = '/tasks'
GOAL_COLOUR: Colour = (213, 94, 0)
REGION_COLOUR: Colour = (0, 158, 115)
OBSTACLE_COLOUR: Colour = (176, 122, 66)
CONE_COLOUR: Colour = (86, 180, 233)
TRANSLUCENT = 0.18
CORNERS = 48
# Length and radius of the axes of a goal, and radius of its ball, as shares of the scene size.
AXES, BALL = (0.07, 0.005), 0.013
# Largest length of a cone as a share of the scene size.
LONGEST_CONE = 0.14


def shape_part(shape: Shape, T: Array, colour: Colour, opacity: float = 1.0) -> Part | None:
    """Return a shape as a solid; None for a half-space, which is infinite."""
    if isinstance(shape, Box):
        return Part('box', tuple((2.0 * shape.half).tolist()), T, colour, opacity)
    if isinstance(shape, Sphere):
        return Part('sphere', (shape.radius,), T, colour, opacity)
    if isinstance(shape, Cylinder):
        radius, half = shape.half.tolist()
        return Part('cylinder', (radius, 2.0 * half), T, colour, opacity)
    return None


def extent(sketch: Sketch, size: float) -> Array:
    """
    Return points (k, 3) that enclose a sketch; empty for a body or a path [m].

    Parameters
    ----------
    sketch : Sketch
        Sketch of a task.
    size : float
        See `SketchScene`.

    """
    if isinstance(sketch, Cone):
        return _rim(sketch, size) @ sketch.T[:3, :3].T + sketch.T[:3, 3]
    if not isinstance(sketch, Triad | Dot):
        return np.empty((0, 3))
    T, length = _pose(sketch), AXES[0] if isinstance(sketch, Triad) else BALL
    return T[:3, 3] + size * np.concatenate((length * T[:3, :3].T, -BALL * T[:3, :3].T))


class SketchScene:
    """
    Sketches of tasks in a scene.

    Parameters
    ----------
    scene : viser.SceneApi
    size : float
        Size of the scene, to which the size of goals is proportional [m].

    """

    def __init__(self, scene: viser.SceneApi, size: float) -> None:
        self._scene, self._size = scene, size
        self._shown: dict[str, tuple[object, viser.SceneNodeHandle]] = {}
        scene.add_frame(TASKS, show_axes=False)

    def draw(self, sketches: Mapping[str, Sequence[Sketch]]) -> None:
        """
        Show sketches in place of the previous ones.

        Parameters
        ----------
        sketches : mapping
            {task: sketches}; the last of two with the same part is shown.

        """
        wanted = {f'{TASKS}/{task}/{sketch.part}': sketch for task, parts in sketches.items()
                  for sketch in parts if type(sketch) in _ADD}
        for name in self._shown.keys() - wanted.keys():
            self._remove(name)
        for name, sketch in wanted.items():
            self._draw(name, sketch)

    def _draw(self, name: str, sketch: Any) -> None:
        """Show a sketch; move its node if its appearance is the same."""
        appearance = _appearance(sketch)
        if name in self._shown and self._shown[name][0] != appearance:
            self._remove(name)
        if name not in self._shown:
            handle = _ADD[type(sketch)](self._scene, name, sketch, self._size)
            if handle is None:
                return
            self._shown[name] = appearance, handle
        if not isinstance(sketch, Path | Arrow):
            place(self._shown[name][1], _pose(sketch))

    def _remove(self, name: str) -> None:
        """Remove a sketch."""
        self._shown.pop(name)[1].remove()


def _pose(sketch: Any) -> Array:
    """Return the pose of a sketch (4, 4)."""
    if isinstance(sketch, Dot):
        T = np.eye(4)
        T[:3, 3] = sketch.p
        return T
    T_sketch: Array = sketch.T
    return T_sketch


def _appearance(sketch: Any) -> object:
    """Return the properties of a sketch whose change needs a new node."""
    if isinstance(sketch, Cone):
        return round(sketch.half_angle, 3), round(sketch.length, 2)
    if isinstance(sketch, Body):
        return id(sketch.shape), sketch.allowed
    if isinstance(sketch, Path):
        return sketch.points.tobytes()
    if isinstance(sketch, Arrow):
        return sketch.start.tobytes(), sketch.end.tobytes()
    return None


def _goal(scene: viser.SceneApi, name: str, sketch: Triad | Dot,
          size: float) -> viser.SceneNodeHandle:
    """Add the axes of a frame around a ball."""
    length, radius = size * AXES[0], size * AXES[1]
    handle = scene.add_frame(name, axes_length=length, axes_radius=radius,
                             show_axes=isinstance(sketch, Triad))
    add_part(scene, f'{name}/ball', Part('sphere', (size * BALL,), np.eye(4), GOAL_COLOUR))
    return handle


def _body(scene: viser.SceneApi, name: str, sketch: Body,
          size: float) -> viser.SceneNodeHandle | None:
    """Add a shape, translucent if the robot may be inside it."""
    part = shape_part(sketch.shape, sketch.T, REGION_COLOUR, TRANSLUCENT) if sketch.allowed \
        else shape_part(sketch.shape, sketch.T, OBSTACLE_COLOUR)
    return None if part is None else add_part(scene, name, part)


def _cone(scene: viser.SceneApi, name: str, sketch: Cone, size: float) -> viser.SceneNodeHandle:
    """Add the surface of a cone."""
    numbers = 1 + np.arange(CORNERS)
    return scene.add_mesh_simple(
        name, np.concatenate((np.zeros((1, 3)), _rim(sketch, size))),
        np.column_stack((np.zeros(CORNERS, dtype=int), numbers, np.roll(numbers, -1))),
        color=CONE_COLOUR, opacity=TRANSLUCENT, side='double', cast_shadow=False,
        receive_shadow=False)


def _rim(sketch: Cone, size: float) -> Array:
    """Return points (k, 3) of the rim of a cone, in its own axes."""
    angles = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    length = min(sketch.length, LONGEST_CONE * size)
    across = length * np.sin(sketch.half_angle)
    return np.column_stack((across * np.cos(angles), across * np.sin(angles),
                            np.full(CORNERS, length * np.cos(sketch.half_angle))))


def _path(scene: viser.SceneApi, name: str, sketch: Path, size: float) -> viser.SceneNodeHandle:
    """Add a line through points."""
    return scene.add_line_segments(
        name, np.stack((sketch.points[:-1], sketch.points[1:]), axis=1), GOAL_COLOUR,
        thickness=2.0, thickness_units='screen')


def _line(scene: viser.SceneApi, name: str, sketch: Arrow, size: float) -> viser.SceneNodeHandle:
    """Add a line from a frame to its goal."""
    return scene.add_line_segments(name, np.stack((sketch.start, sketch.end))[np.newaxis],
                                   GOAL_COLOUR, thickness=2.0, thickness_units='screen')


_ADD: dict[type, Callable[[viser.SceneApi, str, Any, float], viser.SceneNodeHandle | None]] = {
    Triad: _goal, Dot: _goal, Body: _body, Cone: _cone, Path: _path, Arrow: _line}
