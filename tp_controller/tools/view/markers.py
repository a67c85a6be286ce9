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

"""Markers of the tasks (`~/markers`) in a scene of the browser."""

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array, pose, rotation_from_quaternion
from tp_controller.tools.view.parts import add_part, Colour, FARTHEST, is_pose, Part, place
from tp_controller.untrusted import plain
import viser

if TYPE_CHECKING:  # Recordings are shown without ROS; their markers have the same fields.
    from visualization_msgs.msg import Marker

TASKS = '/tasks'
# Identifier of a marker: namespace and number.
Key = tuple[str, int]
# Smallest change of a pose or point that is sent [m].
MARKER_TOLERANCE = 1e-6
# Types and actions of visualization_msgs/Marker.
ARROW, CUBE, SPHERE, CYLINDER, LINE_STRIP, LINE_LIST = range(6)
TEXT_VIEW_FACING, TRIANGLE_LIST = 9, 11
ADDED = 0
PART_KINDS = {CUBE: 'box', SPHERE: 'sphere', CYLINDER: 'cylinder'}
LINES = (LINE_LIST, LINE_STRIP)
# Largest number of markers, and of points of each; longest name [characters].
MOST_MARKERS, MOST_POINTS, LONGEST_NAME = 1000, 20_000, 1000


def drawable(markers: Sequence['Marker']) -> list['Marker']:
    """Return the valid markers, with texts cleaned for display."""
    found = [marker for marker in markers[:MOST_MARKERS] if _is_drawable(marker)]
    for marker in found:
        marker.text = plain(marker.text)
    return found


def _is_drawable(marker: 'Marker') -> bool:
    """Return whether name and numbers of a marker are valid."""
    point, turn, scale = marker.pose.position, marker.pose.orientation, marker.scale
    return (marker.ns.isprintable() and len(marker.ns) <= LONGEST_NAME
            and len(marker.points) <= MOST_POINTS
            and is_pose((turn.w, turn.x, turn.y, turn.z), (point.x, point.y, point.z))
            and len(marker.colors) <= MOST_POINTS
            and all(0.0 <= size <= FARTHEST for size in (scale.x, scale.y, scale.z))
            and all(abs(each.x) <= FARTHEST and abs(each.y) <= FARTHEST
                    and abs(each.z) <= FARTHEST for each in marker.points)
            and all(0.0 <= part <= 1.0 for each in (marker.color, *marker.colors)
                    for part in (each.r, each.g, each.b, each.a)))


class MarkerScene:
    """
    Markers in a scene; only changes are sent.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
        Name of the parent node.
    shown : callable
        Returns whether the markers of a namespace are shown.

    """

    def __init__(self, scene: viser.SceneApi, name: str = TASKS,
                 shown: Callable[[str], bool] = lambda ns: True) -> None:
        self._scene, self._name, self._shown = scene, name, shown
        self._drawn: dict[Key, _Drawn] = {}
        scene.add_frame(name, show_axes=False)

    def draw(self, markers: Iterable['Marker']) -> None:
        """
        Show markers in place of the previous ones.

        Parameters
        ----------
        markers : iterable of visualization_msgs.msg.Marker
            Markers in the root frame; unknown types are ignored.

        """
        wanted = {(marker.ns, marker.id): marker for marker in markers
                  if marker.action == ADDED and marker.type in ADD
                  and self._shown(marker.ns)}
        for key in self._drawn.keys() - wanted.keys():
            self._drawn.pop(key).handle.remove()
        for key, marker in wanted.items():
            self._draw(key, marker)

    def _draw(self, key: Key, marker: 'Marker') -> None:
        """Show a marker."""
        before = self._drawn.get(key)
        points = np.array([(point.x, point.y, point.z) for point in marker.points]).reshape(-1, 3)
        appearance = _appearance(marker)
        if before is not None and before.appearance != appearance:
            self._drawn.pop(key).handle.remove()
            before = None
        content = _content(marker)
        if before is None:
            ns, number = key
            # One node without branches: removing a branch would leave its stem in the scene.
            name = f'{self._name}/{quote(ns, safe="")}:{number}'
            handle = ADD[marker.type](self._scene, name, marker, points)
            before = self._drawn[key] = _Drawn(handle, appearance, points, content)
        elif before.content != content or before.points.shape != points.shape \
                or np.abs(points - before.points).max(initial=0.0) > MARKER_TOLERANCE:
            before.points, before.content = points, content
            _change(before.handle, marker, points)
        T = pose_of(marker)
        if before.T is None or np.abs(T - before.T).max() > MARKER_TOLERANCE:
            before.T = T
            place(before.handle, T)


class _Drawn:
    """Marker with its node in the scene."""

    def __init__(self, handle: viser.SceneNodeHandle, appearance: object, points: Array,
                 content: object) -> None:
        self.handle, self.appearance = handle, appearance
        self.points, self.content = points, content
        self.T: Array | None = None


def pose_of(marker: 'Marker') -> Array:
    """Return the pose (4, 4) of a marker."""
    point, turn = marker.pose.position, marker.pose.orientation
    return pose(rotation_from_quaternion((turn.x, turn.y, turn.z, turn.w)),
                (point.x, point.y, point.z))


def _appearance(marker: 'Marker') -> object:
    """
    Return the properties of a marker whose change needs a new node.

    A new node is invisible for a moment. Nearly all properties of texts and lines can change in
    place; other shapes keep their number of points.
    """
    scale, colour = marker.scale, marker.color
    if marker.type in (*LINES, TEXT_VIEW_FACING):
        return marker.type, scale.x, scale.z
    return (marker.type, scale.x, scale.y, scale.z, colour.r, colour.g, colour.b, colour.a,
            len(marker.points))


def _content(marker: 'Marker') -> object:
    """Return the text of a marker, or the colours of its lines, which change in place."""
    if marker.type not in LINES:
        return marker.text
    return [(each.r, each.g, each.b) for each in (marker.color, *marker.colors)]


def _colour(marker: 'Marker') -> Colour:
    """Return the colour of a marker."""
    return (round(255 * marker.color.r), round(255 * marker.color.g), round(255 * marker.color.b))


def _add_part(scene: viser.SceneApi, name: str, marker: 'Marker',
              points: Array) -> viser.SceneNodeHandle:
    """Add a box, an ellipsoid or a cylinder."""
    x, y, z = marker.scale.x, marker.scale.y, marker.scale.z
    size: dict[int, tuple[float, ...]] = {
        CUBE: (x, y, z), SPHERE: (0.5 * x, 0.5 * y, 0.5 * z),
        CYLINDER: (0.5 * x, z)}
    return add_part(scene, name, Part(PART_KINDS[marker.type], size[marker.type], np.eye(4),
                                      _colour(marker), marker.color.a))


def _add_lines(scene: viser.SceneApi, name: str, marker: 'Marker',
               points: Array) -> viser.SceneNodeHandle:
    """Add lines."""
    return scene.add_line_segments(name, _segments(marker, points), _colours(marker, points),
                                   thickness=marker.scale.x)


def _add_arrow(scene: viser.SceneApi, name: str, marker: 'Marker',
               points: Array) -> viser.SceneNodeHandle:
    """Add an arrow between two points, or along x without points."""
    scale = marker.scale
    if len(points) == 2:
        shaft, head, length = scale.x, scale.y, scale.z
    else:
        points = np.array([(0.0, 0.0, 0.0), (scale.x, 0.0, 0.0)])
        shaft, head, length = scale.y, 2.0 * scale.y, 0.25 * scale.x
    return scene.add_arrows(name, points[np.newaxis], _colour(marker), shaft_radius=0.5 * shaft,
                            head_radius=0.5 * head, head_length=length)


def _add_triangles(scene: viser.SceneApi, name: str, marker: 'Marker',
                   points: Array) -> viser.SceneNodeHandle:
    """Add triangles, seen from both sides."""
    return scene.add_mesh_simple(
        name, points, np.arange(len(points) // 3 * 3).reshape(-1, 3), color=_colour(marker),
        side='double', opacity=marker.color.a if marker.color.a < 1.0 else None,
        cast_shadow=False, receive_shadow=False)


def _add_text(scene: viser.SceneApi, name: str, marker: 'Marker',
              points: Array) -> viser.SceneNodeHandle:
    """Add a text."""
    return scene.add_label(name, marker.text, font_size_mode='scene', anchor='center-center',
                           font_scene_height=marker.scale.z)


def _segments(marker: 'Marker', points: Array) -> Array:
    """Return the ends (k, 2, 3) of the lines of a marker."""
    if marker.type == LINE_LIST:
        return points[:len(points) // 2 * 2].reshape(-1, 2, 3)
    return np.stack((points[:-1], points[1:]), axis=1)


def _colours(marker: 'Marker', points: Array) -> NDArray[np.uint8]:
    """Return the colours (k, 2, 3) of the ends of lines; without these, that of the marker."""
    shades = np.array([(each.r, each.g, each.b) for each in (
        marker.colors if len(marker.colors) == len(points) else [marker.color] * len(points))])
    shades = shades.reshape(-1, 3)
    return np.round(255 * _segments(marker, shades)).astype(np.uint8)


def _change(handle: viser.SceneNodeHandle, marker: 'Marker', points: Array) -> None:
    """Update the points, line colours or text of a marker."""
    if isinstance(handle, viser.LineSegmentsHandle):
        # Both change together: their sizes must match.
        handle.points = _segments(marker, points).astype(np.float32)
        handle.colors = _colours(marker, points)
    elif isinstance(handle, viser.ArrowsHandle):
        handle.points = points[np.newaxis].astype(np.float32)
    elif isinstance(handle, viser.MeshHandle):
        handle.vertices = points.astype(np.float32)
    elif isinstance(handle, viser.LabelHandle):
        handle.text = marker.text


Adder = Callable[[viser.SceneApi, str, 'Marker', Array], viser.SceneNodeHandle]
ADD: dict[int, Adder] = {
    **dict.fromkeys(PART_KINDS, _add_part), **dict.fromkeys(LINES, _add_lines),
    ARROW: _add_arrow, TRIANGLE_LIST: _add_triangles,
    TEXT_VIEW_FACING: _add_text}
