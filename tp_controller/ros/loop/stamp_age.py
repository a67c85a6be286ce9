# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Age of messages by their stamps, from clocks that may be off or set."""

import math

# Time over which the smallest delay of a publisher is taken [s]: a clock drift of 1 % stays
# undetected, a queue that grows by 4 % does not.
OFFSET_SECONDS = 5.0
# Time after which stamps with a constant offset are accepted as another clock [s].
NEW_CLOCK_SECONDS = 2.0


class StampAge:
    """
    Age of the messages of one publisher by their stamps, with an unknown clock offset.

    The offset is the smallest recent difference between receipt and stamp. Stamps with a constant
    error for `NEW_CLOCK_SECONDS` come from a clock that was set, unless they are continuous: then
    the messages are late, for any duration.

    Parameters
    ----------
    limit : float
        Age from which a message is too old [s].

    Attributes
    ----------
    limit : float
        See above.
    age : float
        Age of the last message that was not too old [s].
    delay : float
        Age of the last message, even if it was too old [s].
    overtaken : bool
        A newer message had arrived before the last one.
    offset : float
        Smallest recent difference between receipt and stamp; infinite before the first [s].
    newest : float
        Newest stamp of a message that was not too old [s].

    """

    def __init__(self, limit: float) -> None:
        self.limit, self.age, self.overtaken = limit, 0.0, False
        self.delay = 0.0
        self.newest, self.offset = -math.inf, math.inf
        # Last stamp of any message, and whether stamps have made a step since the last accepted
        # one; those of late messages do not.
        self._seen, self._stepped = -math.inf, False
        # Smallest differences in the two halves of OFFSET_SECONDS: `offset` is the smaller one.
        self._older = self._newer = math.inf
        self._turned = -math.inf
        # Start, smallest and largest difference of stamps with an error.
        self._off: tuple[float, float, float] | None = None

    def fault(self, stamp: float, received: float) -> str:
        """
        Return the fault of a stamp, or an empty string.

        Parameters
        ----------
        stamp : float
            Stamp of the message [s]; 0: none.
        received : float
            Time of receipt [s].

        """
        if stamp == 0.0 or math.isinf(self.limit):
            self.age, self.delay, self.overtaken = 0.0, 0.0, False
            return ''
        difference = received - stamp
        age = difference - self.offset if math.isfinite(self.offset) else 0.0
        self._stepped |= stamp < self._seen - 0.5 * self.limit or age < -self.limit
        if abs(age) > self.limit and not self._is_another_clock(difference, received):
            self.delay, self._seen = age, stamp
            # Without the age, which differs in every message: a status stays the same.
            return f'older than {self.limit:g} s by its stamp' if age > 0.0 \
                else f'stamped more than {self.limit:g} s ahead of the ones before'
        if abs(age) > self.limit:
            self._older = self._newer = self.offset = difference
            self.newest = -math.inf
        self.accept(stamp, received)
        self.delay = age
        return ''

    def accept(self, stamp: float, received: float) -> None:
        """Note a stamp without a fault; see `fault`."""
        if stamp == 0.0 or self.limit == math.inf:
            self.age, self.delay, self.overtaken = 0.0, 0.0, False
            return
        difference = received - stamp
        self.delay = age = difference - self.offset
        self.age = age if age > 0.0 else 0.0
        self._off, self._stepped, self._seen = None, False, stamp
        self.overtaken = stamp < self.newest
        if not self.overtaken:
            self.newest = stamp
        # The smallest differences.
        if received - self._turned > 0.5 * OFFSET_SECONDS:
            self._older, self._newer, self._turned = self._newer, difference, received
            self.offset = min(self._older, difference)
        elif difference < self._newer:
            self._newer = difference
            self.offset = min(self._older, difference)

    def _is_another_clock(self, difference: float, received: float) -> bool:
        """Return whether stamps have had a constant error for long enough."""
        since, least, most = self._off or (received, difference, difference)
        least, most = min(least, difference), max(most, difference)
        if most - least > self.limit:
            since, least, most = received, difference, difference
        self._off = since, least, most
        return self._stepped and received - since >= NEW_CLOCK_SECONDS
