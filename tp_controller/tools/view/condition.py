# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The state of a controller in the words of the page: running, paused, stopped, or gone."""

from collections import deque
from collections.abc import Callable
from textwrap import shorten
import time
from typing import NamedTuple

RUNNING, GOOD, BAD, FAINT = 'running', '#2e9e5b', '#c62828', '#8a8f98'
# A stop that is shorter is a pause, as where joint states come late for a moment [s].
PAUSE_SECONDS = 1.5
# From so many pauses within a time on the machine counts as too slow [s].
MANY_PAUSES, WITHIN_SECONDS = 4, 30.0
# Start of the reason after somebody has stopped the robot.
BY_HAND = 'stopped'
# Letters of the reason of a pause.
LONGEST = 44
WAITING = 'waiting for its status'
GONE = 'no longer heard: it has ended, or this machine has too much to do'
SLOW = ('this machine is too slow: the controller paused {} times in {:.0f} s, which it does '
        'where joint states or its own cycles come late')


class Condition(NamedTuple):
    """What is said of a controller, its colour, and whether it waits to be started."""

    text: str
    colour: str
    waits: bool = False


class ConditionReader:
    """
    Follows what a controller does.

    Parameters
    ----------
    clock : callable
        Returns a time [s].

    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._since: float | None = None
        self._pauses: deque[float] = deque()
        self._slow = False

    def read(self, head: str | None, present: bool) -> Condition:
        """
        Return what is said now.

        Parameters
        ----------
        head : str or None
            ``running``, or why zeros are commanded; None before the first status.
        present : bool
            Whether the last status is recent.

        """
        if head is None:
            return Condition(WAITING, FAINT)
        if not present:
            self._since = None
            return Condition(GONE, BAD)
        now = self._clock()
        if head == RUNNING:
            if self._since is not None and now - self._since <= PAUSE_SECONDS:
                self._pauses.append(now)
            self._since = None
            return Condition(head, GOOD)
        if self._since is None:
            self._since = now
        if head.startswith(BY_HAND) or now - self._since > PAUSE_SECONDS:
            # No pause, however soon the controller goes on.
            self._since = -PAUSE_SECONDS if head.startswith(BY_HAND) else self._since
            return Condition(head, BAD, True)
        # In one line: it is there for a moment, and nothing below it is to jump.
        return Condition(shorten(f'paused: {head}', LONGEST, placeholder=' …'), FAINT)

    def remark(self) -> str:
        """Return that the machine is too slow, once for as long as it is; else nothing."""
        since = self._clock() - WITHIN_SECONDS
        while self._pauses and self._pauses[0] < since:
            self._pauses.popleft()
        before, self._slow = self._slow, len(self._pauses) >= MANY_PAUSES or (
            self._slow and bool(self._pauses))
        return SLOW.format(len(self._pauses), WITHIN_SECONDS) if self._slow and not before else ''
