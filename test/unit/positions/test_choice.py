# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Choice among configurations that reach the same goals."""

import numpy as np
import pytest
import robots
from tp_controller import Robot, Stack
from tp_controller.positions.choice import CRITERIA, has_whole_turns, unwound, whole_turns
from tp_controller.positions.position_stack import PositionStack
from tp_controller.positions.random_postures import random_postures
from tp_controller.positions.search import Attempts


def tasks_of(robot, text):
    """Return the tasks of a stack at positions, started at rest."""
    tasks = PositionStack(robot, Stack.from_yaml(text, robot))
    tasks.stack.start(tasks.place(robot.neutral(), robot.passive_neutral))
    return tasks


def attempt(tasks, q):
    """Return a search that found q."""
    return Attempts(np.array(q, dtype=float), tasks.at(np.array(q, dtype=float)).costs, 1)


def test_joints_turn_back_by_whole_turns_towards_the_start():
    robot = robots.mixed()
    tasks = tasks_of(robot, f'- tip: {{type: position, frame: {robot.frame_names[-1]}}}')
    start = np.array([0.1, 0.2, 6.0, -12.0])
    found = unwound(tasks, attempt(tasks, [0.3, 0.2, 0.2, 0.1]), start)
    # Neither the joint with limits nor the one that slides can turn.
    np.testing.assert_allclose(found.q, [0.3, 0.2, 0.2 + 2 * np.pi, 0.1 - 4 * np.pi])
    assert found.costs == pytest.approx(tasks.at(found.q).costs)
    same = attempt(tasks, [0.3, 0.2, 6.2, -12.1])
    assert unwound(tasks, same, start) is same


def test_no_turn_that_makes_a_goal_worse():
    robot = robots.urdf_robot('ur5')
    tasks = tasks_of(robot, '- last: {type: joint, joints: wrist_3_joint, target: [0.5]}')
    reached = attempt(tasks, [0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    assert unwound(tasks, reached, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 5.0])) is reached


def test_distances_count_joints_and_the_place_of_a_base():
    robot = robots.moving_panda()
    tasks = tasks_of(robot, '- posture: {type: posture}')
    start, q = robot.neutral(), robot.neutral()
    q[:2] += 3.0, 4.0
    assert CRITERIA['nearest'](tasks, q, start) == pytest.approx(5.0)
    q[4] += 12.0
    assert CRITERIA['nearest'](tasks, q, start) == pytest.approx(13.0)


def test_middle_of_the_ranges_is_farthest_from_limits():
    robot = robots.panda()
    tasks = tasks_of(robot, '- posture: {type: posture}')
    middle = 0.5 * (robot.lower + robot.upper)
    other = middle.copy()
    other[3] = robot.upper[3] - 0.1 * (robot.upper[3] - robot.lower[3])
    rank = CRITERIA['limits']
    assert rank(tasks, middle, middle) == pytest.approx(-0.5)
    assert rank(tasks, other, middle) == pytest.approx(-0.1)
    free = Robot.from_dh([{'name': 'spin', 'a': 1.0, 'type': 'continuous', 'velocity': 1.0}])
    assert rank(tasks_of(free, '- posture: {type: posture}'), np.zeros(1), np.zeros(1)) == -1.0


def test_manipulability_is_that_of_the_first_task_with_a_goal():
    robot = robots.planar()
    tasks = tasks_of(robot, '- limits: {type: joint_limits}\n'
                            '- tip: {type: position, frame: link3, axes: xy}\n')
    q = np.array([0.3, 0.9, -0.4])
    J = robot.state(q).jacobian('link3')[:2]
    assert CRITERIA['manipulability'](tasks, q, q) == pytest.approx(
        -np.sqrt(np.linalg.det(J @ J.T)))
    assert CRITERIA['manipulability'](tasks_of(robot, '- limits: {type: joint_limits}'), q, q) == 0


@pytest.mark.parametrize(('name', 'expected'), [('panda', False), ('ur5', True), ('tiago', True)])
def test_whole_turns_need_a_range_of_a_turn(name, expected):
    robot = robots.urdf_robot(name)
    assert has_whole_turns(robot) == expected
    starts = random_postures(robot, robot.neutral(), np.random.default_rng(0), 200)
    found = [whole_turns(robot, starts[::-1], start[np.newaxis]).any() for start in starts]
    assert any(found) == expected
