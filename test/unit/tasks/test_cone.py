# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Angles of cones, compared with rotations of scipy; where an axis is aligned and opposite."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from scipy.spatial.transform import Rotation
from tp_controller import Controller, Settings, Stack
from tp_controller.tasks import FieldOfView, Tilt

SEEDS = st.integers(0, 2 ** 32 - 1)
TOOL, ELBOW = robots.PANDA_TOOL, 'panda_link4'


def random_state(rng):
    """Return a random state of the Panda."""
    robot = robots.panda()
    return robot.state(rng.uniform(robot.lower, robot.upper))


def opposite(state, axis):
    """Return the direction opposite to an axis of the tool (3,)."""
    return -state.rotation(TOOL).dot(axis)


@given(seed=SEEDS, within=st.floats(0.01, 3.1))
def test_tilt_is_the_angle_between_two_directions_of_the_reference(seed, within):
    rng = np.random.default_rng(seed)
    state, (axis, direction) = random_state(rng), rng.normal(size=(2, 3))
    task = Tilt(robots.panda(), 'task', frame=TOOL, reference=ELBOW, axis=axis.tolist(),
                direction=direction.tolist(), within=within)
    task.start(state)
    turn = Rotation.from_matrix(state.rotation(ELBOW)).inv() * Rotation.from_matrix(
        state.rotation(TOOL))
    cosine = direction @ turn.apply(axis) / np.linalg.norm(axis) / np.linalg.norm(direction)
    angle = math.acos(cosine)
    assert task.angle(state) == pytest.approx(angle, abs=1e-7)
    assert task.error(state) == pytest.approx([min(within - angle, 0.0)], abs=1e-7)
    # Near the edge and outside, the value is the angle itself.
    if angle > 0.5 * within:
        assert task.value(state) == pytest.approx([angle], abs=1e-7)
    else:
        assert angle <= task.value(state)[0] <= 0.5 * within


def test_tilt_without_a_direction_is_that_against_z_of_the_reference():
    state = robots.panda().state(robots.PANDA_READY)
    for reference in (None, ELBOW):
        task = Tilt(robots.panda(), 'task', frame=TOOL, within=0.1, reference=reference)
        task.start(state)
        z = state.rotation(task.reference)[:, 2]
        assert math.cos(task.angle(state)) == pytest.approx(state.rotation(TOOL)[:, 2] @ z)


@given(seed=SEEDS, distance=st.floats(1e-9, 1e-3), within=st.floats(0.05, 1.0))
def test_rows_change_no_faster_than_the_axis_where_it_is_aligned(seed, distance, within):
    """The gradient of the angle itself turns round there."""
    rng = np.random.default_rng(seed)
    state = random_state(rng)
    tasks = (Tilt(robots.panda(), 'tilt', frame=TOOL, within=within),
             FieldOfView(robots.panda(), 'view', frame=TOOL, half_angle=within))
    for task, goal in zip(tasks, (-opposite(state, task_axis := np.eye(3)[2]),
                                  state.position(TOOL) - opposite(state, task_axis))):
        task.set_goal(task.parse_goal(goal), 0.0)
        step = distance * rng.normal(size=7) / math.sqrt(7)
        rows = [task.jacobian(robots.panda().state(state.q + sign * step)) for sign in (-1, 0, 1)]
        np.testing.assert_allclose(rows[1], 0.0, atol=1e-6)
        for row in rows:
            assert np.linalg.norm(row) < 20.0 * np.linalg.norm(step) / within + 1e-6


@pytest.mark.parametrize('entry', [
    'type: tilt, within: 0.2', 'type: field_of_view, half_angle: 0.2'])
@pytest.mark.parametrize('noise', [0.0, 1e-4])
def test_axis_that_points_the_other_way_turns_round_without_swinging(entry, noise):
    robot, rng = robots.panda(), np.random.default_rng(1)
    q, axis = np.array(robots.PANDA_READY), np.eye(3)[2]
    state = robot.state(q)
    stack = Stack.from_yaml(f'- guard: {{{entry}, frame: {TOOL}, return_speed: 1.0}}\n'
                            '- posture: {type: posture, gain: 0.1}\n', robot)
    task = stack.tasks['guard']
    away = opposite(state, axis)
    controller = Controller(robot, stack, Settings(period=0.01))
    controller.update(q, 0.0)
    controller.set_goal('guard', away if task.goal_type == 'direction' else
                        state.position(TOOL) + 3.0 * away, 0.0)
    angles = []
    for cycle in range(1500):
        q = q + 0.01 * controller.update(q + noise * rng.normal(size=7), 0.01 * cycle).velocity
        angles.append(task.angle(robot.state(q)))
    assert angles[0] > 3.0 and angles[-1] < 0.2 + 1e-3
    # It never turns back by more than the noise.
    assert np.diff(angles).max() < 1e-3
