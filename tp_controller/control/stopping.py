# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Stop of a joint with a bounded jerk, in closed form.

The stop law is one smooth motion from any velocity v and acceleration a: with the jerk −j to a
deceleration b, at b, and easing off. b is the acceleration limit, or the deceleration from which
the joint just comes to rest without moving backwards, `ease_off`, if that is less.
"""

from typing import NamedTuple

import numpy as np
from tp_controller.model.spatial import Array


class StopLaw(NamedTuple):
    """
    Stop law of joints.

    Easing off, the deceleration decreases with the jerk j; where the velocity is at most j τ², it
    is v/τ: an exponential approach to rest. With τ = 0 the jerk takes the joint to rest exactly.

    A command is in force for up to a period T (zero-order hold), while the velocity of the law
    decreases. It thus moves the joint farther than the law, by at most T times the decrease.

    Attributes
    ----------
    jerk, acceleration : ndarray (n,)
        j [rad/s³ or m/s³], and the largest deceleration [rad/s² or m/s²].
    period : float
        T, the longest time between two commands [s].
    tail : float
        τ [s].

    """

    jerk: Array
    acceleration: Array
    period: float
    tail: float

    def ease_off(self, velocity: Array) -> Array:
        """
        Return the largest decelerations (n,) from which joints come to rest.

        Zero if they do not move forwards.
        """
        jerk, tail = self.jerk, self.tail
        slow = jerk * tail * tail
        v = np.maximum(velocity, 0.0)
        fast = np.sqrt(np.maximum(jerk * (2.0 * v - slow), 0.0))
        return np.minimum(np.where(v <= slow, v / tail, fast), self.acceleration)

    def distance(self, velocity: Array, acceleration: Array) -> Array:
        """
        Return the distances (n,) that the commands of a stop move joints, to the farthest point.

        Parameters
        ----------
        velocity, acceleration : ndarray (n,)
            Velocity [rad/s or m/s] and acceleration [rad/s² or m/s²] at the first command. One
            below −`ease_off` counts as that: the joint stops sooner.

        """
        jerk, tail = self.jerk, self.tail
        a = np.maximum(acceleration, -self.ease_off(velocity))
        # Velocity at which the acceleration is zero, if it had been increased with this jerk.
        top = np.maximum(velocity + 0.5 * a * a / jerk, 0.0)
        slow = jerk * tail * tail
        reached = np.where(top >= 1.5 * slow,
                           np.sqrt(np.maximum(jerk * (top - 0.5 * slow), 0.0)),
                           2.0 * top / (np.sqrt(tail * tail + 2.0 * top / jerk) + tail))
        b = np.minimum(reached, self.acceleration)
        # Until the deceleration is b, at b, and from there to rest.
        t = np.maximum(a + b, 0.0) / jerk
        moved = t * (velocity + t * (0.5 * a - jerk * t / 6.0))
        full_from = top - 0.5 * b * b / jerk
        t = np.maximum(b / jerk - tail, 0.0)
        last = np.where(t > 0.0, 0.5 * (b * b / jerk + slow), b * tail)
        moved = moved + np.where(
            reached > b, 0.5 * (full_from * full_from - last * last) / self.acceleration, 0.0)
        eased = last - t * (b - 0.5 * jerk * t)
        moved = moved + t * (last - t * (0.5 * b - jerk * t / 6.0)) + eased * tail
        return moved + self.period * np.where(a > 0.0, top, velocity)
