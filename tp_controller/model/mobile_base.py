# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Base of a robot: its placement and its degrees of freedom."""

from collections.abc import Sequence
import math

import numpy as np
from tp_controller.errors import RobotError
from tp_controller.model.spatial import (
    Array,
    quaternion_from_rotation,
    QUATERNION_TOLERANCE,
    read_only,
)

# Degrees of freedom of a rigid body, as the rows of its twist (linear, then angular).
TWIST_NAMES = ('base_x', 'base_y', 'base_z', 'base_roll', 'base_pitch', 'base_yaw')
TWIST_UNITS = ('m', 'm', 'm', 'rad', 'rad', 'rad')
# Default limit of the velocity along and about every axis [m/s, rad/s].
DEFAULT_VELOCITY = 0.5
# Default frame that a base moves in (REP 105).
DEFAULT_WORLD = 'odom'


class Base:
    """
    Fixed base, and base class of the moving ones.

    A placement (7,) is x, y, z [m] and a quaternion ``xyzw``: the pose of the base in the world.
    The coordinates of the base are the first entries of q, its velocities those of every array
    of quasi-velocities: the twist of the base in its own axes, x forward, y left, z up (REP 103).

    Attributes
    ----------
    moves : bool
        Whether the base moves.
    columns : tuple of int
        Rows of that twist that are velocities of the base.
    reach : tuple of int
        Rows of a twist in the world along which its pose can be changed, if not at once.
    coordinate_names, names, units : tuple of str
        Names of the coordinates, names of the velocities, and units of their integrals.

    """

    coordinate_names: tuple[str, ...] = ()

    def __init__(self, columns: Sequence[int] = (), reach: Sequence[int] = ()) -> None:
        self.columns, self.reach = tuple(columns), tuple(reach)
        self.moves = bool(columns)
        self.names = tuple(TWIST_NAMES[row] for row in columns)
        self.units = tuple(TWIST_UNITS[row] for row in columns)

    def check(self, q: Array) -> Array:
        """Return q if its first entries are valid coordinates, else raise `RobotError`."""
        return q

    def coordinates(self, R: Array, p: Array) -> list[float]:
        """Return the coordinates of an orientation (3, 3) and a position (3,) in the world."""
        return []

    def placement(self, q: Array) -> Array:
        """Return the placement of the base at q (7,)."""
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])

    def moved(self, q: Array, placement: Array, displacement: Array) -> Sequence[float] | Array:
        """Return the coordinates after a displacement (6,) from q that led to a placement."""
        return []


class FlatBase(Base):
    """Base on the ground, with the coordinates x, y [m] and yaw [rad]."""

    coordinate_names = ('base_x', 'base_y', 'base_yaw')

    def coordinates(self, R: Array, p: Array) -> list[float]:
        """Return x, y and yaw; height, roll and pitch are ignored."""
        return [p[0], p[1], math.atan2(R[1, 0], R[0, 0])]

    def placement(self, q: Array) -> Array:
        """Return the placement of the base (7,), level and at height zero."""
        half = 0.5 * q[2]
        return np.array([q[0], q[1], 0.0, 0.0, 0.0, math.sin(half), math.cos(half)])

    def moved(self, q: Array, placement: Array, displacement: Array) -> Sequence[float] | Array:
        """Return x, y and yaw, which is not wrapped."""
        return [placement[0], placement[1], q[2] + displacement[5]]


class FreeBase(Base):
    """Base in space, with its placement (7,) as coordinates."""

    coordinate_names = ('base_x', 'base_y', 'base_z', 'base_qx', 'base_qy', 'base_qz', 'base_qw')

    def check(self, q: Array) -> Array:
        """Return q with its quaternion normalised; `RobotError` if the norm is not near 1."""
        norm = math.sqrt(q[3:7].dot(q[3:7]))
        if not abs(norm - 1.0) <= QUATERNION_TOLERANCE:
            raise RobotError(f'q: the quaternion {", ".join(self.coordinate_names[3:])} needs '
                             f'norm 1, this one has {norm:.3g}')
        q = q.copy()
        q[3:7] /= norm
        return read_only(q)

    def coordinates(self, R: Array, p: Array) -> list[float]:
        """Return the placement."""
        return [*p, *quaternion_from_rotation(R)]

    def placement(self, q: Array) -> Array:
        """Return the placement of the base (7,), with its quaternion normalised."""
        return self.check(q[:7])

    def moved(self, q: Array, placement: Array, displacement: Array) -> Sequence[float] | Array:
        """Return the placement."""
        return placement


# Surge, sway, heave and the rotations are x, y, z and the rotations about them.
BASES = {
    'fixed': Base(),
    'planar': FlatBase((0, 1, 5), (0, 1, 5)),
    'differential': FlatBase((0, 5), (0, 1, 5)),
    'floating': FreeBase(range(6), range(6)),
    'underwater': FreeBase((0, 1, 2, 5), (0, 1, 2, 5)),
}
