# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Chunks of a stream become one motion: late, overlapping, out of order, or far away."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tp_controller.references.curve import through
from tp_controller.references.forms import FORMS, joints_form
from tp_controller.references.reference import (
    chunk_at_speed,
    chunk_of,
    goal_at,
    JOIN_SPEED,
    JOIN_TIME,
    peaks,
    Reference,
)
from tp_controller.solver.compiled import core

POINT, POSE, TURN = FORMS['point'], FORMS['pose'], FORMS['quaternion']


def path(times):
    """Return points of a path."""
    times = np.asarray(times)
    return np.stack((np.cos(times), np.sin(2.0 * times), times), axis=-1)


def at_rest(value, now=0.0, form=POINT):
    """Return a reference at rest."""
    return Reference.braking(form, np.stack((value, *np.zeros((2, form.size)))), now)


def stream(chunks):
    """Return the reference after {arrival: times} of the path."""
    found = at_rest(path(0.0))
    for now, times in chunks:
        found = found.followed_by(chunk_of(POINT, np.asarray(times), path(times)), now)
    return found


def jumps(curve, times):
    """Return the largest jumps of value, velocity and acceleration over short times."""
    states = np.array([[curve.state(time), curve.state(time + 1e-7)] for time in times])
    return np.abs(states[:, 1] - states[:, 0]).max(axis=(0, 2))


def breaks_of(curve, since=0.0):
    """Return times just before the breaks of a curve, but its last one."""
    return [time - 5e-8 for time in curve.breaks[:-1] if time > since]


def test_motion_starts_at_rest_and_is_the_chunk_after_the_join():
    found = stream([(0.0, np.arange(0.0, 3.0, 0.05))])
    np.testing.assert_array_equal(found.curve.value(0.0), path(0.0))
    np.testing.assert_allclose(found.curve.rate(0.0), np.zeros(3), atol=1e-9)
    np.testing.assert_allclose(found.curve.value(2.0), path(2.0), atol=1e-6)
    assert jumps(found.curve, breaks_of(found.curve)).max() < 1e-3


def test_chunk_that_begins_later_is_approached_in_the_time_left():
    found = stream([(0.0, np.arange(1.0, 3.0, 0.05))])
    np.testing.assert_allclose(found.curve.value(1.0), path(1.0), atol=1e-9)
    assert jumps(found.curve, breaks_of(found.curve)).max() < 1e-3


def test_overlapping_chunk_replaces_the_motion_from_its_start_without_a_jump():
    first, times = stream([(0.0, np.arange(0.0, 3.0, 0.05))]), np.arange(1.5, 4.0, 0.05)
    found = first.followed_by(chunk_of(POINT, times, path(times) + 0.02), 1.0)
    np.testing.assert_allclose(found.curve.value(1.49), first.curve.value(1.49))
    np.testing.assert_allclose(found.curve.value(1.5 + JOIN_TIME),
                               path(1.5 + JOIN_TIME) + 0.02, atol=1e-6)
    assert jumps(found.curve, breaks_of(found.curve, 1.0)).max() < 1e-3


def test_chunks_of_one_path_are_that_path_whatever_their_overlap():
    arrivals = [(0.1 * i, np.arange(0.1 * i - 0.05, 0.1 * i + 1.2, 0.04)) for i in range(1, 20)]
    found = stream([(0.0, np.arange(0.0, 1.5, 0.04)), *arrivals])
    for time in np.linspace(1.9, 2.5, 30):
        np.testing.assert_allclose(found.curve.value(time), path(time), atol=2e-5)


def test_late_chunk_replaces_from_now_on_and_a_past_one_is_refused():
    first, times = stream([(0.0, np.arange(0.0, 3.0, 0.05))]), np.arange(0.5, 4.0, 0.05)
    found = first.followed_by(chunk_of(POINT, times, path(times) + 0.02), 1.0)
    np.testing.assert_allclose(found.curve.state(1.0), first.curve.state(1.0), atol=1e-9)
    np.testing.assert_allclose(found.curve.value(2.0), path(2.0) + 0.02, atol=1e-6)
    with pytest.raises(ValueError, match='it ended 0.55 s ago'):
        first.followed_by(chunk_of(POINT, times[:-60], path(times[:-60])), 1.5)


def test_chunk_that_was_overtaken_is_refused():
    found = stream([(0.0, np.arange(0.0, 2.0, 0.05)), (0.6, np.arange(0.5, 3.0, 0.05))])
    times = np.arange(0.4, 2.5, 0.05)
    with pytest.raises(ValueError, match='0.1 s before the one that runs'):
        found.followed_by(chunk_of(POINT, times, path(times)), 0.7)


def test_chunk_replaces_one_that_still_waits():
    times = np.arange(0.4, 2.0, 0.05)
    found = stream([(0.0, np.arange(0.0, 2.0, 0.05)), (0.1, np.arange(1.5, 3.0, 0.05))])
    found = found.followed_by(chunk_of(POINT, times, path(times) + 1.0), 0.2)
    assert found.curve.end == pytest.approx(times[-1], abs=5.0)
    np.testing.assert_allclose(found.curve.value(8.0), path(times[-1]) + 1.0)


def test_far_chunk_is_joined_at_a_bounded_speed():
    times = np.arange(0.0, 9.0, 0.05)
    found = at_rest(np.zeros(3)).followed_by(
        chunk_of(POINT, times, np.tile([1.0, 0.0, 0.0], (len(times), 1))), 0.0)
    assert peaks(POINT, found.curve)['m'] == pytest.approx(JOIN_SPEED, rel=1e-2)


def test_single_value_is_reached_at_its_time_along_a_straight_line():
    goal = np.array([0.3, -0.4, 1.2])
    found = at_rest(np.zeros(3)).followed_by(
        chunk_of(POINT, np.array([2.0]), goal[np.newaxis]), 0.0)
    values, rates = found.curve.samples()
    np.testing.assert_allclose(np.cross(values, goal), np.zeros_like(values), atol=1e-12)
    assert found.curve.end == 2.0
    assert np.linalg.norm(rates, axis=1).max() == pytest.approx(1.875 * 1.3 / 2.0)


@pytest.mark.parametrize('angle', [0.1, 1.5, 3.1])
def test_speed_bounds_the_turn_as_well(angle):
    start = POSE.flatten(np.eye(4))
    end = np.eye(4)
    end[:3, :3] = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
    end[0, 3] = 0.2
    chunk = chunk_at_speed(POSE, np.array([start, POSE.flatten(end)]), {'m': 0.1, 'rad': 0.4}, 7.0)
    found = peaks(POSE, chunk.curve)
    assert max(found['m'] / 0.1, found['rad'] / 0.4) == pytest.approx(1.0, rel=1e-3)
    assert found['m'] <= 0.1 * 1.001
    assert found['rad'] <= 0.4 * 1.001
    np.testing.assert_allclose(POSE.goal(chunk.curve.value(chunk.end)), end, atol=1e-12)


def test_way_at_a_speed_leads_through_all_values():
    values = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    chunk = chunk_at_speed(POINT, values, {'m': 0.25}, 3.0)
    assert peaks(POINT, chunk.curve)['m'] == pytest.approx(0.25, rel=1e-3)
    found, _ = chunk.curve.samples()
    for value in values:
        assert np.linalg.norm(found - value, axis=1).min() < 1e-9


def test_turn_takes_the_shorter_way_from_any_norm():
    # A reference that turns back in the middle of a join has a quaternion of another norm.
    start = TURN.flatten(np.eye(3))
    goal = Rotation.from_rotvec([0.0, 0.0, 3.0])
    found = at_rest(start, form=TURN).followed_by(chunk_of(
        TURN, np.array([2.0]), TURN.flatten(goal.as_matrix())[np.newaxis]), 0.0)
    back = chunk_of(TURN, np.array([3.0]), -start[np.newaxis])
    after = found.followed_by(back, 1.0)
    for time in (1.0 - 1e-9, 1.0):
        np.testing.assert_allclose(TURN.goal(after.curve.value(time)),
                                   TURN.goal(found.curve.value(time)), atol=1e-8)
        np.testing.assert_allclose(
            TURN.velocity(after.curve.value(time), after.curve.rate(time)),
            TURN.velocity(found.curve.value(time), found.curve.rate(time)), atol=1e-7)
    assert np.linalg.norm(after.curve.value(1.0)) == pytest.approx(1.0)
    np.testing.assert_allclose(TURN.goal(after.curve.value(3.0)), np.eye(3), atol=1e-12)


def test_braking_ends_the_motion_without_a_jump():
    found = stream([(0.0, np.arange(0.0, 3.0, 0.05))])
    after = found.braked(1.0)
    np.testing.assert_allclose(after.curve.state(1.0), found.curve.state(1.0))
    assert after.is_over(1.0 + JOIN_TIME)
    assert not after.is_over(1.0)
    np.testing.assert_array_equal(after.curve.rate(2.0), np.zeros(3))


def test_progress_grows_from_0_to_1():
    found = stream([(0.0, np.arange(1.0, 5.01, 0.05))])
    assert [found.progress(time) for time in (-1.0, 0.0, 9.0)] == [0.0, 0.0, 1.0]
    assert found.progress(2.5) == pytest.approx(0.5, abs=1e-9)


# In the compiled core ---------------------------------------------------------------------------


EVERY = {**FORMS, 'joints': joints_form(('rad', 'm', 'rad', 'rad'), np.zeros(4, dtype=bool)),
         'six joints': joints_form(('rad',) * 6, np.zeros(6, dtype=bool))}


@pytest.mark.skipif(core is None, reason='the package was built without a compiler')
@pytest.mark.parametrize('name', EVERY)
def test_goal_of_the_core_is_that_of_the_reference(name, monkeypatch):
    form, rng = EVERY[name], np.random.default_rng(3)
    times = 1000.0 + np.cumsum(rng.uniform(0.05, 0.3, 12))
    curve = through(times, rng.normal(size=(12, form.size)))
    reference = Reference(form, curve, times[0], times[0], times[-1])
    # Before, between and after the values; the velocity may be that of the next piece.
    for now in (*rng.uniform(times[0] - 0.1, times[-1] + 0.1, 200), times[4] - 1e-3, times[-1]):
        found = reference.goal(now, 2e-3)
        expected = goal_at(form, curve, now, now + 2e-3)
        for this, that in zip(found, expected):
            assert this.shape == that.shape
            np.testing.assert_allclose(this, that, rtol=1e-12, atol=1e-12)
    # Without the core the reference is the same.
    monkeypatch.setattr('tp_controller.references.reference.core', None)
    assert all(map(np.array_equal, reference.goal(now, 2e-3), expected))


@pytest.mark.skipif(core is None, reason='the package was built without a compiler')
def test_core_takes_no_other_shapes():
    piece, fits = np.ones((6, 7)), (np.empty((4, 4)), np.empty(6))
    assert core.moving_goal(piece, 0.1, piece, 0.1, *fits) is True
    for faulty in ((piece[:5], 0.1, piece, 0.1, *fits), (piece, 0.1, np.ones((6, 4)), 0.1, *fits),
                   (piece, 'x', piece, 0.1, *fits), (piece, 0.1, None, 0.1, *fits),
                   (piece, 0.1, piece, 0.1, np.empty((3, 3)), fits[1]),
                   (piece, 0.1, piece, 0.1, fits[0], np.empty(3)),
                   (piece, 0.1, piece, 0.1, np.empty((4, 8))[:, ::2], fits[1]),
                   (piece.astype(int), 0.1, piece, 0.1, *fits)):
        assert core.moving_goal(*faulty) is False
    with pytest.raises(ValueError, match='moving_goal'):
        core.moving_goal(piece)
