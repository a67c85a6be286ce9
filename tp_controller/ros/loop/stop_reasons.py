# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reasons of a stop: faults that pass by themselves, and faults that latch."""

import math

# Largest number of latched faults that are kept: other nodes can cause any number.
MOST_LATCHED = 10


class Stops:
    """
    State of passing and latched faults.

    A passing fault, such as late joint states, stops the robot while it lasts and for `settle`
    seconds more, so that an intermittent fault does not make the robot start and stop. A latched
    fault, such as a robot that does not follow, stops it until the next start; it may be latched
    on one thread and cleared on another.

    Parameters
    ----------
    settle : float
        Time without a fault before the robot moves again [s].

    Attributes
    ----------
    moved : bool
        A cycle without a reason to stop has run.
    abrupt : bool
        Zeros have to be commanded at once: position or motion of the robot is unknown.

    """

    def __init__(self, settle: float) -> None:
        self._settle = settle
        self._passing = ''
        # Latched faults, and the joint of each that does not follow, the first one first.
        self._latched: list[tuple[str, str]] = []
        self._ended = self._interrupted = -math.inf
        # Before the first motion there is no settling time.
        self.moved = self.abrupt = False

    @property
    def latched(self) -> str:
        """Return the first latched fault; empty without one."""
        return ''.join(fault for fault, _ in self._latched[:1])

    @property
    def joint(self) -> str:
        """Return the joint that does not follow, if that is the first latched fault."""
        return ''.join(joint for _, joint in self._latched[:1])

    @property
    def further(self) -> str:
        """Return the fault that was latched after the first one; empty without one."""
        return ''.join(fault for fault, _ in self._latched[1:2])

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
        if self._latched:
            for fault, joint in self._latched[:1]:
                without = ', or ~/lock to go on without it' if joint else ''
                return f'{fault}; call ~/start to go on{without}'
        if self._passing:
            return self._passing if passing else f'{self._passing}, until a moment ago'
        self.moved, self.abrupt = True, False
        return ''

    def interrupt(self, passing: str, now: float) -> None:
        """Stop for `settle` seconds from now on, for a fault that is over."""
        self._passing, self._ended, self._interrupted = passing, now, now
        self.abrupt = True

    def latch(self, fault: str, abrupt: bool = True, joint: str = '') -> None:
        """
        Stop until the next start, if there is a fault; the first one is reported.

        Parameters
        ----------
        fault : str
            May be empty.
        abrupt : bool
            Zeros have to be commanded at once.
        joint : str
            Joint that does not follow, if that is the fault.

        """
        if not fault:
            return
        if (fault, joint) not in self._latched and len(self._latched) < MOST_LATCHED:
            self._latched.append((fault, joint))
        self.abrupt = self.abrupt or abrupt

    def clear_first(self) -> None:
        """Clear the first latched fault only."""
        del self._latched[:1]

    def clear(self) -> None:
        """Clear the latched faults."""
        self._latched.clear()
