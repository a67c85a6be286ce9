# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Time between two commands, measured with the clock of the caller."""

import math
from typing import NamedTuple

from tp_controller.errors import TimeError, TpControllerError

# Share of each new measurement in the mean time between commands.
SMOOTHING = 0.05
# Longest time that a command is in force, relative to the mean time between two; at most a period.
HOLD_RATIO = 2.0


class CycleTime(NamedTuple):
    """
    Time between commands, measured with a clock that may stand still or be set back.

    If the clock does not advance from one command to the next, the time between them is unknown.
    It is then assumed to equal the time at the last advance of the clock, at first a period. A
    clock may also tick less often than commands are computed. When it advances again, the elapsed
    time is divided among the commands since.

    Attributes
    ----------
    now : float
        Sum of these times, never decreasing [s].
    mean : float
        Mean time between two commands [s], at most a period: a pause does not count, and
        commands may be computed faster than required.
    usual : float
        Time between two commands at the last advance of the clock [s], at most a period.
    commands : int
        Number of commands since then.

    """

    now: float
    mean: float
    usual: float
    commands: int = 1

    def expect(self, period: float) -> 'CycleTime':
        """Return the same time with the estimates reset to a period [s]."""
        return CycleTime(self.now, period, period)

    def longest_hold(self, period: float) -> float:
        """Return the longest time that a command is in force [s]."""
        duration = HOLD_RATIO * self.mean
        return duration if duration < period else period

    def advance(self, measured: float, period: float) -> tuple[float, 'CycleTime']:
        """
        Return the duration for which the last command was in force [s] and the time after it.

        Parameters
        ----------
        measured : float
            Advance of the clock since then [s].
        period : float
            Longest time between two commands [s].

        """
        now, mean, usual, commands = self
        if measured > 0.0:
            elapsed = measured / commands
            usual = elapsed if elapsed < period else period
            commands = 1
        else:
            elapsed = usual
            commands += 1
        return elapsed, CycleTime(now + elapsed, mean + SMOOTHING * (usual - mean), usual,
                                  commands)


def check_times(now: float | None, elapsed: float | None) -> tuple[float, float | None]:
    """Return the times of a cycle as floats [s]; raise `TimeError` unless they are finite."""
    # The sum of two floats is finite only if both are.
    if type(now) is float and (elapsed is None or type(elapsed) is float) \
            and math.isfinite(now + (elapsed or 0.0)):
        return now, elapsed
    return check_time(now, 'now', TimeError), \
        None if elapsed is None else check_time(elapsed, 'elapsed', TimeError)


def check_time(value: float | None, name: str, refusal: type[TpControllerError]) -> float:
    """Return a time as a float [s]; raise `refusal` unless it is a finite number."""
    try:
        if value is not None and math.isfinite(value):
            return float(value)
    except (TypeError, ValueError, OverflowError):
        # Reported below.
        pass
    raise refusal(f'{name} must be a finite number, the time of any clock [s], got {value!r}'
                  if name == 'now' else f'{name} must be a finite number [s], got {value!r}')
