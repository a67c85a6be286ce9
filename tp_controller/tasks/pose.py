# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""End-effector configuration task (lecture 3.4)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import GoalError
from tp_controller.model.spatial import are_rotations, Array, pose
from tp_controller.model.state import RobotState
from tp_controller.tasks.goal_remarks import masked_place, masked_turn, out_of_reach
from tp_controller.tasks.keys import finite_vector, has_shape, MAX_NUMBER
from tp_controller.tasks.orientation import TurningFrameTask, valid_rotation
from tp_controller.tasks.task import Task


class PoseTask(Task):
    """Mixin of tasks whose goal is a pose; precedes the base class."""

    goal_type = 'pose'

    def parse_goal(self, goal: ArrayLike) -> Array:
        """Return a pose (4, 4), or raise `GoalError`."""
        return parse_pose(goal, f'the goal of task {self.name!r}')

    def parse_goals(self, goals: Sequence[ArrayLike]) -> Sequence[Array]:
        """Return poses (4, 4), or raise `GoalError`; matrices are parsed at once."""
        poses = matrices_of(goals)
        if poses is None or type(self).parse_goal is not PoseTask.parse_goal:
            return super().parse_goals(goals)
        return list(poses)

    def goal_in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Transform a pose from another frame to the reference frame."""
        return T_reference_frame.dot(goal)

    def goal_pose(self, state: RobotState) -> Array:
        """Return the goal (4, 4)."""
        return self.goal


class Pose(PoseTask, TurningFrameTask):
    """
    Bring a frame to a pose: position and orientation in one task (lecture 3.4).

    The goal is a 4×4 homogeneous matrix, or ``x, y, z`` [m] and a quaternion ``xyzw`` (7,), in
    the reference frame.
    """

    type_name = 'pose'
    example = {'frame': 'panda_hand_tcp'}
    make_twin = TurningFrameTask.twin_with_goal
    sketch_parts = {'frame': True, 'goal': True, 'error': False, 'turn': False}

    def value(self, state: RobotState) -> Array:
        """Return T_reference_frame (4, 4)."""
        return pose(self.rotation(state), self.position(state))

    def error(self, state: RobotState) -> Array:
        """Return translation and rotation vector to the goal along the selected axes (rows,)."""
        error = np.empty(6)
        error[:3] = self.goal[:3, 3] - self.position(state)
        error[3:] = self._turn(state)
        return error[self._mask]

    def out_of_reach(self, goal: Array) -> str:
        """Return a remark if no posture of the robot reaches a goal; else an empty text."""
        return out_of_reach(goal[:3, 3], self.counts[:3], self.reach, self.reference)

    def goal_remarks(self, goal: Array, converted: bool) -> tuple[str, ...]:
        """Return remarks if the goal is out of reach, or parts of it are not selected."""
        place, turns = goal[:3, 3], self.axis_names()[3:]
        masked = () if converted else (masked_place(place, self.axes),
                                       masked_turn(goal[:3, :3], self.axes, turns))
        return tuple(filter(None, (self.out_of_reach(goal), *masked)))

    def goal_place(self, goal: Array, state: RobotState) -> Array:
        """Return the goal along selected axes, else the position of the frame (3,) [m]."""
        return self.selected_place(goal[:3, 3], state)

    def goal_pose(self, state: RobotState) -> Array:
        """Return the goal along selected axes, else the pose of the frame (4, 4)."""
        return pose(self.selected_rotation(state, self.goal[:3, :3]),
                    self.goal_place(self.goal, state))

    def _turn(self, state: RobotState) -> Array:
        """Return the rotation vector to the goal (3,) [rad]."""
        return self._rotation_error.error(self.goal[:3, :3], self.rotation(state))


def matrices_of(goals: Sequence[ArrayLike]) -> Array | None:
    """Return matrices (count, 4, 4); None if goals have another form, or one is invalid."""
    try:
        T = np.array(goals, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return None
    if T.shape[1:] != (4, 4) or not (np.abs(T) <= MAX_NUMBER).all() \
            or (T[:, 3] != [0.0, 0.0, 0.0, 1.0]).any() or not are_rotations(T[:, :3, :3]):
        return None
    return T


def parse_pose(goal: ArrayLike, what: str) -> Array:
    """Return the pose (4, 4) of a matrix or x, y, z, qx, qy, qz, qw, or raise `GoalError`."""
    if has_shape(goal, (4, 4)):
        T = finite_vector(np.ravel(goal), 16, what).reshape(4, 4)
        if T[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise GoalError(f'{what}: the last row of a pose is 0, 0, 0, 1, not {T[3].tolist()}')
        valid_rotation(T[:3, :3], what)
        return T
    goal = finite_vector(goal, 7, f'{what} (a pose x, y, z, qx, qy, qz, qw)')
    return pose(valid_rotation(goal[3:], what), goal[:3])
