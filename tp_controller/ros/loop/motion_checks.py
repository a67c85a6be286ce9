# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of a commanded robot: position limits, and motion that follows the commands."""

from collections.abc import Callable, Collection, Mapping
import math
from typing import Any

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.declarations.controller import LOCK
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
# Recent speed from which a joint that is at its position has moved there [rad/s or m/s].
MOVED_SPEED = 0.01
# Windows of `FollowCheck` after a lock in which a second joint that does not follow stops the
# robot: a driver that fails is noticed with one joint after the other, slow ones late.
SECOND_FAULT = 10.0


class MotionChecks:
    """
    Checks of the driven joints and of the base, from one start of the robot to the next.

    Parameters
    ----------
    robot : Robot
    base : MovingBase or FixedBase
    values : dict
        Parameters of the controller node.
    lock : callable
        Locks a joint, for a reason.

    Attributes
    ----------
    on_not_following : str
        ``lock``: a joint that alone does not follow is locked, unless another one was a moment
        ago; ``stop``: it is a fault.
    limits : LimitCheck
    ignored : ndarray (m,) of bool
        Driven joints that no check counts: they are locked.
    ignores : bool
        There are such joints.
    failing : str
        Joint, or axis of the base, that the last fault is about if it does not follow; else empty.
    follow : FollowCheck
        Check of the driven joints.
    lead : LeadCheck
        Check of their commanded positions, where positions are commanded.

    """

    def __init__(self, robot: Robot, base: MovingBase | FixedBase, values: Mapping[str, Any],
                 lock: Callable[[str, str], None]) -> None:
        rows = robot.joint_columns
        self.on_not_following, self._lock = values['on_not_following'], lock
        # Time of the last lock [s].
        self._window, self._locked_at = values['follow_window'], -math.inf
        self._base, self._names = base, robot.joint_names
        # Joints that are locked, as they were given last.
        self._locked: frozenset[str] = frozenset()
        self._given: Collection[str] = ()
        self.failing = ''
        self.ignored, self.ignores = np.zeros(len(robot.joint_names), dtype=bool), False
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

    def ignore(self, locked: Collection[str]) -> None:
        """Ignore the driven joints that are locked, a constant; checks of the others go on."""
        if locked is self._given:
            return
        self._given = locked
        if len(locked) == len(self._locked) and self._locked.issuperset(locked):
            return
        unlocked = not self._locked.issubset(locked)
        self._locked = frozenset(locked)
        self.ignored = np.array([name in self._locked for name in self._names], dtype=bool)
        self.ignores = bool(self.ignored.any())
        self.limits.ignore(self.ignored)
        self.follow.ignored = self.lead.ignored = self.ignored
        if unlocked:
            # A joint may have moved meanwhile, without a command.
            self.follow.forget()

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
        self.failing = ''
        fault = self.limits.passed(q) \
            or self._unless_locked(self.follow, self.follow.check(q, _carried_out(output), now),
                                   now) \
            or self._unless_locked(self.lead, self.lead.check(output, now), now)
        if fault:
            return fault
        fault = self._base.follows(velocity, now)
        self.failing = self._base.failing if fault else ''
        return fault

    def _unless_locked(self, check: 'FollowCheck | LeadCheck', fault: str, now: float) -> str:
        """Return the fault of a joint; empty if it is locked instead."""
        if not fault or self.on_not_following != LOCK or not check.failed \
                or now - self._locked_at < SECOND_FAULT * self._window:
            self.failing = check.joint if fault else ''
            return fault
        self._locked_at = now
        self._lock(check.failed, fault)
        return ''


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

    Attributes
    ----------
    ignored : ndarray (n,) of bool
        Joints that are not checked.
    joint : str
        Joint of the last fault.
    failed : str
        The same if all others, and one that moved, are at their positions; else empty.

    """

    def __init__(self, names: tuple[str, ...], following: Following) -> None:
        self._names, self._following = names, following
        self.ignored = np.zeros(len(names), dtype=bool)
        self.forget()

    def forget(self) -> None:
        """Restart the check."""
        self._since = np.full(len(self._names), math.inf)
        # Largest recent speeds [rad/s or m/s], fading, and their time [s].
        self._speeds, self._last = np.zeros(len(self._names)), math.inf
        self.joint = self.failed = ''

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
        self._since = np.where(self.ignored | (np.abs(ahead) < allowed), math.inf,
                               np.minimum(self._since, now))
        behind = now - self._since > window
        if not behind.any():
            return ''
        joint = int(np.argmax(behind))
        alone = np.count_nonzero(np.isfinite(self._since)) == 1 \
            and (np.delete(self._speeds, joint) > MOVED_SPEED).any()
        self.joint = self._names[joint]
        self.failed = self.joint if alone else ''
        return (f'{self.joint} does not follow: {abs(ahead[joint]):.2g} away from its '
                f'commanded position for {window:g} s')


def _carried_out(output: VelocityOutput) -> Array:
    """Return the velocities that the driven joints carry out (n,)."""
    return output.velocity if output.share == 1.0 else output.share * output.velocity
