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

"""Long series of numbers, in a memory of constant size: less detail, but no extreme is lost."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array

# Rows that are collected before they are put into bins.
BLOCK = 1024


class Series:
    """
    Values over time, of which the smallest and the largest of each bin of samples stay.

    While there are few samples each is a bin of its own. Whenever there are too many bins, two
    become one, so they all have the same number of samples.

    Parameters
    ----------
    width : int
        How many values belong to a time.
    most : int
        Largest number of bins.

    """

    def __init__(self, width: int, most: int = 2000) -> None:
        self._most = 2 * most
        # Samples in a bin, a power of two; and samples that are in none yet.
        self._share = 1
        self._waiting: list[tuple[float, Sequence[float]]] = []
        self._width = width
        self._bins = _Bins.of(np.empty(0), np.empty((0, width)))

    def __len__(self) -> int:
        """Return how many values belong to a time."""
        return self._width

    def add(self, time: float, values: Sequence[float]) -> None:
        """Add the values of a time; there may be more of them than before, the others missing."""
        self._width = max(self._width, len(values))
        self._waiting.append((time, values))
        if len(self._waiting) >= max(BLOCK, self._share):
            self._sort_in()

    def rows(self) -> tuple[Array, Array]:
        """
        Return what there is: every sample, or two rows for each bin.

        Returns
        -------
        times : ndarray (T,)
        values : ndarray (T, width)
            Not a number where nothing was known. Of a bin the first row has of each column
            the extreme that came first.

        """
        self._sort_in()
        bins = self._bins
        if self._share == 1:
            return bins.first, bins.low
        times = np.column_stack((bins.first, bins.last)).ravel()
        values = np.stack((np.where(bins.falling, bins.high, bins.low),
                           np.where(bins.falling, bins.low, bins.high)), axis=1)
        return times, values.reshape(len(times), -1)

    def _sort_in(self) -> None:
        """Put what is waiting into bins."""
        rows = len(self._waiting)
        times = np.array([time for time, _ in self._waiting])
        values = np.full((rows, self._width), np.nan)
        for row, (_, given) in zip(values, self._waiting):
            row[:len(given)] = given
        self._waiting = []
        bins, share = _Bins.of(times, values), 1
        while share < self._share and len(bins.first):
            bins, share = bins.halved(), 2 * share
        self._bins = self._bins.widened(self._width).followed_by(bins)
        while len(self._bins.first) > self._most:
            self._bins, self._share = self._bins.halved(), 2 * self._share


class _Bins:
    """
    Bins of samples: times of the first and the last, extremes, and whether the high came first.

    All have one row for each bin.
    """

    def __init__(self, *parts: NDArray[Any]) -> None:
        self.first, self.last, self.low, self.high, self.falling = parts

    @classmethod
    def of(cls, times: Array, values: Array) -> '_Bins':
        """Return bins of one sample each."""
        return cls(times, times, values, values, np.zeros(values.shape, bool))

    def followed_by(self, other: '_Bins') -> '_Bins':
        """Return these and others after them."""
        return _Bins(*(np.concatenate(pair) for pair in zip(self._parts(), other._parts())))

    def widened(self, width: int) -> '_Bins':
        """Return bins that have more columns, of which nothing is known."""
        missing = width - self.low.shape[1]
        if not missing:
            return self
        unknown = np.full((len(self.first), missing), np.nan)
        return _Bins(self.first, self.last, np.hstack((self.low, unknown)),
                     np.hstack((self.high, unknown)),
                     np.hstack((self.falling, np.zeros(unknown.shape, bool))))

    def halved(self) -> '_Bins':
        """Return half as many bins, each of two; a last one without a partner stays alone."""
        a, b = (_Bins(*(part[start:len(part) // 2 * 2:2] for part in self._parts()))
                for start in (0, 1))
        low, high = np.fmin(a.low, b.low), np.fmax(a.high, b.high)
        # In which of the two the extremes are; the first where both have the same.
        low_in_a, high_in_a = _is_in(a.low, low), _is_in(a.high, high)
        falling = np.where(low_in_a == high_in_a, np.where(low_in_a, a.falling, b.falling),
                           high_in_a)
        pairs = _Bins(a.first, b.last, low, high, falling)
        if len(self.first) % 2:
            return pairs.followed_by(_Bins(*(part[-1:] for part in self._parts())))
        return pairs

    def _parts(self) -> tuple[NDArray[Any], ...]:
        """Return the arrays."""
        return self.first, self.last, self.low, self.high, self.falling


def _is_in(values: Array, extreme: Array) -> NDArray[np.bool_]:
    """Say where values are the extreme; where nothing is known they may be either."""
    return (values == extreme) | np.isnan(extreme)
