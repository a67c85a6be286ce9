# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Series of constant size: everything while it is short, then the extremes of each part."""

from hypothesis import given, settings, strategies
import numpy as np
import pytest
from tp_controller.tools.recording.series import BLOCK, Series


def series_of(values, most=2000):
    """Return a series of rows, one a second."""
    series = Series(len(values[0]) if len(values) else 1, most)
    for time, row in enumerate(values):
        series.add(float(time), row)
    return series


def test_a_short_series_stays_as_it_is():
    values = np.random.default_rng(1).normal(size=(3000, 2))
    times, found = series_of(values).rows()
    np.testing.assert_array_equal(times, np.arange(3000.0))
    np.testing.assert_array_equal(found, values)


def test_a_series_without_rows_is_empty():
    times, found = Series(3).rows()
    assert times.shape == (0,) and found.shape == (0, 3)


@pytest.mark.parametrize('rows', [500, 1023, 4097, 20_000])
def test_a_long_series_stays_short_and_no_peak_is_lost(rows):
    values = np.zeros((rows, 2))
    values[rows // 3, 0], values[2 * rows // 3, 1] = 7.0, -8.0
    times, found = series_of(values, most=100).rows()
    assert len(times) <= 400
    assert found[:, 0].max() == 7.0 and found[:, 1].min() == -8.0
    # Where they were, to within a bin, and no bin is longer than the others.
    assert times[found[:, 0].argmax()] == pytest.approx(rows // 3, abs=2 * rows / 100)
    assert np.all(np.diff(times) >= 0.0) and times[0] == 0.0 and times[-1] == rows - 1


@settings(max_examples=40, deadline=None)
@given(strategies.lists(strategies.floats(-1e3, 1e3), min_size=1, max_size=300),
       strategies.integers(2, 20))
def test_each_bin_has_its_extremes_in_their_order(numbers, most):
    # A small block, so that bins are halved again and again.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('tp_controller.tools.recording.series.BLOCK', 4)
        times, found = series_of([[number] for number in numbers], most).rows()
    column, numbers = found[:, 0], np.array(numbers)
    assert column.max() == numbers.max() and column.min() == numbers.min()
    if len(times) == len(numbers):
        np.testing.assert_array_equal(column, numbers)
        return
    for first, last, one, other in zip(times[::2], times[1::2], column[::2], column[1::2]):
        part = numbers[int(first):int(last) + 1]
        assert {one, other} == {part.min(), part.max()}
        # In the order in which a part that only rises or falls has them.
        if np.all(np.diff(part) > 0.0):
            assert one <= other
        if np.all(np.diff(part) < 0.0):
            assert one >= other


def test_columns_that_come_later_are_unknown_before():
    series = Series(1, most=50)
    for time in range(2 * BLOCK):
        series.add(float(time), [1.0])
    for time in range(2 * BLOCK, 4 * BLOCK):
        series.add(float(time), [1.0, 2.0])
    times, found = series.rows()
    before = times < 2 * BLOCK
    assert np.isnan(found[before, 1]).all() and (found[~before, 1] == 2.0).all()
    assert before.any() and not before.all()


def test_a_gap_that_is_longer_than_a_bin_stays_a_gap():
    values = np.ones((8000, 1))
    values[2000:6000] = np.nan
    times, found = series_of(values, most=100).rows()
    inside = (times > 2200) & (times < 5800)
    assert inside.any() and np.isnan(found[inside]).all()
    assert (found[(times < 1800) | (times > 6200)] == 1.0).all()
