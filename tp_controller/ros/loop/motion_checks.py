# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of a commanded robot: position limits, and motion that follows the commands."""

from collections.abc import Mapping
from typing import Any

from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.base_topics import FixedBase, MovingBase
from tp_controller.ros.loop.state_checks import (
    endless_joints,
    FollowCheck,
    Following,
    LimitCheck,
)


class MotionChecks:
    """
    Checks of the driven joints and of the base, from one start of the robot to the next.

    Parameters
    ----------
    robot : Robot
    base : MovingBase or FixedBase
    values : dict
        Parameters of the controller node.

    Attributes
    ----------
    limits : LimitCheck
    follow : FollowCheck
        Check of the driven joints.

    """

    def __init__(self, robot: Robot, base: MovingBase | FixedBase,
                 values: Mapping[str, Any]) -> None:
        rows = robot.joint_columns
        self._columns, self._base = rows, base
        self.limits = LimitCheck(robot.joint_names, robot.lower[rows], robot.upper[rows],
                                 values['limit_tolerance'])
        self.follow = FollowCheck(robot.joint_names, endless_joints(robot), Following(
            values['follow_window'], excess=values['jump_tolerance']))

    def forget(self) -> None:
        """Restart the checks of motion: the next one begins from rest."""
        self.limits.forget()
        self.follow.forget()
        self._base.rest()

    def fault(self, q: Array, velocity: Array, share: float, now: float) -> str:
        """
        Return the fault of a robot that does not follow or passes a limit, if any.

        Parameters
        ----------
        q : ndarray (n,)
            Positions of the driven joints [rad or m].
        velocity : ndarray (n,)
            Command in force from now on, of base and joints [rad/s or m/s].
        share : float
            Share of the command that the joints carry out [1].
        now : float
            Time on the clock of the robot [s].

        """
        return self.limits.passed(q) \
            or self.follow.check(q, self._carried_out(velocity, share), now) \
            or self._base.follows(velocity, now)

    def _carried_out(self, velocity: Array, share: float) -> Array:
        """Return the share of a command that the driven joints carry out (n,)."""
        driven = velocity[self._columns]
        return driven if share == 1.0 else share * driven
