# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inverse kinematics of a stack: goals that are reached, and the nearest point to others."""

from concurrent.futures import ThreadPoolExecutor
import copy
from functools import lru_cache
import importlib
import pickle

from hypothesis import example, given, settings, strategies
import numpy as np
import pytest
import robots
from scipy.optimize import least_squares
from tp_controller import (
    Controller,
    EvaluationError,
    GoalError,
    PositionSolver,
    Robot,
    RobotError,
    SettingsError,
    solve_position,
    Stack,
    StackError,
)
from tp_controller.model.spatial import rotation_vector
from tp_controller.positions.random_postures import random_postures
from tp_controller.positions.search import Attempts
from tp_controller.positions.solution import GOAL_TOLERANCE
from tp_controller.tasks.position import Position

TOOL = robots.PANDA_TOOL
solve_position_module = importlib.import_module('tp_controller.positions.solve_position')
POSE = f'- tool: {{type: pose, frame: {TOOL}}}\n'
PATIENT = {'timeout': 60.0}
# {robot: (robot, frame with a pose)}
ARMS = {
    'Panda': (robots.panda, TOOL), 'UR5': (lambda: robots.urdf_robot('ur5'), 'tool0'),
    'planar base': (robots.moving_panda, TOOL),
    'floating base': (lambda: robots.moving_panda('floating'), TOOL)}
seeds = strategies.integers(0, 2 ** 32 - 1)


@lru_cache(maxsize=None)
def solver(name, text=None):
    """Return a robot and its solver for a stack, by default a pose alone."""
    make, frame = ARMS[name]
    robot = make()
    return robot, PositionSolver(robot, Stack.from_yaml(
        text or f'- tool: {{type: pose, frame: {frame}}}', robot))


def posture(robot, seed):
    """Return a configuration (nq,) at random."""
    return random_postures(robot, robot.neutral(), np.random.default_rng(seed), 1)[0]


def pose_at(robot, q, frame):
    """Return the pose of a frame."""
    return robot.state(q).pose(frame).copy()


def pose_error(robot, q, frame, goal):
    """Return the error of a pose, by position and rotation vector."""
    T = pose_at(robot, q, frame)
    return np.concatenate((goal[:3, 3] - T[:3, 3],
                           rotation_vector(goal[:3, :3] @ T[:3, :3].T)))


def assert_within_limits(robot, q):
    """Assert that all position limits hold."""
    rows, columns = robot.joint_rows, robot.joint_columns
    assert (q[rows] >= robot.lower[columns]).all()
    assert (q[rows] <= robot.upper[columns]).all()


@pytest.mark.parametrize('name', ARMS)
@settings(max_examples=20, deadline=None)
@given(seeds)
@example(3)
def test_pose_of_a_posture_is_reached_within_limits(name, seed):
    robot, its = solver(name)
    frame = ARMS[name][1]
    goal = pose_at(robot, posture(robot, seed), frame)
    found = its.solve({'tool': goal}, seed=seed, attempts=1000, **PATIENT)
    assert found.reached
    assert np.abs(pose_error(robot, found.q, frame, goal)).max() < GOAL_TOLERANCE
    assert_within_limits(robot, found.q)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(seeds)
def test_error_of_a_goal_out_of_reach_is_that_of_another_optimizer(seed):
    robot, its = solver('Panda')
    goal = pose_at(robot, posture(robot, seed), TOOL)
    goal[:3, 3] *= 2.0
    goal[:3, 3] += [0.0, 0.0, 0.5]
    found = its.solve({'tool': goal}, seed=seed, attempts=100, **PATIENT)
    best = min(least_squares(
        lambda q: pose_error(robot, q, TOOL, goal), start, bounds=(robot.lower, robot.upper),
        xtol=1e-12, ftol=1e-12, gtol=1e-12).cost
        for start in random_postures(robot, robot.neutral(), np.random.default_rng(seed), 12))
    ours = pose_error(robot, found.q, TOOL, goal)
    assert 0.5 * ours @ ours <= 1.02 * best + 1e-12
    assert_within_limits(robot, found.q)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_posture_below_a_pose_is_as_near_as_the_pose_allows(seed):
    robot, its = solver('Panda', POSE + '- posture: {type: posture}\n')
    generator = np.random.default_rng(seed)
    one, other = random_postures(robot, robot.neutral(), generator, 2)
    goal = pose_at(robot, one, TOOL)
    found = its.solve({'tool': goal, 'posture': other}, one, seed=seed, **PATIENT)
    assert np.abs(pose_error(robot, found.q, TOOL, goal)).max() < GOAL_TOLERANCE
    # Along the motion that keeps the pose, inside the limits, no step leads nearer.
    free = (found.q > robot.lower + 1e-6) & (found.q < robot.upper - 1e-6)
    J = robot.state(found.q).jacobian(TOOL)[:, free]
    _, singular, rows = np.linalg.svd(J)
    keeping = rows[(singular > 1e-3).sum():]
    way = (other - found.q)[free]
    assert np.linalg.norm(keeping @ way) <= 0.03 * np.linalg.norm(way) + 1e-6


def test_bounds_above_hold_and_bounds_below_give_way():
    robot = robots.panda()
    cell = '- cell: {type: keep_in, frame: panda_link4, shape: {box: [0.1, 0.1, 1.4]}, ' \
           'at: [0, 0, 0.5]}\n'
    point = f'- tool: {{type: position, frame: {TOOL}}}\n'
    far = [0.75, 0.0, 0.3]
    above = solve_position(robot, Stack.from_yaml(cell + point, robot), {'tool': far}, **PATIENT)
    below = solve_position(robot, Stack.from_yaml(point + cell, robot), {'tool': far}, **PATIENT)
    assert np.abs(robot.state(above.q).position('panda_link4')[:2]).max() <= 0.05 + GOAL_TOLERANCE
    assert not above.reached
    np.testing.assert_allclose(robot.state(below.q).position(TOOL), far, rtol=0.0,
                               atol=GOAL_TOLERANCE)
    assert below.reached
    assert np.abs(robot.state(below.q).position('panda_link4')[:2]).max() > 0.06
    assert 'bounds of cell' in above.tasks[1].reason


def test_upper_task_has_its_goal_and_the_lower_one_what_is_left():
    robot = robots.planar()
    stack = Stack.from_yaml('- tip: {type: position, frame: link3, axes: xy}\n'
                            '- middle: {type: position, frame: link2, axes: xy}\n', robot)
    q, other = np.array([0.3, 0.8, 0.9]), np.array([-0.4, 0.6, -0.8])
    goals = {'tip': robot.state(q).position('link3'), 'middle': robot.state(other).position(
        'link2')}
    found = solve_position(robot, stack, goals, **PATIENT)
    state = robot.state(found.q)
    np.testing.assert_allclose(state.position('link3'), goals['tip'], rtol=0.0,
                               atol=GOAL_TOLERANCE)
    # The last link turns about the tip, so the middle lies on a circle: the nearest point of it
    # that the first two links reach.
    angles = np.linspace(-np.pi, np.pi, 100_001)
    length = np.linalg.norm(robot.state(q).position('link3') - robot.state(q).position('link2'))
    circle = goals['tip'][:2] + length * np.column_stack((np.cos(angles), np.sin(angles)))
    first = np.linalg.norm(robot.state(q).position('link1'))
    second = np.linalg.norm(robot.state(q).position('link2') - robot.state(q).position('link1'))
    away = np.linalg.norm(circle, axis=1)
    reachable = circle[(away <= first + second) & (away >= abs(first - second))]
    best = np.linalg.norm(reachable - goals['middle'][:2], axis=1).min()
    error = np.linalg.norm(state.position('link2') - goals['middle'])
    assert error == pytest.approx(best, rel=0.02)
    assert not found.reached
    assert 'blocked by tip' in found.tasks[1].reason


def test_near_start_leads_to_the_solution_nearby():
    robot, its = solver('Panda')
    for seed in range(20):
        q = 0.8 * posture(robot, seed) + 0.2 * robot.neutral()
        found = its.solve({'tool': pose_at(robot, q, TOOL)}, q + 0.02, **PATIENT)
        assert found.reached
        assert found.attempts == 1
        assert np.abs(found.q - q).max() < 0.3


def test_equal_calls_have_equal_results_and_seeds_differ():
    robot, its = solver('Panda')
    goals = [pose_at(robot, posture(robot, seed), TOOL) for seed in range(12)]
    first = [its.solve({'tool': goal}, **PATIENT) for goal in goals]
    again = [solve_position(robot, Stack.from_yaml(POSE, robot), {'tool': goal}, **PATIENT)
             for goal in goals]
    assert [each.q.tolist() for each in first] == [each.q.tolist() for each in again]
    restarted = next(index for index, each in enumerate(first) if each.attempts > 1)
    others = {tuple(its.solve({'tool': goals[restarted]}, seed=seed, **PATIENT).q)
              for seed in range(4)}
    assert len(others) > 1


@pytest.mark.parametrize('criterion', ['limits', 'manipulability'])
def test_criterion_chooses_among_solutions(criterion):
    robot, its = solver('UR5')

    def rank(q):
        if criterion == 'limits':
            ranges = robot.upper - robot.lower
            return (np.minimum(q - robot.lower, robot.upper - q) / ranges).min()
        return np.prod(np.linalg.svd(robot.state(q).jacobian('tool0'), compute_uv=False))

    better = 0
    for seed in range(10):
        goals = {'tool': pose_at(robot, posture(robot, seed), 'tool0')}
        chosen = its.solve(goals, criterion=criterion, **PATIENT)
        nearest = its.solve(goals, **PATIENT)
        assert chosen.reached
        assert rank(chosen.q) >= rank(nearest.q) - 1e-9
        better += rank(chosen.q) > rank(nearest.q) + 1e-3
    assert better


def test_nearest_of_three_is_chosen_after_a_restart(monkeypatch):
    robot, its = solver('UR5')
    nearer = 0
    for seed in range(30):
        goals = {'tool': pose_at(robot, posture(robot, seed), 'tool0')}
        found = its.solve(goals, **PATIENT)
        with monkeypatch.context() as patch:
            patch.setattr(solve_position_module, 'NEAREST_OF', 1)
            first = its.solve(goals, **PATIENT)
        distances = [np.linalg.norm(each.q - robot.neutral()) for each in (found, first)]
        assert distances[0] <= distances[1]
        nearer += distances[0] < distances[1]
    assert nearer


def test_tasks_without_a_given_goal_keep_theirs():
    robot = robots.panda()
    text = POSE + '- posture: {type: posture, target: {panda_joint1: 0.5}}\n'
    its = PositionSolver(robot, Stack.from_yaml(text, robot))
    start = np.array(robots.PANDA_READY)
    found = its.solve({'posture': {'panda_joint2': -0.3}}, start, **PATIENT)
    # The tool stays where it was at the start, and is above.
    np.testing.assert_allclose(pose_at(robot, found.q, TOOL), pose_at(robot, start, TOOL),
                               rtol=0.0, atol=1e-6)
    only = PositionSolver(robot, Stack.from_yaml(text.partition('\n')[2], robot))
    expected = start.copy()
    expected[:2] = 0.5, -0.3
    np.testing.assert_allclose(only.solve({'posture': {'panda_joint2': -0.3}}, start).q, expected,
                               rtol=0.0, atol=1e-6)
    # The goal of the call before is gone.
    expected[1] = start[1]
    np.testing.assert_allclose(only.solve(start=start).q, expected, rtol=0.0, atol=1e-6)


def test_values_at_the_start_are_those_of_the_present_call():
    robot = robots.planar()
    its = PositionSolver(robot, Stack.from_yaml('- posture: {type: posture}\n', robot))
    for start in ([0.1, 0.2, 0.3], [0.3, -0.2, 0.1]):
        np.testing.assert_allclose(its.solve(start=start).q, start, atol=1e-9)


def test_goal_below_bounds_that_do_not_hold_is_not_reached():
    robot = robots.panda()
    stack = Stack.from_yaml(
        '- cell: {type: keep_in, frame: panda_link1, shape: {box: [0.1, 0.1, 0.1]}}\n' + POSE,
        robot)
    goal = pose_at(robot, np.array(robots.PANDA_READY), TOOL)
    found = solve_position(robot, stack, {'tool': goal}, **PATIENT)
    assert found.tasks[1].reached
    assert not found.reached


def test_without_goals_those_of_the_stack_count():
    robot = robots.panda()
    text = 'turn: {type: joint, joints: panda_joint1, target: [0.7]}\n'
    found = solve_position(robot, Stack.from_yaml(f'- {text}', robot))
    assert found.reached
    assert found.q[0] == pytest.approx(0.7, abs=1e-6)
    assert solve_position(robot, Stack.from_yaml(POSE, robot)).q.tolist() == \
        robot.neutral().tolist()


def test_velocities_and_disabled_tasks_are_left_out():
    robot = robots.panda()
    stack = Stack.from_yaml(
        f'- slow: {{type: speed_limit, frame: {TOOL}, linear: 0.001}}\n'
        f'- move: {{type: twist, frame: {TOOL}}}\n'
        '- still: {type: joint_velocity, joints: panda_joint1}\n'
        '- still2: {type: joint, joints: panda_joint1, target: [1.0]}\n' + POSE, robot)
    stack.enable('still2', False)
    goal = pose_at(robot, np.array(robots.PANDA_READY), TOOL)
    found = solve_position(robot, stack, {'tool': goal}, **PATIENT)
    assert found.reached
    assert [task.name for task in found.tasks] == ['tool']
    with pytest.raises(GoalError, match="unknown task with a position 'move'.*tool"):
        solve_position(robot, stack, {'move': np.zeros(6)})


def test_stack_in_use_is_left_as_it_is():
    robot = robots.panda()
    ready = np.array(robots.PANDA_READY)
    goal = pose_at(robot, ready + 0.1, TOOL)
    commands = []
    for solves in (False, True):
        stack = Stack.from_yaml(POSE + '- posture: {type: posture}\n', robot)
        controller = Controller(robot, stack)
        controller.update(ready, 0.0)
        if solves:
            assert solve_position(robot, stack, {'tool': goal}, ready).reached
        controller.set_goal('tool', goal, 0.01)
        commands.append([controller.update(ready, 0.01 * number).velocity
                         for number in range(1, 30)])
    np.testing.assert_array_equal(*commands)


def test_passive_positions_are_those_given():
    robot = robots.urdf_robot('panda', tuple(f'panda_joint{number}' for number in range(1, 7)))
    its = PositionSolver(robot, Stack.from_yaml('- tip: {type: position, frame: panda_hand_tcp}',
                                                robot))
    index = robot.passive_names.index('panda_finger_joint1')
    passive = robot.passive_neutral.copy()
    assert passive[index] == 0.0
    frame = 'panda_leftfinger'
    its = PositionSolver(robot, Stack.from_yaml(f'- tip: {{type: position, frame: {frame}}}',
                                                robot))
    passive[index] = 0.04
    goal = robot.state(np.full(6, 0.3) * [1, 1, 1, -4, 1, 3], passive).position(frame)
    found = its.solve({'tip': goal}, passive=passive, **PATIENT)
    assert found.reached
    np.testing.assert_allclose(robot.state(found.q, passive).position(frame), goal, rtol=0.0,
                               atol=GOAL_TOLERANCE)
    # They stay for the next call.
    np.testing.assert_array_equal(its.solve({'tip': goal}, **PATIENT).q, found.q)
    assert found.tasks[0].reached


def test_refused_call_leaves_the_passive_positions_that_count():
    robot = Robot.from_file(robots.PANDA_DH, joints=[
        'panda_joint2', 'panda_joint4', 'panda_joint6'])
    its = PositionSolver(robot, Stack.from_yaml(
        f'- tool: {{type: position, frame: {TOOL}, axes: xz}}', robot))
    passive = [0.5, 0.2, 0.1, 0.0]
    goal = {'tool': robot.state([0.3, -1.0, 1.5], passive).position(TOOL)}
    assert its.solve(goal, passive=passive, **PATIENT).reached
    with pytest.raises(GoalError):
        its.solve({'tool': [1.0]}, passive=np.zeros(4))
    found = its.solve(goal, **PATIENT)
    assert found.reached == found.tasks[0].reached
    for wrong in (np.zeros(3), [np.nan] * 4):
        with pytest.raises(RobotError, match='passive'):
            its.solve(goal, passive=wrong)
    with pytest.raises(RobotError, match='no passive joints'):
        solver('Panda')[1].solve(passive=[1.0])


def test_calls_of_several_threads_do_not_disturb_each_other():
    robot, its = solver('Panda')
    goals = [pose_at(robot, posture(robot, seed), TOOL) for seed in range(12)]
    expected = [its.solve({'tool': goal}, **PATIENT).q.tolist() for goal in goals]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(3):
            found = list(pool.map(lambda goal: its.solve({'tool': goal}, **PATIENT), goals))
            assert [each.q.tolist() for each in found] == expected


def test_task_that_python_evaluates_takes_part():
    robot = robots.panda()

    class Shifted(Position):
        """A task type of another package: one centimetre above the goal."""

        def error(self, state):
            return super().error(state) + [0.0, 0.0, 0.01]

    stack = Stack([[Shifted(robot, 'tool', frame=TOOL)]])
    goal = pose_at(robot, np.array(robots.PANDA_READY), TOOL)[:3, 3]
    found = solve_position(robot, stack, {'tool': goal}, **PATIENT)
    assert found.reached
    np.testing.assert_allclose(robot.state(found.q).position(TOOL), goal + [0.0, 0.0, 0.01],
                               rtol=0.0, atol=GOAL_TOLERANCE)


@pytest.mark.parametrize('method', ['error', 'at_positions', 'forget_cycles', 'jacobian', 'probe'])
def test_failing_task_is_named(method):
    robot = robots.panda()

    def fail(self, *given):
        raise ValueError('no light')

    broken = type('Broken', (Position,), {method: fail, 'type_name': ''})
    with pytest.raises(EvaluationError, match='tool.*no light'):
        solve_position(robot, Stack([[broken(robot, 'tool', frame=TOOL)]]),
                       {'tool': [0.3, 0.0, 0.5]})


@pytest.mark.parametrize('method', ['parse_goal', 'set_goal'])
def test_task_that_fails_with_its_goal_is_named(method):
    robot = robots.panda()

    def fail(self, *given):
        raise ValueError('no light')

    broken = type('Broken', (Position,), {method: fail, 'type_name': ''})
    with pytest.raises(GoalError, match='tool.*no light'):
        solve_position(robot, Stack([[broken(robot, 'tool', frame=TOOL)]]),
                       {'tool': [0.3, 0.0, 0.5]})


def test_timeout_ends_a_search_with_the_best_so_far():
    robot, its = solver('Panda')
    found = its.solve({'tool': [0.5, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0]}, timeout=1e-9)
    assert found.attempts == 1
    assert not found.reached
    assert_within_limits(robot, found.q)


def test_values_at_a_start_beyond_a_limit_are_those_at_the_limit():
    robot = robots.panda()
    start = robot.upper + 0.5
    stack = Stack.from_yaml('- posture: {type: posture}', robot)
    found = solve_position(robot, stack, start=start)
    np.testing.assert_array_equal(found.q, robot.upper)
    assert found.tasks[0].reached


def test_start_beyond_a_limit_is_moved_to_it():
    robot, its = solver('Panda')
    start = np.array(robots.PANDA_READY)
    start[5] = robot.upper[5] + 0.2
    assert_within_limits(robot, its.solve(start=start).q)


@pytest.mark.parametrize(('arguments', 'error', 'text'), [
    ({'goals': {'hand': [0, 0, 0]}}, GoalError, "unknown task with a position 'hand'"),
    ({'goals': {'tool': [0, 0, 0]}}, GoalError, 'tool'),
    ({'goals': {'tool': [np.nan] * 7}}, GoalError, 'finite'),
    ({'goals': [1]}, GoalError, 'goals needs a mapping'),
    ({'start': [0.0, 0.0]}, RobotError, '7 positions'),
    ({'start': [np.inf] * 7}, RobotError, 'finite'),
    ({'attempts': 0}, SettingsError, 'attempts must be a whole number from 1'),
    ({'attempts': 2.5}, SettingsError, 'attempts'),
    ({'timeout': 0.0}, SettingsError, 'timeout must be more than 0 s'),
    ({'timeout': None}, SettingsError, 'timeout'), ({'timeout': 10 ** 400}, SettingsError,
                                                    'timeout'),
    ({'timeout': True}, SettingsError, 'timeout'), ({'timeout': np.nan}, SettingsError, 'timeout'),
    ({'seed': -1}, SettingsError, 'seed'),
    ({'seed': True}, SettingsError, 'seed'),
    ({'criterion': 'fastest'}, SettingsError, 'unknown criterion .fastest.*nearest'),
    ({'criterion': []}, SettingsError, 'criterion'),
], ids=str)
def test_wrong_arguments_are_named(arguments, error, text):
    _, its = solver('Panda')
    with pytest.raises(error, match=text):
        its.solve(**arguments)


def test_copy_of_a_solver_has_its_answers():
    robot = robots.panda()
    first = PositionSolver(robot, Stack.from_yaml(
        POSE + '- posture: {type: posture, target: [0.1, 0.2, 0.3, -1.8, 0.5, 1.6, 0.7]}', robot))
    own = first.solve(**PATIENT)
    first.solve({'posture': robot.neutral()}, **PATIENT)
    for copied in (pickle.loads(pickle.dumps(first)), copy.deepcopy(first)):
        assert copied.solve(**PATIENT).q == pytest.approx(own.q, abs=1e-12)


def test_what_is_no_stack_is_refused():
    with pytest.raises(StackError, match='needs a Stack'):
        PositionSolver(robots.panda(), POSE)


def test_posture_is_finished_after_whole_turns():
    # A turn towards the start changes the error of a posture, and what reduces it.
    robot, its = solver(
        'UR5', '- tool: {type: position, frame: tool0}\n- posture: {type: posture}')
    q = np.array([0.3, -1.0, 1.2, 0.4, 0.8, -1.0])
    turned = q + 2.0 * np.pi * np.eye(6)[5]
    begin = its._begin({'tool': robot.state(q).position('tool0'), 'posture': np.zeros(6)},
                       np.zeros(6), None)
    tasks = its._tasks
    found = its._chosen([Attempts(turned, tasks.at(turned).costs, 1)], begin, 'nearest', np.inf)
    assert found.costs[0] <= GOAL_TOLERANCE ** 2
    assert found.costs[1] < 0.9 * tasks.at(q).costs[1]
