# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inverse kinematics of a robot with locked joints."""

import numpy as np
import pytest
import robots
from tp_controller import (
    Controller,
    PositionSolver,
    RobotError,
    set_goal_by_posture,
    Settings,
    solve_position,
    Stack,
)
from tp_controller.positions.locked_robot import with_locks
from tp_controller.positions.random_postures import random_postures

TOOL, READY = robots.PANDA_TOOL, np.array(robots.PANDA_READY)
TEXT = f'- tool: {{type: pose, frame: {TOOL}}}\n- posture: {{type: posture}}\n'


@pytest.mark.parametrize('compiled', [True, False])
@pytest.mark.parametrize('seed', range(6))
def test_locked_joint_stays_where_it_is_and_the_others_reach_the_goal(seed, compiled):
    robot, rng = robots.panda(), np.random.default_rng(seed)
    joint = int(rng.integers(0, 7))
    start = READY + rng.uniform(-0.3, 0.3, 7)
    there = start + rng.uniform(-0.4, 0.4, 7)
    there[joint] = start[joint]
    goal = robot.state(there).pose(TOOL)
    solver = PositionSolver(robot, Stack.from_yaml(TEXT, robot), [robot.joint_names[joint]], start)
    if not compiled:
        solver._searches._compiled = None
    found = solver.solve({'tool': goal}, start, timeout=2.0)
    assert found.reached
    assert found.q[joint] == start[joint]
    np.testing.assert_allclose(robot.state(found.q).pose(TOOL), goal, atol=2e-6)


def test_search_does_not_count_what_a_locked_joint_could_do():
    robot = robots.panda()
    stack = Stack.from_yaml(f'- mobile: {{type: manipulability_above, frame: {TOOL}, '
                            'minimum: 0.08}\n', robot)
    found = solve_position(robot, stack, start=READY, locked=['panda_joint4'])
    before, after = (np.sqrt(np.linalg.det(J @ J.T)) for J in (
        np.delete(robot.state(q).jacobian(TOOL), 3, axis=1) for q in (READY, found.q)))
    assert found.q[3] == READY[3] and after > 1.2 * before
    assert found.tasks[0].errors[0][0] == pytest.approx(max(1.0 - after / 0.08, 0.0))


def test_lock_is_the_reason_where_no_configuration_reaches_the_goal():
    robot = robots.panda()
    stack = Stack.from_yaml(f'- tool: {{type: position, frame: {TOOL}}}', robot)
    goal = robot.state(READY).position(TOOL) * [2.2, 1.0, 1.0]
    assert solve_position(robot, stack, {'tool': goal}, READY).reached
    found = solve_position(robot, stack, {'tool': goal}, READY, ['panda_joint4'])
    assert not found.reached and found.q[3] == READY[3]
    assert 'panda_joint4 is locked' in found.tasks[0].reason


def test_base_stays_along_a_locked_velocity():
    robot = robots.moving_panda('planar')
    stack = Stack.from_yaml(f'- tool: {{type: position, frame: {TOOL}}}', robot)
    start = robot.configuration(READY, np.eye(4))
    locked = ['base_x', 'base_y', 'base_yaw']
    drawn = random_postures(with_locks(robot, locked, start), start, np.random.default_rng(0), 20)
    np.testing.assert_allclose(drawn[:, :3], np.zeros((20, 3)), atol=1e-15)
    goal = robot.state(start).position(TOOL) + [3.0, 0.0, 0.0]
    assert solve_position(robot, stack, {'tool': goal}, start, timeout=1.0).reached
    found = solve_position(robot, stack, {'tool': goal}, start, locked, timeout=0.3)
    assert not found.reached
    np.testing.assert_allclose(found.q[:3], start[:3], atol=1e-12)


@pytest.mark.parametrize(('locked', 'told'), [
    (['joint4'], "unknown driven joint 'joint4'"),
    ('panda_joint4', "must be a list of names, not 'panda_joint4'"),
    (iter(['panda_joint4']), 'must be a list of names')], ids=['unknown', 'word', 'iterator'])
def test_lock_of_no_known_joints_is_refused(locked, told):
    robot = robots.panda()
    with pytest.raises(RobotError, match=told):
        solve_position(robot, Stack.from_yaml(TEXT, robot), locked=locked)


def test_goal_by_a_posture_is_reached_without_the_locked_joint():
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml(TEXT, robot), Settings(blend=0.0))
    controller.lock(['panda_joint3'], 0.0)
    controller.update(READY, 0.0)
    there = READY + [1.2, 0.4, 0.0, 0.3, -0.5, 0.4, 0.5]
    goal = robot.state(there).pose(TOOL)
    assert set_goal_by_posture(controller, 'tool', goal, 0.0) == ()
    q = READY
    for cycle in range(1, 900):
        velocity = controller.update(q, 0.01 * cycle).velocity
        assert velocity[2] == 0.0
        q = q + 0.01 * velocity
    np.testing.assert_allclose(robot.state(q).pose(TOOL), goal, atol=1e-3)
