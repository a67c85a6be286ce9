# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Axes of the plots on the page are such that errors can be read from them."""

import pytest
from tp_controller.tools.view.plots import labels, MOST_LABELS, powers_of_ten


def test_powers_of_ten_reach_from_below_all_errors_to_above():
    assert powers_of_ten([[0.02, 3e-6], [0.5, 2e-5]]) == pytest.approx(
        (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0))
    # One that is a power of ten itself still has two ends.
    assert powers_of_ten([[1e-6]]) == pytest.approx((1e-6, 1e-5))


def test_labels_are_powers_and_small_ones_are_not_zero():
    assert labels((1e-5, 1e-4, 1e-3)) == ('10⁻⁵', '10⁻⁴', '10⁻³')
    assert labels((1.0, 10.0)) == ('10⁰', '10¹')


def test_labels_do_not_crowd_where_there_are_many_powers():
    powers = powers_of_ten([[1e-6, 3e3]])
    found = labels(powers)
    assert len(found) == len(powers) == 11
    assert 3 <= sum(map(bool, found)) <= MOST_LABELS
    assert found[0] == '10⁻⁶' and found[6] == '10⁰'
