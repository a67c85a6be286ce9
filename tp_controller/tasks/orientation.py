# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""End-effector orientation task (lecture 3.3, slip corrected)."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import GoalError
from tp_controller.model.spatial import (
    Array,
    check_rotation,
    pose,
    rotation_from_quaternion,
    rotation_from_vector,
    rotation_vector,
    shorter_rotation,
)
from tp_controller.model.state import RobotState
from tp_controller.tasks.frame import FrameTask, MovingGoalTask
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.keys import finite_vector, has_shape
from tp_controller.tasks.sketch import arc, AXES_LENGTH, Sketch
from tp_controller.tasks.task import Task

SomeTurningTask = TypeVar('SomeTurningTask', bound='TurningTask')


class ContinuousRotation:
    """Orientation error whose direction stays continuous near half a turn."""

    def __init__(self) -> None:
        # Last rotation vector (3,) [rad], then 1; zeros without one. Twins of the task write here.
        self.memory = np.zeros(4)

    @property
    def previous(self) -> Array | None:
        """Return the last rotation vector (3,) [rad]; None without one."""
        return self.memory[:3].copy() if self.memory[3] else None

    def forget(self) -> None:
        """Drop the last direction."""
        self.memory[:] = 0.0

    def error(self, R_desired: Array, R_actual: Array) -> Array:
        """Return the rotation vector (3,) from actual to desired [rad]."""
        return self.follow(rotation_vector(R_desired.dot(R_actual.T)))

    def follow(self, vector: Array) -> Array:
        """Return a rotation vector (3,), or its complement in the other direction [rad]."""
        vector = shorter_rotation(vector, self.previous)
        self.memory[:3], self.memory[3] = vector, 1.0
        return vector

    def inherit(self, other: 'ContinuousRotation') -> None:
        """Copy the direction of another error."""
        self.memory[:] = other.memory


class TurningTask(Task):
    """Mixin of tasks with a continuous orientation error; precedes the base class."""

    def __init__(self, *arguments: Any, **keys: Any) -> None:
        super().__init__(*arguments, **keys)
        self._rotation_error = ContinuousRotation()

    def set_goal(self, goal: Goal, now: float) -> None:
        """Set a goal, and restart with the shorter rotation to it."""
        super().set_goal(goal, now)
        self._rotation_error.forget()

    def forget_cycles(self) -> None:
        """Restart with the shorter rotation; see `Task`."""
        self._rotation_error.forget()

    def with_goal(self: SomeTurningTask, goal: Goal) -> SomeTurningTask:
        """Return a copy with a goal, which starts with the shorter rotation to it."""
        tried = super().with_goal(goal)
        tried._rotation_error = ContinuousRotation()
        return tried

    def inherit_goal(self, other: Task) -> None:
        """Inherit the goal of a task that this one replaces, and the direction of rotation."""
        if self.goal is None and self.is_compatible(other):
            self._rotation_error.inherit(other._rotation_error)
        super().inherit_goal(other)

    def probe(self) -> 'TurningTask':
        """Return an independent copy for evaluation elsewhere, with its own direction."""
        other = super().probe()
        other._rotation_error = ContinuousRotation()
        other._rotation_error.inherit(self._rotation_error)
        return other


class TurningFrameTask(TurningTask, FrameTask):
    """Base class of tasks about a frame that control its orientation."""

    @abstractmethod
    def _turn(self, state: RobotState) -> Array:
        """Return the rotation vector to the goal (3,) [rad]."""

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return the sketch, with an arc for the remaining turn about the selected axes."""
        drawn = super().sketch(state)
        if self.goal is None:
            return drawn
        return [*drawn, *arc(
            'turn', state.position(self.frame), AXES_LENGTH * state.rotation(self.frame).T,
            state.rotation(self.reference).dot(self.counts[3:] * self._turn(state)))]

    def selected_rotation(self, state: RobotState, R: Array) -> Array:
        """Return R (3, 3); unless all axes are selected, the rotation after a turn about some."""
        counts = self.counts[3:]
        return R if counts.all() else rotation_from_vector(
            counts * self._turn(state)).dot(self.rotation(state))

    def _turned(self) -> Array:
        """Return the memory of the rotation error (4,)."""
        return self._rotation_error.memory


class RotationTask(MovingGoalTask):
    """Mixin of tasks whose goal is an orientation; precedes the base class."""

    goal_type = 'quaternion'
    twist_rows = slice(3, 6)

    def parse_goal(self, goal: ArrayLike) -> Array:
        """Return a rotation matrix (3, 3), or raise `GoalError`."""
        return parse_rotation(goal, f'the goal of task {self.name!r}')

    def goal_in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Rotate an orientation from another frame to the reference frame."""
        return T_reference_frame[:3, :3].dot(goal)


class Orientation(RotationTask, TurningFrameTask):
    """
    Turn a frame to an orientation: error log(R_d Rᵀ), Jacobian J_ω (lecture 3.3).

    The error of lecture 3.3, w ε_d − w_d ε − ε × ε_d, is expressed in the frame itself, while J_ω
    is expressed in the base. Here both are expressed in the reference frame. The rotation vector
    is that of the shorter rotation, and decays with the full gain.

    The goal is a quaternion ``xyzw`` (4,) or a rotation matrix (3, 3), in the reference frame.
    """

    type_name = 'orientation'
    example = {'frame': 'panda_hand_tcp'}
    make_twin = TurningFrameTask.twin_with_goal
    sketch_parts = {'frame': True, 'goal': True, 'turn': False}

    def value(self, state: RobotState) -> Array:
        """Return R_reference_frame (3, 3)."""
        return self.rotation(state)

    def error(self, state: RobotState) -> Array:
        """Return the rotation vector to the goal about the selected axes (rows,) [rad]."""
        return self._turn(state)[self._mask]

    def goal_pose(self, state: RobotState) -> Array:
        """Return the pose of the frame after the turn about the selected axes (4, 4)."""
        return pose(self.selected_rotation(state, self.goal), self.position(state))

    def _turn(self, state: RobotState) -> Array:
        """Return the rotation vector to the goal (3,) [rad]."""
        return self._rotation_error.error(self.goal, self.rotation(state))


def parse_rotation(goal: ArrayLike, what: str) -> Array:
    """Return the rotation matrix (3, 3) of a quaternion ``xyzw`` or matrix, or `GoalError`."""
    if has_shape(goal, (3, 3)):
        return valid_rotation(finite_vector(np.ravel(goal), 9, what).reshape(3, 3), what)
    return valid_rotation(finite_vector(goal, 4, f'{what} (a quaternion x, y, z, w)'), what)


def valid_rotation(numbers: Array, what: str) -> Array:
    """Return the rotation matrix of a quaternion (4,) or matrix (3, 3), or raise `GoalError`."""
    try:
        return check_rotation(numbers) if numbers.ndim == 2 else rotation_from_quaternion(numbers)
    except ValueError as error:
        raise GoalError(f'{what}: {error}') from error
