# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Ranges of orientations, compared with rotation vectors of scipy."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from scipy.spatial.transform import Rotation
from tp_controller import Controller, Settings, solve_position, Stack
from tp_controller.tasks import OrientationRange

SEEDS = st.integers(0, 2 ** 32 - 1)
TOOL, ELBOW = robots.PANDA_TOOL, 'panda_link4'


@given(seed=SEEDS)
def test_errors_are_the_ways_back_about_axes_of_the_goal(seed):
    rng, robot = np.random.default_rng(seed), robots.panda()
    state = robot.state(rng.uniform(robot.lower, robot.upper))
    desired = Rotation.random(random_state=rng)
    task = OrientationRange(robot, 'task', frame=TOOL, reference=ELBOW, axes='zx',
                            minimum=[-0.4, -0.3], maximum=[0.2, 1.0],
                            target=desired.as_quat().tolist())
    frame, reference = (Rotation.from_matrix(state.rotation(name)) for name in (TOOL, ELBOW))
    turn = (desired.inv() * reference.inv() * frame).as_rotvec()
    # In the order of x, y, z, and with bounds in this order.
    np.testing.assert_allclose(task.value(state), turn[[0, 2]], atol=1e-6)
    expected = np.clip(turn[[0, 2]], [-0.4, -0.3], [0.2, 1.0]) - turn[[0, 2]]
    np.testing.assert_allclose(task.error(state), expected, atol=1e-6)


def test_goal_at_the_start_is_the_orientation_there():
    robot = robots.panda()
    state = robot.state(robots.PANDA_READY)
    task = OrientationRange(robot, 'task', frame=TOOL, maximum=0.1)
    task.start(state)
    assert task.has_default_goal
    np.testing.assert_allclose(task.value(state), 0.0, atol=1e-9)
    np.testing.assert_allclose(task.goal_pose(state), state.pose(TOOL), atol=1e-12)


def test_turn_stays_continuous_past_half_a_turn():
    robot = robots.panda()
    task = OrientationRange(robot, 'task', frame=TOOL, axes='z', maximum=0.3)
    state = robot.state(robots.PANDA_READY)
    turns = []
    for angle in (np.pi - 0.02, np.pi + 0.02):
        turn = Rotation.from_rotvec([0.0, 0.0, -angle]).as_matrix()
        # Not as a new goal, which is approached the shorter way.
        task.goal = state.rotation(TOOL) @ turn
        turns.append(task.value(state)[0])
    np.testing.assert_allclose(turns, [np.pi - 0.02, np.pi + 0.02], atol=1e-6)


def test_evaluation_remembers_the_way_past_half_a_turn():
    robot = robots.panda()
    task = OrientationRange(robot, 'task', frame=TOOL, axes='z', maximum=0.3)
    state = robot.state(robots.PANDA_READY)
    for angle in (np.pi - 0.02, np.pi + 0.02):
        task.goal = state.rotation(TOOL) @ Rotation.from_rotvec([0.0, 0.0, -angle]).as_matrix()
        assert task.evaluate(state, 0.0).error == pytest.approx([0.3 - angle], abs=1e-6)


@pytest.mark.parametrize('noise', [0.0, 1e-4])
def test_frame_half_a_turn_away_comes_back_the_way_it_began(noise):
    robot, rng = robots.panda(), np.random.default_rng(1)
    q = np.array(robots.PANDA_READY)
    stack = Stack.from_yaml(
        f'- range: {{type: orientation_range, frame: {TOOL}, maximum: 0.3, return_speed: 1.0}}\n'
        '- posture: {type: posture, gain: 0.1}\n', robot)
    controller = Controller(robot, stack, Settings(period=0.01))
    controller.update(q, 0.0)
    half = Rotation.from_rotvec([0.0, 0.0, np.pi]).as_matrix()
    controller.set_goal('range', robot.state(q).rotation(TOOL) @ half, 0.0)
    task, angles = stack.tasks['range'].probe(), []
    for cycle in range(1500):
        q = q + 0.01 * controller.update(q + noise * rng.normal(size=7), 0.01 * cycle).velocity
        angles.append(np.linalg.norm(task.value(robot.state(q))))
    assert angles[0] > 3.0 and angles[-1] < 0.3 * np.sqrt(3.0) + 1e-3
    assert np.diff(angles).max() < 1e-2


def test_inverse_kinematics_keeps_the_orientation_in_its_range():
    robot = robots.panda()
    stack = Stack.from_yaml(
        f'- range: {{type: orientation_range, frame: {TOOL}, maximum: [0.1, 0.1, 3.0], '
        f'target: [1, 0, 0, 0]}}\n- tool: {{type: position, frame: {TOOL}}}\n', robot)
    goal = [0.45, 0.25, 0.3]
    found = solve_position(robot, stack, goals={'tool': goal}, start=robots.PANDA_READY)
    state = robot.state(found.q)
    turn = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]).T @ state.rotation(TOOL)).as_rotvec()
    assert found.reached and (np.abs(turn[:2]) < 0.1 + 1e-4).all()
    np.testing.assert_allclose(state.position(TOOL), goal, atol=1e-3)
