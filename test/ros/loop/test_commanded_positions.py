# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Last positions of a robot: they count while it stays there, and no longer if it is moved."""

import math

import numpy as np
import pytest
from tp_controller.ros.loop.commanded_positions import CommandedPositions

STILL = np.array([0.5, -1.0])


def stopped(*endless):
    """Return the last positions of two joints."""
    subject = CommandedPositions(np.array(endless or (False, False)))
    subject.move(STILL, 10.0)
    return subject


def watch(subject, *errors, began=10.0, period=0.01):
    """Watch measured positions that differ from the commanded ones."""
    for step, error in enumerate(errors, 1):
        subject.watch(STILL - error, began + step * period)


def test_a_robot_that_comes_to_rest_with_a_lag_stays_stopped():
    subject = stopped()
    watch(subject, *(0.3 * math.exp(-0.01 * step / 0.15) for step in range(200)))
    assert subject.positions is STILL


def test_each_motion_may_end_with_a_lag():
    subject = stopped()
    watch(subject, *[0.0] * 10)
    subject.move(STILL, 11.0)
    watch(subject, 0.3, 0.2, 0.1, began=11.0)
    assert subject.positions is STILL


def test_a_steady_error_of_the_drives_stays_commanded_for_ever():
    subject, random = stopped(), np.random.default_rng(0)
    watch(subject, *(np.array([0.05, -0.03]) + 1e-3 * random.standard_normal(2)
                     for _ in range(2000)))
    np.testing.assert_array_equal(subject.start(STILL - 0.05), STILL)


@pytest.mark.parametrize('direction', [-1.0, 1.0])
def test_a_robot_that_is_moved_is_forgotten_and_starts_where_it_is(direction):
    subject = stopped()
    watch(subject, *(np.array([0.0, direction * 0.002 * step]) for step in range(12)))
    assert subject.positions is None
    np.testing.assert_array_equal(subject.start(STILL + 0.3), STILL + 0.3)
    np.testing.assert_array_equal(subject.ahead(STILL), [0.0, 0.0])


@pytest.mark.parametrize('error, kept', [(0.019, True), (0.021, False)])
def test_a_robot_that_was_not_seen_for_a_while_has_to_be_where_it_was_commanded(error, kept):
    subject = stopped()
    watch(subject, error, began=3600.0)
    assert (subject.positions is not None) == kept


def test_positions_count_only_while_the_robot_is_seen():
    subject = stopped()
    assert subject.is_seen(10.4) and not subject.is_seen(10.6) and not subject.is_seen(9.9)
    subject.watch(STILL, 20.0)
    assert subject.is_seen(20.4)
    subject.lose_sight()
    assert not subject.is_seen(20.4)
    subject.watch(STILL, 20.4)
    assert subject.is_seen(20.4) and subject.positions is STILL


def test_an_error_from_before_a_pause_is_remembered():
    subject = stopped()
    watch(subject, *[0.04] * 10)
    watch(subject, 0.05, began=100.0)
    assert subject.positions is not None
    watch(subject, 0.061, began=200.0)
    assert subject.positions is None


def test_whole_turns_are_no_distance_for_joints_that_turn_without_end():
    subject = stopped(True, False)
    measured = STILL + np.array([-2.0 * math.pi - 0.01, 0.01])
    np.testing.assert_allclose(subject.ahead(measured), [0.01, -0.01], atol=1e-12)
    # The tasks see the turn that is measured, the drives the one that was commanded.
    np.testing.assert_allclose(subject.near(measured), [STILL[0] - 2.0 * math.pi, STILL[1]])
    np.testing.assert_array_equal(subject.start(measured), STILL)
    subject.forget()
    np.testing.assert_allclose(subject.start(measured), [STILL[0] - 0.01, STILL[1] + 0.01])
