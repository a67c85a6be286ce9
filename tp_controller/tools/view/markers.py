# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Primitives of the tasks in a scene of the browser: markers (`~/markers`), and sketches."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TYPE_CHECKING, TypeVar
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array, pose, rotation_from_quaternion
from tp_controller.tasks.primitives import Kind, Primitive, Rgba
from tp_controller.tools.view.parts import add_part, Colour, FARTHEST, is_pose, Part, place
from tp_controller.untrusted.texts import plain
import viser

if TYPE_CHECKING:  # Recordings are shown without ROS; their markers have the same fields.
    from std_msgs.msg import ColorRGBA
    from visualization_msgs.msg import Marker

TASK_MARKERS = '/tasks'
Real = TypeVar('Real', bound=np.floating[Any])
# Identifier of a primitive: namespace and number.
Key = tuple[str, int]
# Smallest change of a pose or point that is sent [m].
MARKER_TOLERANCE = 1e-6
ADDED = 0
# viser takes the colours of points as linear ones, and all others as those of a screen.
GAMMA = 2.2
LINES = (Kind.LINE_LIST, Kind.LINE_STRIP)
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
    Primitives in a scene; only changes are sent.

    Parameters
    ----------
    scene : viser.SceneApi
    pixels : float, optional
        Makes the width of lines independent of their distance [1/m]. A requested picture
        (`get_render`) needs it: SwiftShader does not complete one with lines in metres.

    """

    def __init__(self, scene: viser.SceneApi, pixels: float | None = None) -> None:
        self._scene, self._pixels = scene, pixels
        self._drawn: dict[Key, _Drawn] = {}
        scene.add_frame(TASK_MARKERS, show_axes=False)

    def draw(self, markers: Iterable['Marker']) -> None:
        """
        Show markers in place of the previous ones.

        Parameters
        ----------
        markers : iterable of visualization_msgs.msg.Marker
            Markers in the root frame; unknown types are ignored.

        """
        self.show({(marker.ns, marker.id): primitive_of(marker) for marker in markers
                   if marker.action == ADDED and marker.type in ADD})

    def show(self, wanted: Mapping[Key, Primitive]) -> None:
        """Show primitives in place of the previous ones."""
        for key in self._drawn.keys() - wanted.keys():
            self._drawn.pop(key).handle.remove()
        for key, primitive in wanted.items():
            self._show(key, primitive)

    def _show(self, key: Key, primitive: Primitive) -> None:
        """Show a primitive."""
        before, appearance = self._drawn.get(key), _appearance(primitive)
        if before is not None and before.appearance != appearance:
            self._drawn.pop(key).handle.remove()
            before = None
        if before is None:
            ns, number = key
            # One node without branches: removing a branch would leave its stem in the scene.
            name = f'{TASK_MARKERS}/{quote(ns, safe="")}:{number}'
            handle = ADD[primitive.kind](self._scene, name, primitive)
            before = self._drawn[key] = _Drawn(handle, appearance, primitive)
            if self._pixels is not None and isinstance(handle, viser.LineSegmentsHandle):
                handle.thickness_units = 'screen'
                handle.thickness = self._pixels * primitive.size[0]
            place(handle, primitive.T)
            return
        shown = before.primitive
        if _content(shown) != _content(primitive) or shown.points.shape != primitive.points.shape \
                or np.abs(primitive.points - shown.points).max(initial=0.0) > MARKER_TOLERANCE:
            before.primitive = primitive
            _change(before.handle, primitive)
        if np.abs(primitive.T - before.T).max() > MARKER_TOLERANCE:
            before.T = primitive.T
            place(before.handle, primitive.T)


class _Drawn:
    """Node in the scene, with the primitive whose content it shows and its pose."""

    def __init__(self, handle: viser.SceneNodeHandle, appearance: object,
                 primitive: Primitive) -> None:
        self.handle, self.appearance = handle, appearance
        self.primitive, self.T = primitive, primitive.T


def primitive_of(marker: 'Marker') -> Primitive:
    """Return a marker of a drawable type as a primitive."""
    scale = marker.scale
    return Primitive(
        Kind(marker.type), pose_of(marker), (scale.x, scale.y, scale.z), _rgba(marker.color),
        np.array([(point.x, point.y, point.z) for point in marker.points]).reshape(-1, 3),
        [_rgba(each) for each in marker.colors], marker.text)


def pose_of(marker: 'Marker') -> Array:
    """Return the pose (4, 4) of a marker."""
    point, turn = marker.pose.position, marker.pose.orientation
    return pose(rotation_from_quaternion((turn.x, turn.y, turn.z, turn.w)),
                (point.x, point.y, point.z))


def _rgba(colour: 'ColorRGBA') -> Rgba:
    """Return a colour message as four numbers."""
    return colour.r, colour.g, colour.b, colour.a


def _appearance(primitive: Primitive) -> object:
    """
    Return the properties of a primitive whose change needs a new node.

    A new node is invisible for a moment. Nearly all properties of texts and lines can change in
    place; other shapes keep their number of points.
    """
    if primitive.kind in (*LINES, Kind.TEXT_VIEW_FACING):
        return (primitive.kind, primitive.size[0], primitive.size[2],
                len(primitive.colours) == len(primitive.points))
    return primitive.kind, primitive.size, primitive.colour, len(primitive.points)


def _content(primitive: Primitive) -> object:
    """Return the text of a primitive, or the colours of its lines, which change in place."""
    if primitive.kind not in LINES:
        return primitive.text
    return primitive.colour[:3], [each[:3] for each in primitive.colours]


def _colour(primitive: Primitive) -> Colour:
    """Return the colour of a primitive."""
    red, green, blue, _ = primitive.colour
    return round(255 * red), round(255 * green), round(255 * blue)


def _add_shape(scene: viser.SceneApi, name: str, primitive: Primitive) -> viser.SceneNodeHandle:
    """Add a box, an ellipsoid or a cylinder."""
    x, y, z = primitive.size
    parts: dict[int, tuple[str, tuple[float, ...]]] = {
        Kind.CUBE: ('box', (x, y, z)), Kind.SPHERE: ('sphere', (0.5 * x, 0.5 * y, 0.5 * z)),
        Kind.CYLINDER: ('cylinder', (0.5 * x, z))}
    return add_part(scene, name, Part(*parts[primitive.kind], np.eye(4), _colour(primitive),
                                      primitive.colour[3]))


def _add_lines(scene: viser.SceneApi, name: str, primitive: Primitive) -> viser.SceneNodeHandle:
    """Add lines."""
    return scene.add_line_segments(name, _segments(primitive, primitive.points),
                                   _colours(primitive), thickness=primitive.size[0])


def _add_arrow(scene: viser.SceneApi, name: str, primitive: Primitive) -> viser.SceneNodeHandle:
    """Add an arrow between two points, or along x without points."""
    points, (shaft, head, length) = primitive.points, primitive.size
    if len(points) != 2:
        points = np.array([(0.0, 0.0, 0.0), (shaft, 0.0, 0.0)])
        shaft, head, length = head, 2.0 * head, 0.25 * shaft
    return scene.add_arrows(name, points[np.newaxis], _colour(primitive), shaft_radius=0.5 * shaft,
                            head_radius=0.5 * head, head_length=length)


def _add_triangles(scene: viser.SceneApi, name: str,
                   primitive: Primitive) -> viser.SceneNodeHandle:
    """Add triangles, seen from both sides."""
    opacity = primitive.colour[3]
    return scene.add_mesh_simple(
        name, primitive.points, np.arange(len(primitive.points) // 3 * 3).reshape(-1, 3),
        color=_colour(primitive), side='double', opacity=opacity if opacity < 1.0 else None,
        cast_shadow=False, receive_shadow=False)


def _add_text(scene: viser.SceneApi, name: str, primitive: Primitive) -> viser.SceneNodeHandle:
    """Add a text."""
    return scene.add_label(name, primitive.text, font_size_mode='scene', anchor='center-center',
                           font_scene_height=primitive.size[2])


def _segments(primitive: Primitive, points: NDArray[Real]) -> NDArray[Real]:
    """Return the ends (k, 2, 3) of lines."""
    if primitive.kind == Kind.LINE_LIST:
        return points[:len(points) // 2 * 2].reshape(-1, 2, 3)
    return np.stack((points[:-1], points[1:]), axis=1)


def _colours(primitive: Primitive) -> NDArray[np.uint8] | Colour:
    """Return the colours (k, 2, 3) of the ends of lines, or the one that all have."""
    if len(primitive.colours) != len(primitive.points) or not primitive.colours:
        return _colour(primitive)
    shades = np.array(primitive.colours)[:, :3] ** GAMMA
    return np.round(255 * _segments(primitive, shades)).astype(np.uint8)


def _change(handle: viser.SceneNodeHandle, primitive: Primitive) -> None:
    """Update the points, line colours or text of a primitive."""
    points = primitive.points.astype(np.float32)
    if isinstance(handle, viser.LineSegmentsHandle):
        # Both change together: their sizes must match.
        handle.points = _segments(primitive, points)
        handle.colors = np.array(_colours(primitive), dtype=np.uint8)
    elif isinstance(handle, viser.ArrowsHandle):
        handle.points = points[np.newaxis]
    elif isinstance(handle, viser.MeshHandle):
        handle.vertices = points
    elif isinstance(handle, viser.LabelHandle):
        handle.text = primitive.text


ADD: dict[int, Callable[[viser.SceneApi, str, Primitive], viser.SceneNodeHandle]] = {
    Kind.CUBE: _add_shape, Kind.SPHERE: _add_shape, Kind.CYLINDER: _add_shape,
    Kind.LINE_LIST: _add_lines, Kind.LINE_STRIP: _add_lines, Kind.ARROW: _add_arrow,
    Kind.TRIANGLE_LIST: _add_triangles, Kind.TEXT_VIEW_FACING: _add_text}
