# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Piecewise polynomials of degree five over time, prepared so that a cycle only evaluates them."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from math import comb

import numpy as np
from scipy.interpolate import CubicSpline
from tp_controller.model.spatial import Array, read_only

DEGREE = 5
# Places in each piece where a curve is sampled.
PIECE_SAMPLES = 16
# Factors of the re-expansion of a polynomial about another time, by power before and after.
BINOMIALS = np.array([[float(comb(power, other)) for power in range(DEGREE + 1)]
                      for other in range(DEGREE + 1)])
RAISED = np.array([[max(power - other, 0) for power in range(DEGREE + 1)]
                   for other in range(DEGREE + 1)])
# Coefficients 3 to 5 of a quintic of unit duration that ends at (value, rate, acceleration); the
# inverse of the values, rates and accelerations of u³, u⁴ and u⁵ at its end.
END = np.linalg.inv([[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]])


class Curve:
    """
    Curve in R^d, constant after its end.

    Parameters
    ----------
    breaks : sequence of float
        Start of each piece, increasing [s]; the last piece goes on for ever.
    coefficients : ndarray (k, 6, d)
        Polynomials in the time since the start of each piece, the lowest power first.

    Attributes
    ----------
    breaks : list of float
    coefficients : ndarray (k, 6, d)
        Read-only.

    """

    def __init__(self, breaks: Sequence[float], coefficients: Array) -> None:
        self.breaks, self.coefficients = list(breaks), read_only(coefficients)

    @property
    def end(self) -> float:
        """Return the time from which the curve is constant [s]."""
        return self.breaks[-1]

    def value(self, time: float) -> Array:
        """Return the point of the curve (d,); before the first piece the first one."""
        piece, u = self.place(time)
        u2 = u * u
        found: Array = np.array([1.0, u, u2, u2 * u, u2 * u2, u2 * u2 * u]).dot(
            self.coefficients[piece])
        return found

    def rate(self, time: float) -> Array:
        """Return the velocity (d,) [1/s]."""
        piece, u = self.place(time)
        u2 = u * u
        found: Array = np.array([1.0, 2.0 * u, 3.0 * u2, 4.0 * u2 * u, 5.0 * u2 * u2]).dot(
            self.coefficients[piece, 1:])
        return found

    def state(self, time: float) -> Array:
        """Return value, velocity and acceleration (3, d)."""
        piece, u = self.place(time)
        moved = _about(self.coefficients[piece], u)[:3]
        moved[2] *= 2.0
        return moved

    def samples(self) -> tuple[Array, Array]:
        """Return values and velocities (k, d) at equal steps of each piece, and at the end."""
        durations = np.diff(self.breaks)[:, np.newaxis, np.newaxis]
        powers = np.arange(DEGREE + 1.0)
        scaled = self.coefficients[:-1] * durations ** powers[:, np.newaxis]
        shares = (np.arange(PIECE_SAMPLES) / PIECE_SAMPLES)[:, np.newaxis]
        values = shares ** powers @ scaled
        rates = powers[1:] * shares ** powers[:-1] @ scaled[:, 1:] / durations
        end, d = self.coefficients[-1, :1], self.coefficients.shape[2]
        return (np.concatenate((values.reshape(-1, d), end)),
                np.concatenate((rates.reshape(-1, d), np.zeros_like(end))))

    def since(self, time: float) -> 'Curve':
        """Return the curve from a time on, where a piece begins."""
        piece, u = self.place(time)
        coefficients = self.coefficients[piece:].copy()
        coefficients[0] = _about(coefficients[0], u)
        return Curve([time, *self.breaks[piece + 1:]], coefficients)

    def without_past(self, time: float) -> 'Curve':
        """Return the pieces that are in force at a time or later."""
        piece, _ = self.place(time)
        return Curve(self.breaks[piece:], self.coefficients[piece:]) if piece else self

    def followed_by(self, other: 'Curve') -> 'Curve':
        """Return this curve until another one begins, then that one."""
        count = bisect_left(self.breaks, other.breaks[0])
        return Curve([*self.breaks[:count], *other.breaks],
                     np.concatenate((self.coefficients[:count], other.coefficients)))

    def stretched(self, factor: float) -> 'Curve':
        """Return the same path in another time, counted from the first piece."""
        begin = self.breaks[0]
        return Curve([begin + factor * (time - begin) for time in self.breaks],
                     self.coefficients * factor ** -np.arange(DEGREE + 1.0)[:, np.newaxis])

    def changed(self, factors: Array, shift: Array) -> 'Curve':
        """Return the curve with each component (d,) multiplied, and shifted."""
        coefficients = self.coefficients * factors
        coefficients[:, 0] += shift
        return Curve(self.breaks, coefficients)

    def place(self, time: float) -> tuple[int, float]:
        """Return the piece in force, and the time since its start [s]."""
        piece = bisect_right(self.breaks, time) - 1
        return (piece, time - self.breaks[piece]) if piece >= 0 else (0, 0.0)


def hold(value: Array, begin: float) -> Curve:
    """Return a constant (d,) from a time on."""
    coefficients = np.zeros((1, DEGREE + 1, len(value)))
    coefficients[0, 0] = value
    return Curve([begin], coefficients)


def through(times: Array, values: Array, at_rest: bool = False) -> Curve:
    """
    Return the cubic spline through values that comes to rest at the last one.

    Velocity and acceleration are continuous.

    Parameters
    ----------
    times : ndarray (n,)
        Increasing [s].
    values : ndarray (n, d)
        Values at these times.
    at_rest : bool
        It also begins at rest; otherwise its velocity there is that of the values.

    """
    if len(times) == 1:
        return hold(values[0], float(times[0]))
    start = (1, np.zeros(values.shape[1])) if at_rest else 'not-a-knot'
    # Times on a clock that counts from long ago lose digits in powers.
    spline = CubicSpline(times - times[0], values, axis=0,
                         bc_type=(start, (1, np.zeros(values.shape[1]))))
    coefficients = np.zeros((len(times), DEGREE + 1, values.shape[1]))
    coefficients[:-1, :4] = np.swapaxes(spline.c[::-1], 0, 1)
    coefficients[-1, 0] = values[-1]
    return Curve(times.tolist(), coefficients)


def quintic(start: Array, end: Array, duration: float) -> Array:
    """
    Return the coefficients (6, d) from one state to another.

    From rest to rest it is the curve of least jerk along a straight line.

    Parameters
    ----------
    start, end : ndarray (3, d)
        Value, velocity and acceleration.
    duration : float
        [s]

    """
    powers = duration ** np.arange(DEGREE + 1.0)[:, np.newaxis]
    first = start * powers[:3] / np.array([[1.0], [1.0], [2.0]])
    a, b, c = first
    left = end * powers[:3] - np.array([a + b + c, b + 2.0 * c, 2.0 * c])
    found: Array = np.concatenate((first, END.dot(left))) / powers
    return found


def bridged(old: Curve, new: Curve, begin: float) -> Curve:
    """Return the old curve, from `begin` on a quintic to the start of the new one, and that."""
    until = new.breaks[0]
    piece = quintic(old.state(begin), new.state(until), until - begin)
    return old.followed_by(Curve([begin], piece[np.newaxis])).followed_by(new)


def joined(old: Curve, new: Curve, begin: float, duration: float) -> Curve:
    """
    Return the old curve, and from `begin` on the new one, without a jump.

    The difference of both, with its velocity and acceleration, fades out along a quintic.

    Parameters
    ----------
    old : Curve
        Curve in force before.
    new : Curve
        Curve in force after.
    begin : float
        Start of the new one, which may have begun before [s].
    duration : float
        Time in which the difference fades out [s].

    """
    difference = old.state(begin) - new.state(begin)
    offset, end = quintic(difference, np.zeros_like(difference), duration), begin + duration
    changed = new.since(begin).followed_by(new.since(end))
    coefficients = changed.coefficients.copy()
    for piece, time in enumerate(changed.breaks):
        if time >= end:
            break
        coefficients[piece] += _about(offset, time - begin)
    return old.followed_by(Curve(changed.breaks, coefficients))


def braked(state: Array, begin: float, duration: float) -> Curve:
    """Return the curve from a state (3, d) to rest, where constant deceleration would lead."""
    end = np.zeros_like(state)
    end[0] = state[0] + 0.5 * duration * state[1]
    return Curve([begin], quintic(state, end, duration)[np.newaxis]).followed_by(
        hold(end[0], begin + duration))


def _about(coefficients: Array, shift: float) -> Array:
    """Return the coefficients (6, d) of a polynomial about a time that is later by `shift`."""
    found: Array = (BINOMIALS * shift ** RAISED).dot(coefficients)
    return found
