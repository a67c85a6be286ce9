# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Shapes of regions and obstacles; geometry only, without a robot.

Every shape is centred at its own origin. Points (3,) are in its axes [m]. `inner_radius` is the
radius of the largest sphere inside the shape [m], `sizes` are the radii and half lengths that
shapes.h reads.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
import math
from numbers import Real

import numpy as np
from tp_controller.errors import unknown
from tp_controller.model.spatial import Array

# Distance from a centre or an axis below which the direction away from it is undefined [m].
CENTRE_RADIUS = 1e-9
# Largest size of a shape; larger ones are mistakes [m].
LARGEST_SIZE = 1e6


class Shape(ABC):
    """Shape whose sides, if it has several, are at right angles."""

    inner_radius: float
    sizes: Array

    @abstractmethod
    def within(self, point: Array) -> tuple[Array, Array]:
        """
        Return the values that are bounded if a point is inside; see `inner_bounds`.

        Returns
        -------
        values : ndarray (m,)
            [m]
        gradients : ndarray (m, 3)
            Gradients of the values with respect to the point, orthonormal.

        """

    @abstractmethod
    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of these values, lower and upper (m,) [m]."""

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
        values, gradients = self.within(point)
        lower, upper = self.inner_bounds()
        above, below = values - upper, lower - values
        # Distance from each side, negative on its inner side, and its outward normal.
        excess = np.maximum(above, below)
        normals = np.where(below > above, -gradients.T, gradients.T)
        beyond = np.maximum(excess, 0.0)
        distance = math.sqrt(beyond.dot(beyond))
        if distance > CENTRE_RADIUS:
            # Beyond an edge or a corner the nearest point is on it.
            return distance, normals.dot(beyond) / distance
        nearest = int(excess.argmax())
        return float(excess[nearest]), normals[:, nearest]


class Sphere(Shape):
    """Sphere around the origin."""

    def __init__(self, radius: float) -> None:
        self.radius = self.inner_radius = radius
        self.sizes = np.array([radius])

    def within(self, point: Array) -> tuple[Array, Array]:
        """Return the distance from the centre, and the direction away from it."""
        distance, direction = _from_centre(point)
        return np.array([distance]), direction[np.newaxis]

    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of this distance."""
        return np.array([-np.inf]), np.array([self.radius])


class HalfSpace(Shape):
    """Half-space below the plane z = 0."""

    inner_radius = math.inf
    sizes = np.empty(0)

    def within(self, point: Array) -> tuple[Array, Array]:
        """Return the distance from the plane, and its normal."""
        return point[2:], np.array([[0.0, 0.0, 1.0]])

    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of this distance."""
        return np.array([-np.inf]), np.zeros(1)


class Box(Shape):
    """Box around the origin, with its faces perpendicular to the axes."""

    def __init__(self, x: float, y: float, z: float) -> None:
        self.half = self.sizes = 0.5 * np.array([x, y, z])
        self.inner_radius = float(self.half.min())

    def within(self, point: Array) -> tuple[Array, Array]:
        """Return the coordinates along the axes, and these."""
        return point, np.eye(3)

    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of the coordinates."""
        return -self.half, self.half


class Cylinder(Shape):
    """Cylinder around the origin, with its axis along z."""

    def __init__(self, radius: float, length: float) -> None:
        self.half = self.sizes = np.array([radius, 0.5 * length])
        self.inner_radius = float(self.half.min())

    def within(self, point: Array) -> tuple[Array, Array]:
        """Return the distance from the axis and the coordinate along it, and their gradients."""
        reach, away = _from_centre(np.array([point[0], point[1], 0.0]))
        return np.array([reach, point[2]]), np.array([away, [0.0, 0.0, 1.0]])

    def inner_bounds(self) -> tuple[Array, Array]:
        """Return the bounds of these values."""
        return np.array([-np.inf, -self.half[1]]), self.half


def _from_centre(point: Array) -> tuple[float, Array]:
    """Return the distance of a point from the origin and the direction away from it."""
    distance = math.sqrt(point.dot(point))
    return distance, point / distance if distance > CENTRE_RADIUS else np.array([1.0, 0.0, 0.0])


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
