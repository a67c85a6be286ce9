# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""State of a robot: poses, Jacobians and the centre of mass of its links."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
import pinocchio
from tp_controller.errors import RobotError
from tp_controller.model.kinematics import Kinematics
from tp_controller.model.spatial import Array, cross, read_only

# Largest position [rad or m]; squares and cubes of larger numbers would overflow.
LARGEST = 1e9


class RobotState:
    """
    State of a robot at one configuration, with its kinematics evaluated once.

    Frames are identified by name; the results for a frame are cached until the next `update`. All
    arrays are read-only copies, which later updates do not change. `Robot.state` returns a state.

    Attributes
    ----------
    q : ndarray (nq,)
        Configuration [rad or m].
    positions : ndarray (n,)
        Positions that are subject to limits; see `Robot.positions`.
    motion : Motion or None
        Compiled kinematics at these positions; None if Pinocchio evaluates them.
    velocity : ndarray (n,)
        Velocity commanded since the previous state, for tasks that look ahead; zero unless the
        caller sets it [rad/s or m/s].
    still : sequence of int
        Indices of the velocities that the robot does not have, such as those of locked joints, for
        tasks about what it can do; none unless the caller sets them.

    """

    q: Array
    positions: Array
    still: Sequence[int] = ()

    def __init__(self, kinematics: Kinematics, q: ArrayLike, passive: ArrayLike) -> None:
        self._kinematics = kinematics
        self.motion = kinematics.motion()
        # Whether Pinocchio's data are those of these positions.
        self._is_evaluated = False
        self._offset = kinematics.offset
        self._placements: dict[str, tuple[Array, Array, Array]] = {}
        self._jacobians: dict[str, Array] = {}
        self._center_of_mass: tuple[Array, Array] | None = None
        self.velocity: Array = np.zeros(kinematics.n)
        self.update(q, passive)

    def update(self, q: ArrayLike, passive: ArrayLike | None = None) -> None:
        """
        Move to another configuration and evaluate the kinematics there.

        Parameters
        ----------
        q : array_like (nq,)
            Configuration [rad or m].
        passive : array_like (p,), optional
            Passive positions; unchanged by default.

        Raises
        ------
        RobotError
            Wrong shape, not finite or no quaternion; the state is unchanged.

        """
        kinematics, offset, placement = self._kinematics, self._offset, None
        if passive is not None and kinematics.passive_names:
            offset = kinematics.offset_at(_positions(passive, kinematics.passive_names, 'passive'))
        if self.motion is None or kinematics.base.moves:
            checked = _positions(q, kinematics.coordinate_names, 'q')
            if kinematics.base.moves:
                checked = kinematics.base.check(checked)
                placement = kinematics.base.placement(checked)
        else:
            # The compiled kinematics validate them.
            checked = _array(q, kinematics.coordinate_names, 'q')
        if self.motion is not None:
            try:
                self.motion.move(checked, offset, placement)
            except ValueError:
                _positions(q, kinematics.coordinate_names, 'q')
                raise
        self.q, self.positions = checked, kinematics.positions(checked)
        self._offset = offset
        self._placements.clear()
        self._jacobians.clear()
        self._center_of_mass = None
        self._is_evaluated = False

    def rotation(self, frame: str) -> Array:
        """Return R_root_frame (3, 3)."""
        return (self._placements.get(frame) or self._place(frame))[0]

    def position(self, frame: str) -> Array:
        """Return the origin of a frame (3,), in the root frame [m]."""
        return (self._placements.get(frame) or self._place(frame))[1]

    def pose(self, frame: str) -> Array:
        """Return T_root_frame (4, 4)."""
        return (self._placements.get(frame) or self._place(frame))[2]

    def jacobian(self, frame: str) -> Array:
        """
        Return the Jacobian of a frame, in the axes of the root frame.

        Parameters
        ----------
        frame : str
            Its name.

        Returns
        -------
        ndarray (6, n)
            Rows 0 to 2 give the velocity of the frame's origin, 3 to 5 its angular velocity;
            columns are as in `Robot.velocity_names`.

        """
        J = self._jacobians.get(frame)
        if J is None:
            J = self._jacobians[frame] = read_only(self._jacobian(frame))
        return J

    def jacobian_gradient(self, frame: str, weights: Array) -> Array:
        """
        Return the gradient of a weighted sum of the entries of a frame's Jacobian.

        Parameters
        ----------
        frame : str
            Its name.
        weights : ndarray (6, n)
            Weights of the entries of `jacobian`.

        Returns
        -------
        ndarray (n,)
            ∂/∂q_k of Σ weights ∘ J.

        """
        J, expand, turned = (self._model_jacobian(frame), self._kinematics.expand,
                             self._kinematics.turned)
        if expand is not None:
            weights = weights.dot(expand.T)
        v, w, of_v, of_w = J[:3].T, J[3:].T, weights[:3].T, weights[3:].T
        # Column j of J is (v_j, ω_j). If motion k precedes motion j it turns both,
        # ∂J_j/∂q_k = (ω_k × v_j, ω_k × ω_j); otherwise it moves the frame, by ω_j × v_k.
        turns = cross(v, of_v) + cross(w, of_w)
        shifts = cross(of_v, w)
        gradient = (w.dot(turns.T) * turned + v.dot(shifts.T) * (1.0 - turned)).sum(axis=1)
        return gradient if expand is None else expand.T.dot(gradient)

    def center_of_mass(self) -> tuple[Array, Array]:
        """
        Return the centre of mass of all links and its Jacobian.

        Returns
        -------
        c : ndarray (3,)
            In the root [m].
        J : ndarray (3, n)

        """
        if self._center_of_mass is None:
            kinematics = self._kinematics
            J = pinocchio.jacobianCenterOfMass(kinematics.model, self._evaluated(),
                                               False).reshape(3, -1)
            if kinematics.expand is not None:
                J = J.dot(kinematics.expand)
            # Pinocchio leaves out the bodies that are fixed to the root.
            still = kinematics.model.inertias[0]
            share = still.mass / kinematics.mass
            self._center_of_mass = (
                read_only(share * still.lever + (1.0 - share) * self._data.com[0]),
                read_only((1.0 - share) * J))
        return self._center_of_mass

    def place(self, geometry: pinocchio.GeometryModel, data: pinocchio.GeometryData) -> None:
        """Update the placements in one of Pinocchio's geometry models of this robot."""
        pinocchio.updateGeometryPlacements(self._kinematics.model, self._evaluated(), geometry,
                                           data)

    @cached_property
    def _data(self) -> pinocchio.Data:
        """Return Pinocchio's data."""
        return self._kinematics.model.createData()

    def prepare(self) -> None:
        """Make now, in 4 ms for 50 joints, what the first evaluation by Pinocchio makes."""
        self._evaluated()

    def _evaluated(self) -> pinocchio.Data:
        """Return Pinocchio's data at these positions."""
        if not self._is_evaluated:
            kinematics = self._kinematics
            pinocchio.computeJointJacobians(kinematics.model, self._data,
                                            kinematics.configuration(self.q, self._offset))
            self._is_evaluated = True
        return self._data

    def _jacobian(self, frame: str) -> Array:
        """Evaluate the Jacobian (6, n) of a frame."""
        kinematics = self._kinematics
        if self.motion is not None:
            J = np.empty((6, kinematics.n))
            self.motion.jacobian(kinematics.frame_index(frame), J)
            return J
        J = self._model_jacobian(frame)
        return J if kinematics.expand is None else J.dot(kinematics.expand)

    def _model_jacobian(self, frame: str) -> Array:
        """Return the Jacobian (6, nv) of a frame by the coordinates of Pinocchio's model."""
        kinematics, data = self._kinematics, self._evaluated()
        index = kinematics.frame_index(frame)
        pinocchio.updateFramePlacement(kinematics.model, data, index)
        J = pinocchio.getFrameJacobian(kinematics.model, data, index,
                                       pinocchio.LOCAL_WORLD_ALIGNED)
        # For a model with one coordinate Pinocchio omits the second dimension.
        return J if J.ndim == 2 else J.reshape(6, 1)

    def _place(self, frame: str) -> tuple[Array, Array, Array]:
        """Evaluate the placement of a frame: R_root_frame, its origin, and both as a pose."""
        kinematics = self._kinematics
        if self.motion is not None:
            T = np.empty((4, 4))
            self.motion.place(kinematics.frame_index(frame), T)
        else:
            # The rotation and translation of a placement are views of Pinocchio's data, which the
            # next update changes; this matrix is a copy.
            T = pinocchio.updateFramePlacement(
                kinematics.model, self._evaluated(),
                kinematics.frame_index(frame)).homogeneous
        T = read_only(T)
        self._placements[frame] = placed = T[:3, :3], T[:3, 3], T
        return placed


def _positions(values: ArrayLike, names: Sequence[str], what: str) -> Array:
    """Return joint positions as a read-only array, one for each name."""
    positions = _array(values, names, what)
    if positions.shape != (len(names),):
        raise RobotError(f'{what} needs {len(names)} positions ({", ".join(names)}), '
                         f'got an array of shape {positions.shape}')
    bad = [name for name, value in zip(names, positions.tolist()) if not abs(value) <= LARGEST]
    if bad:
        raise RobotError(f'{what} is not finite for {", ".join(bad)}, or beyond {LARGEST:g}')
    return positions


def _array(values: ArrayLike, names: Sequence[str], what: str) -> Array:
    """Return numbers as a read-only array."""
    try:
        return read_only(np.array(values, dtype=float))
    except (TypeError, ValueError, OverflowError) as error:
        raise RobotError(f'{what} needs {len(names)} positions ({", ".join(names)}): '
                         f'{error}') from error
