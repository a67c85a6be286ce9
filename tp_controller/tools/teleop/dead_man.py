# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Dead-man switch: motion only while it is pressed and every stream of the device is alive."""

from collections.abc import Mapping
import math

TIMEOUT = 'timeout'
AGAIN = 'open the dead-man switch once, then press it'
# Reasons for which nothing moves: the switch is open; it was pressed too early.
SWITCH = f'{TIMEOUT}: dead-man switch not pressed', f'{TIMEOUT}: {AGAIN}'
# The same of a device without a switch.
DEFLECTION = 'at rest', f'{TIMEOUT}: bring the device to rest once'


class DeadManSwitch:
    """
    Dead-man switch of a device, with a timeout of its streams and a ramp.

    After the start, and after a stream was lost, the switch has to be open once before it counts
    as pressed, unless told otherwise: nothing moves by itself when a stream comes back.

    Parameters
    ----------
    timeouts : mapping
        {name: age of the last input from which it counts as lost [s]} of the streams, which all
        have to be alive.
    ramp : float
        Time from the press to full speed [s].
    open_first : bool
        After the start and after a loss the switch has to be open once.
    texts : tuple of str
        Reasons for which nothing moves: the switch is open; it was pressed too early.

    """

    def __init__(self, timeouts: Mapping[str, float], ramp: float = 0.0,
                 open_first: bool = True, texts: tuple[str, str] = SWITCH) -> None:
        self._received = dict.fromkeys(timeouts, -math.inf)
        self._timeouts, self._ramp, self._texts = timeouts, ramp, texts
        self._open_first = open_first
        self._was_open = self._pressed = False
        # Time of the press [s]; None while the switch does not count as pressed.
        self._since: float | None = None
        # Reason for which it was opened, until it is not pressed.
        self._opened = ''

    def receive(self, stream: str, now: float) -> None:
        """Record an input of a stream at a time [s]."""
        self._check(now)
        self._received[stream] = now

    def press(self, pressed: bool, now: float) -> None:
        """Record the state of the switch at a time [s]."""
        self._pressed = pressed
        if not pressed:
            self._was_open, self._since, self._opened = True, None, ''
        elif self._was_open and self._since is None:
            self._since = now

    def open_for(self, reason: str) -> None:
        """Open the switch for a reason: it has to be open once before it counts as pressed."""
        self._was_open, self._since, self._opened = False, None, reason

    def alive(self, stream: str, now: float) -> bool:
        """Return whether a stream is not lost at a time [s]."""
        # A clock that was set back must not extend an old input either.
        return abs(now - self._received[stream]) <= self._timeouts[stream]

    def closed(self, now: float) -> bool:
        """Return whether the device moves the robot at a time [s]."""
        self._check(now)
        return self._since is not None

    def share(self, now: float) -> float:
        """Return the share of the speed at a time [s]: 0, or rising to 1 after the press."""
        self._check(now)
        if self._since is None:
            return 0.0
        return min((now - self._since) / self._ramp, 1.0) if self._ramp > 0.0 else 1.0

    def reason(self, now: float) -> str:
        """Return the reason for which nothing moves at a time [s]; empty if the device may."""
        self._check(now)
        lost = self._lost(now)
        if lost:
            silent = math.isinf(self._received[lost])
            return f'{TIMEOUT}: no input on {lost}' \
                + ('' if silent else f' for {self._timeouts[lost]:g} s')
        if self._opened:
            return f'{TIMEOUT}: {self._opened}; {AGAIN}'
        return '' if self._since is not None else self._texts[self._pressed]

    def _lost(self, now: float) -> str:
        """Return the name of a stream that is lost; empty if there is none."""
        return next((stream for stream in self._received if not self.alive(stream, now)), '')

    def _check(self, now: float) -> None:
        """Open the switch if a stream is lost."""
        if self._lost(now):
            self._was_open, self._since = not self._open_first, None
