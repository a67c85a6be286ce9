# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What every task type promises, checked on all that are registered; then each on its own."""

import inspect
import json
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from scipy.spatial.transform import Rotation
from tp_controller import GoalError, Robot, solve, Stack, StackError, TaskError
from tp_controller.tasks import BoundedTask, GradientTask, JointTask, task_types
from tp_controller.tasks.needs import NEEDS
from tp_controller.tasks.velocity import VelocityTask

SEEDS = st.integers(0, 2 ** 32 - 1)
TOOL, ELBOW = robots.PANDA_TOOL, 'panda_link3'
ALL = [0, 1, 2, 3, 4, 5]

KINDS = task_types()
# More cases than the example of a type: keys, and which rows of a twist (or which joints) the task
# is about; a number of rows where it is neither.
CASES = {
    'position': [
        ({'frame': TOOL, 'gain': 2.0}, [0, 1, 2]),
        ({'frame': TOOL, 'axes': 'xz'}, [0, 2]),
        ({'frame': TOOL, 'axes': ['y']}, [1]),
        ({'frame': TOOL, 'reference': ELBOW, 'gain': [1.0, 2.0, 3.0]}, [0, 1, 2]),
        ({'frame': 'panda_link6', 'reference': 'panda_link2', 'axes': 'x, y'}, [0, 1]),
    ],
    'orientation': [
        ({'frame': TOOL, 'gain': 2.0}, [3, 4, 5]),
        ({'frame': TOOL, 'axes': 'xy'}, [3, 4]),
        ({'frame': TOOL, 'reference': ELBOW, 'gain': 0.5}, [3, 4, 5]),
        ({'frame': TOOL, 'reference': ELBOW, 'axes': 'z x'}, [3, 5]),
    ],
    'pose': [
        ({'frame': TOOL, 'gain': 2.0}, ALL),
        ({'frame': TOOL, 'axes': 'x y z rx ry'}, [0, 1, 2, 3, 4]),
        ({'frame': TOOL, 'axes': ['z', 'rx']}, [2, 3]),
        ({'frame': TOOL, 'axes': 'rz x', 'gain': [1.0, 4.0]}, [0, 5]),
        ({'frame': TOOL, 'reference': 'panda_link1'}, ALL),
    ],
    'relative_position': [
        ({'frame': TOOL, 'reference': ELBOW, 'gain': 2.0}, [0, 1, 2]),
        ({'frame': TOOL, 'reference': 'panda_link2', 'axes': 'yz'}, [1, 2]),
    ],
    'relative_pose': [
        ({'frame': TOOL, 'reference': ELBOW, 'gain': 2.0}, ALL),
        ({'frame': TOOL, 'reference': 'panda_link2', 'axes': 'x ry'}, [0, 4]),
    ],
    'base_pose': [
        ({'gain': 2.0}, [0, 1, 5]),
        ({'axes': 'rz x', 'gain': [1.0, 4.0]}, [0, 5]),
    ],
    'base_orientation': [
        ({'gain': 0.5}, [5]),
        ({'axes': 'z'}, [5]),
    ],
    'twist': [
        ({'frame': TOOL}, ALL),
        ({'frame': TOOL, 'axes': 'rz y'}, [1, 5]),
        ({'frame': TOOL, 'reference': 'panda_link1'}, ALL),
    ],
    'joint': [
        ({'joints': 'panda_joint3', 'gain': 3.0}, [2]),
        ({'joints': ['panda_joint6', 'panda_joint1'], 'gain': [1.0, 2.0]}, [5, 0]),
    ],
    'posture': [
        ({}, list(range(7))),
        ({'joints': ['panda_joint2'], 'gain': 2.0}, [1]),
    ],
    'joint_velocity': [
        ({}, list(range(7))),
        ({'joints': ['panda_joint5', 'panda_joint2']}, [4, 1]),
    ],
    'pointing': [
        ({'frame': TOOL, 'gain': 2.0}, 2),
        ({'frame': TOOL, 'axis': [1.0, 2.0, -0.5], 'reference': ELBOW}, 2),
        ({'frame': TOOL, 'towards': 'point', 'gain': [1.0, 3.0]}, 2),
        ({'frame': TOOL, 'axis': '-x', 'towards': 'point', 'reference': 'panda_link2'}, 2),
    ],
    'look_at': [
        ({'frame': TOOL, 'gain': 2.0}, 2),
        ({'frame': 'panda_link6', 'axis': 'x', 'reference': ELBOW}, 2),
    ],
    'center_of_mass': [
        ({'gain': 2.0}, 3),
        ({'axes': 'yx'}, 2),
    ],
}
# Inequality tasks, and tasks that maximize a function, have a contract of their own.
EQUALITIES = [name for name, kind in KINDS.items()
              if not issubclass(kind, (BoundedTask, GradientTask))]
CONTRACT = [pytest.param(name, dict(KINDS[name].example), None, id=f'{name}-example')
            for name in EQUALITIES]
CONTRACT += [pytest.param(name, keys, rows, id=f'{name}-{index}')
             for name, cases in CASES.items() for index, (keys, rows) in enumerate(cases)]
WITH_VALUE = [case for case in CONTRACT if not issubclass(KINDS[case.values[0]], VelocityTask)]
WITH_ROWS = [case for case in CONTRACT if isinstance(case.values[2], list)]
NOT_FINITE = (math.nan, math.inf, -math.inf, 1e7)


def make(name, keys, robot=None):
    """Return a task of a type, about a robot that can have it."""
    return KINDS[name](robot or robots.robot_for(KINDS[name]), 'task', **keys)


def ready(task):
    """Return a configuration of the robot of a task, far from every limit."""
    return task.robot.configuration(robots.PANDA_READY)


def inside(robot, rng):
    """Return a random configuration (nq,), some way within the limits, the base near the root."""
    lower, upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    zero = robot.configuration(np.zeros(len(robot.joint_names)))
    return robot.integrate(zero, rng.uniform(lower + 0.1, upper - 0.1), 1.0)


def relative_twist(robot, q, direction, frame, reference, h=1e-6):
    """Return the twist (6,) of a frame seen from another, for motion along `direction`."""
    relative = []
    for step in (-h, h):
        state = robot.state(robot.integrate(q, direction, step))
        relative.append(np.linalg.inv(state.pose(reference)) @ state.pose(frame))
    before, after = relative
    turned = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
    return np.concatenate((after[:3, 3] - before[:3, 3], turned)) / (2 * h)


def motion(task, rows, q, direction):
    """Return how fast the value of a task moves, by differences of the robot's poses."""
    if not isinstance(rows, list):
        # Near the goal the error falls as the value moves towards it.
        goal, h = task.goal, 1e-6
        task.goal = task.value(task.robot.state(q))
        before, after = (task.error(task.robot.state(task.robot.integrate(q, direction, step)))
                         for step in (-h, h))
        task.goal = goal
        return (before - after) / (2 * h)
    if isinstance(task, JointTask):
        return direction[rows]
    return relative_twist(task.robot, q, direction, task.frame, task.reference)[rows]


# The contract

@pytest.mark.parametrize('name', KINDS)
def test_every_type_has_an_example_on_the_panda(name):
    kind = KINDS[name]
    accepted = kind.accepted_keys()
    needed = {key for key, default in accepted.items() if default is inspect.Parameter.empty}
    assert needed <= set(kind.example) <= set(accepted)
    robot = robots.robot_for(kind)
    task, = Stack.from_yaml(json.dumps([{'task': {'type': name, **kind.example}}]),
                            robot).tasks.values()
    task.start(robot.state(robot.configuration(robots.PANDA_READY)))
    assert task.evaluate(robot.state(robot.neutral()), 0.0).level.J.shape[1] == robot.n


# Each lacks masses, shapes and position limits; the first a base that moves, the second joints.
BARE = (Robot.from_urdf("""<robot name="wheel"><link name="stand"/><link name="wheel"/>
  <joint name="axle" type="continuous"><parent link="stand"/><child link="wheel"/></joint>
</robot>"""), Robot.from_urdf('<robot name="stone"><link name="stone"/></robot>', 'floating'))


@pytest.mark.parametrize('name', [name for name, kind in KINDS.items() if kind.needs])
def test_robot_that_lacks_what_a_type_needs_is_refused_in_one_sentence(name):
    kind = KINDS[name]
    keys = {key: value for key, value in kind.example.items() if key != 'capsules'}
    told = set()
    for robot in BARE:
        unmet = [need for need in kind.needs if not NEEDS[need].met(robot)]
        told.update(unmet)
        if unmet:
            with pytest.raises(StackError) as error:
                # JSON is YAML in one line.
                Stack.from_yaml(json.dumps([{'task': {'type': name, **keys}}]), robot)
            assert str(error.value) == '; '.join(
                f'line 1: task, type: {name} needs {NEEDS[need].what}; {NEEDS[need].lack(robot)}'
                for need in unmet)
    assert told == set(kind.needs)


@pytest.mark.parametrize('name', KINDS)
def test_every_key_is_described_and_has_a_default_that_is_valid(name):
    kind = KINDS[name]
    accepted, described = kind.accepted_keys(), kind.described_keys()
    assert set(described) == set(accepted) == set(kind.key_ranges())
    assert all(len(text) > 10 and '\n' not in text for text in described.values())
    given = {key: default for key, default in accepted.items()
             if default is not inspect.Parameter.empty}
    assert kind(robots.robot_for(kind), 'task', **{**given, **kind.example})
    assert list(inspect.signature(kind).parameters) == ['robot', 'name', *accepted]


@pytest.mark.parametrize('name, keys, rows', [
    case for case in CONTRACT if case in WITH_VALUE or case in WITH_ROWS])
def test_jacobian_is_the_derivative_of_the_value(name, keys, rows):
    task, rng = make(name, keys), np.random.default_rng(1)
    for _ in range(3):
        q = inside(task.robot, rng)
        state = task.robot.state(q)
        if not isinstance(rows, list):
            # Away from the goal the error does not fall as the value moves towards it.
            task.goal = task.value(state)
        task.start(state)
        numeric = np.array([motion(task, rows, q, axis) for axis in np.eye(task.robot.n)]).T
        np.testing.assert_allclose(task.jacobian(state), numeric, atol=1e-8)
        count = len(rows) if isinstance(rows, list) else rows
        assert task.rows == len(task.units) == (task.rows if rows is None else count)
        assert task.jacobian(state).shape == (task.rows, task.robot.n)


@pytest.mark.parametrize('name, keys, rows', WITH_VALUE)
def test_error_is_zero_at_the_goal_and_only_there(name, keys, rows):
    task, rng = make(name, keys), np.random.default_rng(2)
    q = inside(task.robot, rng)
    state = task.robot.state(q)
    task.set_goal(task.parse_goal(task.value(state)), 0.0)
    np.testing.assert_allclose(task.error(state), 0.0, atol=1e-7)
    np.testing.assert_allclose(task.level(state, 0.0).v, 0.0, atol=1e-6)
    elsewhere = task.robot.state(task.robot.integrate(q, np.ones(task.robot.n), 0.1))
    assert np.linalg.norm(task.error(elsewhere)) > 1e-3


@pytest.mark.parametrize('name, keys, rows', WITH_VALUE)
def test_error_is_desired_minus_actual(name, keys, rows):
    task, rng = make(name, keys), np.random.default_rng(3)
    q = inside(task.robot, rng)
    direction = rng.normal(size=task.robot.n)
    task.set_goal(task.value(task.robot.state(task.robot.integrate(q, direction, 1e-5))), 0.0)
    np.testing.assert_allclose(task.error(task.robot.state(q)) / 1e-5,
                               motion(task, rows, q, direction), atol=1e-3)


@pytest.mark.parametrize('name, keys, rows', WITH_VALUE)
def test_one_step_shrinks_the_error_by_one_minus_gain_times_period(name, keys, rows):
    task, rng = make(name, keys), np.random.default_rng(4)
    robot, dt = task.robot, 0.01
    for _ in range(5):
        q = inside(robot, rng)
        near = robot.integrate(q, rng.normal(size=robot.n), 1e-3)
        task.set_goal(task.value(robot.state(near)), 0.0)
        evaluation = task.evaluate(robot.state(q), 0.0)
        J, v, before = evaluation.level.J, evaluation.level.v, evaluation.error
        after = task.error(robot.state(robot.integrate(q, solve([(J, v)]).velocity, dt)))
        gain = np.asarray(keys.get('gain', 1.0))
        np.testing.assert_allclose(after, (1.0 - gain * dt) * before, rtol=0,
                                   atol=0.03 * dt * np.linalg.norm(gain * before))


@pytest.mark.parametrize('name, keys, rows', [
    case for case in WITH_ROWS if case not in WITH_VALUE])
def test_velocity_task_moves_as_its_goal_says_and_stops_when_it_is_too_old(name, keys, rows):
    task, rng = make(name, keys), np.random.default_rng(5)
    q = inside(task.robot, rng)
    state = task.robot.state(q)
    task.start(state)
    assert task.level(state, 0.0).v.tolist() == [0.0] * task.rows
    wanted = rng.normal(size=6 if name == 'twist' else task.rows)
    task.set_goal(task.parse_goal(wanted), 10.0)
    level = task.level(state, 10.2)
    J, v = level.J, level.v
    velocity = solve([(J, v)]).velocity
    expected = wanted[rows] if name == 'twist' else wanted
    np.testing.assert_allclose(motion(task, rows, q, velocity), expected, atol=1e-7)
    assert task.level(state, 10.6).v.tolist() == [0.0] * task.rows


@pytest.mark.parametrize('name, keys, rows', CONTRACT)
def test_bad_goals_are_refused_and_the_goal_in_force_stays(name, keys, rows):
    task = make(name, keys)
    state = task.robot.state(ready(task))
    task.start(state)
    good = task.value(state)
    before = task.level(state, 0.0).v
    bad = [None, 'goal', object(), [], [[]], [[1.0], [1.0, 2.0]], 0.0, np.zeros(17),
           np.zeros((3, 4)), np.zeros((2, task.rows)), {'no_such_name': 0.0}, ['a'] * task.rows,
           [10 ** 400] * task.rows]
    for value in NOT_FINITE:
        spoilt = np.array(good, dtype=float)
        spoilt.flat[0] = value
        bad.append(spoilt)
    for goal in bad:
        with pytest.raises(GoalError, match="'task'"):
            task.parse_goal(goal)
    np.testing.assert_array_equal(task.level(state, 0.0).v, before)


@pytest.mark.parametrize('name, keys, rows', CONTRACT)
def test_bad_feed_forward_is_refused(name, keys, rows):
    task = make(name, keys)
    size = task.rows if isinstance(task, JointTask) else 6
    bad = [None, 'v', [], [[1.0], [1.0, 2.0]], np.zeros(17), {'no_such_name': 0.0},
           *([value] + [0.0] * (size - 1) for value in NOT_FINITE)]
    for velocity in bad:
        with pytest.raises(GoalError, match="'task'"):
            task.parse_feed_forward(velocity)


@pytest.mark.parametrize('name', EQUALITIES)
def test_every_type_says_what_it_takes_and_what_it_is(name):
    task_type = task_types()[name]
    assert task_type.type_name == name
    kinds = (None, 'point', 'direction', 'quaternion', 'pose', 'joints', 'joint_velocities')
    assert {task_type.goal_type, *task_type.goal_types} <= set(kinds)
    assert task_type.feed_forward_type in ('twist', 'joint_velocities', None)
    assert task_type.goal_type or task_type.feed_forward_type
    assert inspect.getdoc(task_type)


@pytest.mark.parametrize('name, keys, rows', WITH_ROWS)
def test_units_are_those_of_the_rows(name, keys, rows):
    task = make(name, keys)
    joints = isinstance(task, JointTask)
    assert task.units == tuple('m' if row < 3 and not joints else 'rad' for row in rows)


@pytest.mark.parametrize('name, keys, rows', WITH_VALUE)
def test_task_without_a_goal_holds_the_value_it_started_at(name, keys, rows):
    task, rng = make(name, keys), np.random.default_rng(6)
    start = task.robot.state(inside(task.robot, rng))
    task.start(start)
    np.testing.assert_allclose(task.error(start), 0.0, atol=1e-7)
    elsewhere = task.robot.state(inside(task.robot, rng))
    error = task.error(elsewhere)
    assert np.linalg.norm(error) > 1e-3
    task.start(elsewhere)
    np.testing.assert_array_equal(task.error(elsewhere), error)


@pytest.mark.parametrize('name, keys, rows', WITH_VALUE)
def test_goal_set_before_the_start_is_kept_at_the_start(name, keys, rows):
    task, rng = make(name, keys), np.random.default_rng(7)
    goal, start = (task.robot.state(inside(task.robot, rng)) for _ in range(2))
    task.set_goal(task.parse_goal(task.value(goal)), 0.0)
    task.start(start)
    np.testing.assert_allclose(task.error(goal), 0.0, atol=1e-7)


@pytest.mark.parametrize('name, keys, rows', [
    case for case in WITH_ROWS if case in WITH_VALUE])
def test_feed_forward_adds_to_the_feedback_until_it_times_out(name, keys, rows):
    task, rng = make(name, {**keys, 'timeout': 0.25}), np.random.default_rng(8)
    state = task.robot.state(inside(task.robot, rng))
    task.start(task.robot.state(inside(task.robot, rng)))
    feedback = task.level(state, 0.0).v
    given_ = rng.normal(size=task.rows if isinstance(task, JointTask) else 6)
    wanted = given_ if isinstance(task, JointTask) else given_[rows]
    task.set_feed_forward(task.parse_feed_forward(given_), 100.0)
    np.testing.assert_allclose(task.level(state, 100.0).v, feedback + wanted)
    np.testing.assert_allclose(task.level(state, 100.24).v, feedback + wanted)
    np.testing.assert_allclose(task.level(state, 100.26).v, feedback)
    np.testing.assert_allclose(task.level(state, 100.1).v, feedback)


def test_clock_that_jumps_back_ends_a_feed_forward_too():
    for name in ('position', 'twist', 'joint_velocity'):
        task = make(name, CASES[name][0][0])
        state = task.robot.state(robots.PANDA_READY)
        task.start(state)
        size = 7 if name == 'joint_velocity' else 6
        task.set_feed_forward(task.parse_feed_forward(np.ones(size)), 100.0)
        assert task.level(state, 3.0).v.tolist() == [0.0] * task.rows


# Keys

def faults(name, keys, robot=None):
    """Return the keys that a task type finds at fault."""
    with pytest.raises(TaskError) as caught:
        make(name, keys, robot)
    return [key for key, _ in caught.value.faults]


def test_all_wrong_keys_are_reported_at_once():
    assert faults('position', {'frame': 'tool', 'reference': 'world', 'axes': 'w', 'gain': -1,
                               'tolerance': 'small', 'timeout': math.nan}) == [
        'frame', 'reference', 'axes', 'gain', 'tolerance', 'timeout']
    assert faults('joint', {'joints': 'elbow', 'gain': 'high', 'tolerance': 0}) == [
        'joints', 'gain', 'tolerance']
    assert faults('joint', {'joints': 'panda_joint1', 'target': [9.0]}) == ['target']
    assert faults('joint_velocity', {'joints': 5, 'timeout': 0}) == ['joints', 'timeout']


@pytest.mark.parametrize('keys', [
    {'gain': 0}, {'gain': -1.0}, {'gain': math.nan}, {'gain': math.inf}, {'gain': 1e7},
    {'gain': True}, {'gain': 'x'}, {'gain': [1.0, 2.0]}, {'gain': [1.0, 2.0, 0.0]}, {'gain': {}},
    {'axes': ''}, {'axes': []}, {'axes': 'xx'}, {'axes': 'rx'}, {'axes': 5}, {'axes': ['x', 1]},
    {'axes': [['x']]}, {'frame': 5}, {'frame': ['panda_link1']}, {'frame': None},
    {'reference': ''}, {'reference': 0}, {'reference': {}},
    {'tolerance': 0.0}, {'tolerance': -1e-3}, {'tolerance': {'s': 1.0}}, {'tolerance': [1e-3]},
    {'tolerance': {'m': None}}, {'timeout': 0.0}, {'timeout': '1'}, {'timeout': None},
])
def test_key_with_a_senseless_value_is_refused(keys):
    assert faults('position', {'frame': TOOL, **keys}) == list(keys)


@pytest.mark.parametrize('joints', ['x', [], {}, 7, ['panda_joint1', 'panda_joint1'],
                                    ['panda_joint1', 2], [['panda_joint1']]])
def test_joints_that_are_none_are_refused(joints):
    assert faults('joint', {'joints': joints}) == ['joints']


def test_message_names_the_key_what_was_given_and_what_is_valid():
    with pytest.raises(TaskError, match="task task: frame: unknown frame 'panda_link88'.*did you "
                                        'mean.*valid: panda_link0'):
        make('pose', {'frame': 'panda_link88'})
    with pytest.raises(TaskError, match="axes: needs some of x, y, z, rx, ry, rz, got 'w'"):
        make('pose', {'frame': TOOL, 'axes': 'w'})


# Gains, tolerances, default goals

def test_each_row_can_have_its_own_gain():
    task = make('pose', {'frame': TOOL, 'gain': [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]})
    task.set_goal(task.value(task.robot.state(np.add(robots.PANDA_READY, 0.1))), 0.0)
    evaluation = task.evaluate(task.robot.state(robots.PANDA_READY), 0.0)
    np.testing.assert_allclose(evaluation.level.v, np.arange(1, 7) * evaluation.error)


def test_tolerance_is_one_number_or_one_for_each_unit():
    def tolerances(keys):
        return {unit: (rows.tolist(), tolerance)
                for rows, unit, tolerance in make('pose', {'frame': TOOL, **keys}).groups}
    rows = {'m': [0, 1, 2], 'rad': [3, 4, 5]}
    assert tolerances({}) == {'m': (rows['m'], 1e-3), 'rad': (rows['rad'], 5e-3)}
    assert tolerances({'tolerance': 0.02}) == {'m': (rows['m'], 0.02), 'rad': (rows['rad'], 0.02)}
    assert tolerances({'tolerance': {'rad': 0.1}}) == {
        'm': (rows['m'], 1e-3), 'rad': (rows['rad'], 0.1)}
    assert tolerances({'axes': 'rx z'}) == {'m': ([0], 1e-3), 'rad': ([1], 5e-3)}


def test_reported_error_is_its_norm_for_each_unit():
    task = make('pose', {'frame': TOOL})
    error = np.array([3.0, 4.0, 0.0, 0.0, 0.0, 2.0])
    assert task.reported_errors(error, None) == ((5.0, 'm', 1e-3), (2.0, 'rad', 5e-3))


def test_velocity_task_reports_what_is_missing_of_its_velocity():
    task = make('twist', {'frame': TOOL})
    residual = np.array([0.0, 0.3, 0.4, 1.0, 0.0, 0.0])
    assert task.reported_errors(np.zeros(6), residual) == (
        (0.5, 'm/s', 1e-3), (1.0, 'rad/s', 5e-3))


@pytest.mark.parametrize('name, keys, rows', WITH_VALUE)
def test_restart_forgets_default_goals_only(name, keys, rows):
    task, rng = make(name, keys), np.random.default_rng(9)
    first, second = (task.robot.state(inside(task.robot, rng)) for _ in range(2))
    task.start(first)
    task.reset()
    task.start(second)
    np.testing.assert_allclose(task.error(second), 0.0, atol=1e-7)
    task.set_goal(task.value(first), 0.0)
    task.reset()
    task.start(second)
    np.testing.assert_allclose(task.error(first), 0.0, atol=1e-7)


# Positions, and relative motion

def test_axes_are_those_of_the_reference_frame():
    robot = robots.panda()
    state = robot.state(robots.PANDA_READY)
    task = make('position', {'frame': TOOL, 'reference': ELBOW, 'axes': 'y'})
    T = np.linalg.inv(state.pose(ELBOW)) @ state.pose(TOOL)
    task.set_goal(task.parse_goal(T[:3, 3] + [0.5, 0.2, -0.3]), 0.0)
    assert task.error(state) == pytest.approx([0.2])


def test_motion_of_the_reference_alone_is_no_motion_of_what_it_carries():
    task = make('pose', {'frame': TOOL, 'reference': 'panda_link4'})
    state = task.robot.state(robots.PANDA_READY)
    np.testing.assert_allclose(task.jacobian(state)[:, :4], 0.0, atol=1e-12)


@pytest.mark.parametrize('name, keys', [('position', {'frame': TOOL}),
                                        ('orientation', {'frame': TOOL})])
def test_feed_forward_of_a_part_of_the_twist_may_be_that_part_alone(name, keys):
    task = make(name, keys)
    whole = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0] if name == 'position' else [0.0] * 3 + [1.0, 2.0, 3.0]
    assert task.parse_feed_forward([1.0, 2.0, 3.0]).tolist() == whole
    assert task.parse_feed_forward(whole).tolist() == whole


# Joints

def test_joint_without_end_takes_the_shorter_way():
    robot = robots.mixed()
    task = make('joint', {'joints': ['turn', 'spin', 'roll']}, robot)
    task.set_goal(task.parse_goal({'turn': 2.4, 'spin': -3.0, 'roll': 1.0}), 0.0)
    error = task.error(robot.state([-1.9, 0.0, 3.0, 1.0 + 20 * math.pi]))
    assert error == pytest.approx([4.3, 2 * math.pi - 6.0, 0.0])


def test_joint_goal_by_name_leaves_the_other_joints_theirs():
    task = make('joint', {'joints': ['panda_joint1', 'panda_joint6'],
                          'target': {'panda_joint6': 1.0}})
    state = task.robot.state(robots.PANDA_READY)
    task.start(state)
    assert task.error(state) == pytest.approx([0.0, 1.0 - 1.571])
    task.set_goal(task.parse_goal({'panda_joint1': 0.4}), 0.0)
    assert task.error(state) == pytest.approx([0.4, 1.0 - 1.571])
    task.set_goal(task.parse_goal([0.1, 0.2]), 0.0)
    assert task.error(state) == pytest.approx([0.1, 0.2 - 1.571])


def test_joint_goal_beyond_a_limit_is_refused_with_the_limits():
    task = make('posture', {})
    with pytest.raises(GoalError, match=r'panda_joint4 = 0.5 is outside its limits \[-3.07'):
        task.parse_goal({'panda_joint4': 0.5})
    assert faults('posture', {'target': {'panda_joint4': 0.5}}) == ['target']


def test_unknown_joint_of_a_goal_is_named_with_the_valid_ones():
    task = make('joint', {'joints': 'panda_joint1'})
    with pytest.raises(GoalError, match="unknown joint 'panda_joint2'.*valid: panda_joint1"):
        task.parse_goal({'panda_joint2': 0.0})


def test_joint_velocity_by_name_leaves_the_others_at_rest():
    task = make('joint_velocity', {})
    assert task.parse_goal({'panda_joint2': 0.5}).tolist() == [0, 0.5, 0, 0, 0, 0, 0]


def test_linear_joint_counts_in_metres():
    task = make('posture', {}, robots.mixed())
    assert task.units == ('rad', 'm', 'rad', 'rad')


# Orientations

class Body:
    """A state in which a frame can be turned at will: an ideal robot for an orientation."""

    def __init__(self, R, position=(0.0, 0.0, 0.0)):
        self._R, self._position = R, np.array(position)

    def rotation(self, frame):
        """Return the orientation, whatever the frame."""
        return self._R

    def position(self, frame):
        """Return the position, whatever the frame."""
        return self._position


def turn(task, R, cycles, dt=0.02, noise=0.0, rng=None):
    """Follow an orientation task; return the orientation at the end and the angle turned."""
    turned = 0.0
    angular = slice(3, 6) if task.rows == 6 else slice(0, 3)
    for _ in range(cycles):
        seen = R
        if noise:
            seen = (Rotation.from_rotvec(noise * rng.normal(size=3))).as_matrix() @ R
        step = dt * task.velocity(task.error(Body(seen)), 0.0)[angular]
        turned += np.linalg.norm(step)
        R = Rotation.from_rotvec(step).as_matrix() @ R
    return R, turned


def random_orientations(rng, count):
    """Return rotation matrices (count, 3, 3), all orientations equally likely."""
    return Rotation.from_quat(rng.normal(size=(count, 4))).as_matrix()


def angle(R, S):
    """Return the angle between two orientations [rad]."""
    return Rotation.from_matrix(R @ S.T).magnitude()


def orientation_task(name='orientation', gain=2.0):
    """Return a task about the orientation of the Panda's tool."""
    return make(name, {'frame': TOOL, 'gain': gain})


def set_orientation(task, R):
    """Give a task an orientation as its goal."""
    goal = R if task.type_name == 'orientation' else np.block([
        [R, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    task.set_goal(task.parse_goal(goal), 0.0)


@given(SEEDS, st.sampled_from(['orientation', 'pose']))
@pytest.mark.slow
def test_orientation_converges_from_anywhere_to_anywhere_by_the_shorter_way(seed, name):
    start, goal = random_orientations(np.random.default_rng(seed), 2)
    task = orientation_task(name)
    set_orientation(task, goal)
    end, turned = turn(task, start, 400)
    assert angle(end, goal) < 1e-5
    assert turned == pytest.approx(angle(start, goal), rel=1e-5)


@pytest.mark.slow
@given(SEEDS, st.floats(95.0, 180.0))
def test_goal_far_from_the_base_orientation_is_reached(seed, degrees):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    goal = Rotation.from_rotvec(math.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    start = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix() @ goal
    task = orientation_task()
    set_orientation(task, goal)
    end, turned = turn(task, start, 400)
    assert angle(end, goal) < 1e-5
    assert turned == pytest.approx(angle(start, goal), rel=1e-5)


@pytest.mark.parametrize('axis', [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.0, 0.8],
                                  [-0.48, 0.6, 0.64]])
def test_half_a_turn_is_made_at_full_speed_from_the_start(axis):
    goal, = random_orientations(np.random.default_rng(1), 1)
    start = Rotation.from_rotvec(math.pi * np.array(axis)).as_matrix() @ goal
    task = orientation_task()
    set_orientation(task, goal)
    assert np.linalg.norm(task.error(Body(start))) == pytest.approx(math.pi, abs=1e-6)
    end, turned = turn(task, start, 400)
    assert angle(end, goal) < 1e-5
    assert turned == pytest.approx(math.pi, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize('name', ['orientation', 'pose'])
def test_half_a_turn_does_not_stall_where_measurements_are_noisy(name):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        goal, = random_orientations(rng, 1)
        axis = rng.normal(size=3)
        start = Rotation.from_rotvec(
            math.pi * axis / np.linalg.norm(axis)).as_matrix() @ goal
        task = orientation_task(name)
        set_orientation(task, goal)
        # At the gain of 2/s and 10 ms, 0.2 s of steady motion make one third of the way.
        end, turned = turn(task, start, 20, dt=0.01, noise=1e-3, rng=rng)
        assert angle(end, goal) < 0.72 * math.pi
        end, more = turn(task, end, 500, dt=0.01, noise=1e-3, rng=rng)
        assert angle(end, goal) < 0.01


@pytest.mark.parametrize('name', ['orientation', 'pose'])
def test_noise_at_half_a_turn_never_turns_the_robot_round(name):
    rng = np.random.default_rng(4)
    for goal in random_orientations(rng, 10):
        axis = rng.normal(size=3)
        half = Rotation.from_rotvec(math.pi * axis / np.linalg.norm(axis)).as_matrix() @ goal
        task = orientation_task(name)
        set_orientation(task, goal)
        errors = [task.error(Body(Rotation.from_rotvec(1e-3 * rng.normal(size=3)).as_matrix()
                                  @ half))[-3:] for _ in range(50)]
        assert (np.array(errors) @ errors[0] > 0.99 * math.pi ** 2).all()


@pytest.mark.parametrize('degrees', [10, 90, 170])
def test_robot_pushed_past_its_goal_comes_back_the_shorter_way(degrees):
    task = orientation_task()
    set_orientation(task, np.eye(3))
    for sign in (1.0, -1.0, 1.0):
        vector = sign * math.radians(degrees) * np.array([0.6, 0.0, 0.8])
        error = task.error(Body(Rotation.from_rotvec(vector).as_matrix()))
        np.testing.assert_allclose(error, -vector, atol=1e-9)


def test_longer_way_is_kept_only_close_to_half_a_turn():
    task = orientation_task()
    set_orientation(task, np.eye(3))
    for angle_ in (3.0, math.pi + 0.09, math.pi + 0.11):
        error = task.error(Body(Rotation.from_rotvec([0.0, 0.0, angle_]).as_matrix()))
        expected = -angle_ if angle_ < math.pi + 0.1 else 2.0 * math.pi - angle_
        np.testing.assert_allclose(error, [0.0, 0.0, expected], atol=1e-9)


def test_new_goal_is_approached_the_shorter_way_whatever_was_followed_before():
    task = orientation_task()
    start = np.eye(3)
    for sign in (1.0, -1.0, 1.0):
        set_orientation(task, Rotation.from_rotvec([0.0, 0.0, sign * 3.1]).as_matrix())
        assert task.error(Body(start)) == pytest.approx([0.0, 0.0, sign * 3.1])


def test_orientation_is_a_quaternion_of_either_sign_or_a_matrix():
    rotation = Rotation.from_rotvec([0.1, -0.7, 0.4])
    task = orientation_task()
    for goal in (rotation.as_quat(), -rotation.as_quat(), 1.001 * rotation.as_quat(),
                 rotation.as_matrix()):
        np.testing.assert_allclose(task.parse_goal(goal), rotation.as_matrix(), atol=1e-12)
    pose = make('pose', {'frame': TOOL}).parse_goal([1.0, 2.0, 3.0, *rotation.as_quat()])
    np.testing.assert_allclose(pose[:3, :3], rotation.as_matrix(), atol=1e-12)
    assert pose[:, 3].tolist() == [1.0, 2.0, 3.0, 1.0]


@pytest.mark.parametrize('goal', [
    [0.0] * 4, [0.5, 0.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.2], np.diag([1.0, 1.0, -1.0]),
    2.0 * np.eye(3), np.ones((3, 3)), np.zeros((3, 3))])
def test_what_is_no_orientation_is_refused(goal):
    with pytest.raises(GoalError, match="the goal of task 'task'"):
        orientation_task().parse_goal(goal)
    pose = make('pose', {'frame': TOOL})
    whole = np.eye(4)
    if np.shape(goal) == (3, 3):
        whole[:3, :3] = goal
    else:
        whole = [0.0, 0.0, 0.0, *goal]
    with pytest.raises(GoalError, match="the goal of task 'task'"):
        pose.parse_goal(whole)


def test_tool_that_points_down_turns_by_30_degrees_about_any_axis():
    robot = robots.panda()
    start = robot.state(robots.PANDA_READY).pose(TOOL)
    rng = np.random.default_rng(0)
    for _ in range(12):
        axis = rng.normal(size=3)
        goal = start.copy()
        goal[:3, :3] = Rotation.from_rotvec(
            math.radians(30) * axis / np.linalg.norm(axis)).as_matrix() @ start[:3, :3]
        task = make('pose', {'frame': TOOL, 'gain': 5.0})
        task.set_goal(task.parse_goal(goal), 0.0)
        q, state = np.array(robots.PANDA_READY), robot.state(robots.PANDA_READY)
        turned = 0.0
        for _ in range(120):
            state.update(q)
            level = task.level(state, 0.0)
            J, v = level.J, level.v
            step = 0.02 * solve([(J, v)]).velocity
            turned += np.linalg.norm(J[3:] @ step)
            q = q + step
        assert np.abs(task.error(robot.state(q))).max() < 1e-4
        assert turned < 1.02 * math.radians(30)


def test_orientation_in_a_moving_reference_is_led_there_too():
    robot = robots.panda()
    task = make('orientation', {'frame': TOOL, 'reference': ELBOW, 'gain': 5.0})
    goal = task.value(robot.state(np.add(robots.PANDA_READY, [0.3, 0.2, -0.4, 0.3, 0.2, -0.5, 1])))
    task.set_goal(goal, 0.0)
    q = np.array(robots.PANDA_READY)
    for _ in range(120):
        q = q + 0.02 * solve([task.level(robot.state(q), 0.0)]).velocity
    assert angle(task.value(robot.state(q)), goal) < 1e-4
