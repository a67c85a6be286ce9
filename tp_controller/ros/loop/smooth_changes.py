# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes of the velocities behind commanded positions, within the jerk limits of the joints."""

from collections.abc import Mapping
import math

import numpy as np
from tp_controller.control.jerk_limit import ANY_JERK, boundary, JerkLimit, SHORTEST_TAIL
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.stopping import StopLaw
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.ramped_stop import LONGEST_RAMP

# Velocities count as the demanded ones within this [rad/s or m/s].
CAUGHT_UP = 1e-9


class SmoothChanges:
    """
    Velocities that change within the jerk limits of m joints; infinite ones have no effect.

    What the tasks demand keeps these limits, and passes as it is. Where something else slows the
    joints down, they follow what is left of the demand as a jerk limit follows a demand, until
    they have caught up with it.

    Parameters
    ----------
    limits : mapping
        {key: ndarray (m,)} for `lower`, `upper`, `velocity`, `acceleration` and `jerk`.
    fastest, free_lead : ndarray (m,)
        Lead within which no velocity up to these has to be lower [rad/s or m/s, rad or m].
    period, gain : float
        See `JerkLimit`.

    Attributes
    ----------
    largest_lead : ndarray (m,)
        Free lead, and the distance in which these can stop; infinite without a jerk limit.

    """

    def __init__(self, limits: Mapping[str, Array], fastest: Array, free_lead: Array,
                 period: float, gain: float) -> None:
        self._values, self._period, self._gain = limits, period, gain
        self._limited = np.isfinite(limits['jerk'])
        jerk = np.where(self._limited, limits['jerk'], ANY_JERK)
        self._law = StopLaw(jerk, limits['acceleration'], period,
                            max(1.0 / gain - period, SHORTEST_TAIL))
        # The farthest stop: from the largest acceleration that still ends at the largest velocity.
        rising = np.minimum(limits['acceleration'], np.sqrt(2.0 * jerk * fastest))
        stop = self._law.distance(fastest - 0.5 * rising * rising / jerk, rising)
        self.largest_lead = np.where(self._limited, free_lead + stop, math.inf)
        self._lead = self._lead_limit(limits)
        # The tasks brake for position limits, but with velocities that may not be in force.
        self._range = JerkLimit(limits, period, 1.0 / period)
        self.begin()

    def _lead_limit(self, limits: Mapping[str, Array]) -> JerkLimit:
        """Return the jerk limit of joints that must not come to the ends of their lead."""
        return JerkLimit({**limits, 'lower': -self.largest_lead, 'upper': self.largest_lead},
                         self._period, self._gain)

    def begin(self) -> None:
        """Begin from rest."""
        self._acceleration, self._before = np.zeros(len(self._limited)), math.inf
        self._in_step = True

    def speed(self, toward: Array, speed: Array) -> Array:
        """
        Return the speeds (m,) from which joints stop within their lead.

        Parameters
        ----------
        toward : ndarray (m,)
            Lead in the direction of motion [rad or m].
        speed : ndarray (m,)
            Largest speeds of interest [rad/s or m/s].

        """
        left = np.where(self._limited, self.largest_lead - toward, 0.0)
        found = boundary(lambda v: self._law.distance(v, np.zeros(len(v))) - left,
                         np.zeros(len(speed)), speed)
        return np.where(self._limited, found, math.inf)

    def follow(self, demand: Array, motion: JointMotion, ahead: Array, slowed: bool) -> Array:
        """
        Return the velocities (m,) that come as near to a demand as the jerk allows.

        Parameters
        ----------
        demand : ndarray (m,)
            [rad/s or m/s]
        motion : JointMotion
            Commanded positions, velocities in force, and the time since then.
        ahead : ndarray (m,)
            Lead of the commanded positions [rad or m].
        slowed : bool
            Whether the demand is not that of the tasks.

        """
        motion = motion._replace(acceleration=self._acceleration, before=self._before,
                                 demand=demand if slowed or not self._in_step else None)
        least, most = self._range.interval(motion)
        below, above = self._lead.interval(motion._replace(positions=ahead))
        found = np.minimum(np.maximum(demand, np.maximum(least, below)), np.minimum(most, above))
        caught_up = bool((np.abs(found - demand) <= CAUGHT_UP).all())
        self._in_step = caught_up and not slowed
        # Rounding errors would add up.
        return demand if caught_up else found

    def stop_limit(self, velocity: Array) -> JerkLimit:
        """Return the limit of a stop from velocities (m,), of at most `LONGEST_RAMP`."""
        # A quarter of the time to end the acceleration, three eighths for each half of the rest.
        rising = np.abs(self._acceleration)
        fastest, half = np.abs(velocity) + LONGEST_RAMP / 8.0 * rising, 0.375 * LONGEST_RAMP
        return self._lead_limit({
            **self._values,
            'acceleration': np.maximum(self._values['acceleration'], fastest / half),
            'jerk': np.maximum(self._values['jerk'], np.maximum(
                4.0 / LONGEST_RAMP * rising, fastest / half ** 2))})

    def brake(self, otherwise: Array, before: Array, limit: JerkLimit, interval: float) -> Array:
        """
        Return the velocities (m,) of joints that brake.

        Parameters
        ----------
        otherwise : ndarray (m,)
            Velocities of joints without a jerk limit [rad/s or m/s].
        before : ndarray (m,)
            Velocities in force [rad/s or m/s].
        limit : JerkLimit
            That of `stop_limit`.
        interval : float
            More than zero, at most a period [s].

        """
        rest = np.zeros(len(before))
        least, most = limit.interval(JointMotion(
            rest, before, interval, (), 0.0, self._acceleration, self._before, rest))
        self._in_step = False
        return np.where(self._limited, np.minimum(np.maximum(rest, least), most), otherwise)

    def note(self, velocity: Array, before: Array, interval: float) -> None:
        """Note velocities (m,) that replaced those before after an interval."""
        self._acceleration, self._before = (velocity - before) / interval, interval
