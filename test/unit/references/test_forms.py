# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals as vectors: poses, rotations, and joints without end."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tp_controller.model.spatial import pose
from tp_controller.references.curve import through
from tp_controller.references.forms import FORMS, joints_form

RNG = np.random.default_rng(5)
STEP = 1e-6


def goals(kind, count):
    """Return goals of a form."""
    turns = Rotation.random(count, random_state=7).as_matrix()
    return {'point': RNG.normal(size=(count, 3)), 'quaternion': turns,
            'pose': np.array([pose(turn, place) for turn, place in zip(
                turns, RNG.normal(size=(count, 3)))])}[kind]


@pytest.mark.parametrize('kind', FORMS)
def test_goal_of_a_vector_is_the_goal(kind):
    form = FORMS[kind]
    for goal in goals(kind, 5):
        vector = form.flatten(goal)
        assert vector.shape == (form.size,)
        np.testing.assert_allclose(form.goal(vector), goal, atol=1e-12)


@pytest.mark.parametrize('kind', FORMS)
def test_velocity_is_the_twist_of_the_goal(kind):
    form = FORMS[kind]
    curve = through(np.arange(4.0), form.continuous(
        np.array([form.flatten(goal) for goal in goals(kind, 4)])))
    for time in (0.2, 1.4, 2.9):
        before, after = (form.goal(curve.value(time + shift)) for shift in (-STEP, STEP))
        twist = form.velocity(curve.value(time), curve.rate(time))
        if kind != 'quaternion':
            places = [goal if kind == 'point' else goal[:3, 3] for goal in (before, after)]
            np.testing.assert_allclose(twist[:3], (places[1] - places[0]) / (2.0 * STEP),
                                       atol=1e-6)
        if kind != 'point':
            turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
            np.testing.assert_allclose(twist[3:], turn / (2.0 * STEP), atol=1e-5)


@pytest.mark.parametrize('kind', FORMS)
def test_rate_is_the_inverse_of_the_velocity(kind):
    form = FORMS[kind]
    value, twist = form.flatten(goals(kind, 1)[0]), RNG.normal(size=6)
    twist[:3] *= kind != 'quaternion'
    twist[3:] *= kind != 'point'
    np.testing.assert_allclose(form.velocity(value, form.rate(value, twist)), twist, atol=1e-12)


def test_distances_are_those_of_place_and_turn():
    form, turn = FORMS['pose'], np.array([0.0, 1.5, 0.0])
    values = form.continuous(np.array([
        form.flatten(pose(np.eye(3), [0.0, 0.0, 0.0])),
        form.flatten(pose(Rotation.from_rotvec(turn).as_matrix(), [3.0, 4.0, 0.0]))]))
    found = form.distances(values)
    assert found['m'] == pytest.approx([5.0])
    assert found['rad'] == pytest.approx([1.5])


def test_speed_of_a_quaternion_of_any_norm_is_that_of_its_turn():
    form, twist = FORMS['quaternion'], np.array([0.0, 0.0, 0.0, 0.3, -0.4, 1.2])
    value = form.flatten(Rotation.from_rotvec([0.4, 0.2, 0.1]).as_matrix())
    rate = form.rate(value, twist)
    for scale in (1.0, 0.8):
        found = form.sizes(scale * value[np.newaxis], scale * (rate + 3.0 * value)[np.newaxis])
        assert found['rad'] == pytest.approx([1.3])


def test_quaternions_and_angles_go_on_by_the_shorter_way():
    turns = FORMS['quaternion'].continuous(np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.6, -0.8],
                                                     [0.0, 0.0, 0.7, -0.7]]))
    np.testing.assert_array_equal(turns[1:, 3], [0.8, 0.7])
    joints = joints_form(('rad', 'm'), np.array([True, False]))
    found = joints.continuous(np.array([[3.0, 9.0], [-3.0, 0.0]]))
    np.testing.assert_allclose(found, [[3.0, 9.0], [2.0 * np.pi - 3.0, 0.0]])
    factors, shift = joints.nearest(np.array([-3.0, 0.0]), np.array([13.0, 9.0]))
    np.testing.assert_allclose(factors, np.ones(2))
    np.testing.assert_allclose(shift, [6.0 * np.pi, 0.0])


def test_joints_have_a_speed_in_each_unit():
    joints = joints_form(('rad', 'm', 'rad'), np.zeros(3, dtype=bool))
    found = joints.sizes(np.zeros((1, 3)), np.array([[0.5, -0.2, -0.7]]))
    assert {unit: size.tolist() for unit, size in found.items()} == {'rad': [0.7], 'm': [0.2]}
