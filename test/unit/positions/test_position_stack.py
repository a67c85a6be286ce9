# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks of a stack at a configuration: whole errors, and steps that a constant J predicts."""

import numpy as np
import pytest
import robots
from tp_controller import Stack
from tp_controller.positions.position_stack import linear_cost, PositionStack

TOOL = robots.PANDA_TOOL
TEXT = f"""
- cell: {{type: keep_in, frame: {TOOL}, shape: {{box: [0.2, 0.2, 0.2]}}, at: [0.4, 0, 0.4]}}
- tool: {{type: pose, frame: {TOOL}, gain: 3.0}}
- [one: {{type: joint, joints: panda_joint1}}, two: {{type: joint, joints: panda_joint2}}]
- slow: {{type: speed_limit, frame: {TOOL}, linear: 0.1}}
"""
READY = np.array(robots.PANDA_READY)


def at_positions(text=TEXT, robot=None):
    """Return the tasks of a stack at positions, started at the ready posture."""
    robot = robot or robots.panda()
    tasks = PositionStack(robot, Stack.from_yaml(text, robot))
    tasks.stack.start(tasks.place(READY[:robot.nq], robot.passive_neutral))
    return tasks


def test_costs_are_squared_errors_whatever_the_gain():
    tasks = at_positions()
    robot = tasks.robot
    q = READY + 0.1
    point = tasks.at(q)
    assert len(point.levels) == 3
    tool = tasks.stack.tasks['tool']
    np.testing.assert_allclose(point.levels[1].v, tool.error(robot.state(q)), atol=1e-12)
    assert point.costs[1] == pytest.approx(np.square(tool.error(robot.state(q))).sum())
    assert point.costs[2] == pytest.approx(2 * 0.1 ** 2)
    place = robot.state(q).position(TOOL) - [0.4, 0.0, 0.4]
    beyond = np.maximum(np.abs(place) - 0.1, 0.0)
    assert point.costs[0] == pytest.approx(np.square(beyond).sum())


def test_bounds_are_the_distances_that_are_left():
    tasks = at_positions()
    point = tasks.at(READY)
    place = tasks.robot.state(READY).position(TOOL) - [0.4, 0.0, 0.4]
    inside = np.abs(place) < 0.1
    level = point.levels[0]
    # Rows inside, in metres: not slowed, and not limited by a speed.
    assert level.upper[inside] == pytest.approx((0.1 - place)[inside])
    assert level.lower[inside] == pytest.approx((-0.1 - place)[inside])


def test_small_step_costs_what_a_constant_jacobian_predicts():
    tasks = at_positions()
    point = tasks.at(READY + 0.2)
    step = np.random.default_rng(0).normal(size=7)
    for level, error, cost in zip(point.levels, point.errors, point.costs):
        assert linear_cost(level, error, np.zeros(7)) == pytest.approx(cost)
        index = point.levels.index(level)
        size = 1e-5
        slope = (tasks.moved(point, size * step).costs[index] - cost) / size
        predicted = (linear_cost(level, error, size * step) - cost) / size
        assert slope == pytest.approx(predicted, abs=1e-3 * np.linalg.norm(step))


def test_moves_stay_within_position_limits():
    tasks = at_positions()
    moved = tasks.moved(tasks.at(READY), np.full(7, 100.0))
    np.testing.assert_array_equal(moved.q, tasks.robot.upper)


def test_stack_is_not_changed_and_nothing_of_the_past_counts():
    robot = robots.panda()
    stack = Stack.from_yaml(TEXT, robot)
    tasks = PositionStack(robot, stack)
    assert stack.tasks['tool'].gain == 3.0
    assert stack.tasks['tool'].goal is None
    tasks.stack.start(tasks.place(READY, robot.passive_neutral))
    assert stack.tasks['tool'].goal is None
    first = tasks.at(READY + 0.3)
    tasks.at(READY - 1.0)
    again = tasks.at(READY + 0.3)
    assert again.costs == first.costs
    np.testing.assert_array_equal(again.levels[0].lower, first.levels[0].lower)


def test_rotation_is_the_shorter_one_wherever_the_one_before_was():
    robot = robots.planar()
    tasks = at_positions('- turn: {type: orientation, frame: link3, axes: z}\n', robot)
    tasks.stack.tasks['turn'].goal = np.eye(3)
    for angle in (3.1, -3.1, 3.1):
        assert tasks.at(np.array([angle, 0.0, 0.0])).errors[0][0] == pytest.approx(-angle)


def test_far_outside_bounds_the_whole_way_back_counts():
    robot = robots.cartesian()
    tasks = at_positions('- cell: {type: keep_in, frame: z, shape: {box: [0.2, 0.2, 0.2]}}\n',
                         robot)
    point = tasks.at(np.array([1.6, 0.0, 0.0]))
    step = np.array([-0.4, 0.0, 0.0])
    assert point.costs[0] == pytest.approx(1.5 ** 2)
    assert linear_cost(point.levels[0], point.errors[0], step) == pytest.approx(1.1 ** 2)
    # One step need not go all the way.
    assert point.levels[0].upper[point.errors[0] < 0.0] == pytest.approx(-0.5)


def test_objectives_have_no_cost():
    tasks = at_positions('- tool: {type: position, frame: panda_hand_tcp}\n'
                         '- middle: {type: joint_limit_distance, gain: 0.1}\n'
                         f'- [agile: {{type: manipulability, frame: {TOOL}}}, '
                         'more: {type: joint_limit_distance}]\n')
    assert tasks.objectives == (False, True, True)
    assert tasks.at(READY + 0.1).costs[1:] == [0.0, 0.0]


def test_nothing_but_the_error_is_demanded():
    robot = robots.cartesian()
    stack = Stack.from_yaml('- cell: {type: keep_in, frame: z, shape: {box: [0.2, 0.2, 0.2]}, '
                            'return_speed: 0.01}\n- tip: {type: position, frame: z}\n', robot)
    stack.tasks['tip'].goal = np.array([0.5, 0.0, 0.0])
    stack.tasks['tip'].set_feed_forward(np.ones(6), 0.0)
    tasks = PositionStack(robot, stack)
    tasks.stack.start(tasks.place(robot.neutral(), robot.passive_neutral))
    point = tasks.at(np.array([0.3, 0.0, 0.0]))
    np.testing.assert_allclose(point.levels[1].v, [0.2, 0.0, 0.0], atol=1e-12)
    assert point.levels[0].upper[point.errors[0] < 0.0] == pytest.approx(-0.2)
