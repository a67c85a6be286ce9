# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals reached by a posture: where the straight way is blocked, and along a straight line."""

import numpy as np
import pytest
import robots
from tp_controller import (
    Controller,
    GoalError,
    KinematicSimulator,
    PositionSolver,
    Robot,
    set_goal_by_posture,
    Settings,
    Stack,
)

TOOL = robots.PANDA_TOOL
READY = np.array(robots.PANDA_READY)
PERIOD = 0.02
TEXT = (f'- tool: {{type: pose, frame: {TOOL}, gain: 2.0}}\n'
        '- posture: {type: posture, gain: 0.5}\n')


def controller_of(text=TEXT, robot=None, q=READY):
    """Return a controller that knows where the robot is."""
    robot = robot or robots.panda()
    found = Controller(robot, Stack.from_yaml(text, robot), Settings(period=PERIOD))
    found.update(q, 0.0)
    return found


def run(controller, q, cycles=500):
    """Run a closed loop until the first task is reached; return all positions and commands."""
    simulator = KinematicSimulator(controller.robot, q)
    path, commands = [simulator.q], []
    for cycle in range(1, cycles):
        command = controller.update(simulator.q, PERIOD * cycle)
        simulator.command(command.velocity)
        simulator.step(PERIOD)
        path.append(simulator.q)
        commands.append(command)
        if command.report.tasks[0].reached:
            break
    return np.array(path), commands


def poses(count):
    """Return poses that a Panda can reach, many of them not straight."""
    robot = robots.panda()
    middle, generator = (robot.lower + robot.upper) / 2, np.random.default_rng(4)
    return [robot.state(middle + 0.8 * (generator.uniform(robot.lower, robot.upper) - middle))
            .pose(TOOL).copy() for _ in range(count)]


@pytest.mark.slow
def test_poses_are_reached_that_are_not_on_the_straight_way():
    straight = by_posture = 0
    for goal in poses(12):
        controller = controller_of()
        controller.set_goal('tool', goal, 0.0)
        straight += run(controller, READY)[1][-1].report.tasks[0].reached
        controller = controller_of()
        assert set_goal_by_posture(controller, 'tool', goal, 0.0) == ()
        path, commands = run(controller, READY)
        by_posture += commands[-1].report.tasks[0].reached
        robot = controller.robot
        assert (path >= robot.lower).all()
        assert (path <= robot.upper).all()
        for command in commands:
            assert (np.abs(command.velocity) <= robot.velocity * (1 + 1e-12)).all()
    assert by_posture == 12
    assert straight < 12


def test_joints_move_along_a_straight_line_until_the_task_goes_on():
    controller = controller_of()
    task = controller.stack.tasks['tool']
    set_goal_by_posture(controller, 'tool', poses(1)[0], 0.0)
    assert task.led
    posture = controller._tasks._leads[task].posture
    path, commands = run(controller, READY)
    assert commands[-1].report.tasks[0].reached
    assert not task.led
    line = posture - READY
    line /= np.linalg.norm(line)
    led = path[np.abs(path - posture).max(axis=1) > 0.03]
    aside = (led - READY) - np.outer((led - READY) @ line, line)
    assert len(led) > 50
    # The change of the goal is blended in, from rest.
    assert np.abs(aside).max() < 1e-6
    # Compiled cycles evaluate the task again.
    controller.update(path[-1], 100.0)
    assert task.twin is not None


def test_task_above_is_not_disturbed_on_the_way():
    text = f'- height: {{type: position, frame: {TOOL}, axes: z, gain: 5.0}}\n' + TEXT
    robot = robots.panda()
    goal = robot.state(READY + [0.8, 0.0, 0.2, 0.0, 0.3, 0.1, 0.5]).pose(TOOL).copy()
    height = robot.state(READY).position(TOOL)[2]
    goal[2, 3] = height
    controller = controller_of(text)
    assert set_goal_by_posture(controller, 'tool', goal, 0.0) == ()
    path, commands = run(controller, READY, 2)
    simulator = KinematicSimulator(robot, READY)
    for cycle in range(1, 400):
        command = controller.update(simulator.q, PERIOD * cycle + 1.0)
        simulator.command(command.velocity)
        simulator.step(PERIOD)
        assert abs(robot.state(simulator.q).position(TOOL)[2] - height) < 2e-3
    assert command.report.tasks[1].reached


def test_goal_that_no_posture_reaches_is_approached_straight_with_the_reason():
    controller = controller_of()
    goal = robots.panda().state(READY).pose(TOOL).copy()
    goal[2, 3] = 2.5
    remarks = set_goal_by_posture(controller, 'tool', goal, 0.0)
    assert any('no posture reaches it: out of reach by' in remark for remark in remarks)
    assert not controller.stack.tasks['tool'].led
    assert controller.stack.tasks['tool'].goal[2, 3] == 2.5


def test_joint_that_cannot_move_leads_straight():
    robot = Robot.from_file(robots.PANDA_DH, limits={
        name: {'velocity': 0.0} for name in ('panda_joint6', 'panda_joint7')})
    controller = controller_of(robot=robot)
    assert set_goal_by_posture(controller, 'tool', poses(1)[0], 0.0) == (
        'no posture reaches it: panda_joint6, panda_joint7 cannot move, with a velocity limit of '
        'zero',)
    assert not controller.stack.tasks['tool'].led
    # A lead that a user gives moves the others all the same.
    posture = READY + [0.2, 0.1, 0.0, -0.2, 0.1, 0.1, 0.3]
    controller.set_goal('tool', poses(1)[0], 0.0, posture=posture)
    path, _ = run(controller, READY, 100)
    assert np.isfinite(path).all()
    assert path[-1][6] == READY[6]
    assert np.abs(path[-1] - READY).max() > 0.1


def test_disabled_task_gets_its_goal():
    controller = controller_of()
    controller.enable('tool', False)
    goal = poses(1)[0]
    assert set_goal_by_posture(controller, 'tool', goal, 0.0) == ()
    np.testing.assert_allclose(controller.stack.tasks['tool'].goal, goal)


def test_next_goal_ends_the_approach():
    controller = controller_of()
    task = controller.stack.tasks['tool']
    one, other = poses(2)
    set_goal_by_posture(controller, 'tool', one, 0.0)
    run(controller, READY, 10)
    controller.set_goal('tool', other, 1.0)
    assert not task.led
    assert not controller._tasks._leads
    np.testing.assert_allclose(task.goal, other)


@pytest.mark.parametrize('end', [
    lambda controller: controller.enable('tool', False),
    lambda controller: controller.forget_goals(),
    lambda controller: controller.replace_stack(Stack.from_yaml(TEXT, controller.robot))],
    ids=['disabled', 'goals forgotten', 'stack replaced'])
def test_approach_ends_with_its_task(end):
    controller = controller_of()
    task = controller.stack.tasks['tool']
    set_goal_by_posture(controller, 'tool', poses(1)[0], 0.0)
    assert task.led
    end(controller)
    assert not task.led
    assert not controller._tasks._leads


def test_search_of_a_led_task_is_compiled():
    controller = controller_of()
    set_goal_by_posture(controller, 'tool', poses(1)[0], 0.0)
    its = PositionSolver(controller.robot, controller.stack)
    assert not its._tasks.stack.tasks['tool'].led


def test_goal_in_another_frame_is_where_that_frame_is_now():
    robot = robots.panda()
    shift = np.eye(4)
    shift[:3, 3] = 0.05, 0.02, -0.1
    controller = controller_of()
    set_goal_by_posture(controller, 'tool', shift, 0.0, TOOL)
    np.testing.assert_allclose(controller.stack.tasks['tool'].goal,
                               robot.state(READY).pose(TOOL) @ shift, atol=1e-12)
    path, commands = run(controller, READY)
    assert commands[-1].report.tasks[0].reached


def test_what_cannot_lead_is_refused():
    robot = robots.panda()
    goal = robot.state(READY).pose(TOOL)
    with pytest.raises(GoalError, match='none have arrived yet'):
        set_goal_by_posture(Controller(robot, Stack.from_yaml(TEXT, robot)), 'tool', goal, 0.0)
    with pytest.raises(GoalError, match="unknown task 'hand'"):
        set_goal_by_posture(controller_of(), 'hand', goal, 0.0)
    with pytest.raises(GoalError, match='finite'):
        set_goal_by_posture(controller_of(), 'tool', np.full(7, np.nan), 0.0)
    for posture, text in ((np.full(7, 9.0), 'beyond the position limits of panda_joint1'),
                          (np.zeros(3), 'needs 7'), (np.full(7, np.nan), 'finite')):
        controller = controller_of()
        with pytest.raises(GoalError, match=text):
            controller.set_goal('tool', goal, 0.0, posture=posture)
        assert not controller.stack.tasks['tool'].led
    moving = robots.moving_panda()
    controller = controller_of(robot=moving, q=moving.neutral())
    with pytest.raises(GoalError, match='base moves'):
        controller.set_goal('tool', goal, 0.0, posture=np.zeros(10))


@pytest.mark.parametrize('shared', [False, True])
def test_posture_leads_without_the_joints_that_the_task_must_not_move(shared):
    tool = f'tool: {{type: position, frame: {TOOL}, excluded_joints: panda_joint1}}'
    other = 'other: {type: joint, joints: panda_joint3, excluded_joints: panda_joint1}'
    controller = controller_of(f'- [{tool}, {other}]\n' if shared else f'- {tool}\n')
    robot, q, there = controller.robot, READY, READY + 0.3 * np.array([0, 1, 0, 1, 0, 1, 0])
    goal = robot.state(there).position(TOOL).copy()
    controller.set_goal('tool', goal, 0.0, posture=there)
    for cycle in range(1, 600):
        command = controller.update(q, PERIOD * cycle)
        assert controller._last.cycle.levels[0].joints.tolist() == [False, *6 * [True]]
        assert abs(command.velocity[0]) < 1e-12
        q = q + PERIOD * command.velocity
    assert not controller.stack.tasks['tool'].led
    np.testing.assert_allclose(robot.state(q).position(TOOL), goal, atol=1e-3)


@pytest.mark.parametrize(('keys', 'limits'), [
    ('excluded_joints: panda_joint1', {}), ('gain: 2.0', {'panda_joint1': {'velocity': 0.0}})],
    ids=['excluded', 'without a velocity'])
def test_posture_is_searched_with_the_joints_that_move(keys, limits):
    robot = Robot.from_file(robots.PANDA_DH, limits=limits)
    controller = controller_of(TEXT.replace('gain: 2.0', keys), robot)
    goal = robot.state(READY + 0.2).pose(TOOL)
    # The posture below would turn the joint.
    controller.set_goal('posture', READY + 0.4, 0.0)
    assert set_goal_by_posture(controller, 'tool', goal, 0.0) == ()
    assert controller.stack.tasks['tool'].led
    path, commands = run(controller, READY)
    assert commands[-1].report.tasks[0].reached
    # It may turn once the task goes on by itself.
    assert np.ptp(path[:20, 0]) < 1e-9


def test_posture_that_moves_other_joints_leads_to_no_goal():
    controller = controller_of(TEXT.replace('gain: 2.0', 'excluded_joints: panda_joint1'))
    there = READY + 0.5
    goal = controller.robot.state(there).pose(TOOL)
    with pytest.raises(GoalError, match="moves panda_joint1, which task 'tool' must not move"):
        controller.set_goal('tool', goal, 0.0, posture=there)
    # There is one, but for the mask.
    far = controller.robot.state(READY + [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]).pose(TOOL)
    remark, = set_goal_by_posture(controller, 'tool', far, 0.0)
    assert remark.startswith('no posture reaches it: tool must not move panda_joint1')
    assert not controller.stack.tasks['tool'].led
