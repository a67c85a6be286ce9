# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Primitives of sketches: what markers and scenes of viewers consist of, without ROS."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
import math

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.model.shapes import Box, Cylinder, HalfSpace, Shape, Sphere
from tp_controller.model.spatial import Array, pose
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

Rgba = tuple[float, float, float, float]

# Colours of the parts (RGBA).
ORANGE, BLUE, GREY = (0.84, 0.37, 0.0, 1.0), (0.2, 0.6, 1.0, 1.0), (0.6, 0.6, 0.6, 0.8)
WHITE = (1.0, 1.0, 1.0, 1.0)
# Keys of the colours of shapes that the robot may be inside of, and of others.
ALLOWED, FORBIDDEN = 'allowed', 'forbidden'
COLOURS: Mapping[str, Rgba] = {
    'goal': ORANGE, 'frame': BLUE, 'error': ORANGE, 'turn': ORANGE, 'axis': BLUE, 'sight': GREY,
    'reference': GREY, 'cone': (0.2, 0.6, 1.0, 0.25), 'sphere': (0.2, 0.6, 1.0, 0.25),
    'range': BLUE, 'region/minimum': (0.9, 0.3, 0.15, 0.2), 'polygon': (0.2, 0.8, 0.3, 1.0),
    ALLOWED: (0.2, 0.8, 0.3, 0.2), FORBIDDEN: (0.9, 0.3, 0.15, 0.45)}
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
# Largest number of points of a primitive.
MOST_DRAWN_POINTS = 2000


class Kind(IntEnum):
    """Kinds of primitives, with the names and numbers of ``visualization_msgs/Marker``."""

    ARROW = 0
    CUBE = 1
    SPHERE = 2
    CYLINDER = 3
    LINE_STRIP = 4
    LINE_LIST = 5
    TEXT_VIEW_FACING = 9
    TRIANGLE_LIST = 11


@dataclass(frozen=True, slots=True, eq=False)
class Primitive:
    """
    Shape, lines, triangles or text, with the meaning of the fields of ``Marker``.

    Attributes
    ----------
    kind : Kind
    T : ndarray (4, 4)
        T_root_primitive.
    size : tuple of float
        Three sides of a shape; width of lines; diameters of shaft and head of an arrow between
        two points, and length of the head; height of a text as the last one [m].
    colour : tuple of float
        Red, green, blue and opacity up to 1.
    points : ndarray (k, 3)
        In its axes [m].
    colours : sequence of tuple of float
        Colour of each point; empty where all have that of the primitive.
    text : str

    """

    kind: Kind
    T: Array
    size: tuple[float, float, float]
    colour: Rgba
    points: Array = field(default_factory=lambda: np.empty((0, 3)))
    colours: Sequence[Rgba] = ()
    text: str = ''


def primitives(sketch: Sketch, scale: float = 1.0,
               colours: Mapping[str, Rgba] = COLOURS) -> list[Primitive]:
    """
    Return the primitives that a sketch consists of.

    Parameters
    ----------
    sketch : Sketch
        Sketch of a task.
    scale : float
        Factor on the sizes of axes, points, lines and texts.
    colours : mapping
        {part: colour}, with those of shapes.

    Raises
    ------
    ValueError, TypeError, AttributeError, KeyError
        The sketch is invalid: a task type of another package may return anything.

    """
    return _MAKERS[type(sketch)](sketch, scale, colours)


def checked(values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a shape, with -1 for any length; raise ValueError otherwise."""
    array = np.asarray(values, dtype=float)
    if array.ndim != len(shape) or any(
            size not in (-1, given) for size, given in zip(shape, array.shape)):
        raise ValueError(f'needs an array of shape {shape}, got {array.shape}')
    if not np.isfinite(array).all():
        raise ValueError('its numbers are not finite')
    return array


def _made(kind: Kind, T: ArrayLike, size: ArrayLike, colour: Rgba,
          points: ArrayLike = (), colours: Sequence[Rgba] = (), text: str = '') -> Primitive:
    """Return a primitive of valid numbers."""
    x, y, z = checked(size, (3,)).tolist()
    given = checked(np.reshape(points, (-1, 3)), (-1, 3))
    if len(given) > MOST_DRAWN_POINTS:
        raise ValueError(f'needs at most {MOST_DRAWN_POINTS} points, got {len(given)}')
    return Primitive(kind, checked(T, (4, 4)), (x, y, z), colour, given, colours, text)


def _axes(sketch: Triad, scale: float, colours: Mapping[str, Rgba]) -> list[Primitive]:
    """Return the axes of a frame: x red, y green, z blue; a goal has a ball at its origin."""
    share = scale * (1.0 if sketch.part == GOAL else 0.5)
    axes = _made(Kind.LINE_LIST, sketch.T, (share * AXES_WIDTH, 0.0, 0.0), WHITE,
                 _axis_points(share * AXES_LENGTH), [each for each in AXIS_COLOURS for _ in '12'])
    return [axes] if sketch.part != GOAL else [
        axes, _made(Kind.SPHERE, _at(axes.T[:3, 3]), 3 * [scale * BALL_SIZE], colours[GOAL])]


def _dot(sketch: Dot, scale: float, colours: Mapping[str, Rgba]) -> list[Primitive]:
    """Return a small sphere."""
    return [_made(Kind.SPHERE, _at(sketch.p), 3 * [scale * DOT_SIZE],
                  colour_of(sketch.part, colours))]


def _arrow(sketch: Arrow, scale: float, colours: Mapping[str, Rgba]) -> list[Primitive]:
    """Return an arrow; its pose is at its start, in the axes of the root."""
    way = checked(sketch.end, (3,)) - checked(sketch.start, (3,))
    shaft, head, longest = (scale * size for size in ARROW_SIZE)
    size = shaft, head, min(longest, HEAD_SHARE * math.sqrt(way.dot(way)))
    return [_made(Kind.ARROW, _at(sketch.start), size, colour_of(sketch.part, colours),
                  [np.zeros(3), way])]


def _path(sketch: Path, scale: float, colours: Mapping[str, Rgba]) -> list[Primitive]:
    """Return a line through points; its pose is at the first, in the axes of the root."""
    points = checked(sketch.points, (-1, 3))
    return [_made(Kind.LINE_STRIP, _at(points[0]), (scale * LINE_WIDTH, 0.0, 0.0),
                  colour_of(sketch.part, colours), points - points[0])]


def _cone(sketch: Cone, scale: float, colours: Mapping[str, Rgba]) -> list[Primitive]:
    """Return the surface of a cone; its tip is at the pose, its axis along z."""
    half_angle, length = checked((sketch.half_angle, sketch.length), (2,)).tolist()
    return [_made(Kind.TRIANGLE_LIST, sketch.T, (1.0, 1.0, 1.0), colour_of(sketch.part, colours),
                  _surface(half_angle, length))]


def _body(sketch: Body, scale: float, colours: Mapping[str, Rgba]) -> list[Primitive]:
    """Return a shape."""
    kind, size = _size(sketch.shape)
    return [_made(kind, sketch.T, size, colours.get(
        sketch.part, colours[ALLOWED if sketch.allowed else FORBIDDEN]))]


def _size(shape: Shape) -> tuple[Kind, Sequence[float]]:
    """Return the kind and size of the primitive of a shape."""
    if isinstance(shape, Sphere):
        return Kind.SPHERE, (2.0 * shape.radius,) * 3
    if isinstance(shape, Box):
        return Kind.CUBE, (2.0 * shape.half).tolist()
    if isinstance(shape, Cylinder):
        radius, half = shape.half.tolist()
        return Kind.CYLINDER, (2.0 * radius, 2.0 * radius, 2.0 * half)
    if isinstance(shape, HalfSpace):
        return Kind.CUBE, (HALF_SPACE_PLATE[0], HALF_SPACE_PLATE[0], HALF_SPACE_PLATE[1])
    raise ValueError(f'{type(shape).__name__} is not a shape')


def _gaps(sketch: Gaps, scale: float, colours: Mapping[str, Rgba]) -> list[Primitive]:
    """Return a line for each distance, red to green, and the smallest one as text."""
    starts, ends = checked(sketch.starts, (-1, 3)), checked(sketch.ends, (-1, 3))
    distances = checked(sketch.distances, (len(starts),))
    shares = np.clip((distances - sketch.least) / (sketch.within - sketch.least), 0.0, 1.0)
    lights = [_traffic_light(share) for share in shares.tolist()]
    nearest = int(distances.argmin())
    # Points are in the root frame, as there are several lines.
    return [_made(Kind.LINE_LIST, np.eye(4), (scale * LINE_WIDTH, 0.0, 0.0), lights[0],
                  np.stack([starts, ends], axis=1), [each for each in lights for _ in '12']),
            _made(Kind.TEXT_VIEW_FACING, _at(_text_position(starts[nearest], ends[nearest])),
                  (0.0, 0.0, scale * TEXT_SIZE), lights[nearest],
                  text=f'{distances[nearest]:.3f} m')]


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


_MAKERS: dict[type, Callable[..., list[Primitive]]] = {
    Triad: _axes, Dot: _dot, Arrow: _arrow, Path: _path, Cone: _cone, Body: _body, Gaps: _gaps}


@lru_cache(maxsize=8)
def _axis_points(length: float) -> Array:
    """Return the ends (6, 3) of three axes."""
    return np.stack([np.zeros((3, 3)), length * np.eye(3)], axis=1).reshape(-1, 3)


def _surface(half_angle: float, length: float) -> Array:
    """Return the corners (3 k, 3) of triangles from the tip of a cone to its rim [m]."""
    angles = np.linspace(0.0, 2.0 * math.pi, RIM_CORNERS + 1)
    across = length * math.sin(half_angle)
    rim = np.column_stack([across * np.cos(angles), across * np.sin(angles),
                           np.full(RIM_CORNERS + 1, length * math.cos(half_angle))])
    return np.stack([np.zeros((RIM_CORNERS, 3)), rim[:-1], rim[1:]], axis=1).reshape(-1, 3)


def colour_of(part: str, colours: Mapping[str, Rgba] = COLOURS) -> Rgba:
    """Return the colour of a part; suffixes after a slash have no effect."""
    return colours.get(part.partition('/')[0], GREY)


def _traffic_light(share: float) -> Rgba:
    """Return red for 0, yellow for a half, green for 1."""
    return min(1.0, 2.0 - 2.0 * share), min(1.0, 2.0 * share), 0.0, 1.0


def _at(p: ArrayLike) -> Array:
    """Return the pose (4, 4) at a point, with the axes of the root."""
    return pose(np.eye(3), checked(p, (3,)))
