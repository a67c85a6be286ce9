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

"""Long time series in constant memory: reduced resolution, preserved extremes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array

# Number of rows collected before binning.
BLOCK = 1024


class Series:
    """
    Time series that stores the minimum and the maximum of each bin of samples.

    With few samples each one is a bin. When there are too many bins, pairs of bins are merged, so
    all bins have the same number of samples.

    Parameters
    ----------
    width : int
        Number of values per sample.
    most : int
        Largest number of bins.

    """

    def __init__(self, width: int, most: int = 2000) -> None:
        self._most = 2 * most
        # Samples per bin, a power of two; and samples not yet binned.
        self._share = 1
        self._waiting: list[tuple[float, Sequence[float]]] = []
        self._width = width
        self._bins = _Bins.of(np.empty(0), np.empty((0, width)))

    def __len__(self) -> int:
        """Return the number of values per sample."""
        return self._width

    def add(self, time: float, values: Sequence[float]) -> None:
        """Add a sample; if it has more values than earlier samples, these are extended by NaN."""
        self._width = max(self._width, len(values))
        self._waiting.append((time, values))
        if len(self._waiting) >= max(BLOCK, self._share):
            self._bin_waiting()

    def rows(self) -> tuple[Array, Array]:
        """
        Return all samples, or two rows for each bin.

        Returns
        -------
        times : ndarray (T,)
        values : ndarray (T, width)
            Not a number if unknown. The first row of a bin has the earlier extreme of each
            column.

        """
        self._bin_waiting()
        bins = self._bins
        if self._share == 1:
            return bins.first, bins.low
        times = np.column_stack((bins.first, bins.last)).ravel()
        values = np.stack((np.where(bins.falling, bins.high, bins.low),
                           np.where(bins.falling, bins.low, bins.high)), axis=1)
        return times, values.reshape(len(times), -1)

    def _bin_waiting(self) -> None:
        """Bin the waiting samples."""
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

    All arrays have one row for each bin.
    """

    def __init__(self, *parts: NDArray[Any]) -> None:
        self.first, self.last, self.low, self.high, self.falling = parts

    @classmethod
    def of(cls, times: Array, values: Array) -> '_Bins':
        """Return bins of one sample each."""
        return cls(times, times, values, values, np.zeros(values.shape, bool))

    def followed_by(self, other: '_Bins') -> '_Bins':
        """Return these bins followed by others."""
        return _Bins(*(np.concatenate(pair) for pair in zip(self._parts(), other._parts())))

    def widened(self, width: int) -> '_Bins':
        """Return bins with more columns, of unknown values."""
        missing = width - self.low.shape[1]
        if not missing:
            return self
        unknown = np.full((len(self.first), missing), np.nan)
        return _Bins(self.first, self.last, np.hstack((self.low, unknown)),
                     np.hstack((self.high, unknown)),
                     np.hstack((self.falling, np.zeros(unknown.shape, bool))))

    def halved(self) -> '_Bins':
        """Return merged pairs of bins; an unpaired last one stays."""
        a, b = (_Bins(*(part[start:len(part) // 2 * 2:2] for part in self._parts()))
                for start in (0, 1))
        low, high = np.fmin(a.low, b.low), np.fmax(a.high, b.high)
        # Bin of the pair with the extremes; the first if both have the same.
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
    """Return a mask of the values that equal the extreme, or have an unknown one."""
    return (values == extreme) | np.isnan(extreme)
