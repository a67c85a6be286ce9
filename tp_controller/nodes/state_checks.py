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

"""
What joint states say about themselves: how old they are, and whether they can be true.

Everything here is numbers in and sentences out. A message that cannot be believed is left out;
what that means for the robot is decided in `tp_controller.nodes.stops`.
"""

from collections import deque
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array, wrap_angle

# For how long the smallest delay of a publisher is remembered [s]: clocks that drift apart by
# 1 % stay unnoticed, a queue that grows by 4 % does not.
REMEMBERED = 5.0
# After how long stamps that are off by a constant time are taken as another clock [s].
RELEARNED = 2.0
# A longer step between two cycles, as a share of the window in which a robot has to follow, is a
# leap of the clock. It is so short that a robot which did not move meanwhile follows all the same.
LEAP = 0.5


def motion(change: Array, endless: NDArray[np.bool_]) -> Array:
    """Return changes of positions (…, n) as motion: joints that turn without end may wrap."""
    return np.where(endless, wrap_angle(change), change)


class StampAge:
    """
    How old messages of one publisher are by their stamps, although its clock may be any.

    The clock's offset is the smallest difference between receipt and stamp of late. Stamps that
    are off by a constant time for `RELEARNED` seconds come from a clock that was set, unless they
    go on from where they were: then the messages are late, for however long they are.

    Parameters
    ----------
    limit : float
        Age from which a message is too old [s].

    Attributes
    ----------
    age : float
        Of the last message that was not too old [s].
    overtaken : bool
        A newer one had come before that.

    """

    def __init__(self, limit: float) -> None:
        self._limit, self.age, self.overtaken = limit, 0.0, False
        self._newest = -math.inf
        # The last stamp, of whatever message, and whether stamps have made a step since one that
        # was believed, as those of messages that are late do not.
        self._seen, self._stepped = -math.inf, False
        # Smallest differences of two halves of the time that is remembered.
        self._older = self._newer = math.inf
        self._turned = -math.inf
        # Where stamps are off: since when, and between which differences.
        self._off: tuple[float, float, float] | None = None

    def fault(self, stamp: float, received: float) -> str:
        """
        Return what is wrong with a stamp; empty where nothing is.

        Parameters
        ----------
        stamp : float
            Of the message [s]; 0 where it has none.
        received : float
            When it was received [s].

        """
        if stamp == 0.0 or math.isinf(self._limit):
            self.age, self.overtaken = 0.0, False
            return ''
        difference = received - stamp
        offset = min(self._older, self._newer)
        age = difference - offset if math.isfinite(offset) else 0.0
        self._stepped |= stamp < self._seen - 0.5 * self._limit or age < -self._limit
        self._seen = stamp
        if abs(age) > self._limit and not self._is_another_clock(difference, received):
            return f'{age:.2g} s old by its stamp' if age > 0.0 \
                else f'stamped {-age:.2g} s ahead of the ones before'
        if abs(age) > self._limit:
            self._older = self._newer = difference
            self._newest, age = -math.inf, 0.0
        self._off, self._stepped, self.age = None, False, max(age, 0.0)
        self.overtaken = stamp < self._newest
        self._newest = max(self._newest, stamp)
        self._remember(difference, received)
        return ''

    def _remember(self, difference: float, received: float) -> None:
        """Keep the smallest differences."""
        if received - self._turned > 0.5 * REMEMBERED:
            self._older, self._newer, self._turned = self._newer, math.inf, received
        self._newer = min(self._newer, difference)

    def _is_another_clock(self, difference: float, received: float) -> bool:
        """Say whether stamps have been off by the same time for long enough."""
        since, least, most = self._off or (received, difference, difference)
        least, most = min(least, difference), max(most, difference)
        if most - least > self._limit:
            since, least, most = received, difference, difference
        self._off = since, least, most
        return self._stepped and received - since >= RELEARNED


@dataclass(frozen=True)
class Following:
    """
    When a robot counts as one that does not follow.

    Attributes
    ----------
    window : float
        Time over which motion is compared [s]; 0: never.
    lag : float
        By how much the robot may be late [s].
    distance : float
        What has to be commanded in that time, at least [rad or m].
    share : float
        Smallest share of it that counts as following [1].

    """

    window: float = 1.0
    lag: float = 0.3
    distance: float = 0.05
    share: float = 0.2


class MotionCheck:
    """
    Whether joints move as they are commanded, and stay within their limits.

    Parameters
    ----------
    names : tuple of str
        Of the driven joints.
    lower, upper : ndarray (n,)
        Their position limits [rad or m].
    endless : ndarray (n,) of bool
        Which of them turn without end.
    following : Following
    tolerance : float
        By how much a joint may pass a limit [rad or m].

    """

    # Samples in a window.
    SAMPLES = 20

    def __init__(self, names: tuple[str, ...], lower: Array, upper: Array,
                 endless: NDArray[np.bool_], following: Following, tolerance: float) -> None:
        self._names, self._following = names, following
        self._lower, self._upper, self._tolerance = lower, upper, tolerance
        self._ranges = list(zip(lower.tolist(), upper.tolist()))
        self._endless = endless
        self.forget()

    def forget(self) -> None:
        """Begin anew: what comes next need not follow from what was."""
        late = 1 + math.ceil(self.SAMPLES * self._following.lag / (self._following.window or 1.0))
        self._samples: deque[tuple[Array, Array, float]] = deque(maxlen=self.SAMPLES + late)
        self._commanded = np.zeros(len(self._names))
        self._velocity = np.zeros(len(self._names))
        self._sampled = self._last = -math.inf
        # Where a joint starts outside it is led back.
        self._inside = np.zeros(len(self._names), dtype=bool)
        self._all_inside = False

    def passed(self, q: Array) -> str:
        """Return which joint has passed a position limit since it was inside; q (n,)."""
        if self._all_inside and self._is_inside(q.tolist()):
            return ''
        beyond = np.maximum(q - self._upper, self._lower - q)
        gone = self._inside & (beyond > self._tolerance)
        self._inside = (self._inside | (beyond <= 0.0)) & ~gone
        self._all_inside = bool(self._inside.all())
        if not gone.any():
            return ''
        joint = int(np.argmax(gone))
        return f'{self._names[joint]} has passed its position limit, at {q[joint]:.4g}'

    def _is_inside(self, positions: list[float]) -> bool:
        """Say whether all joints are within their limits; quicker than numpy for a few."""
        for position, (lower, upper) in zip(positions, self._ranges):
            if not lower <= position <= upper:
                return False
        return True

    def check(self, q: Array, velocity: Array, now: float) -> str:
        """
        Return which joint does not follow; empty where all do.

        Parameters
        ----------
        q : ndarray (n,)
            Measured positions [rad or m].
        velocity : ndarray (n,)
            What is commanded from now on, and is not changed afterwards [rad/s or m/s].
        now : float
            [s]

        """
        window = self._following.window
        if not window or not len(q):
            return ''
        if self._last > -math.inf and not 0.0 <= now - self._last <= LEAP * window:
            # The clock was set: nobody knows for how long the last command was in force.
            self.forget()
        if self._last > -math.inf:
            self._commanded = self._commanded + self._velocity * (now - self._last)
        self._velocity, self._last = velocity, now
        # A little early is better than a whole cycle late.
        if now - self._sampled < 0.9 * window / self.SAMPLES:
            return ''
        self._sampled = now
        self._samples.append((q.copy(), self._commanded, now))
        return self._fault() if len(self._samples) == self._samples.maxlen else ''

    def _fault(self) -> str:
        """Return which joint has not followed in the window that ends now."""
        positions, commanded, times = (np.array(rows) for rows in zip(*self._samples))
        moved = motion(np.diff(positions[-1 - self.SAMPLES:], axis=0), self._endless).sum(axis=0)
        # What was commanded in windows of the same length that end earlier: however late the
        # robot is, one of them is what it has to follow now.
        asked = commanded[self.SAMPLES:] - commanded[:-self.SAMPLES]
        least = np.where(np.abs(np.sign(asked).sum(axis=0)) == len(asked),
                         np.abs(asked).min(axis=0), 0.0)
        along = moved * np.sign(asked[-1])
        still = (least > self._following.distance) & (along < self._following.share * least)
        if not still.any():
            return ''
        joint = int(np.argmax(still))
        return (f'{self._names[joint]} does not follow: commanded to move by '
                f'{asked[-1][joint]:.2g}, moved by {moved[joint]:.2g} '
                f'in {times[-1] - times[-1 - self.SAMPLES]:.2g} s')
