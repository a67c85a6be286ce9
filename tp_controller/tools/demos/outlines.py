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

"""Outlines of solid shapes, as lines to be drawn: of what stands around, and of a base."""

from collections.abc import Callable, Iterable
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.shapes import Box, Cylinder, parse_shape, Sphere
from tp_controller.model.spatial import Array, pose, rotation_from_rpy
from tp_controller.model.urdf import parse

# Corners of a circle, and lines along a cylinder.
ROUND, ALONG = 24, 6
# Axes of a base without shapes [m].
AXES = 0.3
GAP = np.full((1, 3), np.nan)


def outline(shape: object, T: Array) -> Array:
    """
    Return the outline of a shape.

    Parameters
    ----------
    shape : object
        One of `tp_controller.model.shapes`.
    T : ndarray (4, 4)
        Where it is.

    Returns
    -------
    ndarray (k, 3)
        Points to be joined by lines, with rows that are not a number between lines [m]; none for
        a half-space, which has no end.

    """
    draw = _LINES.get(type(shape))
    if draw is None:
        return np.empty((0, 3))
    return joined(draw(shape)) @ T[:3, :3].T + T[:3, 3]


def base_outline(robot: Robot) -> Array:
    """
    Return the outline of the link that all others hang on, in its own frame.

    Returns
    -------
    ndarray (k, 3)
        Of its collision shapes; of three axes where it has none that can be drawn. See `outline`.

    """
    lines = []
    for link in parse(robot.urdf).findall('link'):
        if link.get('name') == robot.base_frame:
            lines = [_urdf_outline(element) for element in link.findall('collision')]
    lines = [line for line in lines if len(line)]
    return joined(lines or [np.array([np.zeros(3), AXES * axis]) for axis in np.eye(3)])


def joined(lines: Iterable[Array]) -> Array:
    """Return lines (k, 3) as one, with gaps in between."""
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
    """Return the numbers of an attribute, those of a place by default."""
    text = None if element is None else element.get(attribute)
    return [float(number) for number in (text or '0 0 0').split()]


def _box(box: Box) -> list[Array]:
    """Return the twelve edges: two faces, and what joins them."""
    x, y = box.half[:2]
    face = np.array([(x, y), (-x, y), (-x, -y), (x, -y), (x, y)])
    faces = [np.column_stack((face, np.full(5, z))) for z in (-box.half[2], box.half[2])]
    return [*faces, *np.stack(faces, axis=1)[:4]]


def _cylinder(cylinder: Cylinder) -> list[Array]:
    """Return its two circles, and lines along it."""
    radius, half = cylinder.half
    circle = radius * _circle()
    circles = [np.column_stack((circle, np.full(len(circle), z))) for z in (-half, half)]
    return [*circles, *np.stack(circles, axis=1)[:-1:ROUND // ALONG]]


def _sphere(sphere: Sphere) -> list[Array]:
    """Return three great circles."""
    circle = np.column_stack((sphere.radius * _circle(), np.zeros(ROUND + 1)))
    return [np.roll(circle, turn, axis=1) for turn in range(3)]


def _circle() -> Array:
    """Return points (k, 2) of a closed circle of radius 1."""
    angles = np.linspace(0.0, 2.0 * np.pi, ROUND + 1)
    return np.column_stack((np.cos(angles), np.sin(angles)))


# A function takes the shape it stands beside, which no type can say.
_LINES: dict[type, Callable[[Any], list[Array]]] = {
    Box: _box, Cylinder: _cylinder, Sphere: _sphere}
