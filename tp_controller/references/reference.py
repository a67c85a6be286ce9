# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reference of one task: chunks of a stream, joined to one motion without a jump."""

from collections.abc import Mapping
import math
from typing import NamedTuple

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.references.curve import (
    braked,
    bridged,
    Curve,
    hold,
    joined,
    quintic,
    through,
)
from tp_controller.references.forms import Form
from tp_controller.solver.compiled import core

# Least time in which a reference passes from one chunk to another, or comes to rest [s]: joints
# with acceleration limits need some tenths of a second to change their speed.
JOIN_TIME = 0.2
# Largest speed at which a difference between chunks fades out, where that takes longer than
# `JOIN_TIME` [m/s or rad/s].
JOIN_SPEED = 0.5
# Peak of the speed of a quintic from rest to rest, relative to its mean.
PEAK = 1.875
# Most pieces of a curve, and most values of a chunk.
MOST_PIECES, MOST_KNOTS = 20_000, 10_000


class Chunk(NamedTuple):
    """
    Values with times, as a curve.

    Attributes
    ----------
    curve : Curve
    start, end : float
        Times of the first and the last value [s].

    """

    curve: Curve
    start: float
    end: float


class Reference(NamedTuple):
    """
    Motion in force of one task.

    Attributes
    ----------
    form : Form
    curve : Curve
    begin : float
        Time at which the last chunk was accepted [s].
    start : float
        Start of that chunk [s]; -inf if there was none.
    rest : float
        Time from which a chunk need not wait: the end, or the start of braking [s].

    """

    form: Form
    curve: Curve
    begin: float
    start: float
    rest: float

    @classmethod
    def braking(cls, form: Form, state: Array, now: float) -> 'Reference':
        """Return the motion from a state (3, d) to rest."""
        curve = braked(state, now, JOIN_TIME) if state[1:].any() else hold(state[0], now)
        return cls(form, curve, now, -math.inf, now)

    def braked(self, now: float) -> 'Reference':
        """Return the motion that comes to rest from now on."""
        return self.braking(self.form, self.curve.state(now), now)

    def is_over(self, now: float) -> bool:
        """Return whether the motion holds its end."""
        return now >= self.curve.end

    def progress(self, now: float) -> float:
        """Return the share of the time since the last chunk that has passed, from 0 to 1."""
        duration = self.curve.end - self.begin
        return min(max((now - self.begin) / duration, 0.0), 1.0) if duration > 0.0 else 1.0

    def goal(self, now: float, ahead: float) -> tuple[Array, Array]:
        """
        Return the goal now, and its feed-forward velocity a little later.

        Parameters
        ----------
        now, ahead : float
            Time, and how much later [s]. Half a cycle later the velocity is the mean of those in
            the cycle.

        """
        form, curve, later = self.form, self.curve, now + ahead
        if core is not None:
            (piece, u), (next_piece, next_u) = curve.place(now), curve.place(later)
            goal, velocity = np.empty(form.shape), np.empty(form.size if form.units else 6)
            if core.moving_goal(curve.coefficients[piece], u, curve.coefficients[next_piece],
                                next_u, goal, velocity):
                return goal, velocity
        return goal_at(form, curve, now, later)

    def followed_by(self, chunk: Chunk, now: float) -> 'Reference':
        """
        Return the motion that passes to a chunk, without a jump.

        A chunk replaces the motion from its own start time on, or from now on if that is past. If
        the motion ends before, or the chunk is a single value, it is approached in the time left.

        Raises
        ------
        ValueError
            The chunk is over, or begins before one that runs, or there would be too many pieces.

        """
        if chunk.end < now:
            raise ValueError(f'it ended {now - chunk.end:.3g} s ago')
        if chunk.start < self.start <= now:
            raise ValueError(f'it begins {self.start - chunk.start:.3g} s before the one that '
                             'runs, which has overtaken it')
        old, new, first = self.curve.without_past(now), chunk.curve, chunk.start
        single = first == chunk.end
        begin = now if single else max(now, min(self.rest, first))
        bridges = first - begin >= JOIN_TIME
        if not bridges and single:
            new = hold(new.value(first), now)
        elif not bridges:
            begin = max(begin, first)
        old, new = self._matched(old, new, begin)
        if bridges:
            curve = bridged(old, new, begin)
        else:
            curve = joined(old, new, begin, self._join_time(old, new, begin))
        if len(curve.breaks) > MOST_PIECES:
            raise ValueError(f'more than {MOST_PIECES} values are waiting')
        return Reference(self.form, curve, now, first, curve.end)

    def _matched(self, old: Curve, new: Curve, begin: float) -> tuple[Curve, Curve]:
        """Return both curves with the quaternions and angles that are nearest to each other."""
        value = old.value(begin)
        factors = self.form.norms(value)
        return (old.changed(factors, np.zeros(self.form.size)),
                new.changed(*self.form.nearest(new.value(begin), factors * value)))

    def _join_time(self, old: Curve, new: Curve, begin: float) -> float:
        """Return the time in which the difference of two curves fades out [s]."""
        value = old.value(begin)
        gaps = self.form.sizes(value[np.newaxis], (new.value(begin) - value)[np.newaxis])
        return max(JOIN_TIME, PEAK * max(float(gap[0]) for gap in gaps.values()) / JOIN_SPEED)


def goal_at(form: Form, curve: Curve, now: float, later: float) -> tuple[Array, Array]:
    """Return the goal at a time, and its feed-forward velocity at another one [s]."""
    rate, value = curve.rate(later), curve.value(now)
    return form.goal(value), form.velocity(value if form.units else curve.value(later), rate)


def chunk_of(form: Form, times: Array, values: Array) -> Chunk:
    """Return the chunk of values (n, d) at increasing times (n,) [s]."""
    return Chunk(through(times, form.continuous(values)), float(times[0]), float(times[-1]))


def chunk_at_speed(form: Form, values: Array, speed: Mapping[str, float], now: float) -> Chunk:
    """
    Return the chunk that moves from rest through values (n, d), from now on.

    Parameters
    ----------
    form : Form
        Form of the values.
    values : ndarray (n, d)
        The first one is where the motion starts.
    speed : mapping
        {unit: largest speed} [m/s, rad/s].
    now : float
        [s]

    """
    values = form.continuous(values)
    lasts = np.max([found / speed[unit] for unit, found in form.distances(values).items()], axis=0)
    # A value that is repeated takes no time, but its own.
    lasts = np.maximum(lasts, max(1e-3 * float(lasts.sum()), 1e-6))
    # The first and the last part include starting and stopping.
    lasts[[0, -1]] *= 1.5
    times = now + np.concatenate(([0.0], np.cumsum(lasts)))
    if len(values) == 2:
        start, end = (np.stack((value, *np.zeros((2, form.size)))) for value in values)
        piece = quintic(start, end, float(times[1]) - now)
        curve = Curve([now], piece[np.newaxis]).followed_by(hold(values[1], float(times[1])))
    else:
        curve = through(times, values, at_rest=True)
    factor = max(largest / speed[unit] for unit, largest in peaks(form, curve).items())
    factor = max(factor, JOIN_TIME / (curve.end - now))
    curve = curve.stretched(factor)
    return Chunk(curve, now, curve.end)


def peaks(form: Form, curve: Curve) -> dict[str, float]:
    """Return the largest speed of a curve in each unit [m/s, rad/s]."""
    return {unit: float(found.max()) for unit, found in form.sizes(*curve.samples()).items()}
