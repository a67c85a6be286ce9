# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Goals as vectors, so that one kind of curve serves positions, rotations, poses and joints.

A rotation is a quaternion: a curve in R⁴ that is normalised where it is evaluated. It is as smooth
as that curve, and the path between two rotations is the shortest one.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import (
    Array,
    pose,
    quaternion_from_rotation,
    rotation_from_quaternion,
    wrap_angle,
)

Mask: TypeAlias = NDArray[np.bool_]
NONE, POINT, QUATERNION = slice(0, 0), slice(0, 3), slice(0, 4)


@dataclass(frozen=True)
class Form:
    """
    Form of the goals of a task as vectors (d,).

    Attributes
    ----------
    size : int
        d.
    shape : tuple of int
        Shape of a goal.
    place, turn : slice
        Components that are a position [m], and those that are a quaternion xyzw.
    flatten, goal : callable
        Return the vector of a goal, and the goal of a vector.
    wraps : ndarray (d,) or None
        Mask of angles without end; None if there are none.
    units : tuple of str
        Unit of each component of joints.

    """

    size: int
    shape: tuple[int, ...]
    place: slice
    turn: slice
    flatten: Callable[[Array], Array]
    goal: Callable[[Array], Array]
    wraps: Mask | None = None
    units: tuple[str, ...] = ()

    def velocity(self, value: Array, rate: Array) -> Array:
        """Return the feed-forward velocity: a twist (6,) [m/s, rad/s], or that of joints (d,)."""
        if self.units:
            return rate
        twist = np.zeros(6)
        if self.place is not NONE:
            twist[:3] = rate[self.place]
        if self.turn is not NONE:
            # q_dot = ½ ω q, hence ω = 2 q_dot q* of a unit quaternion.
            x, y, z, w = value[self.turn].tolist()
            dx, dy, dz, dw = rate[self.turn].tolist()
            twice = 2.0 / (x * x + y * y + z * z + w * w)
            twist[3:] = (twice * (w * dx - dw * x + y * dz - z * dy),
                         twice * (w * dy - dw * y + z * dx - x * dz),
                         twice * (w * dz - dw * z + x * dy - y * dx))
        return twist

    def rate(self, value: Array, velocity: Array) -> Array:
        """Return the derivative (d,) of a vector; the inverse of `velocity`."""
        if self.units:
            return velocity
        rate = np.zeros(self.size)
        if self.place is not NONE:
            rate[self.place] = velocity[:3]
        if self.turn is not NONE:
            vector, w, omega = value[self.turn][:3], value[self.turn][3], velocity[3:]
            rate[self.turn] = 0.5 * np.append(w * omega + np.cross(omega, vector),
                                              -omega.dot(vector))
        return rate

    def continuous(self, values: Array) -> Array:
        """Return values (n, d) whose quaternions and angles go on from each to the next."""
        values = values.copy()
        if self.turn is not NONE:
            turns = values[:, self.turn]
            signs = np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
            turns[1:] *= np.cumprod(signs)[:, np.newaxis]
        if self.wraps is not None:
            values[:, self.wraps] = np.unwrap(values[:, self.wraps], axis=0)
        return values

    def nearest(self, value: Array, other: Array) -> tuple[Array, Array]:
        """Return factors and shift (d,) that bring an equal value nearest to another one."""
        factors, shift = np.ones(self.size), np.zeros(self.size)
        if self.turn is not NONE and value[self.turn].dot(other[self.turn]) < 0.0:
            factors[self.turn] = -1.0
        if self.wraps is not None:
            gap = (value - other)[self.wraps]
            shift[self.wraps] = wrap_angle(gap) - gap
        return factors, shift

    def norms(self, value: Array) -> Array:
        """Return factors (d,) that make the quaternion of a value one of norm 1."""
        factors = np.ones(self.size)
        factors[self.turn] /= math.sqrt(value[self.turn].dot(value[self.turn])) or 1.0
        return factors

    def sizes(self, values: Array, rates: Array) -> dict[str, Array]:
        """
        Return the norms (n,) of rates (n, d) at values, in each unit.

        Also of differences between values that are near each other.
        """
        found = {}
        if self.place is not NONE:
            found['m'] = np.linalg.norm(rates[:, self.place], axis=1)
        if self.turn is not NONE:
            turns, turned = values[:, self.turn], rates[:, self.turn]
            squares = (turns * turns).sum(axis=1)
            across = turned - turns * ((turns * turned).sum(axis=1) / squares)[:, np.newaxis]
            found['rad'] = 2.0 * np.linalg.norm(across, axis=1) / np.sqrt(squares)
        for unit in dict.fromkeys(self.units):
            found[unit] = np.abs(rates[:, [each == unit for each in self.units]]).max(axis=1)
        return found

    def distances(self, values: Array) -> dict[str, Array]:
        """Return the steps (n - 1,) from each value to the next, in each unit."""
        steps = np.diff(values, axis=0)
        found = self.sizes(values[:-1], steps)
        if self.turn is not NONE:
            chords = np.linalg.norm(steps[:, self.turn], axis=1)
            found['rad'] = 4.0 * np.arcsin(np.minimum(0.5 * chords, 1.0))
        return found


def _same(value: Array) -> Array:
    """Return a value."""
    return value


def _rotation(value: Array) -> Array:
    """Return the rotation matrix (3, 3) of a quaternion of any norm (4,)."""
    return rotation_from_quaternion(value / math.sqrt(value.dot(value)))


FORMS = {
    'point': Form(3, (3,), POINT, NONE, _same, _same),
    'quaternion': Form(4, (3, 3), NONE, QUATERNION, quaternion_from_rotation, _rotation),
    'pose': Form(
        7, (4, 4), POINT, slice(3, 7),
        lambda T: np.concatenate((T[:3, 3], quaternion_from_rotation(T[:3, :3]))),
        lambda value: pose(_rotation(value[3:]), value[:3])),
}


def joints_form(units: tuple[str, ...], wraps: Mask) -> Form:
    """Return the form of positions of joints with units and a mask of those without end."""
    return Form(len(units), (len(units),), NONE, NONE, _same, _same,
                wraps if wraps.any() else None, units)
