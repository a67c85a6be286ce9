# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compiled kinematics (kinematics.h), created once from Pinocchio's model.

They replace Pinocchio in the cycle: a call of Pinocchio from Python takes several times as long
as its computation. They support joints that turn about or slide along an axis, and a moving base.
For other joints, for more than `MOST` bodies or frames, and without a compiler, `RobotState` uses
Pinocchio.
"""

from typing import Protocol, TypeAlias

import numpy as np
import pinocchio
from tp_controller.model.spatial import Array
from tp_controller.solver.compiled import core, MOST

# Kinds of joints, numbered as in kinematics.h; the first is the root.
STILL, FREE, TURNS, SLIDES = range(4)


class Motion(Protocol):
    """Interface of the compiled kinematics; ValueError if arrays do not fit."""

    def move(self, q: Array, offset: Array, placement: Array | None) -> None:
        """Move to q (nq,), all joints with an `offset` (j,), the base to a placement (7,)."""

    def place(self, frame: int, T: Array) -> None:
        """Fill in T_root_frame (4, 4)."""

    def jacobian(self, frame: int, J: Array) -> None:
        """Fill in J (6, n) of a frame, as `RobotState.jacobian`."""


# Number of velocities, row where the driven joints begin in a configuration, rows of the twist of
# the base that are velocities, bodies (b, 23) and frames (f, 13).
Numbers: TypeAlias = tuple[int, int, Array, Array, Array]


def numbers_of(model: pinocchio.Model, n: int, first_row: int, base: tuple[int, ...],
               joint_map: Array) -> Numbers | None:
    """
    Return the arguments of `make_motion` for a model; None if it is not supported.

    Parameters
    ----------
    model : pinocchio.Model
        Model of the robot.
    n : int
        Number of velocities.
    first_row : int
        Index of the first driven joint in a configuration.
    base : tuple of int
        Rows of the twist of the base that are velocities.
    joint_map : ndarray (j, driven)
        Share that each driven joint has in the position of every joint; one a row at most.

    """
    bodies = _bodies(model, joint_map)
    if bodies is None or max(n, len(bodies), len(model.frames)) > MOST:
        return None
    frames = [[frame.parentJoint, *_numbers(frame.placement)] for frame in model.frames]
    return n, first_row, np.array(base, dtype=float), bodies, np.array(frames)


def make_motion(numbers: Numbers | None) -> Motion | None:
    """Return new compiled kinematics, to be moved by a state; None if they are unavailable."""
    if numbers is None or core is None:
        return None
    found: Motion = core.Motion(*numbers)
    return found


def _bodies(model: pinocchio.Model, joint_map: Array) -> Array | None:
    """Return joint, placement, mass and centre of each body (b, 23); None if unsupported."""
    still = _numbers(pinocchio.SE3.Identity())
    bodies = [[STILL, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, *still]]
    shares, data = iter(joint_map), model.createData()
    for index in range(1, model.njoints):
        joint, placement = model.joints[index], _numbers(model.jointPlacements[index])
        size, parent = (joint.nq, joint.nv), model.parents[index]
        if size == (7, 6) and parent == 0 and placement == still:
            bodies.append([FREE, parent, -1.0, 0.0, 0.0, 0.0, 0.0, *placement])
        elif size == (1, 1) and not joint.shortname().startswith('JointModelH'):
            bodies.append([*_joint(data.joints[index].S, parent, next(shares)), *placement])
        else:
            return None
    inertias = list(model.inertias)
    mass = sum(inertia.mass for inertia in inertias) or 1.0
    return np.hstack((bodies, [[inertia.mass / mass, *inertia.lever] for inertia in inertias]))


def _joint(subspace: Array, parent: int, shares: Array) -> list[float]:
    """Return kind, parent, column, share and axis of a joint that turns or slides."""
    columns = np.flatnonzero(shares)
    column = int(columns[0]) if len(columns) else -1
    turns = bool(subspace[3:].any())
    axis = subspace[3:] if turns else subspace[:3]
    return [TURNS if turns else SLIDES, parent, column, shares[column] if len(columns) else 0.0,
            *np.ravel(axis)]


def _numbers(placement: pinocchio.SE3) -> list[float]:
    """Return the rotation, row by row, and the translation of a placement."""
    return [*placement.rotation.ravel().tolist(), *placement.translation.tolist()]
