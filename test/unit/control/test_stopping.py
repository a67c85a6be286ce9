# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The stop of a joint with a bounded jerk: its closed form is the motion, integrated."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from tp_controller.control.stopping import StopLaw

JERKS, ACCELERATIONS = st.floats(5.0, 100.0), st.floats(0.5, 8.0)
TAILS = st.floats(0.01, 0.4)
# No tail: shorter than any time that matters.
NONE = 1e-9


def law_of(jerk, acceleration=1e3, period=0.0, tail=NONE):
    """Return the law of one joint."""
    return StopLaw(np.array([jerk]), np.array([acceleration]), period, tail)


def distance(law, velocity, acceleration=0.0):
    """Return the distance that one joint needs."""
    return float(law.distance(np.array([velocity]), np.array([acceleration]))[0])


def ease_off(velocity, jerk, acceleration, tail):
    """Return the deceleration of the last part of a stop, from its definition."""
    if velocity <= jerk * tail ** 2:
        return min(velocity / tail, acceleration)
    # v = j τ² + (b² − j² τ²)/(2 j), as the deceleration falls from b to j τ.
    return min(math.sqrt(2.0 * jerk * (velocity - jerk * tail ** 2) + (jerk * tail) ** 2),
               acceleration)


@pytest.mark.slow
@given(JERKS, ACCELERATIONS, TAILS, st.floats(0.02, 1.5), st.floats(-1.0, 1.0))
def test_the_closed_form_is_the_integral_of_the_law(jerk, most, tail, velocity, share):
    dt, position, v, a = 1e-4, 0.0, velocity, share * most
    a = max(a, -ease_off(v, jerk, most, tail))
    while v > 1e-4 or a > 0.0:
        after = max(a - jerk * dt, -ease_off(v, jerk, most, tail))
        middle = 0.5 * (a + after)
        position += dt * (v + 0.5 * dt * middle)
        v, a = v + dt * middle, after
    assert distance(law_of(jerk, most, tail=tail), velocity, share * most) == pytest.approx(
        position + max(v, 0.0) * tail, rel=1e-3, abs=1e-5)


@given(JERKS, ACCELERATIONS, TAILS, st.floats(0.0, 3.0))
def test_a_joint_eases_off_by_its_jerk_and_its_tail(jerk, most, tail, velocity):
    found = float(law_of(jerk, most, tail=tail).ease_off(np.array([velocity]))[0])
    assert found == pytest.approx(ease_off(velocity, jerk, most, tail), rel=1e-9)


def test_stops_worked_out_by_hand():
    # From 1 m/s with a jerk of 4 m/s³ alone: half a second to −2 m/s², half a second back.
    assert distance(law_of(4.0), 1.0) == pytest.approx(0.5)
    # At most 1 m/s²: 0.25 s, then 0.75 s of it, then 0.25 s; as long as with v/a + a/j.
    assert distance(law_of(4.0, 1.0), 1.0) == pytest.approx(0.5 * 1.25)
    # From 0.875 m/s and 1 m/s², 0.25 s later 1 m/s.
    assert distance(law_of(4.0, 1.0), 0.875, 1.0) == pytest.approx(
        0.625 + 0.25 * (0.875 + 0.125 - 1.0 / 24.0))
    # Along v = d/τ where that is the law.
    assert distance(law_of(4.0, tail=0.5), 0.3, -0.6) == pytest.approx(0.15)
    # A command is in force for a period: at the highest speed of the motion.
    assert distance(law_of(4.0, period=0.1), 1.0) == pytest.approx(0.6)
    assert distance(law_of(4.0, 1.0, period=0.1), 0.875, 1.0) - distance(
        law_of(4.0, 1.0), 0.875, 1.0) == pytest.approx(0.1)


def test_a_joint_that_does_not_go_forwards_needs_no_distance():
    law = law_of(4.0, 1.0, 0.1, 0.2)
    for velocity, acceleration in ((0.0, 0.0), (-1.0, 0.0), (-1.0, -1.0), (-0.2, 1.0)):
        assert distance(law, velocity, acceleration) <= 0.0
    # It has to be fast enough backwards: 1 m/s² more than 0.125 m/s of it.
    assert distance(law, -0.12, 1.0) > distance(law, -0.125, 1.0)


@given(JERKS, ACCELERATIONS, TAILS, st.floats(0.0, 2.0), st.floats(-1.0, 1.0),
       st.floats(0.0, 1.0))
def test_more_speed_or_acceleration_needs_no_less_distance(jerk, most, tail, velocity, share,
                                                           more):
    law = law_of(jerk, most, 0.01, tail)
    least = distance(law, velocity, share * most)
    assert distance(law, velocity + more, share * most) >= least - 1e-12
    assert distance(law, velocity, (share + more) * most) >= least - 1e-12
