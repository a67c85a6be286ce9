# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Jerk limit: bounds on the second difference of the commands, with the look-ahead that they need.

Each command within these bounds has a successor within them, with the symbols of docs/limits.md.
Upwards, a command is allowed if some α in I = [a − j h/2, a + j h/2] satisfies D(v, α) ≤ d and v
+ max(α, 0)²/(2 j) ≤ q̇_max: these α are an interval without lower end, as D does not decrease
with α. Downwards, they are one without upper end. Of I count accelerations up to a_max; as b is
at most that, no condition changes.

1. They have a common α. Let v ≥ 0. Every α ≥ −√(2 j v) is allowed downwards, as the joint can
   reach a = 0 before it moves back. If any α is allowed upwards, so is −b(v) ≥ −√(2 j v). So the
   intervals of both directions meet, and each of them meets I; three intervals that meet in pairs
   have a common point. The same holds for v < 0, mirrored.
2. A smooth motion r goes on from (v, α), with a jerk of at most j and an acceleration of at most
   a_max, that both directions allow at each of its times. Let v ≥ 0. Above −b(v) it is the stop
   law: ∫ r dt decreases by the motion of the joint, nothing is added downwards, and the velocity
   limit is kept. Between −√(2 j v) and −b(v) it is the jerk +j until it meets −b: the joint slows
   down faster than the law demands. Below, it turns back in any case, and r is the mirrored stop
   law. For v < 0, mirrored.
3. The next command is v′ = r(h′), after any h′ ≤ T. Then a′ is the mean of the acceleration of r
   over h′. It differs from α by at most j h′/2, so from a by at most j (h + h′)/2; and r has an
   acceleration at h′ that differs from a′ by at most j h′/2: it is in the I of the next cycle.
4. The distance suffices. In h′ the command moves the joint by v h′, r by ∫ r dt. If r does not
   fall below v, v h′ ≤ ∫ r dt. Otherwise v h′ − ∫ r dt ≤ h′ (v − v′) ≤ T (max r before − max r
   after): the second term of D pays for it.
"""

from collections.abc import Callable, Mapping

import numpy as np
from tp_controller.control.joint_limits import (
    JointLimit,
    JointMotion,
    LowerPositionLimit,
    PositionLimit,
    UNLIMITED_ACCELERATION,
    UpperPositionLimit,
)
from tp_controller.control.stopping import StopLaw
from tp_controller.model.spatial import Array

# Steps of the regula falsi that finds the boundary of the accelerations from which a joint stops.
BOUNDARY_STEPS = 5
# Shortest time constant of the approach to a position limit [s].
SHORTEST_TAIL = 1e-9
# Replaces a missing jerk limit in formulas [rad/s³ or m/s³].
ANY_JERK = 1.0
# Share of the rate at which the demand falls that is expected to last; of the largest demand, by
# which joints may move against their own; and of the time to the largest acceleration, by which
# commands lag. With less of them, joints swing about goals out of reach (calm.py --jerk); with
# more, lower levels disturb upper ones, and goals take longer (jerk.py).
FALL, COMPENSATION, LAG = 0.5, 0.5, 0.03


class JerkLimit(JointLimit):
    """
    Limit of the absolute jerk.

    Let a be the change of the last command per time, made in the time h₀. A command after the
    time h changes it by at most j (h + h₀)/2: the second difference of the commands, between the
    middles of both times. In addition the joint has to be able to stop by `StopLaw` within its
    position limits, and to end its acceleration within its velocity limits. It also reaches the
    velocity that the tasks demand, which may fall, without overshoot, but for a part by which
    joints compensate what others miss.
    """

    name, key = 'jerk limit', 'jerk'
    sentence = '{} at its jerk limit'
    transient = compiled = follows_demand = True

    def __init__(self, limits: Mapping[str, Array], period: float, gain: float) -> None:
        super().__init__(limits, period, gain)
        self._limited = np.isfinite(self._values)
        self._jerk = np.where(self._limited, self._values, ANY_JERK)
        self._acceleration = np.minimum(limits['acceleration'], UNLIMITED_ACCELERATION)
        self._velocity = limits['velocity']
        # Zero where a speed is not limited; a joint that is locked demands nothing.
        self._speed = np.where(np.isfinite(self._velocity), self._velocity, 0.0)
        self._fastest = np.where(self._speed > 0.0, self._speed, np.inf)
        largest = np.minimum(self._acceleration, np.sqrt(self._jerk * self._velocity))
        known = self._limited & (largest < UNLIMITED_ACCELERATION)
        self.response = LAG * float((largest / self._jerk)[known].max(initial=0.0))
        self._upper = UpperPositionLimit(limits, period, gain)
        self._lower = LowerPositionLimit(limits, period, gain)

    def interval(self, motion: JointMotion) -> tuple[Array, Array]:
        """Return the velocities within the jerk from which a joint can keep all other limits."""
        h, last = min(motion.elapsed, self._period), motion.velocity
        least, most = self._reachable(motion, h)
        upper = np.minimum(self._stopping(self._upper, motion, h, least, most, last),
                           self._approach(self._velocity - last, h))
        lower = np.minimum(self._stopping(self._lower, motion, h, -most, -least, -last),
                           self._approach(self._velocity + last, h))
        upper, lower = (np.minimum(np.maximum(end, least), most) for end in (upper, -lower))
        # Rounding alone makes them cross.
        middle = 0.5 * (upper + lower)
        upper, lower = np.maximum(upper, middle), np.minimum(lower, middle)
        if motion.demand is not None:
            upper, lower = (np.minimum(np.maximum(end, lower), upper)
                            for end in self._following(motion.demand, motion, h))
        return (np.where(self._limited, last + h * lower, -np.inf),
                np.where(self._limited, last + h * upper, np.inf))

    def _reachable(self, motion: JointMotion, h: float) -> tuple[Array, Array]:
        """Return the least and largest accelerations (n,) in a cycle of time h [s]."""
        a = np.zeros(len(self._jerk)) if motion.acceleration is None else np.clip(
            motion.acceleration, -self._acceleration, self._acceleration)
        change = 0.5 * self._jerk * (h + min(motion.before, self._period))
        return (np.maximum(a - change, -self._acceleration),
                np.minimum(a + change, self._acceleration))

    def _following(self, demand: Array, motion: JointMotion, h: float) -> tuple[Array, Array]:
        """
        Return the largest and least accelerations (n,) that follow what the tasks demand.

        Parameters
        ----------
        demand : ndarray (n,)
            Demanded velocities [rad/s or m/s].
        motion : JointMotion
            Motion of the joints.
        h : float
            Time of the cycle [s].

        """
        last, free = motion.velocity, self._jerk * h
        rate = self._fall(demand, motion, h)
        wanted = rate + self._approach(demand - last - h * rate, h)
        # The other way: as much acceleration as one cycle takes back, up to a velocity in a share
        # of the largest demand, so that joints at rest come to rest.
        share = COMPENSATION * float((np.abs(demand) / self._fastest).max())
        more = 0.5 * free + share * self._speed / h
        up, down = (np.clip(gap / h + more, 0.0, free) for gap in (demand - last, last - demand))
        return np.maximum(wanted, rate + up), np.minimum(wanted, rate - down)

    def _fall(self, demand: Array, motion: JointMotion, h: float) -> Array:
        """Return the rates (n,) at which the demand is expected to fall as the joints move."""
        last = motion.velocity
        if motion.demanded is None:
            return np.zeros(len(last))
        rate = np.minimum(FALL * np.abs(demand - motion.demanded) / motion.elapsed,
                          np.minimum(self._acceleration, np.abs(last) / h))
        return np.where((demand - motion.demanded) * last < 0.0, -np.copysign(rate, last), 0.0)

    def _approach(self, gap: Array, h: float) -> Array:
        """
        Return the accelerations (n,) that end soonest, without overshoot, at other velocities.

        Parameters
        ----------
        gap : ndarray (n,)
            Differences of these velocities and the present ones [rad/s or m/s].
        h : float
            Time of the cycle [s].

        """
        size, step = np.abs(gap), self._jerk * h
        return np.copysign(np.where(size <= 0.5 * step * h, size / h,
                                    np.sqrt(2.0 * self._jerk * size) - 0.5 * step), gap)

    def _stopping(self, limit: PositionLimit, motion: JointMotion, h: float, least: Array,
                  most: Array, last: Array) -> Array:
        """
        Return the largest accelerations (n,) towards a limit from which joints can stop.

        Parameters
        ----------
        limit : PositionLimit
            One end of the range.
        motion : JointMotion
            Motion of the joints.
        h : float
            Time of the cycle [s].
        least, most : ndarray (n,)
            Reachable accelerations towards the limit [rad/s² or m/s²].
        last : ndarray (n,)
            Velocity towards the limit [rad/s or m/s].

        """
        tail = max(1.0 / limit.gain_of(motion) - self._period, SHORTEST_TAIL)
        law = StopLaw(self._jerk, self._acceleration, self._period, tail)
        # Outside of its range a joint only has to stop; the position limit returns it.
        distance = np.maximum(limit.remaining(motion), 0.0)

        def excess(a: Array) -> Array:
            # The jerk acts from the middle of the cycle on.
            return law.distance(last + h * a, a - 0.5 * self._jerk * h) - distance

        # A joint that does not go forwards, nor accelerates forwards, has stopped.
        stopped = np.minimum(-last / h, 0.5 * self._jerk * h)
        return boundary(excess, np.minimum(np.maximum(stopped, least), most), most)


def boundary(excess: Callable[[Array], Array], least: Array, most: Array) -> Array:
    """
    Return the largest numbers (n,) between others at which an increasing function is not positive.

    They come from a few steps of the Illinois method, and are never too large. If the function is
    positive everywhere, they are the least ones.
    """
    low, high = least, most
    f_low, f_high = excess(low), excess(high)
    found = np.where(f_high <= 0.0, high, low)
    open_ends = (f_low <= 0.0) & (f_high > 0.0)
    if not open_ends.any():
        return found
    f_low, f_high = np.where(open_ends, f_low, -1.0), np.where(open_ends, f_high, 1.0)
    side = np.zeros(len(low))
    for _ in range(BOUNDARY_STEPS):
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        f = excess(middle)
        fits = f <= 0.0
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        # The same end twice in a row: halve the other one.
        f_low, f_high = (np.where(fits, f, f_low * np.where(side < 0.0, 0.5, 1.0)),
                         np.where(fits, f_high * np.where(side > 0.0, 0.5, 1.0), f))
        side = np.where(fits, 1.0, -1.0)
    return np.where(open_ends, low, found)
