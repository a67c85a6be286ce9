# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Bounds on the joint velocities in one cycle: what all limits of the joints allow together."""

from collections.abc import Mapping, Sequence
from functools import cached_property
import math
from typing import Protocol, TypeAlias

import numpy as np
from tp_controller.control.jerk_limit import JerkLimit
from tp_controller.control.joint_limits import (
    AccelerationLimit,
    JointLimit,
    JointMotion,
    LowerPositionLimit,
    PositionLimit,
    UpperPositionLimit,
    VelocityLimit,
)
from tp_controller.errors import SettingsError, unknown
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.resources import is_number
from tp_controller.solver.compiled import core, MOST
from tp_controller.solver.solution import Bounds

# Difference up to which a velocity counts as at its limit [rad/s or m/s].
SAME_VELOCITY = 1e-9
# Kind of limit: the share of its speed that the levels below the first one leave to a joint.
RESERVE = 'reserve'
# Limits of every robot; transient ones apply, in this order, to robots that have them.
LIMITS: tuple[type[JointLimit], ...] = (VelocityLimit, UpperPositionLimit, LowerPositionLimit,
                                        AccelerationLimit, JerkLimit)
# Least and largest velocities (n,) [rad/s or m/s].
Interval: TypeAlias = tuple[Array, Array]


class VelocityBounds(Bounds):
    """
    Bounds on the joint velocities in one cycle, and the limits that set them.

    Parameters
    ----------
    limits : VelocityLimits
    motion : JointMotion
    box : tuple of ndarray (n,)
        Least and largest velocities.
    cap, hold
        See `Bounds`.
    intervals : dict, optional
        {limit: least and largest velocities that it allows}; by default those at the motion.

    """

    def __init__(self, limits: 'VelocityLimits', motion: JointMotion, box: Interval,
                 cap: Array | None, hold: float,
                 intervals: dict[JointLimit, Interval] | None = None) -> None:
        self.lower, self.upper = box
        self.cap, self.hold = cap, hold
        self._limits, self._motion, self._given = limits, motion, intervals

    @cached_property
    def _intervals(self) -> dict[JointLimit, Interval]:
        """Return the least and largest velocities that each limit allows."""
        if self._given is not None:
            return self._given
        return {limit: limit.interval(self._motion) for limit in self._limits.all}

    @property
    def settled(self) -> 'VelocityBounds':
        """Return the bounds without transient limits, as reached in time."""
        # Without the intervals of the transient limits, as that of the jerk takes longest.
        given = self._given
        return self._with({limit: limit.interval(self._motion) if given is None else given[limit]
                           for limit in self._limits.all if not limit.transient}, self.cap)

    @property
    def follow_demand(self) -> bool:
        """Return whether the bounds depend on what the tasks demand."""
        return self._limits.follow_demand

    def towards(self, demand: Array, goes_on: bool = True) -> 'VelocityBounds':
        """
        Return the bounds for velocities that the tasks demand.

        Parameters
        ----------
        demand : ndarray (n,)
            Demanded velocities within `settled` bounds [rad/s or m/s].
        goes_on : bool
            Whether they go on from those of the cycle before.

        """
        motion = self._motion._replace(demand=demand)
        if not goes_on:
            motion = motion._replace(demanded=None)
        return VelocityBounds(self._limits, motion, self._limits.box(motion), self.cap, self.hold)

    @cached_property
    def standing(self) -> tuple[int, ...]:
        """Return the joints that stand, and stay: those with a velocity limit of zero."""
        return tuple([joint for joint in self._limits.zero
                      if self.lower[joint] == self.upper[joint] == 0.0])

    @property
    def last(self) -> Array:
        """Return the velocities (n,) of the last command."""
        return self._motion.velocity

    @property
    def stopping(self) -> tuple[Array, Array]:
        """Return the speeds (n,) from which joints can stop before upper and lower limits."""
        upper, lower = (np.maximum(limit.speed(self._motion), 0.0)
                        for limit in self._limits.all if isinstance(limit, PositionLimit))
        return upper, lower

    def limits(self, joint: int, up: bool, velocity: float | None = None) -> list[str]:
        """
        Return the names of the limits that stop a joint; mostly one.

        Parameters
        ----------
        joint : int
            Index of the joint.
        up : bool
            Whether they limit its velocity from above.
        velocity : float, optional
            Velocity at which they stop it [rad/s or m/s]; by default its bound.

        """
        bound = float((self.upper if up else self.lower)[joint])
        if velocity is not None and self.cap is not None and math.isfinite(self.cap[joint]) \
                and (bound - velocity if up else velocity - bound) > SAME_VELOCITY:
            # The reserve stops a joint before its own bound does.
            return [RESERVE]
        found, position = [], ''
        for limit, interval in self._intervals.items():
            if isinstance(limit, PositionLimit) and (limit.sign > 0.0) == up:
                position = limit.name
            # If all reachable velocities are too fast, the nearer end of them is the bound.
            ends = interval if limit.transient else interval[up:up + 1]
            if any(abs(float(end[joint]) - bound) <= SAME_VELOCITY for end in ends):
                found.append(limit.name)
        # Otherwise the bound is the speed of return from outside of the range.
        return found or [position]

    def without(self, joint: int, limits: Sequence[str]) -> 'VelocityBounds':
        """Return the bounds without some limits of a joint; a velocity limit includes its cap."""
        intervals, cap = dict(self._intervals), self.cap
        for limit in intervals:
            if limit.name in limits:
                least, most = (end.copy() for end in intervals[limit])
                least[joint], most[joint] = -np.inf, np.inf
                intervals[limit] = least, most
        if cap is not None and not {RESERVE, VelocityLimit.name}.isdisjoint(limits):
            cap = cap.copy()
            cap[joint] = np.inf
        return self._with(intervals, cap)

    def _with(self, intervals: dict[JointLimit, Interval], cap: Array | None) -> 'VelocityBounds':
        """Return the bounds with other intervals and another cap."""
        return VelocityBounds(self._limits, self._motion, bounded(intervals), cap, self.hold,
                              intervals)


def bounded(intervals: Mapping[JointLimit, Interval]) -> Interval:
    """
    Return the least and largest velocities (n,) that limits allow together.

    Limits that contradict each other are approached as fast as transient ones allow: these take
    precedence, the last one over all.

    Parameters
    ----------
    intervals : mapping
        {limit: least and largest velocities (n,)}, the transient limits last.

    """
    lasting = [its for limit, its in intervals.items() if not limit.transient]
    lower, upper = lasting[0]
    for least, most in lasting[1:]:
        lower, upper = np.maximum(lower, least), np.minimum(upper, most)
    if np.count_nonzero(upper < lower):
        # A joint must not return so fast that it cannot stop at the other end of its range.
        upper = np.maximum(upper, np.minimum(lower, 0.0))
        lower = np.minimum(lower, upper)
    for limit, (least, most) in intervals.items():
        if limit.transient:
            lower = np.minimum(np.maximum(lower, least), most)
            upper = np.minimum(np.maximum(upper, least), most)
    return lower, upper


def lowered(robot: Robot, limits: Array, changes: Mapping[str, float]) -> Array:
    """
    Return validated velocity limits (n,) with some of them changed.

    Parameters
    ----------
    robot : Robot
        Its own limits are the largest possible.
    limits : ndarray (n,)
        Limits before the change [rad/s or m/s].
    changes : mapping
        {velocity: limit}, of `Robot.velocity_names`.

    Raises
    ------
    SettingsError
        Lists all changes that are not possible.

    """
    if not isinstance(changes, Mapping):
        raise SettingsError(['velocity limits need a mapping such as {joint1: 1.0}, '
                             f'not {changes!r}'])
    faults, limits = [], limits.copy()
    for name, value in changes.items():
        if name not in robot.velocity_names:
            faults.append(unknown('velocity', name, robot.velocity_names))
            continue
        row = robot.velocity_names.index(name)
        largest = float(robot.velocity[row])
        if not is_number(value) or not 0.0 < value <= largest:
            faults.append(f'velocity limit of {name} must be above 0 and at most {largest:g} '
                          f'{robot.velocity_units[row]}/s, that of the robot, not {value!r}')
        else:
            limits[row] = value
    if faults:
        raise SettingsError(faults)
    return limits


class CompiledLimits(Protocol):
    """Compiled part of `VelocityLimits`."""

    def box(self, motion: JointMotion, lower: Array, upper: Array) -> None:
        """Fill in the result of `bounded` (n,)."""


class VelocityLimits:
    """
    Limits of the joints of a robot as one box of velocities.

    Parameters
    ----------
    robot : Robot
        Its limits apply.
    period : float
        T, the longest time between two commands [s].
    braking_gain : float
        g [1/s], at most 1/T.
    velocity : ndarray (n,), optional
        Velocity limits [rad/s or m/s]; those of the robot by default.
    cap : ndarray (n,), optional
        See `Bounds`.

    Attributes
    ----------
    all : list of JointLimit
        Limits in force, the transient ones last.
    follow_demand : bool
        Whether the bounds depend on what the tasks demand.
    response : float
        Largest `JointLimit.response` [s].
    cap : ndarray (n,) or None
        See `Bounds`.
    zero : list of int
        Indices of the joints whose velocity limit is zero.
    compiled : CompiledLimits or None
        The limits in the compiled core; None if it does not support them.

    """

    def __init__(self, robot: Robot, period: float, braking_gain: float,
                 velocity: Array | None = None, cap: Array | None = None) -> None:
        values = dict(robot.limits)
        if velocity is not None:
            values['velocity'] = velocity
        self.all = [limit(values, period, braking_gain) for limit in LIMITS
                    if not limit.transient or np.isfinite(values[limit.key]).any()]
        self.follow_demand = any(limit.follows_demand for limit in self.all)
        self.response = max(limit.response for limit in self.all)
        self.cap, self._size = cap, len(values['velocity'])
        self.zero: list[int] = np.flatnonzero(values['velocity'] == 0.0).tolist()
        self.compiled: CompiledLimits | None = None
        if core is not None and self._size <= MOST and all(limit.compiled for limit in self.all):
            self.compiled = core.Limits(period, braking_gain,
                                        {limit.key: values[limit.key] for limit in self.all})

    def at(self, motion: JointMotion, hold: float = 0.0) -> VelocityBounds:
        """
        Return the bounds on the joint velocities.

        If limits contradict each other, as after a disturbance, the limits of acceleration and
        jerk take precedence and the others are approached as fast as these allow. A joint outside
        its range has to move inwards at a bounded speed, and may move as fast as inside the range.

        Parameters
        ----------
        motion : JointMotion
            Motion of the joints in this cycle.
        hold : float
            See `Bounds`.

        """
        return self.bounds(motion, self.box(motion), hold)

    def bounds(self, motion: JointMotion, box: Interval, hold: float) -> VelocityBounds:
        """Return the result of `at` with the result of `box`."""
        return VelocityBounds(self, motion, box, self.cap, hold + self.response)

    def box(self, motion: JointMotion) -> Interval:
        """Return the least and largest velocities (n,)."""
        if self.compiled is None:
            return self.box_by_reference(motion)
        lower, upper = np.empty(self._size), np.empty(self._size)
        self.compiled.box(motion, lower, upper)
        return lower, upper

    def box_by_reference(self, motion: JointMotion) -> Interval:
        """Return the result of `box`, computed in Python: the reference of velocity_limits.h."""
        return bounded({limit: limit.interval(motion) for limit in self.all})
