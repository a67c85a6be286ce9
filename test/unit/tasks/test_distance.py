# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Distances between frames, compared with poses that scipy composes."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Controller, Settings, Stack
from tp_controller.tasks import Distance

SEEDS = st.integers(0, 2 ** 32 - 1)
TOOL, ELBOW = robots.PANDA_TOOL, 'panda_link4'


@given(seed=SEEDS, least=st.floats(0.01, 0.6), more=st.floats(0.01, 0.6))
def test_error_is_the_way_back_between_the_bounds(seed, least, more):
    rng, robot = np.random.default_rng(seed), robots.panda()
    state, at = robot.state(rng.uniform(robot.lower, robot.upper)), rng.normal(size=3)
    task = Distance(robot, 'task', frame=TOOL, reference=ELBOW, at=at.tolist(), minimum=least,
                    maximum=least + more)
    task.start(state)
    T = np.linalg.inv(state.pose(ELBOW)) @ state.pose(TOOL)
    distance = np.sqrt(((T[:3, 3] - at) ** 2).sum())
    assert task.value(state) == pytest.approx([distance])
    expected = least - distance if distance < least else min(least + more - distance, 0.0)
    assert task.error(state) == pytest.approx([expected])


def test_frame_and_point_need_no_other_key_than_one_bound():
    robot = robots.panda()
    state = robot.state(robots.PANDA_READY)
    task = Distance(robot, 'task', frame=TOOL, maximum=1.0)
    task.start(state)
    assert task.value(state) == pytest.approx([np.linalg.norm(state.position(TOOL))])
    assert (task.lower, task.upper) == (-np.inf, 1.0)


@pytest.mark.parametrize('noise', [0.0, 1e-5])
def test_frame_that_starts_at_the_point_leaves_it_for_good(noise):
    """The direction away from it is arbitrary there, but one."""
    robot, rng = robots.panda(), np.random.default_rng(0)
    q = np.array(robots.PANDA_READY)
    place = robot.state(q).position(TOOL)
    stack = Stack.from_yaml(f'- apart: {{type: distance, frame: {TOOL}, at: {place.tolist()}, '
                            'minimum: 0.1}\n- posture: {type: posture, gain: 0.1}\n', robot)
    controller, distances = Controller(robot, stack, Settings(period=0.01)), []
    for cycle in range(300):
        q = q + 0.01 * controller.update(q + noise * rng.normal(size=7), 0.01 * cycle).velocity
        distances.append(np.linalg.norm(robot.state(q).position(TOOL) - place))
    assert distances[-1] == pytest.approx(0.1, abs=1e-4)
    assert np.diff(distances).min() > -1e-4


def test_frame_passes_through_the_point_inside_of_a_largest_distance():
    robot, q = robots.panda(), np.array(robots.PANDA_READY)
    place = robot.state(q).position(TOOL)
    stack = Stack.from_yaml(f"""
- near: {{type: distance, frame: {TOOL}, at: {place.tolist()}, maximum: 0.2}}
- tool: {{type: position, frame: {TOOL}}}
""", robot)
    controller, ways = Controller(robot, stack, Settings(period=0.01)), []
    controller.update(q, 0.0)
    for side in (-0.15, 0.15):
        controller.set_goal('tool', place + [0.0, side, 0.0], 0.0)
        for cycle in range(600):
            q = q + 0.01 * controller.update(q, 0.01 * cycle).velocity
            ways.append(robot.state(q).position(TOOL) - place)
    assert ways[-1] == pytest.approx([0.0, 0.15, 0.0], abs=1e-3)
    assert np.linalg.norm(ways, axis=1).max() < 0.2


def test_goal_is_a_point_of_any_frame():
    robot = robots.panda()
    q = np.array(robots.PANDA_READY)
    stack = Stack.from_yaml(f'- span: {{type: distance, frame: {TOOL}, reference: {ELBOW}, '
                            'maximum: 0.5}\n', robot)
    controller, state = Controller(robot, stack, Settings(period=0.01)), robot.state(q)
    controller.update(q, 0.0)
    controller.set_goal('span', [0.3, 0.2, 0.1], 0.0, frame='panda_link2')
    point = (state.pose('panda_link2') @ [0.3, 0.2, 0.1, 1.0])[:3]
    assert stack.tasks['span'].value(state) == pytest.approx(
        [np.linalg.norm(state.position(TOOL) - point)])
