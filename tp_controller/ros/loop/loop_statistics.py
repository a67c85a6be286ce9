# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Statistics of the loop: rate, durations, latencies and faults."""

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.solver.compiled import left_to_the_reference, running

# Number of last cycles that percentiles are computed from.
CYCLES = 1000


class Figures:
    """
    Counters and times of the cycles, written by the loop and read by the reporter.

    Parameters
    ----------
    period : float
        Nominal time between two cycles [s]; infinite if joint states start the cycles.

    Attributes
    ----------
    cycles : int
    overruns : int
        Cycles that began more than a period late, or took longer than a period.
    stalls : int
        Number of stalls of the whole loop.
    missed_deadlines : int
        Number of joint states later than `state_deadline`.
    other_publishers : int
        Number of other nodes that publish the same commands.
    listeners, watchdogs : int
        Number of nodes, and of watchdogs, that listen to the commands.
    lead : float
        Largest distance of commanded from measured positions, relative to the largest allowed
        one; NaN if no positions are commanded.
    not_following : str
        Joint that has stopped the robot as it does not follow, or empty.
    ignored_description : str
        Hint about a received robot description that is not in use, or empty.

    """

    def __init__(self, period: float) -> None:
        self._period = period
        self.cycles = self.overruns = self.stalls = self.missed_deadlines = 0
        self.other_publishers = self.listeners = self.watchdogs = 0
        self.lead = np.nan
        self.not_following = self.ignored_description = ''
        # Start, duration, and time from a joint state to its command, of the last cycles.
        self._times = [(np.nan, np.nan, np.nan)] * CYCLES
        self._last_start = np.inf

    def add(self, start: float, end: float, received: float) -> None:
        """Add a cycle with its start, its end, and the time of receipt of its joint states [s]."""
        if start - self._last_start > 2.0 * self._period or end - start > self._period:
            self.overruns += 1
        self._last_start = start
        self._times[self.cycles % CYCLES] = start, end - start, end - received
        self.cycles += 1

    def as_text(self) -> dict[str, str]:
        """Return {key: value as text} of the last cycles, always with the same keys."""
        times: Array = np.array(self._times[:min(self.cycles, CYCLES)]).reshape(-1, 3)
        starts = times[:, 0]
        span = np.ptp(starts) if len(starts) > 1 else np.nan
        # Sorted once for all percentiles: the loop waits meanwhile.
        took, latency = np.sort(times[:, 1:], axis=0).T
        return {'cycles': str(self.cycles),
                'rate [Hz]': f'{(len(starts) - 1) / span if span > 0.0 else np.nan:.4g}',
                **_milliseconds('cycle', took), **_milliseconds('state to command', latency),
                'overruns': str(self.overruns), 'stalls': str(self.stalls),
                'missed deadlines': str(self.missed_deadlines),
                'not following': self.not_following,
                'other publishers': str(self.other_publishers),
                'listeners': str(self.listeners), 'watchdogs': str(self.watchdogs),
                'lead': f'{self.lead:.3g}', 'ignored description': self.ignored_description,
                'solver': running(), 'cycles left to Python': str(left_to_the_reference())}


def _milliseconds(what: str, times: Array) -> dict[str, str]:
    """Return median, 99th percentile and maximum of sorted times [s] as text."""
    shares = {'median': 0.5, 'p99': 0.99, 'max': 1.0}
    values = times[[round(share * (len(times) - 1)) for share in shares.values()]] \
        if len(times) else np.full(len(shares), np.nan)
    return {f'{what} {name} [ms]': f'{1e3 * value:.4g}' for name, value in zip(shares, values)}
