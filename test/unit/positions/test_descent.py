# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A descent: levels above are kept, costs fall, and the region of trust follows the prediction."""

import numpy as np
import pytest
import robots
from tp_controller import Stack
from tp_controller.positions.descent import Descent, kept_cost, MET
from tp_controller.positions.position_stack import PositionStack
from tp_controller.positions.random_postures import random_postures

TOOL = robots.PANDA_TOOL
TEXT = (f'- tool: {{type: position, frame: {TOOL}}}\n'
        '- elbow: {type: position, frame: panda_link4}\n- posture: {type: posture}\n')


def scene(seed, text=TEXT, out_of_time=lambda: False):
    """Return tasks with goals of different postures, a descent, and a point."""
    robot = robots.panda()
    tasks = PositionStack(robot, Stack.from_yaml(text, robot))
    postures = random_postures(robot, robot.neutral(), np.random.default_rng(seed), 4)
    for task, q in zip(tasks.stack.active_tasks, postures):
        task.start(robot.state(q))
    # Near the posture of the first goal.
    return tasks, Descent(tasks, robot, out_of_time), tasks.at(tasks.within_limits(
        postures[0] + 0.2))


@pytest.mark.parametrize('seed', range(8))
def test_upper_levels_are_kept_while_lower_ones_are_reduced(seed):
    tasks, descent, point = scene(seed)
    first = descent.approach(point, 1)
    assert first.costs[0] <= MET
    last = descent.finish(first)
    assert last.costs[0] <= kept_cost(first.costs[0])
    assert last.costs[1] <= first.costs[1]
    # From the end nothing is left to reduce.
    descent.begin()
    again = descent.finish(last)
    for before, after in zip(last.costs, again.costs):
        assert after == pytest.approx(before, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize('seed', range(8))
def test_levels_that_fit_together_are_met_together(seed):
    tasks, descent, point = scene(seed, TEXT.partition('- posture')[0])
    robot = tasks.robot
    q = random_postures(robot, robot.neutral(), np.random.default_rng(seed), 1)[0]
    for task in tasks.stack.active_tasks:
        task.goal = None
        task.start(robot.state(q))
    assert sum(descent.approach(tasks.at(q + 0.2), 2).costs) <= MET


def test_levels_that_do_not_fit_together_are_met_in_order():
    left = []
    for seed in range(5):
        tasks, descent, point = scene(seed)
        found = descent.approach(point, 2)
        descent.begin()
        found = descent.finish(found)
        assert found.costs[0] <= kept_cost(MET)
        left.append(found.costs[1])
    assert max(left) > 1e-3


def test_nothing_is_done_without_time():
    tasks, descent, point = scene(0, out_of_time=lambda: True)
    assert descent.approach(point, 1) is point
    assert descent.finish(point) is point


def test_steps_of_a_descent_are_counted(monkeypatch):
    monkeypatch.setattr('tp_controller.positions.descent.MOST_STEPS', 2)
    tasks, descent, point = scene(1)
    once = descent.approach(point, 1)
    assert descent.approach(once, 1) is once
    descent.begin()
    assert descent.approach(once, 1).costs[0] < once.costs[0]


@pytest.mark.parametrize('kind', ['joint_limit_distance', f'manipulability, frame: {TOOL}'])
def test_objective_has_its_maximum_below_the_tasks_above(kind):
    text = f'- tool: {{type: pose, frame: {TOOL}}}\n- best: {{type: {kind}}}\n'
    counted, gained = 0, 0.0
    for seed in range(6):
        tasks, descent, point = scene(seed, text)
        task, tool = (tasks.stack.tasks[name] for name in ('best', 'tool'))
        robot = tasks.robot
        tool.goal = tool.value(robot.state(point.q))
        found = descent.finish(tasks.at(point.q))
        assert found.costs[0] <= kept_cost(MET)

        # Along the motion that keeps the pose the demand of the objective is zero.
        free = (found.q > robot.lower + 1e-6) & (found.q < robot.upper - 1e-6)
        _, singular, rows = np.linalg.svd(robot.state(found.q).jacobian(TOOL)[:, free])
        demand = task.error(robot.state(found.q))[free]
        if free.all() and singular[-1] > 0.02:
            assert abs(rows[-1] @ demand) <= 1e-3 * np.linalg.norm(demand)
            counted += 1
        gained += task.value(robot.state(found.q))[0] - task.value(robot.state(point.q))[0]
    assert counted
    assert gained > 0.1


def test_goal_at_a_fold_is_reached():
    # Stretched, no motion leads the tip towards its base at first.
    robot = robots.planar()
    tasks = PositionStack(robot, Stack.from_yaml(
        '- tip: {type: position, frame: link3, axes: xy}\n', robot))
    task = tasks.stack.tasks['tip']
    task.goal = task.parse_goal([1.2, 0.1, 0.0])
    found = Descent(tasks, robot, lambda: False).approach(tasks.at(np.zeros(3)), 1)
    assert found.costs[0] <= MET
