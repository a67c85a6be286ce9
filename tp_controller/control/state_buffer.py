# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""States of the robot in the present and the previous cycle, and frames at the present one."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.cycle_record import CycleRecord
from tp_controller.errors import GoalError, unknown
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, inverse_pose
from tp_controller.model.state import RobotState
from tp_controller.tasks.pose import parse_pose
from tp_controller.tasks.task import Task


class StateBuffer:
    """
    States of a robot, reused in turn.

    Pinocchio takes 8 ms to make one for TIAGo, 44 ms with two arms: too long for a cycle.

    Parameters
    ----------
    robot : Robot

    Attributes
    ----------
    spare : RobotState
        Scratch state for reports.
    passive : ndarray (p,) or None
        Positions of the passive joints [rad or m]; None if not given.
    pending : CycleRecord or None
        Last cycle, if it needed no state.

    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._present: RobotState | None = None
        self._next, self._other, self.spare = [robot.state(robot.neutral()) for _ in range(3)]
        for state in (self._next, self._other, self.spare):
            state.prepare()
        self.passive: Array | None = None
        self.pending: CycleRecord | None = None

    def set_still(self, joints: Sequence[int]) -> None:
        """Set the velocities that the robot does not have; see `RobotState.still`."""
        for state in (self._next, self._other, self.spare):
            state.still = joints

    def update(self, q: ArrayLike, passive: ArrayLike | None, velocity: Array) -> RobotState:
        """
        Return the state at other positions and a velocity (n,) [rad/s or m/s].

        The previous one stays valid until the next.
        """
        state = self._next
        if passive is None or not self._robot.passive_names:
            state.update(q, self.passive)
        else:
            state.update(q, passive)
            # Copy: the caller may modify the array.
            self.passive = np.array(passive)
        self._next, self._other = self._other, state
        self._present, self.pending = state, None
        state.velocity = velocity
        return state

    @property
    def present(self) -> RobotState | None:
        """Return the state of the last cycle; None before the first one."""
        if self.pending is not None:
            self.update(self.pending.place.q, None, self.pending.velocity_before)
        return self._present

    @property
    def configuration(self) -> tuple[Array, Array | None] | None:
        """Return the configuration of the last cycle; see `Controller.configuration`."""
        pending, present = self.pending, self._present
        if pending is not None:
            return pending.place.q, self.passive
        return None if present is None else (present.q, self.passive)

    def pose_in_reference(self, task: Task, frame: str | Array) -> Array:
        """
        Return T_reference_frame (4, 4) of a task at the present state.

        Parameters
        ----------
        task : Task
            Task with a goal in the frame.
        frame : str or ndarray (4, 4)
            Frame of the robot, or T_root_frame.

        Raises
        ------
        GoalError
            The task has no reference frame, the frame is unknown, or there is no state yet.

        """
        if task.reference is None:
            raise GoalError(f'a goal of task {task.name!r} is not expressed in a frame: '
                            'leave it out')
        if isinstance(frame, str) and frame not in self._robot.frame_names:
            raise GoalError(unknown('frame', frame, self._robot.frame_names))
        if isinstance(frame, str) and frame == task.reference:
            return np.eye(4)
        if self.present is None:
            raise GoalError('a goal in another frame needs joint positions, '
                            'and none have arrived yet')
        T_root_frame = self.present.pose(frame) if isinstance(frame, str) else parse_pose(
            frame, f'the frame of a goal for task {task.name!r}')
        return inverse_pose(self.present.pose(task.reference)).dot(T_root_frame)
