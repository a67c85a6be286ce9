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

"""Outlines of solid shapes as lines, for obstacles and bases."""

from collections.abc import Callable, Iterable
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.shapes import Box, Cylinder, parse_shape, Sphere
from tp_controller.model.spatial import Array, pose, rotation_from_rpy
from tp_controller.model.urdf import parse

# Number of segments of a circle, and of lines along a cylinder.
CIRCLE_SEGMENTS, CYLINDER_LINES = 24, 6
# Length of the axes that represent a base without shapes [m].
AXIS_LENGTH = 0.3
GAP = np.full((1, 3), np.nan)


def outline(shape: object, T: Array) -> Array:
    """
    Return the outline of a shape.

    Parameters
    ----------
    shape : object
        One of `tp_controller.model.shapes`.
    T : ndarray (4, 4)
        Pose of the shape.

    Returns
    -------
    ndarray (k, 3)
        Points of the lines, separated by rows of NaN [m]; empty for a half-space, which is
        infinite.

    """
    draw = _LINES.get(type(shape))
    if draw is None:
        return np.empty((0, 3))
    return joined(draw(shape)) @ T[:3, :3].T + T[:3, 3]


def base_outline(robot: Robot) -> Array:
    """
    Return the outline of the root link in its own frame.

    Returns
    -------
    ndarray (k, 3)
        Outline of its collision shapes, or three axes if none can be drawn. See `outline`.

    """
    lines = []
    for link in parse(robot.urdf).findall('link'):
        if link.get('name') == robot.base_frame:
            lines = [_urdf_outline(element) for element in link.findall('collision')]
    lines = [line for line in lines if len(line)]
    return joined(lines or [np.array([np.zeros(3), AXIS_LENGTH * axis]) for axis in np.eye(3)])


def joined(lines: Iterable[Array]) -> Array:
    """Return lines (k, 3) joined into one, separated by gaps."""
    return np.concatenate([part for line in lines for part in (line, GAP)])


def _urdf_outline(element: Element) -> Array:
    """Return the outline of a <collision> element; empty for a mesh."""
    shape, origin = next(iter(next(element.iter('geometry')))), element.find('origin')
    sizes = {'box': ('size',), 'sphere': ('radius',), 'cylinder': ('radius', 'length')}
    if shape.tag not in sizes:
        return np.empty((0, 3))
    values = [number for name in sizes[shape.tag] for number in _numbers(shape, name)]
    roll, pitch, yaw = _numbers(origin, 'rpy')
    return outline(parse_shape({shape.tag: values}),
                   pose(rotation_from_rpy(roll, pitch, yaw), np.array(_numbers(origin, 'xyz'))))


def _numbers(element: Element | None, attribute: str) -> list[float]:
    """Return the numbers of an attribute; zeros by default."""
    text = None if element is None else element.get(attribute)
    return [float(number) for number in (text or '0 0 0').split()]


def _box(box: Box) -> list[Array]:
    """Return the twelve edges: two faces, and the edges between them."""
    x, y = box.half[:2]
    face = np.array([(x, y), (-x, y), (-x, -y), (x, -y), (x, y)])
    faces = [np.column_stack((face, np.full(5, z))) for z in (-box.half[2], box.half[2])]
    return [*faces, *np.stack(faces, axis=1)[:4]]


def _cylinder(cylinder: Cylinder) -> list[Array]:
    """Return the two circles, and lines along the axis."""
    radius, half = cylinder.half
    circle = radius * _circle()
    circles = [np.column_stack((circle, np.full(len(circle), z))) for z in (-half, half)]
    return [*circles, *np.stack(circles, axis=1)[:-1:CIRCLE_SEGMENTS // CYLINDER_LINES]]


def _sphere(sphere: Sphere) -> list[Array]:
    """Return three great circles."""
    circle = np.column_stack((sphere.radius * _circle(), np.zeros(CIRCLE_SEGMENTS + 1)))
    return [np.roll(circle, turn, axis=1) for turn in range(3)]


def _circle() -> Array:
    """Return points (k, 2) of a closed circle of radius 1."""
    angles = np.linspace(0.0, 2.0 * np.pi, CIRCLE_SEGMENTS + 1)
    return np.column_stack((np.cos(angles), np.sin(angles)))


# The parameter of each function is the shape of its key, which types cannot express.
_LINES: dict[type, Callable[[Any], list[Array]]] = {
    Box: _box, Cylinder: _cylinder, Sphere: _sphere}
