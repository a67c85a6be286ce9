# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inputs of the tasks of a controller between two cycles: goals, gains, tolerances, enabling."""

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.active_stack import ActiveStack
from tp_controller.control.cycle_time import check_time
from tp_controller.control.gains import set_gain, set_tolerance
from tp_controller.control.goal_limits import check_goal
from tp_controller.control.lead import Lead
from tp_controller.control.settings import Settings
from tp_controller.control.state_buffer import StateBuffer
from tp_controller.errors import GoalError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.keys import finite_vector, Gain, Tolerance
from tp_controller.tasks.stack import Stack
from tp_controller.tasks.task import Task
from tp_controller.tasks.task_errors import accept


class TaskInputs:
    """
    Tasks in force, and their inputs, which take effect in the next cycle.

    Parameters
    ----------
    robot : Robot
    stack : Stack
        First stack.
    settings : Settings
        Settings in force.

    """

    def __init__(self, robot: Robot, stack: Stack, settings: Settings) -> None:
        self.robot = robot
        self._settings = settings
        self._tasks = ActiveStack(stack)
        self._changes = self._tasks.changes
        self._states = StateBuffer(robot)

    @property
    def stack(self) -> Stack:
        """Return the stack in force."""
        return self._tasks.stack

    def restart(self) -> None:
        """
        Reset the default goals: in the next cycle tasks without a goal take their present value.

        Raises
        ------
        EvaluationError
            A task fails; the default goals of the others are reset.

        """
        self._tasks.restart()

    def forget_goals(self) -> None:
        """
        Replace all goals, in the next cycle, by the present values of the tasks; bounds stay.

        Raises
        ------
        EvaluationError
            A task fails; the goals of the others are replaced.

        """
        self._tasks.forget_goals()

    def set_gain(self, name: str, gain: Gain) -> None:
        """
        Set the gain of a task from the next cycle on; it is blended in as a setting is.

        Parameters
        ----------
        name : str
            Task.
        gain : float or array_like (rows,)
            Scalar, or one number for each row [1/s].

        Raises
        ------
        GoalError
            There is no such task.
        SettingsError
            It has no gain, or the value is not valid; the previous gain stays in force.

        """
        task = self._tasks.task(name)
        before = task.gain
        set_gain(task, gain, self._settings.period)
        if np.array_equal(task.gain, before):
            return
        self._changes.announce_task(task, self.stack.active)

    def set_tolerance(self, name: str, tolerance: Tolerance) -> None:
        """
        Set the tolerances of a task, which affect its report only.

        Parameters
        ----------
        name : str
            Task.
        tolerance : float or dict
            Error below which the goal counts as reached, or {unit: error}.

        Raises
        ------
        GoalError
            There is no such task.
        SettingsError
            It has no tolerance, or the value is not valid; the previous tolerances stay in force.

        """
        set_tolerance(self._tasks.task(name), tolerance)

    def _set_constant_goal(self, name: str, goal: Goal, now: float | None,
                           frame: str | Array | None, posture: ArrayLike | None
                           ) -> tuple[str, ...]:
        """Set a goal that is in force at once; see `Controller.set_goal`."""
        now = check_time(now, 'now', GoalError)
        task, goal = self._tasks.task(name), self.parsed_goal(name, goal, frame)
        accept(task, check_goal, task, goal, self._states.present, self._settings)
        remarks = accept(task, task.goal_remarks, goal, not self._is_own(task, frame))
        lead = None if posture is None else Lead(
            self._checked_posture(task, posture))
        self._tasks.set_goal(task, goal, now, lead)
        return remarks

    @staticmethod
    def _is_own(task: Task, frame: str | Array | None) -> bool:
        """Return whether a frame is the reference of a task."""
        return frame is None or (isinstance(frame, str) and frame == task.reference)

    def parsed_goal(self, name: str, goal: Goal, frame: str | Array | None = None) -> Goal:
        """Return a goal of a task in internal form, in its reference frame; see `set_goal`."""
        task = self._tasks.task(name)
        parsed = accept(task, task.parse_goal, goal)
        if frame is None:
            return parsed
        return accept(task, task.goal_in_reference, parsed,
                      self._states.pose_in_reference(task, frame))

    def _checked_posture(self, task: Task, posture: ArrayLike) -> Array:
        """Return positions (n,) that lead a task to its goal, or raise `GoalError`."""
        robot = self.robot
        if robot.moves:
            raise GoalError('a posture leads to no goal where the base moves')
        found = finite_vector(posture, robot.n, 'the posture that leads to a goal')
        bad = [name for name, value, lower, upper in zip(
            robot.joint_names, found, robot.lower, robot.upper) if not lower <= value <= upper]
        if bad:
            raise GoalError('the posture that leads to a goal is beyond the position limits of '
                            f'{", ".join(bad)}')
        return found

    def enable(self, name: str, enabled: bool) -> None:
        """
        Enable or disable a task of the stack.

        A task that is enabled again without a goal takes its present value as the default goal.

        Raises
        ------
        GoalError
            There is no such task, or `enabled` is neither true nor false.

        """
        task = self._tasks.task(name)
        if not isinstance(enabled, (int, np.bool_)) or enabled not in (True, False):
            raise GoalError(f'enabled must be True or False, got {enabled!r}')
        self._tasks.enable(task, bool(enabled))

    def configuration(self) -> tuple[Array, Array | None] | None:
        """
        Return the configuration of the robot in the last update; None before the first one.

        Returns
        -------
        q : ndarray (nq,)
            Configuration [rad or m].
        passive : ndarray (p,) or None
            Positions of the passive joints [rad or m]; None if not given.

        """
        return self._states.configuration
