# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Stops of the robot, with their reasons."""

from dataclasses import dataclass
import re

from tp_controller.ros.client.status import RUNNING

# Largest number of listed stops; more are counted.
MOST_STOPS = 500
# Parts of the reason of a stop that change while it lasts.
VARIABLE_PARTS = re.compile(r' \(ignored: .*\)|, until a moment ago|[-+]?\d+(\.\d+)?')


@dataclass
class Stop:
    """Stop: zeros were commanded from `start` to `end` [s], for a reason."""

    start: float
    end: float
    reason: str


class Stops:
    """
    Stops of one controller.

    Attributes
    ----------
    stops : list of Stop
        Stops in order of time.
    more : int
        Number of stops that are not listed.

    """

    def __init__(self) -> None:
        self.stops: list[Stop] = []
        self.more = 0
        self._current: Stop | None = None

    def add_status(self, time: float, head: str) -> None:
        """Process the reason of zero commands, or the end of a stop."""
        stop = self._current
        if stop is not None:
            stop.end = time
            if _constant_part(head) == _constant_part(stop.reason):
                return
        self._current = None
        if head != RUNNING:
            self._current = Stop(time, time, head)
            if len(self.stops) < MOST_STOPS:
                self.stops.append(self._current)
            else:
                self.more += 1


def _constant_part(reason: str) -> str:
    """Return a reason without its variable parts."""
    return VARIABLE_PARTS.sub('', reason)
