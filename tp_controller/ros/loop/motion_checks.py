# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of a commanded robot: position limits, and motion that follows the commands."""

from collections.abc import Mapping
import math
from typing import Any

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.base_topics import FixedBase, MovingBase
from tp_controller.ros.loop.outputs import VelocityOutput
from tp_controller.ros.loop.state_checks import (
    endless_joints,
    FollowCheck,
    Following,
    LimitCheck,
)

# Lead, relative to the largest one, that counts as full: the approach to it is exponential.
FULL_LEAD = 0.95


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
    lead : LeadCheck
        Check of their commanded positions, where positions are commanded.

    """

    def __init__(self, robot: Robot, base: MovingBase | FixedBase,
                 values: Mapping[str, Any]) -> None:
        rows = robot.joint_columns
        self._base = base
        self.limits = LimitCheck(robot.joint_names, robot.lower[rows], robot.upper[rows],
                                 values['limit_tolerance'])
        following = Following(values['follow_window'], excess=values['jump_tolerance'])
        self.follow = FollowCheck(robot.joint_names, endless_joints(robot), following)
        self.lead = LeadCheck(robot.joint_names, following)

    def forget(self) -> None:
        """Restart the checks of motion: the next one begins from rest."""
        self.limits.forget()
        self.follow.forget()
        self.lead.forget()
        self._base.rest()

    def fault(self, q: Array, velocity: Array, output: VelocityOutput, now: float) -> str:
        """
        Return the fault of a robot that does not follow or passes a limit, if any.

        Parameters
        ----------
        q : ndarray (n,)
            Positions of the driven joints [rad or m].
        velocity : ndarray (n,)
            Command in force from now on, of base and joints [rad/s or m/s].
        output : VelocityOutput
            Output for the driven joints.
        now : float
            Time on the clock of the robot [s].

        """
        return self.limits.passed(q) \
            or self.follow.check(q, _carried_out(output), now) \
            or self.lead.check(output, now) \
            or self._base.follows(velocity, now)


class LeadCheck:
    """
    Check that measured positions come to the commanded ones, where positions are commanded.

    A joint may be away from them by the tolerance and, in motion, by the way of `lag` seconds at
    its largest recent speed, but not as far as the commanded positions may lead.

    Parameters
    ----------
    names : tuple of str
        Names of the driven joints.
    following : Following
        Time for which a joint may be farther away (`window`), `lag`, and tolerance (`excess`).

    """

    def __init__(self, names: tuple[str, ...], following: Following) -> None:
        self._names, self._following = names, following
        self.forget()

    def forget(self) -> None:
        """Restart the check."""
        self._since = np.full(len(self._names), math.inf)
        # Largest recent speeds [rad/s or m/s], fading, and their time [s].
        self._speeds, self._last = np.zeros(len(self._names)), math.inf

    def check(self, output: VelocityOutput, now: float) -> str:
        """
        Return the fault of the first joint that does not come to its positions, if any.

        Parameters
        ----------
        output : VelocityOutput
            Output for the driven joints.
        now : float
            [s]

        """
        window, ahead = self._following.window, output.ahead
        if ahead is None or not window:
            return ''
        faded = math.exp(-max(now - self._last, 0.0) / window)
        self._speeds, self._last = np.maximum(np.abs(output.velocity), faded * self._speeds), now
        allowed = np.minimum(FULL_LEAD * output.largest_lead,
                             self._following.excess + self._following.lag * self._speeds)
        self._since = np.where(np.abs(ahead) < allowed, math.inf, np.minimum(self._since, now))
        behind = now - self._since > window
        if not behind.any():
            return ''
        joint = int(np.argmax(behind))
        return (f'{self._names[joint]} does not follow: {abs(ahead[joint]):.2g} away from its '
                f'commanded position for {window:g} s')


def _carried_out(output: VelocityOutput) -> Array:
    """Return the velocities that the driven joints carry out (n,)."""
    return output.velocity if output.share == 1.0 else output.share * output.velocity
