# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Ramped stop along the path of the robot in configuration space."""

import numpy as np
from tp_controller.control.cycle_options import CycleOptions
from tp_controller.control.step import CycleMemory
from tp_controller.model.spatial import Array


def ramp_down(options: CycleOptions, memory: CycleMemory, positions: Array, now: float,
              elapsed: float | None, deceleration: float) -> Array:
    """
    Return the next velocity (n,) of a ramped stop; zero at its end.

    Parameters
    ----------
    options : CycleOptions
        Options of the cycles.
    memory : CycleMemory
        Memory of the last cycle or command.
    positions : ndarray (n,)
        [rad or m]
    now : float
        [s]
    elapsed : float or None
        Time since the last command, by default the advance of `now`; a period if it is not more
        than zero [s].
    deceleration : float
        Deceleration of the fastest joint [rad/s² or m/s²].

    """
    before, last = memory.velocity, memory.commanded
    if elapsed is None:
        elapsed = 0.0 if last is None else now - last
    passed = min(max(elapsed, 0.0), 1.0) or options.period
    fastest = float(np.abs(before).max(initial=0.0))
    left = fastest - deceleration * passed
    factor = 0.0
    if left > 0.0:
        motion = memory.motion(positions, passed, memory.time.longest_hold(options.period))
        upper, lower = options.limits.at(motion).stopping
        moving = before != 0.0
        shares = np.where(before > 0.0, upper, lower)[moving] / np.abs(before[moving])
        factor = min(left / fastest, float(shares.min()))
    return factor * before
