# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""End-effector position task (lecture 3.2; lab exercise 2 [3])."""

from numpy.typing import ArrayLike
from tp_controller.model.spatial import Array, pose
from tp_controller.model.state import RobotState
from tp_controller.tasks.frame import FrameTask, MovingGoalTask
from tp_controller.tasks.goal_remarks import masked_place, out_of_reach
from tp_controller.tasks.keys import finite_vector


class PointTask(MovingGoalTask):
    """Mixin of tasks whose goal is a point; precedes the base class."""

    goal_type = 'point'
    twist_rows = slice(0, 3)

    def parse_goal(self, goal: ArrayLike) -> Array:
        """Return a point (3,) [m], or raise `GoalError`."""
        return finite_vector(goal, 3, f'the goal of task {self.name!r} (a point x, y, z)')

    def goal_in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Transform a point from another frame to the reference frame."""
        return T_reference_frame[:3, :3].dot(goal) + T_reference_frame[:3, 3]


class Position(PointTask, FrameTask):
    """
    Bring the origin of a frame to a point: σ = η₁, error η₁,d − η₁, Jacobian J_v (lecture 3.2).

    The goal is a point (3,) in the reference frame [m].
    """

    type_name = 'position'
    example = {'frame': 'panda_hand_tcp'}
    make_twin = FrameTask.twin_with_goal

    def value(self, state: RobotState) -> Array:
        """Return the origin of the frame (3,), in the reference frame [m]."""
        return self.position(state)

    def error(self, state: RobotState) -> Array:
        """Return the vector to the goal along the selected axes (rows,) [m]."""
        return (self.goal - self.position(state))[self._mask]

    def out_of_reach(self, goal: Array) -> str:
        """Return a remark if no posture of the robot reaches a goal; else an empty text."""
        return out_of_reach(goal, self.counts[:3], self.reach, self.reference)

    def goal_remarks(self, goal: Array, converted: bool) -> tuple[str, ...]:
        """Return remarks if the goal is out of reach, or some coordinates are not selected."""
        return tuple(filter(None, (
            self.out_of_reach(goal),
            '' if converted else masked_place(goal, self.axes))))

    def goal_place(self, goal: Array, state: RobotState) -> Array:
        """Return the goal along selected axes, else the position of the frame (3,) [m]."""
        return self.selected_place(goal, state)

    def goal_pose(self, state: RobotState) -> Array:
        """Return the pose of the frame at the goal, with its current orientation (4, 4)."""
        return pose(self.rotation(state), self.goal_place(self.goal, state))
