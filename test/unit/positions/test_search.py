# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A search: one descent after the other, until the needed levels are met."""

import numpy as np
import pytest
import robots
from tp_controller import Stack
from tp_controller.positions.compiled import Searches
from tp_controller.positions.descent import Descent, MET
from tp_controller.positions.position_stack import PositionStack
from tp_controller.positions.random_postures import random_postures
from tp_controller.positions.search import Attempts, finish, improves, is_better, search
from tp_controller.solver.compiled import core

TOOL = robots.PANDA_TOOL


@pytest.mark.parametrize(('costs', 'others', 'expected'), [
    ([0.0, 2.0], [0.0, 1.0], False), ([0.0, 1.0], [0.0, 2.0], True),
    ([1.0, 0.0], [0.5, 9.0], False), ([0.5, 9.0], [1.0, 0.0], True),
    ([1e-15, 1.0], [0.0, 2.0], True), ([1.0005, 1.0], [1.0, 2.0], True),
    ([1.0, 1.0], [1.0, 1.0], False), ([], [], False)])
def test_first_cost_that_differs_decides(costs, others, expected):
    assert is_better(costs, others) == expected


@pytest.mark.parametrize(('costs', 'others', 'expected'), [
    ([0.0, 1.0], [0.0, 2.0], True), ([0.0, 2.0], [0.0, 1.0], False),
    ([0.5, 9.0], [1.0, 0.0], True), ([1.0, 1.0], [1.0, 1.0], False),
    # Less than the tolerance is left, and more is not.
    ([1.0000009, 1.0], [1.0, 2.0], True), ([1.00001, 1.0], [1.0, 2.0], False),
    ([1e-13, 1.0], [0.0, 2.0], True), ([1e-12, 1.0], [0.0, 2.0], False),
    ([0.9999, 2.0], [1.0, 1.0], False), ([], [], False)])
def test_no_level_above_gets_worse_for_one_below(costs, others, expected):
    assert improves(costs, others) == expected


def scene(goal, below=''):
    """Return tasks with a goal of the tool, others below it, and a descent."""
    robot = robots.panda()
    tasks = PositionStack(robot, Stack.from_yaml(
        f'- tool: {{type: position, frame: {TOOL}}}\n' + below, robot))
    task = tasks.stack.tasks['tool']
    task.goal = task.parse_goal(goal)
    return tasks, Descent(tasks, robot, lambda: False)


def test_search_ends_where_the_goal_is_reached():
    tasks, descent = scene([0.4, 0.1, 0.5])
    ready = np.array(robots.PANDA_READY)
    found, = search(tasks, descent, 1, iter([ready, ready + 0.1]))
    assert found.descents == 1
    assert found.costs[0] <= MET


def test_as_many_configurations_as_wanted_are_found():
    tasks, descent = scene([0.4, 0.1, 0.5])
    starts = random_postures(tasks.robot, tasks.robot.neutral(), np.random.default_rng(0), 20)
    each = [found for start in starts for found in search(tasks, descent, 1, [start])
            if found.meets(1)]
    found = search(tasks, descent, 1, starts, 3)
    assert len(each) > 3
    np.testing.assert_array_equal([one.q for one in found], [one.q for one in each[:3]])
    all_of_them = search(tasks, descent, 1, starts, 100)
    assert [one.q.tolist() for one in all_of_them] == [one.q.tolist() for one in each]
    assert {one.descents for one in all_of_them} == {20}


def test_levels_below_those_that_are_met_have_the_least_error():
    tasks, descent = scene([0.4, 0.1, 0.5], '- posture: {type: posture}\n')
    task = tasks.stack.tasks['posture']
    task.goal = np.array(robots.PANDA_READY) + 0.3
    found, = search(tasks, descent, 1, [np.array(robots.PANDA_READY)])
    descent.begin()
    again = descent.finish(tasks.at(found.q))
    assert found.costs[1] > 1e-4
    np.testing.assert_allclose(again.costs[1], found.costs[1], rtol=1e-6)


def test_best_of_all_descents_is_returned():
    tasks, descent = scene([2.0, 0.0, 0.3])
    starts = np.random.default_rng(0).uniform(tasks.robot.lower, tasks.robot.upper, (6, 7))
    each = [search(tasks, descent, 1, [start])[0] for start in starts]
    found, = search(tasks, descent, 1, starts)
    assert found.descents == 6
    best = min(each, key=lambda one: one.costs[0])
    assert found.costs[0] <= best.costs[0] * 1.002
    np.testing.assert_array_equal(found.q, next(
        one.q for one in each if one.costs == found.costs))


@pytest.mark.skipif(core is None, reason='the package was built without a compiler')
def test_descents_from_nearby_leave_a_saddle_point():
    # Stretched away from the goal, no motion of a joint changes the distance at first.
    robot = robots.planar()
    tasks = PositionStack(robot, Stack.from_yaml(
        '- tip: {type: position, frame: link3, axes: xy}\n', robot))
    task = tasks.stack.tasks['tip']
    task.goal = task.parse_goal([-5.0, 0.0, 0.0])
    descent, point = Descent(tasks, robot, lambda: False), tasks.at(np.zeros(3))
    reach = np.linalg.norm(robot.state(np.zeros(3)).position('link3'))
    assert descent.finish(point) is point
    searches = Searches(robot, tasks)
    searches.begin(robot.passive_neutral)
    assert searches._compiled.fit
    for found in (finish(tasks, descent, point),
                  searches.finish(Attempts(point.q, point.costs, 1), np.inf)):
        assert found.costs[0] == pytest.approx((5.0 - reach) ** 2, rel=1e-4)


def test_no_descent_follows_where_all_levels_are_met():
    tasks, descent = scene([0.4, 0.1, 0.5])
    point = descent.approach(tasks.at(np.array(robots.PANDA_READY)), 1)
    descent.approach = None
    assert finish(tasks, descent, point) is point
