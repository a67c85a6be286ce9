# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Range of the orientation of a frame about a desired one."""

from collections.abc import Sequence
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import GoalError
from tp_controller.model.spatial import (
    Array,
    pose,
    read_only,
    rotation_from_vector,
    rotation_vector,
    vector_rate_matrix,
)
from tp_controller.model.state import RobotState
from tp_controller.tasks.bounded import BoundedTask
from tp_controller.tasks.frame import (
    frame_and_reference,
    frame_key,
    parse_axes,
    reference_key,
    RelativeTask,
)
from tp_controller.tasks.keys import finite_vector, Keys, positive
from tp_controller.tasks.orientation import parse_rotation, RotationTask, TurningTask
from tp_controller.tasks.sketch import arc, AXES_LENGTH, Path, Sketch
from tp_controller.tasks.twin import make_twin, ORIENTATION_RANGE, Twin
from tp_controller.tasks.yaml_keys import DEFAULT_TIMEOUT, yaml_key

AXES = ('x', 'y', 'z')
# Number of straight segments of the arc of a range.
RANGE_SEGMENTS = 24


class OrientationRange(TurningTask, RotationTask, RelativeTask, BoundedTask):
    """
    Keep the turn of a frame from a desired orientation between bounds.

    The rows are components of the rotation vector r = log(R_dᵀ R) along axes of the desired
    orientation, with J = L(r) R_dᵀ J_ω and the inverse left Jacobian L of the rotation group.

    The goal is the desired orientation in the reference frame, a quaternion ``xyzw`` (4,) or a
    rotation matrix (3, 3); a twist is its angular velocity.
    """

    type_name = 'orientation_range'
    example = {'frame': 'panda_hand_tcp', 'maximum': [0.5, 0.3, 1.5], 'target': [1, 0, 0, 0]}
    sketch_parts = {'frame': True, 'goal': True, 'range': True, 'turn': False}

    frame: str = frame_key('frame of the robot that is kept in the range')
    maximum: ArrayLike = yaml_key('largest turn about each axis: a number, or one for each axis',
                                  unit='rad')
    minimum: ArrayLike | None = yaml_key('least turn about each axis (default: −maximum)',
                                         default=None, unit='rad')
    axes: tuple[str, ...] = yaml_key(
        'axes of the desired orientation with a range: some of x, y, z (default: all)',
        lambda axes: parse_axes(axes, AXES), None)
    target: ArrayLike | None = yaml_key(
        'desired orientation at the start, a quaternion x, y, z, w in the reference frame '
        '(default: that of the frame)', default=None)
    reference: str = reference_key(
        'frame that goals are expressed in, and move with (default: the root)')
    timeout: float = yaml_key('time that a velocity of the goal stays in force', positive,
                              DEFAULT_TIMEOUT, unit='s', acts=False)

    def check_keys(self, keys: Keys) -> None:
        """Set rows, bounds and goal; the rows of all axes if the key has a fault."""
        super().check_keys(keys)
        self.axes = self.axes or AXES
        self._rows = [AXES.index(axis) for axis in self.axes]
        self.units = ('rad',) * len(self._rows)
        most = keys.check('maximum', self._angles, self.maximum)
        least = most if self.minimum is None else keys.check('minimum', self._angles, self.minimum)
        if most is not None and least is not None:
            self._set_bounds(-most if self.minimum is None else least, most, keys)
        if self.target is not None:
            self.goal = keys.check('target', parse_rotation, self.target, 'the target')

    def start(self, state: RobotState) -> None:
        """Set the orientation of the frame as the default goal."""
        super().start(state)
        if self.goal is None:
            self.goal, self.has_default_goal = self._motion.rotation(state).copy(), True

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return the turns about the selected axes (m,) [rad], and their Jacobian (m, n)."""
        turn = self._turn(state)
        return turn[self._rows], self._rates(turn).dot(self._motion.jacobian(state)[3:])

    def own_motion(self, state: RobotState, now: float) -> float | Array:
        """Return the rates of the values due to the motion of the goal, (m,) or 0 [rad/s]."""
        twist = self.feed_forward(now)
        return 0.0 if twist is None else -self._rates(self._turn(state)).dot(twist[3:])

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        if not isinstance(self.goal, np.ndarray):
            return None
        return make_twin(ORIENTATION_RANGE, self._law(), (
            *frame_and_reference(self.robot, self.frame, self.reference), bytes(self._rows),
            read_only(self.goal), self._rotation_error.memory, self._limits()), self.mode)

    def goal_pose(self, state: RobotState) -> Array:
        """Return the desired orientation at the origin of the frame (4, 4)."""
        return pose(self.goal, self._motion.position(state))

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return frame and goal, an arc for each range, and one for the turn back to them."""
        drawn, T_root_goal = self._frame_and_goal(state)
        if T_root_goal is None:
            return drawn
        R, p, back = T_root_goal[:3, :3], T_root_goal[:3, 3], np.zeros(3)
        for row, least, most in zip(self._rows, *np.atleast_1d(self.lower, self.upper)):
            # The axis after that of the turn shows it.
            tip, axis = AXES_LENGTH * np.eye(3)[(row + 1) % 3], np.eye(3)[row]
            drawn.append(Path(f'range/{AXES[row]}', np.array([
                p + R.dot(rotation_from_vector(angle * axis).dot(tip))
                for angle in np.linspace(least, most, RANGE_SEGMENTS + 1)])))
        turn = self._turn(state)
        back[self._rows] = self._distance_back(turn[self._rows])
        return [*drawn, *arc('turn', p, AXES_LENGTH * state.rotation(self.frame).T, R.dot(back))]

    def _set_bounds(self, least: Array, most: Array, keys: Keys) -> None:
        """Set the bounds (m,) [rad], or record their fault."""
        self.lower, self.upper = least, most
        if (least >= most).any():
            keys.faults.append(('minimum', 'must be less than maximum about every axis, got '
                                f'{least.tolist()} and {most.tolist()}'))

    def _turn(self, state: RobotState) -> Array:
        """Return the rotation vector from the goal to the frame, in the axes of the goal (3,)."""
        return self._rotation_error.follow(rotation_vector(
            self.goal.T.dot(self._motion.rotation(state))))

    def _rates(self, turn: Array) -> Array:
        """Return the matrix (m, 3) from angular velocities in the reference to the values."""
        return vector_rate_matrix(turn)[self._rows].dot(self.goal.T)

    def _angles(self, value: Any) -> Array:
        """Return an angle for each axis (m,) [rad], or raise ValueError or `GoalError`."""
        count = len(self._rows)
        angles = finite_vector(np.full(count, value) if np.ndim(value) == 0 else value, count,
                               'a range')
        if (np.abs(angles) > math.pi).any():
            raise GoalError(f'needs angles of at most π, got {angles.tolist()}')
        return angles
