# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Status of a controller as shown on the page: errors of a task, and its condition."""

from collections import deque
from collections.abc import Callable
import math
from textwrap import shorten
import time
from typing import NamedTuple

from tp_controller.ros.client.status import RUNNING, TaskStatus

# Displayed units, with their conversion factors.
SHOWN = {'m': ('mm', 1e3), 'rad': ('°', math.degrees(1.0)), 'm/s': ('mm/s', 1e3),
         'rad/s': ('°/s', math.degrees(1.0))}
GOOD, BAD, FAINT = '#2e9e5b', '#c62828', '#8a8f98'
# A shorter stop is shown as a pause, for example when joint states are late [s].
PAUSE_SECONDS = 1.5
# Number of pauses within a time [s] from which the machine counts as too slow.
MANY_PAUSES, WITHIN_SECONDS = 4, 30.0
# Prefix of the reason of a stop by command.
STOP_PREFIX = 'stopped'
# Length of the text of a pause [characters].
MAX_PAUSE_TEXT = 44
WAITING = 'waiting for its status'
GONE = 'no status received: it has ended, or this machine is overloaded'
SLOW = ('this machine is too slow: the controller paused {} times in {:.0f} s, because joint '
        'states or its own cycles were late')


def error_text(task: TaskStatus) -> str:
    """Return the errors of a task as text, in suitable units."""
    return ', '.join(quantity(unit, value) for unit, value in task.errors.items())


def quantity(unit: str, value: float) -> str:
    """Return a value as text with its unit, converted to a suitable one."""
    if math.isnan(value):
        return '-'
    shown, factor = SHOWN.get(unit, (unit, 1.0))
    text = f'{factor * value:.1f}' if unit in SHOWN else f'{value:.4g}'
    return text if unit == '1' else f'{text}{"" if shown.startswith("°") else " "}{shown}'


class Condition(NamedTuple):
    """State of a controller: text, colour, and whether it can be started."""

    text: str
    colour: str
    waits: bool = False


class ConditionReader:
    """
    Derives the displayed state from the status of a controller.

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
        Return the current state.

        Parameters
        ----------
        head : str or None
            ``running`` or the reason of zero commands; None before the first status.
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
        if head.startswith(STOP_PREFIX) or now - self._since > PAUSE_SECONDS:
            # A commanded stop is not a pause, however short.
            self._since = -PAUSE_SECONDS if head.startswith(STOP_PREFIX) else self._since
            return Condition(head, BAD, True)
        # One line: a short pause must not shift the widgets below.
        return Condition(shorten(f'paused: {head}', MAX_PAUSE_TEXT, placeholder=' …'), FAINT)

    def remark(self) -> str:
        """Return a warning once when the machine becomes too slow, else an empty string."""
        since = self._clock() - WITHIN_SECONDS
        while self._pauses and self._pauses[0] < since:
            self._pauses.popleft()
        before, self._slow = self._slow, len(self._pauses) >= MANY_PAUSES or (
            self._slow and bool(self._pauses))
        return SLOW.format(len(self._pauses), WITHIN_SECONDS) if self._slow and not before else ''
