# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reasons of a stop: faults that pass by themselves, and faults that latch."""

import math


class Stops:
    """
    State of passing and latched faults.

    A passing fault, such as late joint states, stops the robot while it lasts and for `settle`
    seconds more, so that an intermittent fault does not make the robot start and stop. A latched
    fault, such as a robot that does not follow, stops it until the next start.

    Parameters
    ----------
    settle : float
        Time without a fault before the robot moves again [s].

    Attributes
    ----------
    latched : str
        Latched fault; the robot is stopped until this is cleared.
    moved : bool
        A cycle without a reason to stop has run.
    abrupt : bool
        Zeros have to be commanded at once: position or motion of the robot is unknown.

    """

    def __init__(self, settle: float) -> None:
        self._settle = settle
        self.latched = self._passing = ''
        self._ended = self._interrupted = -math.inf
        # Before the first motion there is no settling time.
        self.moved = self.abrupt = False

    def reason(self, passing: str, now: float) -> str:
        """
        Return the reason for which the robot is stopped, or an empty string.

        Parameters
        ----------
        passing : str
            Current fault that passes by itself, or empty.
        now : float
            [s]

        """
        if passing:
            self._ended = now
            # Faults that an interruption causes are not reported in its place.
            if not self._passing or now - self._interrupted >= self._settle:
                self._passing = passing
        elif not self.moved or now - self._ended >= self._settle:
            self._passing = ''
        if self.latched:
            return f'{self.latched}; call ~/start to go on'
        if self._passing:
            return self._passing if passing else f'{self._passing}, until a moment ago'
        self.moved, self.abrupt = True, False
        return ''

    def interrupt(self, passing: str, now: float) -> None:
        """Stop for `settle` seconds from now on, for a fault that is over."""
        self._passing, self._ended, self._interrupted = passing, now, now
        self.abrupt = True

    def latch(self, fault: str, abrupt: bool = True) -> None:
        """Stop until the next start, if there is a fault; the first one is reported."""
        if not fault:
            return
        self.latched = self.latched or fault
        self.abrupt = self.abrupt or abrupt
