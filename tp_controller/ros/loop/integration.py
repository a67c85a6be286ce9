# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Integration of joint velocities to positions, within limits and with a bounded lead."""

from collections.abc import Mapping
import math
from typing import Any, NamedTuple

import numpy as np
from tp_controller.control.jerk_limit import JerkLimit
from tp_controller.control.joint_limits import (
    JointMotion,
    UNLIMITED_ACCELERATION,
    UpperPositionLimit,
)
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.ramped_stop import LONGEST_RAMP
from tp_controller.ros.loop.smooth_changes import SmoothChanges

# Lead of a joint at rest: noise, backlash, and the steady error of a drive [rad or m].
RESTING_LEAD = 0.02
# Largest speed towards the largest lead, per distance to it [1/s]; noise of 1 mrad then changes
# the speed by 0.02 rad/s.
LEAD_GAIN = 20.0
# Velocity limit, for the lead alone, of joints that have none [rad/s or m/s].
UNLIMITED_VELOCITY = 1.0
# Duration of a late cycle that is made up for [s].
LATE_SECONDS = 0.02


class Stop(NamedTuple):
    """
    Limits of a stop.

    Attributes
    ----------
    deceleration : ndarray (m,)
        [rad/s² or m/s²]
    jerk : JerkLimit or None
        Limit of the joints that have one.

    """

    deceleration: Array
    jerk: JerkLimit | None = None


class Integration:
    """
    Integration of velocities to commanded positions, for m joints.

    Positions lead the measured ones by at most `lead` seconds of motion at the velocity limit, the
    stopping distance from there, and `RESTING_LEAD`: a robot that is at most `lead` seconds late
    is never slowed down, and the positions stop in front of the bound if the robot is blocked. All
    joints are slowed down by the same factor, within their limits of acceleration and jerk:
    positions do not retreat from a robot that moves away from them.

    Parameters
    ----------
    limits : mapping
        {key: ndarray (m,)} for `lower`, `upper`, `velocity`, `acceleration` and `jerk`.
    period : float
        T, the nominal time between two commands [s].
    timeout : float
        Age of measured positions from which the robot is stopped [s].
    lead : float
        [s]

    Attributes
    ----------
    largest_lead : ndarray (m,)
        Largest distance of the commanded from the measured positions [rad or m].

    """

    def __init__(self, limits: Mapping[str, Array], period: float, timeout: float,
                 lead: float) -> None:
        self._lower, self._upper, self._period = limits['lower'], limits['upper'], period
        self._longest = min(max(2.0 * period, LATE_SECONDS), max(period, timeout))
        self._acceleration = np.minimum(limits['acceleration'], UNLIMITED_ACCELERATION)
        velocity = limits['velocity']
        velocity = np.where(np.isinf(velocity), UNLIMITED_VELOCITY, velocity)
        gain = min(LEAD_GAIN, 1.0 / period)
        self._braking = np.maximum(self._acceleration, velocity / LONGEST_RAMP)
        # Within this lead no velocity up to the limits has to be lower.
        self._velocity, self._free_lead = velocity, lead * velocity + RESTING_LEAD
        self.largest_lead = self._free_lead + stopping_distance(
            velocity, self._braking, period, gain)
        self._smooth: SmoothChanges | None = None
        if np.isfinite(limits['jerk']).any():
            self._smooth = SmoothChanges(
                {**limits, 'acceleration': self._braking}, velocity, self._free_lead, period, gain)
            self.largest_lead = np.where(
                np.isfinite(limits['jerk']), self._smooth.largest_lead, self.largest_lead)
        self._bound = UpperPositionLimit({
            'upper': self.largest_lead, 'velocity': velocity,
            'acceleration': self._braking}, period, gain)

    @classmethod
    def of(cls, robot: Robot, values: Mapping[str, Any]) -> 'Integration':
        """Return the integration for the driven joints of a robot and the node's parameters."""
        rows, rate, timeout = robot.joint_columns, values['rate'], values['state_timeout']
        limits = {key: getattr(robot, key)[rows]
                  for key in ('lower', 'upper', 'velocity', 'acceleration', 'jerk')}
        return cls(limits, 1.0 / rate if rate > 0.0 else timeout, timeout, values['lead'])

    def begin(self) -> None:
        """Begin a motion from rest."""
        if self._smooth is not None:
            self._smooth.begin()

    def interval(self, elapsed: float) -> float:
        """Return the time over which velocities count [s], of a time since the last command."""
        return min(max(elapsed, 0.0), self._longest)

    def advance(self, velocity: Array, before: Array, positions: Array, ahead: Array,
                interval: float) -> tuple[Array, Array]:
        """
        Return the velocities in force and the positions that they lead to.

        Parameters
        ----------
        velocity : ndarray (m,)
            Demanded velocities [rad/s or m/s].
        before : ndarray (m,)
            Velocities in force before [rad/s or m/s].
        positions : ndarray (m,)
            Commanded positions [rad or m].
        ahead : ndarray (m,)
            Their distances from the measured ones [rad or m].
        interval : float
            [s]

        Returns
        -------
        velocity, positions : ndarray (m,)

        """
        share, change = self._share(velocity, ahead, interval), min(interval, self._period)
        velocity = share * velocity
        if self._smooth is not None and change > 0.0:
            velocity = self._smooth.follow(
                velocity, JointMotion(positions, before, change), ahead, share < 1.0)
        faster, slower = change * self._acceleration, change * self._braking
        velocity = np.minimum(np.maximum(
            velocity, before - np.where(before > 0.0, slower, faster)),
            before + np.where(before < 0.0, slower, faster))
        return self._within(velocity, before, positions, interval)

    def _share(self, velocity: Array, ahead: Array, interval: float) -> float:
        """Return the share of velocities (m,) from which the lead stays within its bound."""
        speed = np.abs(velocity)
        if (np.abs(ahead) <= self._free_lead).all() and (speed <= self._velocity).all():
            return 1.0
        toward = np.where(velocity < 0.0, -ahead, ahead)
        allowed = np.maximum(self._bound.speed(JointMotion(toward, velocity, interval)), 0.0)
        if self._smooth is not None:
            allowed = np.minimum(allowed, self._smooth.speed(toward, speed))
        fast = speed > allowed
        return float((allowed[fast] / speed[fast]).min(initial=1.0))

    def stop(self, velocity: Array, otherwise: float) -> Stop:
        """
        Return the limits of a stop from velocities (m,).

        Parameters
        ----------
        velocity : ndarray (m,)
            [rad/s or m/s]
        otherwise : float
            Deceleration of joints without an acceleration limit; 0: they stop at once [rad/s² or
            m/s²].

        """
        limits = self._acceleration
        limits = np.where(limits >= UNLIMITED_ACCELERATION, otherwise or math.inf, limits)
        return Stop(np.maximum(limits, np.abs(velocity) / LONGEST_RAMP),
                    None if self._smooth is None else self._smooth.stop_limit(velocity))

    def brake(self, velocity: Array, positions: Array, stop: Stop,
              interval: float) -> tuple[Array, Array]:
        """
        Return the velocities and positions of joints that brake, after an interval.

        Parameters
        ----------
        velocity, positions : ndarray (m,)
            Before the interval [rad/s or m/s, rad or m].
        stop : Stop
            Its limits.
        interval : float
            [s]

        Returns
        -------
        velocity, positions : ndarray (m,)

        """
        lost = stop.deceleration * interval if interval else np.zeros(len(velocity))
        slower = np.sign(velocity) * np.maximum(np.abs(velocity) - lost, 0.0)
        if self._smooth is not None and stop.jerk is not None and interval > 0.0:
            slower = self._smooth.brake(slower, velocity, stop.jerk, min(interval, self._period))
        return self._within(slower, velocity, positions, interval)

    def _within(self, velocity: Array, before: Array, positions: Array,
                interval: float) -> tuple[Array, Array]:
        """Return velocities and positions (m,) after an interval, no farther outside limits."""
        free = positions + interval * velocity
        moved = np.minimum(np.maximum(free, np.minimum(self._lower, positions)),
                           np.maximum(self._upper, positions))
        if interval > 0.0:
            velocity = np.where(moved == free, velocity, (moved - positions) / interval)
            if self._smooth is not None:
                self._smooth.note(velocity, before, min(interval, self._period))
        return velocity, moved


def stopping_distance(velocity: Array, acceleration: Array, period: float, gain: float) -> Array:
    """
    Return the stopping distances (m,) from velocities (m,), as position limits have them.

    Parameters
    ----------
    velocity, acceleration : ndarray (m,)
        [rad/s or m/s, per s]
    period : float
        T, the time between two commands [s].
    gain : float
        g, the speed per distance near the end [1/s].

    """
    change = acceleration * period
    # Steps of a full change, until the speed is at most a/g.
    steps = np.ceil(np.maximum(velocity - acceleration / gain, 0.0) / change)
    return period * steps * (velocity - 0.5 * (steps - 1.0) * change) \
        + (velocity - steps * change) / gain
