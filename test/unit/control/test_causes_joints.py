# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The joints that a task may move are a cause, in the core and in the reference."""

import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack

ROBOT = Robot.from_file(str(robots.CONFIG / 'robots' / 'mobile_arm.urdf'), base='differential',
                        groups={'arm': [f'arm_{number}' for number in range(1, 8)]})
Q = ROBOT.configuration([0.15, 0.0, -0.8, 0.0, 1.6, 0.0, -0.8, 0.0])


def reported(text, names, distance=2.0):
    """Return the report of a stack with goals so far in front of its tasks, after a while [m]."""
    controller = Controller(ROBOT, Stack.from_yaml(text, ROBOT), Settings(blend=0.0, period=0.01))
    controller.update(Q, 0.0)
    for name in names:
        here = controller.stack.tasks[name].value(ROBOT.state(Q))
        controller.set_goal(name, here + np.array([distance, 0.0, 0.0]), 0.0)
    for cycle in range(1, 6):
        command = controller.update(Q, 0.01 * cycle)
    return command.report


def check(report):
    """Check that the reference finds the causes of the core, and return those of each task."""
    cycle = report._cycle
    for task, evaluation in zip(report.tasks, cycle.evaluations):
        expected = {(each.kind, each.name): each.share for each in cycle.search.of(evaluation)}
        assert {(each.kind, each.name): each.share for each in task.causes} \
            == pytest.approx(expected, abs=1e-9)
    return [{(each.kind, each.name) for each in task.causes} for task in report.tasks]


@pytest.mark.parametrize('keys, reason', [
    ('joints: [torso_lift, arm_7]', 'uses torso_lift and arm_7 only'),
    ('excluded_joints: [base, arm]', 'uses torso_lift only'),
    ('joints: base_yaw', 'uses base_yaw only')])
def test_own_joints_are_a_cause_that_is_named(keys, reason):
    report = reported(f'- tool: {{type: position, frame: tool, {keys}}}\n', ['tool'])
    causes, = check(report)
    assert ('joints', '') in causes
    assert reason in report.tasks[0].reason
    assert 'let tool use all joints' in report.tasks[0].hint


def test_joints_of_a_task_above_are_a_cause_with_its_name():
    # The base would bring the tool there without the arm, which is to stay.
    report = reported('- tool: {type: position, frame: tool, joints: arm}\n'
                      '- stay: {type: posture, joints: arm, gain: 5, excluded_joints: base, '
                      'target: {arm_2: -0.7}}\n',
                      ['tool'])
    _, causes = check(report)
    assert {('joints', 'tool'), ('task', 'tool')} <= causes
    assert report.tasks[1].reason == 'blocked by tool; does not use base'


def test_joints_that_suffice_are_no_cause():
    report = reported('- tool: {type: position, frame: tool, joints: arm}\n', ['tool'], 0.01)
    assert check(report) == [set()]
