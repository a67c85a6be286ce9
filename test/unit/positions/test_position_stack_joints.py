# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inverse kinematics moves the joints of each task, and weighs its rows, in core and reference."""

import numpy as np
import pytest
import robots
from tp_controller import Robot, solve_position, Stack
from tp_controller.positions.descent import Descent
from tp_controller.positions.position_stack import PositionStack
from tp_controller.tasks.stack import levels_of

ROBOT = Robot.from_file(str(robots.CONFIG / 'robots' / 'mobile_arm.urdf'), base='planar',
                        groups={'arm': [f'arm_{number}' for number in range(1, 8)]})
Q = ROBOT.configuration([0.15, 0.0, -0.8, 0.0, 1.6, 0.0, -0.8, 0.0])


def found(text, goals):
    """Return the configurations that the core finds, and that of one descent in Python."""
    stack = Stack.from_yaml(text, ROBOT)
    its = solve_position(ROBOT, stack, goals, start=Q, attempts=1, timeout=5.0)
    tasks = PositionStack(ROBOT, stack)
    for task in tasks.stack.active_tasks:
        task.start(ROBOT.state(Q))
        if task.name in goals:
            task.set_goal(task.parse_goal(goals[task.name]), 0.0)
    descent = Descent(tasks, ROBOT, lambda: False)
    descent.begin()
    point = descent.finish(descent.approach(tasks.at(Q), len(levels_of(tasks.at(Q).evaluations))))
    return its.q, point.q


def test_only_the_joints_of_the_task_move():
    goal = ROBOT.state(Q).position('tool') + np.array([0.1, 0.05, 0.0])
    for q in found('- tool: {type: position, frame: tool, joints: arm}\n', {'tool': goal}):
        np.testing.assert_allclose(q[:4], Q[:4], atol=1e-9)
        np.testing.assert_allclose(ROBOT.state(q).position('tool'), goal, atol=1e-5)


def test_base_goes_where_the_arm_does_not_reach():
    goal = ROBOT.state(Q).position('tool') + np.array([2.0, 0.0, 0.0])
    for q in found('- tool: {type: position, frame: tool, joints: base}\n', {'tool': goal}):
        np.testing.assert_allclose(q[3:], Q[3:], atol=1e-9)
        np.testing.assert_allclose(ROBOT.state(q).position('tool'), goal, atol=1e-5)


@pytest.mark.parametrize('weight', [1.0, 9.0])
def test_error_of_two_goals_is_shared_by_weight(weight):
    # Two tasks ask for positions of the same frame, 0.1 m apart.
    here = ROBOT.state(Q).position('tool')
    goals = {'one': here, 'other': here + np.array([0.1, 0.0, 0.0])}
    for q in found(f'- [one: {{type: position, frame: tool, joints: arm, weights: {weight}}}, '
                   'other: {type: position, frame: tool, joints: arm}]\n', goals):
        place = ROBOT.state(q).position('tool') - here
        np.testing.assert_allclose(place, [0.1 / (1.0 + weight), 0.0, 0.0], atol=1e-5)
