# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inputs of the joints of a controller between two cycles: velocity limits and locks."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.cycle_time import check_time
from tp_controller.control.lead import ARRIVED
from tp_controller.control.settings import Settings
from tp_controller.control.trajectory_inputs import TrajectoryInputs
from tp_controller.control.velocity_limits import lowered
from tp_controller.errors import GoalError, TimeError
from tp_controller.model.joint_groups import check_velocities
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tasks.stack import Stack
from tp_controller.tasks.task import Task


class JointInputs(TrajectoryInputs):
    """
    Inputs of the tasks of a controller, and of its joints.

    A lock is a velocity limit of zero: the joint brakes within its limits, then it stands, and
    every task is that of a robot without it. Where it stands is measured, as of a passive joint.
    """

    def __init__(self, robot: Robot, stack: Stack, settings: Settings) -> None:
        super().__init__(robot, stack, settings)
        self._velocity_limits = robot.velocity
        self._locked: MappingProxyType[str, float] = MappingProxyType({})

    @abstractmethod
    def _apply(self, settings: Settings) -> None:
        """Apply validated settings, with the present velocity limits."""

    @property
    def velocity_limits(self) -> Array:
        """Return the velocity limits in force (n,), without locks [rad/s or m/s]."""
        return self._velocity_limits.copy()

    def check_velocity_limits(self, limits: Mapping[str, float]) -> None:
        """Raise `SettingsError` if `set_velocity_limits` cannot set such limits."""
        lowered(self.robot, self._velocity_limits, limits)

    def set_velocity_limits(self, limits: Mapping[str, float]) -> None:
        """
        Lower velocity limits from the next cycle on, or raise them again.

        A faster joint brakes with its acceleration limit, or at once without such a limit.

        Parameters
        ----------
        limits : mapping
            {velocity: limit}, of `Robot.velocity_names` [rad/s or m/s]; others stay.

        Raises
        ------
        SettingsError
            Lists all limits that are not above 0, or are beyond the limit of the robot; the
            previous limits stay in force.

        """
        found = lowered(self.robot, self._velocity_limits, limits)
        if not np.array_equal(found, self._velocity_limits):
            self._velocity_limits = found
            self._change_limits()

    @property
    def locked(self) -> Mapping[str, float]:
        """Return the times of the locks by joint [s]."""
        return self._locked

    def check_joints(self, joints: Sequence[str]) -> None:
        """Raise `RobotError` if `lock` and `unlock` do not take such joints."""
        check_velocities(joints, self.robot.velocity_names)

    def lock(self, joints: Sequence[str], now: float | None = None) -> None:
        """
        Lock joints from the next cycle on: they become passive where they stand.

        A joint that moves brakes within its limits of acceleration and jerk, or stands at once
        without them; it need not reach the demand of any task. The other joints go on, and do
        what it did as far as they can. Locks stay in force with another stack and other settings.

        Parameters
        ----------
        joints : sequence of str
            Driven joints, or velocities of a moving base; see `Robot.velocity_names`.
        now : float
            [s]

        Raises
        ------
        RobotError
            A name is none of these; no joint is locked then.
        TimeError
            `now` is not a finite number; no joint is locked then.

        """
        now = check_time(now, 'now', TimeError)
        self.check_joints(joints)
        self._set_locked(dict.fromkeys(joints, now) | self._locked)

    def unlock(self, joints: Sequence[str], now: float | None = None) -> None:
        """
        Unlock joints from the next cycle on: they move again, without a jump.

        Parameters
        ----------
        joints, now
            See `lock`; joints that are not locked stay as they are.

        Raises
        ------
        RobotError, TimeError
            As `lock`; all locks stay in force.

        """
        check_time(now, 'now', TimeError)
        self.check_joints(joints)
        self._set_locked({name: time for name, time in self._locked.items()
                          if name not in joints})

    def _set_locked(self, locked: dict[str, float]) -> None:
        """Replace the locks."""
        if locked.keys() != self._locked.keys():
            self._locked = MappingProxyType(locked)
            # A posture that leads to a goal may be out of reach now.
            self._tasks.end_leads()
            self._change_limits()

    def _change_limits(self) -> None:
        """Apply changed velocity limits or locks."""
        self._apply(self._settings)
        self._changes.announce(0)

    @property
    def _limits_with_locks(self) -> Array:
        """Return the velocity limits (n,), zero for locked joints [rad/s or m/s]."""
        if not self._locked:
            return self._velocity_limits
        names = np.array(self.robot.velocity_names)
        return np.where(np.isin(names, list(self._locked)), 0.0, self._velocity_limits)

    def _checked_posture(self, task: Task, posture: ArrayLike) -> Array:
        """Return positions (n,), NaN where the task cannot move a joint, or raise `GoalError`."""
        found, place = super()._checked_posture(task, posture), self.configuration()
        for index, name in enumerate(self.robot.joint_names):
            if name in self._locked:
                why = 'is locked'
            elif task.joint_mask is not None and not task.joint_mask[index]:
                why = f'task {task.name!r} must not move'
            else:
                continue
            if place is not None and abs(found[index] - place[0][index]) > ARRIVED:
                raise GoalError(f'the posture that leads to a goal moves {name}, which {why}')
            found[index] = np.nan
        return found
