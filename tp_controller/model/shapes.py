# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Shapes of regions and obstacles; geometry only, without a robot.

Every shape is centred at its own origin. Points (3,) are in its axes [m]. `inner_radius` is the
radius of the largest sphere inside the shape [m], `sizes` are the radii and half lengths that
shapes.h reads.
"""

from collections.abc import Callable
import math
from numbers import Real
from typing import TypeAlias

import numpy as np
from tp_controller.errors import unknown
from tp_controller.model.spatial import Array

# Distance from a centre or an axis below which the direction away from it is undefined [m].
CENTRE_RADIUS = 1e-9
# Largest size of a shape; larger ones are mistakes [m].
LARGEST_SIZE = 1e6


class Sphere:
    """Sphere around the origin."""

    def __init__(self, radius: float) -> None:
        self.radius = self.inner_radius = radius
        self.sizes = np.array([radius])

    def within(self, point: Array) -> tuple[Array, Array]:
        """
        Return the values that are bounded if a point is inside; see `inner_bounds`.

        Returns
        -------
        values : ndarray (m,)
            [m]
        gradients : ndarray (m, 3)
            Gradients of the values with respect to the point.

        """
        distance, direction = _from_centre(point)
        return np.array([distance]), direction[np.newaxis]

    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of these values, lower and upper (m,) [m]."""
        return np.array([-np.inf]), np.array([self.radius])

    def distance(self, point: Array) -> tuple[float, Array]:
        """
        Return the signed distance of a point from the surface, and its gradient.

        Returns
        -------
        float
            [m], negative inside.
        ndarray (3,)
            Its gradient, the direction away from the shape.

        """
        distance, direction = _from_centre(point)
        return distance - self.radius, direction


class HalfSpace:
    """Half-space below the plane z = 0."""

    inner_radius = math.inf
    sizes = np.empty(0)

    def within(self, point: Array) -> tuple[Array, Array]:
        """Return the bounded values and their gradients; see `Sphere.within`."""
        return point[2:], np.array([[0.0, 0.0, 1.0]])

    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of these values, lower and upper (m,) [m]."""
        return np.array([-np.inf]), np.zeros(1)

    def distance(self, point: Array) -> tuple[float, Array]:
        """Return the signed distance and its gradient; see `Sphere.distance`."""
        return point[2], np.array([0.0, 0.0, 1.0])


class Box:
    """Box around the origin, with its faces perpendicular to the axes."""

    def __init__(self, x: float, y: float, z: float) -> None:
        self.half = self.sizes = 0.5 * np.array([x, y, z])
        self.inner_radius = float(self.half.min())

    def within(self, point: Array) -> tuple[Array, Array]:
        """Return the bounded values and their gradients; see `Sphere.within`."""
        return point, np.eye(3)

    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of these values, lower and upper (m,) [m]."""
        return -self.half, self.half

    def distance(self, point: Array) -> tuple[float, Array]:
        """Return the signed distance and its gradient; see `Sphere.distance`."""
        return _outside(np.abs(point) - self.half, np.diag(np.where(point < 0.0, -1.0, 1.0)))


class Cylinder:
    """Cylinder around the origin, with its axis along z."""

    def __init__(self, radius: float, length: float) -> None:
        self.half = self.sizes = np.array([radius, 0.5 * length])
        self.inner_radius = float(self.half.min())

    def within(self, point: Array) -> tuple[Array, Array]:
        """Return the bounded values and their gradients; see `Sphere.within`."""
        reach, away = _from_centre(np.array([point[0], point[1], 0.0]))
        return np.array([reach, point[2]]), np.array([away, [0.0, 0.0, 1.0]])

    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of these values, lower and upper (m,) [m]."""
        return np.array([-np.inf, -self.half[1]]), self.half

    def distance(self, point: Array) -> tuple[float, Array]:
        """Return the signed distance and its gradient; see `Sphere.distance`."""
        values, gradients = self.within(point)
        side = -1.0 if values[1] < 0.0 else 1.0
        return _outside(np.array([values[0], side * values[1]]) - self.half,
                        np.array([gradients[0], side * gradients[1]]))


def _from_centre(point: Array) -> tuple[float, Array]:
    """Return the distance of a point from the origin and the direction away from it."""
    distance = math.sqrt(point.dot(point))
    return distance, point / distance if distance > CENTRE_RADIUS else np.array([1.0, 0.0, 0.0])


def _outside(excess: Array, directions: Array) -> tuple[float, Array]:
    """
    Return the signed distance from a shape whose sides are at right angles, and its gradient.

    Parameters
    ----------
    excess : ndarray (k,)
        Distance of the point from each side, negative on its inner side [m].
    directions : ndarray (k, 3)
        Outward normals of the sides, orthonormal.

    """
    beyond = np.maximum(excess, 0.0)
    distance = math.sqrt(beyond.dot(beyond))
    if distance > CENTRE_RADIUS:
        # Beyond an edge or a corner the nearest point is on it.
        return distance, beyond.dot(directions) / distance
    nearest = int(excess.argmax())
    return float(excess[nearest]), directions[nearest]


Shape: TypeAlias = Box | Sphere | Cylinder | HalfSpace
# In the order of shapes.h.
KINDS: tuple[type[Shape], ...] = (Box, Sphere, Cylinder, HalfSpace)
# {name: (class, names of its sizes)}
SHAPES: dict[str, tuple[Callable[..., Shape], tuple[str, ...]]] = {
    'box': (Box, ('x', 'y', 'z')),
    'sphere': (Sphere, ('radius',)),
    'cylinder': (Cylinder, ('radius', 'length')),
    'half_space': (HalfSpace, ()),
}


def _is_size(value: object) -> bool:
    """Return whether a value is a positive number of at most `LARGEST_SIZE`."""
    return (isinstance(value, Real) and not isinstance(value, bool)
            and not value <= 0.0 and value <= LARGEST_SIZE)


def parse_shape(value: object) -> Shape:
    """
    Return the shape of ``half_space`` or of a mapping such as ``{box: [1.0, 0.5, 0.2]}``.

    Raises
    ------
    ValueError
        The shape is unknown, or its sizes are not positive numbers.

    """
    if isinstance(value, str):
        value = {value: []}
    if not isinstance(value, dict) or len(value) != 1:
        raise ValueError('needs one shape with its sizes, such as {box: [1.0, 0.5, 0.2]}; valid: '
                         + ', '.join(SHAPES))
    (name, sizes), = value.items()
    if name not in SHAPES:
        raise ValueError(unknown('shape', name, SHAPES))
    kind, meanings = SHAPES[name]
    sizes = sizes if isinstance(sizes, (list, tuple)) else [sizes]
    if len(sizes) != len(meanings) or not all(map(_is_size, sizes)):
        raise ValueError(f'{name} needs {", ".join(meanings) or "no sizes"}'
                         f'{", positive numbers [m]" if meanings else ""}, got {sizes!r}')
    return kind(*map(float, sizes))
