# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Counts of reversals, sign changes and swings in a sequence of commands."""

import numpy as np

# Changes and velocities below this are none [rad/s or m/s].
SLOW = 0.01


def reversals(commands: np.ndarray, period: float) -> float:
    """
    Return how often per second the velocity of a joint turns back, of the joint that does most.

    It turns back in a cycle in which it changes to the other side of how it changed before, both
    by more than `SLOW`.

    Parameters
    ----------
    commands : ndarray (T, n)
        Velocities [rad/s or m/s].
    period : float
        Between two commands [s].

    """
    return _per_second(_sides(np.diff(commands, axis=0)), commands, period)


def sign_flips(commands: np.ndarray, period: float) -> float:
    """Return how often per second the sign of a velocity changes; as `reversals`."""
    return _per_second(_sides(commands), commands, period)


def swings(commands: np.ndarray, period: float) -> float:
    """
    Return how often per second the velocity of a joint turns, of the joint that does most.

    It turns where it comes back by more than `SLOW` from the highest or lowest it was since it
    turned last. Other than `reversals`, that sees an oscillation that takes many cycles.

    Parameters
    ----------
    commands, period
        As in `reversals`.

    """
    highest = lowest = commands[0]
    side, turns = np.zeros(commands.shape[1]), np.zeros(commands.shape[1])
    for velocity in commands[1:]:
        highest, lowest = np.maximum(highest, velocity), np.minimum(lowest, velocity)
        falls = (velocity < highest - SLOW) & (side >= 0.0)
        rises = (velocity > lowest + SLOW) & (side <= 0.0)
        turned = falls | rises
        turns += turned & (side != 0.0)
        side = np.where(falls, -1.0, np.where(rises, 1.0, side))
        highest, lowest = (np.where(turned, velocity, extreme) for extreme in (highest, lowest))
    return float(turns.max() / (len(commands) * period))


def _sides(values: np.ndarray) -> np.ndarray:
    """Return 1 and -1 for what is above and below zero, and 0 for what is slow."""
    return np.where(np.abs(values) > SLOW, np.sign(values), 0.0)


def _per_second(sides: np.ndarray, commands: np.ndarray, period: float) -> float:
    """Return how often a side follows directly on the other one, in the worst column."""
    turned = sides[1:] * sides[:-1] < 0.0
    return float(turned.sum(axis=0).max() / (len(commands) * period))
