# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Kinematic model of a robot in Pinocchio, from its joints and its base."""

from collections.abc import Sequence

import numpy as np
import pinocchio
from tp_controller.errors import RobotError, unknown
from tp_controller.model.compiled import make_motion, Motion, numbers_of
from tp_controller.model.mobile_base import Base
from tp_controller.model.spatial import Array, read_only
from tp_controller.model.urdf import FREE_FLYER, MimicRules, resolve_mimic


class Kinematics:
    """
    Pinocchio's model of a robot, with coordinates for each moving joint and the whole base.

    Attributes
    ----------
    model : pinocchio.Model
    frame_ids : dict
        {name: index} of the frames, in the order of `Robot.frame_names`.
    base : Base
        Kind of the base.
    mass : float
        Total mass of the links [kg].
    coordinate_names, passive_names : tuple of str
        Coordinates of the base, then driven joints; passive joints.
    n : int
        Number of velocities.
    joint_columns, joint_rows : slice
        Entries of the driven joints in an array (n,), and in an array (nq,).
    offset : ndarray (j,)
        Positions of all joints if driven and passive ones are at zero [rad or m].
    expand : ndarray (nv, n) or None
        The Jacobian of the robot is that of the model times this. None if the configurations of
        the two are the same.
    turned : ndarray (nv, nv)
        1 if motion k of the model turns the axis of motion j, else 0.

    """

    def __init__(self, model: pinocchio.Model, frame_ids: dict[str, int], base: Base,
                 driven: Sequence[str], passive: Sequence[str], mimics: MimicRules) -> None:
        self.model, self.frame_ids, self.base = model, frame_ids, base
        self.mass = float(sum(inertia.mass for inertia in model.inertias))
        self.coordinate_names = (*base.coordinate_names, *driven)
        self.passive_names = tuple(passive)
        self.n = len(base.names) + len(driven)
        self.joint_columns = slice(len(base.names), self.n)
        self.joint_rows = slice(len(base.coordinate_names), len(self.coordinate_names))
        names = [name for name in model.names[1:] if name != FREE_FLYER]
        self._map_joints(names, driven, mimics)
        self._driven_joints = {model.getJointId(name) for name in model.names[1:]
                               if name == FREE_FLYER or resolve_mimic(name, mimics)[0] in driven}
        self._driven_rows = [model.joints[model.getJointId(name)].idx_q for name in driven]
        first = model.nv - len(names)
        expand = np.zeros((model.nv, self.n))
        expand[list(base.columns), range(self.joint_columns.start)] = 1.0
        expand[first:, self.joint_columns] = self._joint_map
        self.expand: Array | None = expand
        if not base.moves and np.array_equal(expand, np.eye(model.nv)):
            self.expand = None
        # Motion k turns the axis of motion j if it precedes it in the chain from the root. The
        # motions of a base are about its own axes, so each of them turns all of them.
        self.turned = np.triu(np.ones((model.nv, model.nv)))
        self.turned[:first, :first] = 1.0
        # Created once: all states of the robot share them.
        self._numbers = numbers_of(model, self.n, self.joint_rows.start, base.columns,
                                   self._joint_map)

    def _map_joints(self, names: Sequence[str], driven: Sequence[str],
                    mimics: MimicRules) -> None:
        """Prepare the positions of all joints: `_joint_map` q + `_passive_map` p + `offset`."""
        self._joint_map = np.zeros((len(names), len(driven)))
        self._passive_map = np.zeros((len(names), len(self.passive_names)))
        self.offset: Array = np.zeros(len(names))
        for row, name in enumerate(names):
            leader, multiplier, self.offset[row] = resolve_mimic(name, mimics)
            if leader in driven:
                self._joint_map[row, driven.index(leader)] = multiplier
            else:
                self._passive_map[row, self.passive_names.index(leader)] = multiplier

    def motion(self) -> Motion | None:
        """Return new compiled kinematics, to be moved by a state; None for Pinocchio."""
        return make_motion(self._numbers)

    def check_frame(self, name: object) -> str:
        """Return `name` if it is a frame of the robot, else raise `RobotError`."""
        if not isinstance(name, str) or name not in self.frame_ids:
            raise RobotError(unknown('frame', name, self.frame_ids))
        return name

    def frame_index(self, name: str) -> int:
        """Return the index of a frame of the model, or raise `RobotError`."""
        return self.frame_ids[self.check_frame(name)]

    def attachment(self, frame: str) -> tuple[int, pinocchio.SE3]:
        """Return the joint that moves a frame, and the placement of the frame on it."""
        found = self.model.frames[self.frame_ids[frame]]
        return found.parentJoint, found.placement

    def joints_between(self, frames: Sequence[str]) -> tuple[Array, Array]:
        """
        Count the joints on the path between each two of some frames.

        Parameters
        ----------
        frames : sequence of str
            Names of the frames (f,).

        Returns
        -------
        every, driven : ndarray (f, f)
            Number of moving joints, and of the driven ones among them, a base included.

        """
        supports = np.zeros((len(frames), self.model.njoints))
        for row, frame in enumerate(frames):
            supports[row, list(self.model.supports[self.attachment(frame)[0]])] = 1.0
        return _differences(supports), _differences(supports[:, sorted(self._driven_joints)])

    def reach(self, one: str, other: str) -> float:
        """
        Return an upper bound of the distance of two frames: the links laid in a line [m].

        The bound is not tight: the joints may not be able to align the links. It is infinite if a
        moving base, or a sliding joint without limits, lies between them.
        """
        ends = (self.attachment(frame)[1].translation for frame in (one, other))
        return float(sum(np.linalg.norm(end) for end in ends)
                     + sum(np.linalg.norm(self.model.jointPlacements[joint].translation)
                           + self._travel(joint) for joint in self._between(one, other)))

    def _travel(self, joint: int) -> float:
        """Return the largest translation of a joint from its zero position [m]."""
        found = self.model.joints[joint]
        kind = found.shortname()
        if kind == 'JointModelFreeFlyer':
            return np.inf
        if not kind.startswith('JointModelP'):
            return 0.0
        ends = (self.model.lowerPositionLimit, self.model.upperPositionLimit)
        return max(abs(limits[found.idx_q]) for limits in ends)

    def _between(self, one: str, other: str) -> set[int]:
        """Return the joints on the path from one frame to another."""
        ends = (self.attachment(frame)[0] for frame in (one, other))
        return set.symmetric_difference(*(set(self.model.supports[end]) for end in ends))

    def positions(self, q: Array) -> Array:
        """Return the positions of the driven joints (n,) at q, zeros for the base."""
        if not self.base.moves:
            return q
        positions = np.zeros(self.n)
        positions[self.joint_columns] = q[self.joint_rows]
        return read_only(positions)

    def offset_at(self, passive: Array) -> Array:
        """Return `offset` with the passive joints at given positions (p,)."""
        return self.offset + self._passive_map.dot(passive)

    def configuration(self, q: Array, offset: Array) -> Array:
        """Return the configuration of the model at q, with an offset (j,) of all joints."""
        if self.expand is None:
            return q
        if not self.base.moves:
            return self._joint_map.dot(q) + offset
        return np.concatenate((self.base.placement(q),
                               self._joint_map.dot(q[self.joint_rows]) + offset))

    def integrate(self, q: Array, velocity: Array, dt: float) -> Array:
        """Return the configuration (nq,) after `dt` seconds; see `Robot.integrate`."""
        if self.expand is None:
            return pinocchio.integrate(self.model, q, dt * velocity)
        displacement = dt * self.expand.dot(velocity)
        moved = pinocchio.integrate(self.model, self.configuration(q, self.offset), displacement)
        joints = moved[self._driven_rows]
        if not self.base.moves:
            return joints
        return np.concatenate((self.base.moved(q, moved[:7], displacement[:6]), joints))


def _differences(members: Array) -> Array:
    """Return the number of different entries (f, f) of each two rows (f, m) of zeros and ones."""
    counts = members.sum(axis=1)
    return counts[:, np.newaxis] + counts - 2.0 * members @ members.T
