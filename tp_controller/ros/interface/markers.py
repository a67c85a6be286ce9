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

"""Markers of the tasks, for RViz and other viewers."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
import math

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, Quaternion
import numpy as np
from numpy.typing import ArrayLike
from std_msgs.msg import ColorRGBA
from tp_controller.errors import in_words
from tp_controller.model.shapes import Box, Cylinder, HalfSpace, Shape, Sphere
from tp_controller.model.spatial import Array, pose, quaternion_from_rotation
from tp_controller.tasks.sketch import (
    Arrow,
    AXES_LENGTH,
    Body,
    Cone,
    Dot,
    Gaps,
    Path,
    Sketch,
    STEEP_SLOPE,
    Triad,
)
from visualization_msgs.msg import Marker, MarkerArray

Rgba = tuple[float, float, float, float]

# Colours of the parts (RGBA).
ORANGE, BLUE, GREY = (0.84, 0.37, 0.0, 1.0), (0.2, 0.6, 1.0, 1.0), (0.6, 0.6, 0.6, 0.8)
COLOURS: dict[str, Rgba] = {
    'goal': ORANGE, 'frame': BLUE, 'error': ORANGE, 'turn': ORANGE, 'axis': BLUE, 'sight': GREY,
    'reference': GREY, 'cone': (0.2, 0.6, 1.0, 0.25), 'sphere': (0.2, 0.6, 1.0, 0.25)}
ALLOWED, FORBIDDEN = (0.2, 0.8, 0.3, 0.2), (0.9, 0.3, 0.15, 0.45)
AXIS_COLOURS: tuple[Rgba, ...] = ((0.9, 0.1, 0.1, 1.0), (0.1, 0.7, 0.1, 1.0),
                                  (0.2, 0.3, 0.95, 1.0))
# Widths and sizes [m]; axes of frames other than the goal are half as long and wide.
AXES_WIDTH, LINE_WIDTH, DOT_SIZE, BALL_SIZE, TEXT_SIZE = 0.008, 0.004, 0.03, 0.024, 0.03
# Largest distance of the text of a line above its middle, besides its own height [m].
MOST_LIFT = 2.0 * TEXT_SIZE
# Diameters of shaft and head of an arrow, and largest length of the head [m], also as a share of
# the arrow [1].
ARROW_SIZE, HEAD_SHARE = (0.006, 0.015, 0.03), 0.4
# Edge length and thickness of the plate that represents a half-space [m].
HALF_SPACE_PLATE = (2.0, 0.002)
# Number of corners on the rim of a cone.
RIM_CORNERS = 24
GOAL = 'goal'
# Largest number of points of a marker.
MOST_DRAWN_POINTS = 2000
# Lifetime of the markers: in periods, and at least [s].
LIFE_PERIODS, SHORTEST_LIFE = 3.0, 1.0


class Markers:
    """
    Converter of sketches to markers, with deletion of outdated ones.

    Parameters
    ----------
    period : float
        Time from one message to the next [s].
    refused : callable
        Called with the name of a task that cannot be drawn, and the reason.

    """

    def __init__(self, period: float, refused: Callable[[str, str], object]) -> None:
        life = max(SHORTEST_LIFE, LIFE_PERIODS * period)
        self._life = Duration(sec=int(life), nanosec=int(life % 1.0 * 1e9))
        self._refused = refused
        self._shown: dict[tuple[str, int], None] = {}

    def message(self, stamp: Time, root: str,
                sketches: Mapping[str, Iterable[Sketch]]) -> MarkerArray:
        """
        Return all markers, and deletions of those that only the last message had.

        Parameters
        ----------
        stamp : builtin_interfaces.msg.Time
            Time of the message.
        root : str
            Root frame of the robot.
        sketches : mapping
            {task: sketches}

        Returns
        -------
        visualization_msgs.msg.MarkerArray

        """
        array = MarkerArray(markers=[
            marker for name, parts in sketches.items()
            for marker in self._task_markers(name, parts)])
        for marker in array.markers:
            marker.lifetime = self._life
        shown = {(marker.ns, marker.id): None for marker in array.markers}
        array.markers.extend(Marker(ns=ns, id=number, action=Marker.DELETE)
                             for ns, number in self._shown if (ns, number) not in shown)
        self._shown = shown
        for marker in array.markers:
            marker.header.frame_id, marker.header.stamp = root, stamp
        return array

    def _task_markers(self, name: str, parts: Iterable[Sketch]) -> list[Marker]:
        """Return the markers of a task, or an empty list if they are invalid."""
        found, numbers = [], Counter[str]()
        try:
            for part in parts:
                for marker in _MAKERS[type(part)](part):
                    marker.ns = f'{name}/{part.part}'
                    # Raises an error for text that cannot be published.
                    marker.ns.encode()
                    marker.id = numbers[marker.ns]
                    numbers[marker.ns] += 1
                    found.append(marker)
        except Exception as error:
            # Task types of other packages may return anything.
            self._refused(name, f'its sketch cannot be drawn: {in_words(error)}')
            return []
        return found


def to_pose(T: ArrayLike) -> Pose:
    """Return a pose message."""
    T_checked = _checked(T, (4, 4))
    x, y, z, w = quaternion_from_rotation(T_checked[:3, :3]).tolist()
    return Pose(position=_to_point(T_checked[:3, 3]), orientation=Quaternion(x=x, y=y, z=z, w=w))


def _marker(kind: int, T: ArrayLike, colour: Rgba, size: Sequence[float],
            points: Sequence[Point] = ()) -> Marker:
    """Return a marker at a pose (4, 4)."""
    marker = Marker(type=kind, action=Marker.ADD, pose=to_pose(T), color=_to_colour(colour),
                    points=points)
    marker.scale.x, marker.scale.y, marker.scale.z = _checked(size, (3,)).tolist()
    return marker


def _axes(sketch: Triad) -> list[Marker]:
    """Return the axes of a frame: x red, y green, z blue; a goal has a ball at its origin."""
    share = 1.0 if sketch.part == GOAL else 0.5
    marker = _marker(Marker.LINE_LIST, sketch.T, (1.0, 1.0, 1.0, 1.0),
                     (share * AXES_WIDTH, 0.0, 0.0), _axis_points(share * AXES_LENGTH))
    marker.colors = _axis_colours()
    if sketch.part != GOAL:
        return [marker]
    return [marker, _marker(Marker.SPHERE, _at(np.asarray(sketch.T)[:3, 3]), ORANGE,
                            (BALL_SIZE,) * 3)]


def _dot(sketch: Dot) -> list[Marker]:
    """Return a small sphere."""
    return [_marker(Marker.SPHERE, _at(sketch.p), _colour(sketch.part), (DOT_SIZE,) * 3)]


def _arrow(sketch: Arrow) -> list[Marker]:
    """Return an arrow; its pose is at its start, in the axes of the root."""
    way = _checked(sketch.end, (3,)) - _checked(sketch.start, (3,))
    length = math.sqrt(way.dot(way))
    return [_marker(Marker.ARROW, _at(sketch.start), _colour(sketch.part),
                    (*ARROW_SIZE[:2], min(ARROW_SIZE[2], HEAD_SHARE * length)),
                    [Point(), _to_point(way)])]


def _path(sketch: Path) -> list[Marker]:
    """Return a line through points; its pose is at the first, in the axes of the root."""
    points = _checked(sketch.points, (-1, 3))
    return [_marker(Marker.LINE_STRIP, _at(points[0]), _colour(sketch.part),
                    (LINE_WIDTH, 0.0, 0.0), _to_points(points - points[0]))]


def _cone(sketch: Cone) -> list[Marker]:
    """Return the surface of a cone; its tip is at the pose, its axis along z."""
    half_angle, length = _checked((sketch.half_angle, sketch.length), (2,)).tolist()
    return [_marker(Marker.TRIANGLE_LIST, sketch.T, _colour(sketch.part), (1.0, 1.0, 1.0),
                    _to_points(_surface(half_angle, length)))]


def _body(sketch: Body) -> list[Marker]:
    """Return a shape."""
    kind, size = _size(sketch.shape)
    colour = COLOURS.get(sketch.part, ALLOWED if sketch.allowed else FORBIDDEN)
    return [_marker(kind, sketch.T, colour, size)]


def _size(shape: Shape) -> tuple[int, Sequence[float]]:
    """Return the type and scale of a marker for a shape."""
    if isinstance(shape, Sphere):
        return Marker.SPHERE, (2.0 * shape.radius,) * 3
    if isinstance(shape, Box):
        return Marker.CUBE, (2.0 * shape.half).tolist()
    if isinstance(shape, Cylinder):
        radius, half = shape.half.tolist()
        return Marker.CYLINDER, (2.0 * radius, 2.0 * radius, 2.0 * half)
    if isinstance(shape, HalfSpace):
        return Marker.CUBE, (HALF_SPACE_PLATE[0], HALF_SPACE_PLATE[0], HALF_SPACE_PLATE[1])
    raise ValueError(f'{type(shape).__name__} is not a shape')


def _gaps(sketch: Gaps) -> list[Marker]:
    """Return a line for each distance, red to green, and the smallest one as text."""
    starts, ends = _checked(sketch.starts, (-1, 3)), _checked(sketch.ends, (-1, 3))
    distances = _checked(sketch.distances, (len(starts),))
    shares = np.clip((distances - sketch.least) / (sketch.within - sketch.least), 0.0, 1.0)
    colours = [_traffic_light(share) for share in shares.tolist()]
    # Points are in the root frame, as there are several lines.
    lines = _marker(Marker.LINE_LIST, np.eye(4), colours[0], (LINE_WIDTH, 0.0, 0.0),
                    _to_points(np.stack([starts, ends], axis=1).reshape(-1, 3)))
    lines.colors = [_to_colour(colour) for colour in colours for _ in range(2)]
    nearest = int(distances.argmin())
    text = _marker(Marker.TEXT_VIEW_FACING, _at(_text_position(starts[nearest], ends[nearest])),
                   colours[nearest], (0.0, 0.0, TEXT_SIZE))
    text.text = f'{distances[nearest]:.3f} m'
    return [lines, text]


def _text_position(start: Array, end: Array) -> Array:
    """
    Return the position of the text of a line (3,): above it, or below one that rises to its start.

    A text is as large as a short line, and would hide it. A long steep line is visible on both
    sides of the text.
    """
    way, middle = start - end, 0.5 * (start + end)
    lift = min(0.5 * abs(way[2]), MOST_LIFT) + TEXT_SIZE
    rises = way[2] > STEEP_SLOPE * math.sqrt(way.dot(way))
    return middle + np.array((0.0, 0.0, -lift if rises else lift))


_MAKERS: dict[type, Callable[..., list[Marker]]] = {
    Triad: _axes, Dot: _dot, Arrow: _arrow, Path: _path, Cone: _cone, Body: _body, Gaps: _gaps}


@lru_cache(maxsize=8)
def _axis_points(length: float) -> list[Point]:
    """Return the ends of three axes."""
    return [point for tip in length * np.eye(3) for point in (Point(), _to_point(tip))]


@lru_cache(maxsize=1)
def _axis_colours() -> list[ColorRGBA]:
    """Return the colours of the ends of three axes."""
    return [_to_colour(colour) for colour in AXIS_COLOURS for _ in range(2)]


def _surface(half_angle: float, length: float) -> Array:
    """Return the corners (3 k, 3) of triangles from the tip of a cone to its rim [m]."""
    angles = np.linspace(0.0, 2.0 * math.pi, RIM_CORNERS + 1)
    across = length * math.sin(half_angle)
    rim = np.column_stack([across * np.cos(angles), across * np.sin(angles),
                           np.full(RIM_CORNERS + 1, length * math.cos(half_angle))])
    return np.stack([np.zeros((RIM_CORNERS, 3)), rim[:-1], rim[1:]], axis=1).reshape(-1, 3)


def _colour(part: str) -> Rgba:
    """Return the colour of a part; suffixes after a slash have no effect."""
    return COLOURS.get(part.partition('/')[0], GREY)


def _traffic_light(share: float) -> Rgba:
    """Return red for 0, yellow for a half, green for 1."""
    return min(1.0, 2.0 - 2.0 * share), min(1.0, 2.0 * share), 0.0, 1.0


def _checked(values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a shape, with -1 for any length; raise ValueError otherwise."""
    array = np.asarray(values, dtype=float)
    if array.ndim != len(shape) or any(
            size not in (-1, given) for size, given in zip(shape, array.shape)):
        raise ValueError(f'needs an array of shape {shape}, got {array.shape}')
    if not np.isfinite(array).all():
        raise ValueError('its numbers are not finite')
    return array


def _at(p: ArrayLike) -> Array:
    """Return the pose (4, 4) at a point, with the axes of the root."""
    return pose(np.eye(3), _checked(p, (3,)))


def _to_point(vector: Array) -> Point:
    """Return a point message."""
    x, y, z = vector.tolist()
    return Point(x=x, y=y, z=z)


def _to_points(points: Array) -> list[Point]:
    """Return point messages."""
    if len(points) > MOST_DRAWN_POINTS:
        raise ValueError(f'needs at most {MOST_DRAWN_POINTS} points, got {len(points)}')
    return [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]


def _to_colour(colour: Rgba) -> ColorRGBA:
    """Return a colour message."""
    red, green, blue, alpha = colour
    return ColorRGBA(r=red, g=green, b=blue, a=alpha)
