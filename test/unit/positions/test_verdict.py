# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reports at a configuration: only positions limit the tasks, and the reason says which."""

import numpy as np
import pytest
import robots
from tp_controller import Robot, solve_position, Stack

TOOL = robots.PANDA_TOOL


def test_distance_out_of_reach_is_named():
    robot = robots.planar()
    found = solve_position(robot, Stack.from_yaml(
        '- tip: {type: position, frame: link3, axes: xy}\n', robot), {'tip': [2.25, 0.0, 0.0]})
    report, = found.tasks
    assert not found.reached
    assert 'out of reach by 0.5 m' in report.reason
    assert report.errors[0][0] == pytest.approx(0.5, abs=1e-6)
    assert report.status == 'limited'


def test_joint_at_its_limit_is_named():
    robot = Robot.from_dh([
        {'name': 'one', 'a': 1.0, 'velocity': 1e-3, 'lower': -0.5, 'upper': 0.5,
         'acceleration': 1e-3}])
    found = solve_position(robot, Stack.from_yaml(
        '- angle: {type: orientation, frame: link1, axes: z}\n', robot),
        {'angle': [0.0, 0.0, np.sin(0.4), np.cos(0.4)]})
    assert found.q[0] == pytest.approx(0.5)
    assert found.tasks[0].reason == 'one at its upper position limit'
    assert [cause.kind for cause in found.tasks[0].causes] == ['upper position limit']


def test_task_that_blocks_is_named_with_a_hint():
    robot = robots.panda()
    text = f'- tool: {{type: position, frame: {TOOL}}}\n- posture: {{type: posture}}\n'
    goal = robot.state(np.array(robots.PANDA_READY)).position(TOOL)
    tool, posture = solve_position(robot, Stack.from_yaml(text, robot), {'tool': goal},
                                   robot.neutral()).tasks
    assert tool.reached
    assert tool.reason == ''
    assert posture.reason == 'blocked by tool'
    assert posture.hint


def test_reports_are_those_of_the_goals_of_their_call():
    robot = robots.planar()
    stack = Stack.from_yaml('- tip: {type: position, frame: link3, axes: xy}\n', robot)
    first = solve_position(robot, stack, {'tip': [2.25, 0.0, 0.0]})
    solve_position(robot, stack, {'tip': [1.0, 0.5, 0.0]})
    assert first.tasks[0].errors[0][0] == pytest.approx(0.5, abs=1e-6)


def test_task_that_a_stretched_arm_keeps_waiting_is_blocked_by_what_stretches_it():
    robot = robots.planar()
    text = ('- tip: {type: position, frame: link3, axes: xy}\n'
            '- middle: {type: joint, joints: joint2}\n- last: {type: joint, joints: joint3}\n')
    found = solve_position(robot, Stack.from_yaml(text, robot), {
        'tip': [2.25, 0.0, 0.0], 'middle': [0.5], 'last': [0.4]})
    assert [task.status for task in found.tasks] == ['limited'] * 3
    assert [task.reason for task in found.tasks[1:]] == ['blocked by tip'] * 2
