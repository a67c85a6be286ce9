# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Transitions between stacks, goals or settings while the robot moves."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level, norm

# Offset [rad/s or m/s], and its change in a second, below which it is dropped.
NEGLIGIBLE_OFFSET = 1e-6


@dataclass(frozen=True, eq=False)
class Fade:
    """
    Offset of the velocity that fades out as a cubic polynomial of time, ending at rest.

    Attributes
    ----------
    offset, rate : ndarray (n,)
        Initial offset [rad/s or m/s], and its initial rate [rad/s² or m/s²].
    began, duration : float
        [s]
    shared : int
        Number of upper levels that do not fade.

    """

    offset: Array
    rate: Array
    began: float
    duration: float
    shared: int

    def active(self, now: float) -> bool:
        """Return whether the offset still fades out."""
        return now - self.began < self.duration

    def at(self, now: float) -> tuple[Array, Array]:
        """Return the offset and its rate."""
        r = (now - self.began) / self.duration
        change = self.duration * self.rate
        return ((1.0 - r) ** 2 * ((1.0 + 2.0 * r) * self.offset + r * change),
                (1.0 - r) * ((1.0 - 3.0 * r) * change - 6.0 * r * self.offset) / self.duration)


class Transition(NamedTuple):
    """
    Transition after a change of the stack, a goal or a setting, without a jump of the velocity.

    A change makes the velocity differ from the previous one by an offset. The offset is added to
    the new velocity and fades out. The sum is the demand of a closing level, below the levels that
    the old and the new stack share: those are solved exactly. The bounds are the same.

    A change during a transition adds to the offset, which keeps its rate. The offset therefore
    fades out even if there is a change in every cycle: it follows a linear filter of second order,
    with the natural frequency √6 / duration and the damping ratio 0.82. A change that shares more
    levels than the previous ones has an offset of its own, and does not delay theirs.

    Attributes
    ----------
    fades : tuple of Fade
        Offsets that fade out; none by default.

    """

    fades: tuple[Fade, ...] = ()

    def begin(self, offset: Array, began: float, duration: float, shared: int) -> 'Transition':
        """
        Return the transition with one more offset, with the initial rate of those it replaces.

        It replaces the offsets that share as many levels, or more.

        Parameters
        ----------
        offset : ndarray (n,)
            Velocity before the change − velocity after it − `offset` of fewer levels.
        began : float
            Time of the velocity before, on a clock that is never set back [s].
        duration : float
            Time until the offset has faded out [s]; 0 applies changes at once.
        shared : int
            Number of upper levels that the change does not affect.

        """
        rate = np.zeros_like(offset)
        fades = self.at(began).fades
        for fade in fades:
            if fade.shared >= shared:
                rate += fade.at(began)[1]
        kept = tuple([fade for fade in fades if fade.shared < shared])
        if norm(offset) > NEGLIGIBLE_OFFSET or norm(rate) > NEGLIGIBLE_OFFSET:
            kept += (Fade(offset, rate, began, duration, shared),)
        return Transition(kept)

    def at(self, now: float) -> 'Transition':
        """Return the transition without the offsets that have ended."""
        return Transition(tuple([fade for fade in self.fades if fade.active(now)]))

    def offset(self, now: float, below: int) -> Array | float:
        """Return the sum of offsets that share fewer than `below` levels (n,); 0 without any."""
        return sum(fade.at(now)[0] for fade in self.fades
                   if fade.shared < below and fade.active(now))

    def levels(self, levels: list[Level], velocity: Array, now: float) -> list[Level] | None:
        """
        Return the levels of the transition to `velocity`; None if it is over.

        Parameters
        ----------
        levels : list of Level
            Levels of the new stack.
        velocity : ndarray (n,)
            Solution of these levels [rad/s or m/s].
        now : float
            [s]

        """
        fades = self.at(now).fades
        if not fades:
            return None
        shared = min(fade.shared for fade in fades)
        return kept_above(levels, shared) + [
            Level.of_joints(velocity + sum(fade.at(now)[0] for fade in fades))]


def kept_above(levels: list[Level], count: int) -> list[Level]:
    """
    Return the first `count` levels, and the inequality levels directly below them.

    Bounds serve safety: they apply as soon as they are in the stack. Bounds farther down are below
    tasks, which they must not disturb.
    """
    while count < len(levels) and levels[count].v is None:
        count += 1
    return levels[:count]
