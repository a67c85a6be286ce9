# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inverse kinematics of many goals: the answers of one by one."""

from collections import deque

import numpy as np
import pytest
import robots
from tp_controller import (
    GoalError,
    PositionSolver,
    RobotError,
    SettingsError,
    solve_positions,
    Stack,
)
from tp_controller.positions.compiled import Searches
from tp_controller.positions.random_postures import random_postures
from tp_controller.solver.compiled import running

TOOL = robots.PANDA_TOOL
TEXT = f'- tool: {{type: pose, frame: {TOOL}}}\n- posture: {{type: posture}}\n'
PATIENT = {'timeout': 60.0}


@pytest.mark.slow
@pytest.mark.parametrize('jobs', [1, 3, -1])
@pytest.mark.parametrize('each', [False, True], ids=['one start', 'a start for each'])
def test_answers_are_those_of_single_calls(jobs, each):
    robot = robots.panda()
    stack = Stack.from_yaml(TEXT, robot)
    generator = np.random.default_rng(0)
    goals = [robot.state(q).pose(TOOL) for q in random_postures(
        robot, robot.neutral(), generator, 40)]
    # One that nothing reaches.
    goals[7] = goals[7].copy()
    goals[7][2, 3] = 3.0
    starts = random_postures(robot, robot.neutral(), generator, 40) if each else robot.neutral()
    found = solve_positions(robot, stack, {'tool': goals}, starts, jobs=jobs, seed=5, **PATIENT)
    single = PositionSolver(robot, stack)
    assert len(found) == 40
    for index, one in enumerate(found):
        expected = single.solve({'tool': goals[index]}, starts[index] if each else starts, seed=5,
                                **PATIENT)
        np.testing.assert_array_equal(one.q, expected.q)
        assert (one.reached, one.attempts) == (expected.reached, expected.attempts)
    assert [index for index, one in enumerate(found) if not one.reached] == [7]
    assert 'out of reach' in found[7].tasks[0].reason
    assert found[8].tasks[0].reached


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'frame'), [('ur5', 'tool0'), ('tiago', 'arm_tool_link')])
def test_joints_turn_by_whole_turns_as_in_single_calls(name, frame):
    robot = robots.urdf_robot(name)
    stack = Stack.from_yaml(f'- tool: {{type: pose, frame: {frame}}}', robot)
    generator = np.random.default_rng(0)
    goals = [robot.state(q).pose(frame)
             for q in random_postures(robot, robot.neutral(), generator, 60)]
    start = random_postures(robot, robot.neutral(), generator, 1)[0]
    found = solve_positions(robot, stack, {'tool': goals}, start, **PATIENT)
    single = PositionSolver(robot, stack)
    expected = [single.solve({'tool': goal}, start, **PATIENT) for goal in goals]
    np.testing.assert_array_equal([one.q for one in found], [one.q for one in expected])
    assert [one.reached for one in found] == [one.reached for one in expected]


def test_goal_of_a_joint_keeps_it_from_turning():
    robot = robots.urdf_robot('ur5')
    stack = Stack.from_yaml('- last: {type: joint, joints: wrist_3_joint}', robot)
    found = solve_positions(robot, stack, {'last': [[0.5], [1.5]]}, [0.0] * 5 + [5.0], **PATIENT)
    np.testing.assert_allclose([one.q[5] for one in found], [0.5, 1.5], rtol=0.0, atol=1e-6)
    assert all(one.reached for one in found)


# Of a planar arm of 1.75 m.
TIP = '- tip: {type: position, frame: link3, axes: xy}\n'
# Keeps the first joint at 0.31 rad or more, or cannot be met.
BOUND = """
- cell: {{type: keep_in, frame: link1, shape: {{box: [4.0, {0}, 4.0]}}, at: [0, {1}, 0]}}
- hold: {{type: joint, joints: joint1}}
- aim: {{type: joint, joints: joint3}}
"""
MET, UNMET = BOUND.format(0.5, 0.5), BOUND.format(0.1, 2.0)


@pytest.mark.parametrize(('text', 'goals', 'reached'), [
    (TIP, {'tip': [[1.75 + 7e-7, 0.0, 0.0], [1.75 + 2e-6, 0.0, 0.0]]}, [True, False]),
    (MET, {'aim': [[0.5], [0.9]]}, [True, True]), (UNMET, {'aim': [[0.5], [0.9]]}, [False, False]),
    (MET, {'hold': [[0.0], [0.6]]}, [False, True])], ids=['beyond', 'met', 'unmet', 'named'])
def test_goals_and_bounds_decide_what_is_reached(text, goals, reached):
    robot = robots.planar()
    stack = Stack.from_yaml(text, robot)
    start = [0.0, 0.3, 0.3]
    found = solve_positions(robot, stack, goals, start, **PATIENT)
    single = PositionSolver(robot, stack)
    for index, one in enumerate(found):
        expected = single.solve({name: given[index] for name, given in goals.items()}, start,
                                **PATIENT)
        np.testing.assert_array_equal(one.q, expected.q)
        assert one.reached == expected.reached == reached[index]


def test_goals_left_to_the_reference_are_solved_one_by_one(monkeypatch):
    robot = robots.panda()
    stack = Stack.from_yaml(TEXT, robot)
    goals = [robot.state(q).pose(TOOL) for q in random_postures(
        robot, robot.neutral(), np.random.default_rng(1), 12)]
    expected = solve_positions(robot, stack, {'tool': goals}, jobs=1, **PATIENT)
    together, single, alone = Searches.find_each, PositionSolver.solve, []

    def find_each(self, *arguments):
        found = together(self, *arguments)
        return found and [(q, 0 if index == 2 else descents, error)
                          for index, (q, descents, error) in enumerate(found)]

    def solve(self, its_goals, *arguments, **options):
        alone.append(its_goals['tool'])
        return single(self, its_goals, *arguments, **options)

    monkeypatch.setattr(Searches, 'find_each', find_each)
    monkeypatch.setattr(PositionSolver, 'solve', solve)
    found = solve_positions(robot, stack, {'tool': goals}, jobs=1, **PATIENT)
    np.testing.assert_array_equal([one.q for one in found], [one.q for one in expected])
    # Calls of 6, 3 and single goals.
    left = (2, 8) if running() == 'compiled' else range(12)
    np.testing.assert_array_equal(alone, [goals[index] for index in left])


def test_goals_may_be_any_sequence_or_none():
    robot = robots.panda()
    stack, goal = Stack.from_yaml(TEXT, robot), robot.state(robot.neutral()).pose(TOOL)
    for given in (deque([goal, goal]), (goal, goal), np.array([goal, goal]), iter([goal, goal])):
        assert len(solve_positions(robot, stack, {'tool': given}, jobs=np.int64(2))) == 2
    assert solve_positions(robot, stack, {'tool': np.zeros((0, 7))}) == []


@pytest.mark.parametrize(('arguments', 'error', 'text'), [
    ({'goals': {}}, GoalError, 'no task'), ({'goals': 5}, GoalError, 'goals need a mapping'),
    ({'goals': {'tool': 5}}, GoalError, 'need a sequence'),
    ({'goals': {'tool': {'a': 1}}}, GoalError, 'need a sequence'),
    ({'goals': {'tool': 'abc'}}, GoalError, 'need a sequence'),
    ({'goals': {'tool': np.array(1.0)}}, GoalError, 'need a sequence'),
    ({'goals': {'tool': [[0.4, 0.0], [0.4]]}}, GoalError, "goal 0: the goal of task 'tool'"),
    ({'goals': {'tool': []}, 'attempts': -3}, SettingsError, 'attempts'),
    ({'goals': {'hand': []}}, GoalError, "position 'hand'"),
    ({'start': 'abc'}, RobotError, 'start'), ({'start': [[1.0], [1.0, 2.0]]}, RobotError, 'start'),
    ({'tries': 3}, SettingsError, "unknown option 'tries'"),
    ({'goals': {'tool': np.zeros((2, 7)), 'posture': np.zeros((3, 7))}}, GoalError,
     'tool: 2, posture: 3'),
    ({'goals': {'tool': np.zeros((2, 7))}}, GoalError, 'tool'),
    ({'start': np.zeros((5, 7))}, RobotError, 'start needs one configuration, or 2, got 5'),
    ({'start': np.zeros(3)}, RobotError, '7 positions'),
    ({'jobs': 0}, SettingsError, 'jobs'), ({'jobs': True}, SettingsError, 'jobs'),
    ({'attempts': -1}, SettingsError, 'attempts')], ids=str)
def test_wrong_arguments_are_named(arguments, error, text):
    robot = robots.panda()
    goals = {'tool': [robot.state(robot.neutral()).pose(TOOL)] * 2}
    with pytest.raises(error, match=text):
        solve_positions(robot, Stack.from_yaml(TEXT, robot), **{'goals': goals, **arguments})


@pytest.mark.parametrize('form', ['matrices', 'quaternions', 'criterion'])
def test_invalid_goal_is_named_by_its_number(form):
    robot = robots.panda()
    stack, goal = Stack.from_yaml(TEXT, robot), robot.state(robot.neutral()).pose(TOOL)
    goals = np.array([goal if form != 'quaternions' else [0.4, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0]] * 9)
    goals[5] *= 2.0
    options = {'criterion': 'limits', 'attempts': 1} if form == 'criterion' else {}
    with pytest.raises(GoalError, match="goal 5: the goal of task 'tool'"):
        solve_positions(robot, stack, {'tool': goals}, jobs=1, **options)


@pytest.mark.parametrize(('goal', 'valid', 'given'), [
    ([0.4, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0], '(N, 7)', '(7,)'), (np.eye(4), '(N, 4, 4)', '(4, 4)')],
    ids=['numbers', 'matrix'])
def test_single_goal_is_refused_with_the_shape_of_several(goal, valid, given):
    robot = robots.panda()
    with pytest.raises(GoalError) as error:
        solve_positions(robot, Stack.from_yaml(TEXT, robot), {'tool': goal}, jobs=1)
    assert str(error.value).startswith("the goals of task 'tool' need a list or array")
    assert f'such as one of shape {valid}, not a single goal of shape {given}' in str(error.value)
