# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Long time series in constant memory: reduced resolution, preserved extremes."""

from collections.abc import Sequence

import numpy as np
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
        # Of each bin: first and last time; minima, maxima, and 1 where the maximum came first.
        self._times, self._values = np.empty((2, 0)), np.empty((3, 0, width))

    def __len__(self) -> int:
        """Return the number of values per sample."""
        return self._values.shape[2]

    def add(self, time: float, values: Sequence[float]) -> None:
        """Add a sample; if it has more values than earlier samples, these are extended by NaN."""
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
        low, high, falling = self._values
        if self._share == 1:
            return self._times[0], low
        values = np.where(falling == 1.0, (high, low), (low, high))
        return self._times.T.ravel(), values.swapaxes(0, 1).reshape(-1, len(self))

    def _bin_waiting(self) -> None:
        """Bin the waiting samples."""
        width = max([len(self), *(len(given) for _, given in self._waiting)])
        times = np.array([time for time, _ in self._waiting])
        values = np.full((len(times), width), np.nan)
        for row, (_, given) in zip(values, self._waiting):
            row[:len(given)] = given
        self._waiting = []
        bins, share = (np.stack((times, times)),
                       np.stack((values, values, np.zeros_like(values)))), 1
        while share < self._share and len(times):
            bins, share = _halved(*bins), 2 * share
        missing = width - len(self)
        known = np.pad(self._values, ((0, 0), (0, 0), (0, missing)), constant_values=np.nan)
        self._times = np.concatenate((self._times, bins[0]), axis=1)
        self._values = np.concatenate((known, bins[1]), axis=1)
        while self._times.shape[1] > self._most:
            self._times, self._values = _halved(self._times, self._values)
            self._share *= 2


def _halved(times: Array, values: Array) -> tuple[Array, Array]:
    """Return bins merged by pairs; an unpaired last one stays."""
    even = times.shape[1] // 2 * 2
    a, b = values[:, :even:2], values[:, 1:even:2]
    low, high = np.fmin(a[0], b[0]), np.fmax(a[1], b[1])
    # Bin of the pair with the extremes; the first if both have the same or none.
    low_in_a, high_in_a = (a[0] == low) | np.isnan(low), (a[1] == high) | np.isnan(high)
    falling = np.where(low_in_a == high_in_a, np.where(low_in_a, a[2], b[2]), high_in_a)
    merged = np.stack((times[0, :even:2], times[1, 1:even:2]))
    return (np.concatenate((merged, times[:, even:]), axis=1),
            np.concatenate((np.stack((low, high, falling)), values[:, even:]), axis=1))
