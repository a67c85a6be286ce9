# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Limits of the joints: each an interval of velocities in a cycle, with its name and its reason.

A new limit is one class, listed in `tp_controller.control.velocity_limits.LIMITS`, and its key in
`tp_controller.model.limits`. Its formula may have a compiled twin in joint_limits.h; while a limit
in force has none, the bounds are computed in Python.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import reduce
import math
from operator import add
from typing import ClassVar, NamedTuple

import numpy as np
from tp_controller.model.spatial import Array

# Speed at which a joint outside its range has to return: this share of its speed limit, at most
# RETURN_SPEED [rad/s or m/s]; tasks may demand more. (q_min − q) / period would be 10 rad/s for
# 10 mrad at 1 kHz.
RETURN_SHARE = 0.2
RETURN_SPEED = 1.0
# Distance beyond which position limits have no effect [rad or m].
LARGEST_DISTANCE = 1e6
# Replaces a missing acceleration limit if other joints have one [rad/s² or m/s²].
UNLIMITED_ACCELERATION = 1e12


class JointMotion(NamedTuple):
    """
    Motion of the joints, as their limits see it in a cycle.

    Attributes
    ----------
    positions : ndarray (n,)
        Positions [rad or m], as `RobotState.positions`.
    velocity : ndarray (n,)
        Last command [rad/s or m/s].
    elapsed : float
        Time since then, more than zero [s].
    pending : tuple of ndarray (n,)
        Commands that the positions do not reflect yet [rad/s or m/s]; none by default.
    duration : float
        Longest time that each of them is in force [s].
    acceleration : ndarray (n,) or None
        Change of the last command per time [rad/s² or m/s²]; None: zeros.
    before : float
        Time of that change, at most a period; by default a period [s].
    demand : ndarray (n,) or None
        Velocities that the tasks demand within all limits that are not transient [rad/s or m/s];
        None if unknown.
    demanded : ndarray (n,) or None
        The same of the cycle before; None if unknown, or if what the tasks demand does not go on
        from there.

    """

    positions: Array
    velocity: Array
    elapsed: float
    pending: tuple[Array, ...] = ()
    duration: float = 0.0
    acceleration: Array | None = None
    before: float = math.inf
    demand: Array | None = None
    demanded: Array | None = None


class JointLimit(ABC):
    """
    One kind of limit, of all joints.

    Parameters
    ----------
    limits : mapping
        {key: ndarray (n,)}, for each key of `tp_controller.model.limits.LIMIT_UNITS`.
    period : float
        T, the longest time between two commands [s].
    gain : float
        g, the allowed speed per distance to a position limit, at most 1/T [1/s].

    Attributes
    ----------
    name : str
        Kind of the limit, as `Cause.kind`.
    key : str
        Key of its values, and of their unit, among the limits of a robot.
    sentence, hint : str
        Reason why it limits the command, and suggested change: {} is the joint, {name} one or
        more joints, and {s} the plural. One that is transient has no hint.
    transient : bool
        Whether it limits the change of the velocity: it excludes velocities from this cycle only.
        Such a limit takes precedence over the others.
    caused_by_gain : bool
        Whether a gain that is too high for the period leads to it.
    follows_demand : bool
        Whether it needs `JointMotion.demand`.
    response : float
        Time by which commands lag behind what the tasks demand, as longer cycles would [s].
    compiled : bool
        Whether joint_limits.h has its formula, too.

    """

    name: ClassVar[str]
    key: ClassVar[str]
    sentence: ClassVar[str]
    hint: ClassVar[str] = ''
    transient: ClassVar[bool] = False
    caused_by_gain: ClassVar[bool] = True
    follows_demand: ClassVar[bool] = False
    response = 0.0
    compiled: ClassVar[bool] = False

    def __init__(self, limits: Mapping[str, Array], period: float, gain: float) -> None:
        self._values, self._period, self._gain = limits[self.key], period, gain

    @abstractmethod
    def interval(self, motion: JointMotion) -> tuple[Array, Array]:
        """Return the least and the largest velocities (n,) that it allows [rad/s or m/s]."""


class VelocityLimit(JointLimit):
    """Limit of the absolute velocity (lecture 4)."""

    name, key = 'velocity limit', 'velocity'
    sentence = '{} at its velocity limit'
    hint = 'raise the velocity limit{s} of {name}'
    compiled = True

    def interval(self, motion: JointMotion) -> tuple[Array, Array]:
        """Return −v and v."""
        return -self._values, self._values


class PositionLimit(JointLimit):
    """
    One end of the range of the joints.

    The allowed speed towards it decreases with the distance d to it: v = g d near the limit, and
    farther away as fast as the acceleration limit a allows. With a zero-order hold of at most a
    period T the stopping distance from the speed v is::

        D(v) = v / g                          for v ≤ a / g
        D(v) = v T + D(v − a T)               above

    D is convex and piecewise linear, and the speed allowed at d is its inverse. With g = 1/T it is
    the exact discrete stopping distance. Each state within these bounds has a successor within
    them.

    Pending commands move the joint by −D⁻ to D⁺ before the next one acts: each acts between zero
    and the longest time that a command is in force. The distance thus lies between d − D⁺ and
    d + D⁻, and the value nearest to zero counts: the worst case towards the limit, while a joint
    returns only if it is outside in any case. With d pending commands the gain is at most
    `calm_gain` (d) / T; otherwise the robot would stop and go if they act sooner than that.
    """

    # Direction of velocities towards the limit.
    sign: ClassVar[float]
    caused_by_gain = False
    compiled = True

    def __init__(self, limits: Mapping[str, Array], period: float, gain: float) -> None:
        super().__init__(limits, period, gain)
        self._unlimited = np.full(len(self._values), self.sign * -np.inf)
        # The slowest return from outside is the least speed.
        self._least = -np.minimum(RETURN_SHARE * limits['velocity'], RETURN_SPEED)
        self._acceleration: Array | None = None
        if np.isfinite(limits['acceleration']).any():
            self._acceleration = np.minimum(limits['acceleration'], UNLIMITED_ACCELERATION)
            self._change = self._acceleration * period

    @abstractmethod
    def distance(self, positions: Array) -> Array:
        """Return the distances (n,) to the limit, negative outside [rad or m]."""

    def speed(self, motion: JointMotion) -> Array:
        """
        Return the speeds (n,) from which joints can stop before the limit [rad/s or m/s].

        Negative outside: the joint has to return, at a bounded speed.
        """
        return np.maximum(self._braking_speed(self.remaining(motion), self.gain_of(motion)),
                          self._least)

    def gain_of(self, motion: JointMotion) -> float:
        """Return the gain at which pending commands do not make a joint stop and go [1/s]."""
        pending = motion.pending
        return min(self._gain, calm_gain(len(pending)) / motion.duration) if pending \
            else self._gain

    def remaining(self, motion: JointMotion) -> Array:
        """Return the distances (n,) nearest to zero that pending commands may leave."""
        distance, pending = np.minimum(self.distance(motion.positions), LARGEST_DISTANCE), \
            motion.pending
        if pending:
            up = motion.duration * reduce(add, [np.maximum(each, 0.0) for each in pending])
            down = motion.duration * reduce(add, [np.minimum(each, 0.0) for each in pending])
            nearer, farther = (up, down) if self.sign > 0.0 else (-down, -up)
            distance = np.maximum(distance - nearer, np.minimum(distance - farther, 0.0))
        return distance

    def _braking_speed(self, distance: Array, gain: float) -> Array:
        """Return the speed from which a joint can still stop within `distance` (n,)."""
        if self._acceleration is None:
            return gain * distance
        # D(v) = v/g up to `slow`; above it, one more piece for each step of `change`.
        change, slow = self._change, self._acceleration / gain ** 2
        beyond = np.maximum(distance - slow, 0.0) / (change * self._period)
        pieces = 1.0 + 2.0 / (gain * self._period)
        steps = np.ceil(0.5 * (np.sqrt(pieces * pieces + 8.0 * beyond) - pieces))
        return (distance + steps * change * (0.5 * (steps - 1.0) * self._period + 1.0 / gain)) \
            / (steps * self._period + 1.0 / gain)


class UpperPositionLimit(PositionLimit):
    """Upper end of the range of the joints."""

    name, key, sign = 'upper position limit', 'upper', 1.0
    sentence = '{} at its upper position limit'
    hint = ('choose a goal farther from the upper position limit{s} of '
            '{name}')

    def distance(self, positions: Array) -> Array:
        """Return the distances (n,) to the limit, negative outside [rad or m]."""
        return self._values - positions

    def interval(self, motion: JointMotion) -> tuple[Array, Array]:
        """Return −∞ and the speed from which a joint can stop before the limit."""
        return self._unlimited, self.speed(motion)


class LowerPositionLimit(PositionLimit):
    """Lower end of the range of the joints."""

    name, key, sign = 'lower position limit', 'lower', -1.0
    sentence = '{} at its lower position limit'
    hint = ('choose a goal farther from the lower position limit{s} of '
            '{name}')

    def distance(self, positions: Array) -> Array:
        """Return the distances (n,) to the limit, negative outside [rad or m]."""
        return positions - self._values

    def interval(self, motion: JointMotion) -> tuple[Array, Array]:
        """Return minus the speed from which a joint can stop before the limit, and ∞."""
        return -self.speed(motion), self._unlimited


class AccelerationLimit(JointLimit):
    """Limit of the absolute acceleration."""

    name, key = 'acceleration limit', 'acceleration'
    sentence = '{} at its acceleration limit'
    transient = compiled = True

    def __init__(self, limits: Mapping[str, Array], period: float, gain: float) -> None:
        super().__init__(limits, period, gain)
        self._values = np.minimum(self._values, UNLIMITED_ACCELERATION)

    def interval(self, motion: JointMotion) -> tuple[Array, Array]:
        """Return the velocities that can be reached since the last command."""
        change = self._values * min(motion.elapsed, self._period)
        return motion.velocity - change, motion.velocity + change


def calm_gain(delay: int) -> float:
    """Return the largest K for which x[k+1] = x[k] − K x[k−delay] does not oscillate [1]."""
    return float(delay ** delay / (delay + 1.0) ** (delay + 1))
