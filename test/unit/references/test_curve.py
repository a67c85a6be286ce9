# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Piecewise quintics: splines through values, joins without a jump, bridges and braking."""

import numpy as np
import pytest
from tp_controller.references.curve import braked, bridged, hold, joined, quintic, through

RNG = np.random.default_rng(3)
TIMES = np.array([100.0, 100.3, 100.4, 101.0, 101.7])
VALUES = RNG.normal(size=(5, 2))
STEP = 1e-5


def curve():
    """Return a spline through the values."""
    return through(TIMES, VALUES)


def largest_jump(found, first, last):
    """Return the largest jumps of value, velocity and acceleration at the breaks between."""
    edges = [edge for edge in found.breaks if first <= edge <= last]
    before = np.array([found.state(edge - 1e-9) for edge in edges])
    after = np.array([found.state(edge) for edge in edges])
    return np.abs(after - before).max(axis=(0, 2))


def test_spline_meets_its_values_and_holds_the_last_one():
    for time, value in zip(TIMES, VALUES):
        np.testing.assert_allclose(curve().value(time), value, atol=1e-12)
    np.testing.assert_array_equal(curve().value(1000.0), VALUES[-1])
    np.testing.assert_array_equal(curve().rate(1000.0), np.zeros(2))
    assert curve().end == TIMES[-1]


def test_spline_has_no_jump_in_velocity_or_acceleration_and_ends_at_rest():
    assert largest_jump(curve(), TIMES[1], TIMES[-2]).max() < 1e-6
    np.testing.assert_allclose(curve().rate(TIMES[-1] - 1e-12), np.zeros(2), atol=1e-9)
    np.testing.assert_allclose(
        through(TIMES, VALUES, at_rest=True).rate(TIMES[0]), np.zeros(2), atol=1e-12)


def test_spline_of_a_cubic_is_that_cubic_up_to_the_last_values():
    # Only the rest at its end is not that of the cubic, and fades with each value before.
    times = np.linspace(0.0, 3.0, 31)
    found = through(times, (times ** 3 - times)[:, np.newaxis])
    np.testing.assert_allclose(found.value(0.05), 0.05 ** 3 - 0.05, atol=1e-9)
    np.testing.assert_allclose(found.rate(0.05), 3.0 * 0.05 ** 2 - 1.0, atol=1e-9)


@pytest.mark.parametrize('time', [100.0, 100.35, 101.2, 103.0])
def test_rate_and_acceleration_are_differences_of_the_value(time):
    found = curve()
    values = [found.value(time + shift) for shift in (0.0, STEP, 2.0 * STEP)]
    middle = found.state(time + STEP)
    np.testing.assert_allclose(found.rate(time + STEP), (values[2] - values[0]) / (2.0 * STEP),
                               atol=1e-5)
    np.testing.assert_allclose(middle[0], values[1], atol=1e-12)
    np.testing.assert_allclose(middle[1], found.rate(time + STEP), atol=1e-9)
    rates = [found.rate(time + shift) for shift in (0.0, 2.0 * STEP)]
    np.testing.assert_allclose(middle[2], (rates[1] - rates[0]) / (2.0 * STEP), atol=1e-2)


def test_quintic_goes_from_one_state_to_another():
    start, end = RNG.normal(size=(2, 3, 4))
    piece = quintic(start, end, 0.7)
    powers = 0.7 ** np.arange(6.0)
    np.testing.assert_allclose(piece[:3] * [[1.0], [1.0], [2.0]], start)
    np.testing.assert_allclose(powers @ piece, end[0])
    np.testing.assert_allclose((np.arange(6.0) * 0.7 ** (np.arange(6.0) - 1.0))[1:] @ piece[1:],
                               end[1])
    second = np.arange(6.0) * (np.arange(6.0) - 1.0) * 0.7 ** np.maximum(np.arange(6.0) - 2.0, 0.0)
    np.testing.assert_allclose(second @ piece, end[2])


def test_join_has_no_jump_and_is_the_new_curve_after_it():
    new = through(TIMES + 0.4, RNG.normal(size=(5, 2)))
    found = joined(curve(), new, 100.9, 0.5)
    assert largest_jump(found, 100.8, 101.5).max() < 1e-3
    np.testing.assert_allclose(found.state(100.8), curve().state(100.8))
    for time in (101.4, 101.6, 102.05, 200.0):
        np.testing.assert_allclose(found.state(time), new.state(time), atol=1e-9)


def test_join_of_equal_curves_is_that_curve():
    found = joined(curve(), curve(), 100.9, 0.5)
    for time in np.linspace(100.5, 103.0, 50):
        np.testing.assert_allclose(found.state(time), curve().state(time), atol=1e-9)


def test_join_may_last_beyond_the_end_of_the_new_curve():
    found = joined(curve(), hold(np.ones(2), 0.0), 100.9, 0.5)
    assert found.end == pytest.approx(101.4)
    np.testing.assert_allclose(found.value(101.4), np.ones(2))
    assert largest_jump(found, 100.8, 101.4).max() < 1e-3


def test_bridge_leads_to_the_start_of_the_new_curve():
    new = through(TIMES + 5.0, VALUES)
    found = bridged(curve(), new, 101.0)
    assert largest_jump(found, 101.0, 105.0).max() < 1e-3
    np.testing.assert_allclose(found.state(105.0), new.state(105.0))


def test_braking_comes_to_rest_without_turning_back():
    found = braked(np.array([[1.0], [2.0], [0.0]]), 5.0, 0.4)
    rates = [found.rate(time)[0] for time in np.linspace(5.0, 5.5, 100)]
    assert rates[0] == 2.0
    assert rates[-1] == 0.0
    assert np.diff(rates).max() <= 1e-12
    np.testing.assert_allclose(found.value(9.0), [1.4])


def test_samples_are_those_of_the_curve():
    values, rates = curve().samples()
    assert len(values) == 4 * 16 + 1
    np.testing.assert_allclose(values[3], curve().value(100.0 + 0.3 * 3 / 16))
    np.testing.assert_allclose(rates[20], curve().rate(100.3 + 0.1 * 4 / 16))
    np.testing.assert_allclose(values[-1], VALUES[-1])


def test_stretched_curve_has_the_same_path():
    found = curve().stretched(3.0)
    np.testing.assert_allclose(found.value(100.0 + 3.0 * 0.35), curve().value(100.35))
    np.testing.assert_allclose(3.0 * found.rate(100.0 + 3.0 * 0.35), curve().rate(100.35))


def test_curve_without_past_is_the_same_from_there_on():
    found = curve().without_past(100.5)
    assert len(found.breaks) == 3
    np.testing.assert_array_equal(found.value(100.5), curve().value(100.5))
