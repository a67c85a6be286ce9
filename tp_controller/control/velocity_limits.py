# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Bounds on the joint velocities, from velocity, position and acceleration limits."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from tp_controller.errors import SettingsError, unknown
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.resources import is_number
from tp_controller.solver.compiled import core, MOST

# Speed at which a joint outside its range has to return: this share of its speed limit, at most
# RETURN_SPEED [rad/s or m/s]; tasks may demand more. (q_min − q) / period would be 10 rad/s for
# 10 mrad at 1 kHz.
RETURN_SHARE = 0.2
RETURN_SPEED = 1.0
# Distance beyond which position limits have no effect [rad or m].
LARGEST_DISTANCE = 1e6
# Replaces a missing acceleration limit if other joints have one [rad/s² or m/s²].
UNLIMITED_ACCELERATION = 1e12
# Difference up to which a velocity counts as at its limit [rad/s or m/s].
SAME_VELOCITY = 1e-9
# Kinds of limits of a joint.
VELOCITY, ACCELERATION = 'velocity limit', 'acceleration limit'
LOWER, UPPER = 'lower position limit', 'upper position limit'


class VelocityBounds:
    """
    Bounds on the joint velocities in one cycle.

    Parameters
    ----------
    rows : ndarray (8, n)
        As returned by `bounded`.
    velocity : ndarray (n,)
        Velocity limits [rad/s or m/s].
    accelerated : bool
        Whether there are acceleration limits.

    Attributes
    ----------
    lower, upper : ndarray (n,)
        [rad/s or m/s], lower ≤ upper.

    """

    __slots__ = ('lower', 'upper', '_rows', '_velocity', '_accelerated')

    def __init__(self, rows: Array, velocity: Array, accelerated: bool) -> None:
        self._rows, self._velocity, self._accelerated = rows, velocity, accelerated
        self.lower: Array = rows[0]
        self.upper: Array = rows[1]

    @property
    def settled(self) -> tuple[Array, Array]:
        """Return lower and upper bounds (n,) without acceleration limits, as reached in time."""
        return self._rows[2], self._rows[3]

    @property
    def stopping(self) -> Array:
        """Return the speeds (2, n) from which joints can stop before their position limits."""
        return np.maximum(self._braking, 0.0)

    @property
    def _braking(self) -> Array:
        """Return `braking` of `bounded` (2, n)."""
        return self._rows[4:6]

    @property
    def _window(self) -> Array | None:
        """Return `window` of `bounded` (2, n)."""
        return self._rows[6:] if self._accelerated else None

    def limits(self, joint: int, up: bool) -> list[str]:
        """Return the limits that set the upper, or lower, bound of a joint; mostly one."""
        bound = float(self.upper[joint] if up else -self.lower[joint])
        position = UPPER if up else LOWER
        speeds = [(VELOCITY, self._velocity[joint]),
                  (position, self._braking[0 if up else 1, joint])]
        if self._window is not None:
            # If all reachable velocities are too fast, the nearer end of the window is the bound.
            speeds += [(ACCELERATION, end if up else -end) for end in self._window[:, joint]]
        found = {limit: True for limit, speed in speeds
                 if abs(float(speed) - bound) <= SAME_VELOCITY}
        # Otherwise the bound is the speed of return from outside of the range.
        return list(found) or [position]

    def without(self, joint: int, limits: Sequence[str]) -> 'VelocityBounds':
        """Return the bounds without some limits of a joint."""
        found = VelocityBounds(self._rows.copy(), self._velocity.copy(), self._accelerated)
        braking, velocity, window = found._braking, found._velocity, found._window
        if VELOCITY in limits:
            velocity[joint] = np.inf
        for side, limit in enumerate((UPPER, LOWER)):
            if limit in limits:
                braking[side, joint] = np.inf
        if ACCELERATION in limits and window is not None:
            window[:, joint] = -np.inf, np.inf
        return VelocityBounds(bounded(braking, velocity, window), velocity, self._accelerated)


def bounded(braking: Array, velocity: Array, window: Array | None) -> Array:
    """
    Return the bounds on the joint velocities, with the limits that they follow from.

    Parameters
    ----------
    braking : ndarray (2, n)
        Speeds from which joints can still stop before their upper and lower position limits;
        negative outside of them [rad/s or m/s].
    velocity : ndarray (n,)
        Velocity limits [rad/s or m/s].
    window : ndarray (2, n) or None
        Least and largest velocity that the joints can reach now within acceleration limits.

    Returns
    -------
    ndarray (8, n)
        Least and largest velocity, the same without acceleration limits, `braking`, `window`.

    """
    speed = np.minimum(braking, velocity)
    upper, lower = speed[0], -speed[1]
    if np.count_nonzero(upper < lower):
        # A joint must not return so fast that it cannot stop at the other end of its range.
        upper = np.maximum(upper, np.minimum(lower, 0.0))
        lower = np.minimum(lower, upper)
    if window is None:
        return np.array((lower, upper, lower, upper, *braking, *braking))
    # Clamp to the reachable velocities, even if all of them are too fast.
    least, most = window
    return np.array((np.minimum(np.maximum(lower, least), most),
                     np.minimum(np.maximum(upper, least), most), lower, upper, *braking, *window))


def calm_gain(delay: int) -> float:
    """Return the largest K for which x[k+1] = x[k] − K x[k−delay] does not oscillate [1]."""
    return float(delay ** delay / (delay + 1.0) ** (delay + 1))


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


class Limits(Protocol):
    """Compiled part of `VelocityLimits`."""

    def at(self, q: Array, previous: Array, elapsed: float, pending: Array, duration: float,
           rows: Array) -> None:
        """Fill `rows` (8, n) with the result of `bounded`."""


class VelocityLimits:
    """
    Velocity, position and acceleration limits of a robot as one box of joint velocities.

    The allowed speed towards a position limit decreases with the distance d to it: v = g d near
    the limit, and farther away as fast as the acceleration limit a allows. With a zero-order hold
    of at most a period T the stopping distance from the speed v is::

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

    """

    def __init__(self, robot: Robot, period: float, braking_gain: float,
                 velocity: Array | None = None) -> None:
        self._lower, self._upper = robot.lower, robot.upper
        self._velocity = robot.velocity if velocity is None else velocity
        self._endless = bool((self._upper - self._lower > LARGEST_DISTANCE).any())
        self._period, self._gain = period, braking_gain
        self._return_speed = np.minimum(RETURN_SHARE * self._velocity, RETURN_SPEED)
        self._acceleration: Array | None = None
        if np.isfinite(robot.acceleration).any():
            self._acceleration = np.minimum(robot.acceleration, UNLIMITED_ACCELERATION)
        self._no_commands = np.empty((0, robot.velocity.size))
        self._compiled: Limits | None = None
        if core is not None and len(self._lower) <= MOST:
            self._compiled = core.Limits(period, braking_gain, self._endless, self._lower,
                                         self._upper, self._velocity, self._acceleration)

    def at(self, q: Array, previous: Array, elapsed: float, pending: Array | None = None,
           duration: float = 0.0) -> VelocityBounds:
        """
        Return the bounds on the joint velocities at `q`.

        If limits contradict each other, as after a disturbance, the acceleration limit takes
        precedence and the others are approached as fast as it allows. A joint outside its range
        has to move inwards at a bounded speed, and may move as fast as inside the range.

        Parameters
        ----------
        q : ndarray (n,)
            Positions [rad or m], as `RobotState.positions`.
        previous : ndarray (n,)
            Previously commanded velocities [rad/s or m/s].
        elapsed : float
            Time since then, more than zero [s].
        pending : ndarray (delay, n), optional
            Commanded velocities that `q` does not reflect yet [rad/s or m/s]; none by default.
        duration : float
            Longest time that each of them is in force [s].

        Returns
        -------
        VelocityBounds

        """
        accelerated = self._acceleration is not None
        pending = self._no_commands if pending is None else pending
        if self._compiled is None:
            return VelocityBounds(self._rows(q, previous, elapsed, pending, duration),
                                  self._velocity, accelerated)
        rows = np.empty((8, len(q)))
        self._compiled.at(q, previous, elapsed, pending, duration, rows)
        return VelocityBounds(rows, self._velocity, accelerated)

    def _rows(self, q: Array, previous: Array, elapsed: float, pending: Array,
              duration: float) -> Array:
        """Return the result of `bounded` at `q`: the reference of velocity_limits.h."""
        distance = np.array((self._upper - q, q - self._lower))
        if self._endless:
            distance = np.minimum(distance, LARGEST_DISTANCE)
        gain = self._gain
        if len(pending):
            gain = min(gain, calm_gain(len(pending)) / duration)
            up, down = (duration * np.maximum(side, 0.0).sum(axis=0)
                        for side in (pending, -pending))
            distance = np.maximum(distance - (up, down), np.minimum(distance + (down, up), 0.0))
        braking = np.maximum(self._braking_speed(distance, gain), -self._return_speed)
        if self._acceleration is None:
            return bounded(braking, self._velocity, None)
        change = self._acceleration * min(elapsed, self._period)
        return bounded(braking, self._velocity, np.array((previous - change, previous + change)))

    def _braking_speed(self, distance: Array, gain: float) -> Array:
        """Return the speed from which a joint can still stop within `distance` (2, n)."""
        if self._acceleration is None:
            return gain * distance
        # D(v) = v/g up to `slow`; above it, one more piece for each step of `change`.
        change, slow = self._acceleration * self._period, self._acceleration / gain ** 2
        beyond = np.maximum(distance - slow, 0.0) / (change * self._period)
        pieces = 1.0 + 2.0 / (gain * self._period)
        steps = np.ceil(0.5 * (np.sqrt(pieces * pieces + 8.0 * beyond) - pieces))
        return (distance + steps * change * (0.5 * (steps - 1.0) * self._period + 1.0 / gain)) \
            / (steps * self._period + 1.0 / gain)
