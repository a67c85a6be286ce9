# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Axes that point in a direction or at a point: errors, paths, and the five rows of drilling."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from scipy.spatial.transform import Rotation
from tp_controller import Controller, GoalError, Settings, solve, Stack, TaskError
from tp_controller.tasks import task_types

SEEDS = st.integers(0, 2 ** 32 - 1)
TOOL = robots.PANDA_TOOL
PERIOD = 0.01
AXES = {'x': [1, 0, 0], '-x': [-1, 0, 0], 'y': [0, 1, 0], '-y': [0, -1, 0], 'z': [0, 0, 1],
        '-z': [0, 0, -1]}


def make(name, **keys):
    """Return a task of a type, about the Panda's tool."""
    return task_types()[name](robots.panda(), 'task', **{'frame': TOOL, **keys})


def inside(rng):
    """Return random positions of the Panda (7,), some way within the limits."""
    robot = robots.panda()
    return rng.uniform(robot.lower + 0.1, robot.upper - 0.1)


def angle(a, b):
    """Return the angle between two vectors [rad]."""
    return math.atan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))


def unit(vector):
    """Return a vector at length 1."""
    return np.asarray(vector, float) / np.linalg.norm(vector)


@given(SEEDS, st.sampled_from(list(AXES)))
def test_error_is_the_angle_between_axis_and_direction(seed, axis):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    task, state = make('pointing', axis=axis), robots.panda().state(inside(rng))
    task.set_goal(task.parse_goal(direction), 0.0)
    shown = state.rotation(TOOL) @ AXES[axis]
    assert np.linalg.norm(task.error(state)) == pytest.approx(angle(shown, direction), abs=1e-9)


@given(SEEDS, st.sampled_from(['x', '-z', 'y']))
def test_error_towards_a_point_is_the_angle_to_the_way_to_it(seed, axis):
    rng = np.random.default_rng(seed)
    point = rng.normal(size=3)
    state = robots.panda().state(inside(rng))
    seen = state.rotation('panda_link3').T @ (point - state.position('panda_link3'))
    for name, keys in (('pointing', {'towards': 'point'}), ('look_at', {})):
        task = make(name, axis=axis, reference='panda_link3', **keys)
        task.set_goal(task.parse_goal(seen), 0.0)
        assert np.linalg.norm(task.error(state)) == pytest.approx(
            angle(state.rotation(TOOL) @ AXES[axis], point - state.position(TOOL)), abs=1e-9)


@given(SEEDS, st.sampled_from(['pointing', 'look_at']))
def test_angle_decays_with_the_gain_from_anywhere_by_the_shortest_turn(seed, name):
    """However far the goal, and although the frame moves on the way to it."""
    rng = np.random.default_rng(seed)
    robot = robots.panda()
    task, q = make(name, gain=2.0), inside(rng)
    goal = rng.normal(size=3)
    # A point at arm's length or more: close to it the direction turns faster than it is led.
    goal *= 1.0 if name == 'pointing' else 3.0 / np.linalg.norm(goal)
    task.set_goal(task.parse_goal(goal), 0.0)
    state, dt = robot.state(q), 1e-3
    before = task.error(state)
    level = task.level(state, 0.0)
    s = np.linalg.svd(level.J, compute_uv=False)
    if s[-1] < 0.2:
        return
    velocity = solve([level]).velocity
    after = task.error(robot.state(q + dt * velocity))
    assert np.linalg.norm(after) == pytest.approx(
        (1.0 - 2.0 * dt) * np.linalg.norm(before),
        abs=5.0 * (dt * np.linalg.norm(velocity)) ** 2 + 1e-12)


def test_five_rows_of_drilling_leave_the_turn_about_the_tool_free():
    robot = robots.panda()
    stack = Stack.from_yaml(f"""
- [tip: {{type: position, frame: {TOOL}, gain: 4.0}},
   drill: {{type: pointing, frame: {TOOL}, target: [0.2, 0.1, -1.0], gain: 4.0}}]
- roll: {{type: joint, joints: panda_joint7, target: [1.5], gain: 2.0}}
""", robot)
    controller, q = Controller(robot, stack, Settings(period=PERIOD)), np.array(robots.PANDA_READY)
    tip = robot.state(q).position(TOOL)
    for cycle in range(400):
        q = q + PERIOD * controller.update(q, cycle * PERIOD).velocity
    state = robot.state(q)
    assert np.linalg.norm(state.position(TOOL) - tip) < 1e-5
    assert angle(state.rotation(TOOL)[:, 2], [0.2, 0.1, -1.0]) < 1e-5
    assert q[6] == pytest.approx(1.5, abs=1e-3)


@pytest.mark.parametrize('keys, goal', [
    ({}, [0.3, -0.5, 0.8]), ({'towards': 'point'}, [0.5, 0.6, 0.9]),
    ({'axis': '-y', 'reference': 'panda_link2'}, [0.0, 1.0, 0.2])])
def test_axis_gets_there_in_a_closed_loop(keys, goal):
    robot = robots.panda()
    task = make('pointing', gain=3.0, **keys)
    controller = Controller(robot, Stack([[task]]), Settings(period=PERIOD))
    q = np.array(robots.PANDA_READY)
    controller.update(q, 0.0)
    controller.set_goal('task', goal, 0.0)
    for cycle in range(1, 800):
        command = controller.update(q, cycle * PERIOD)
        q = q + PERIOD * command.velocity
    assert np.linalg.norm(task.error(robot.state(q))) < 1e-5
    assert command.report.reached


def test_point_of_a_frame_is_followed_while_that_moves():
    """An eye on the elbow: both move with the joints, and the error stays small."""
    robot = robots.urdf_robot('baxter', tuple(
        f'{side}_{joint}' for side in ('left', 'right')
        for joint in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2')))
    stack = Stack.from_yaml("""
- look: {type: look_at, frame: left_gripper, target: right_gripper, gain: 10.0}
- wave: {type: twist, frame: right_gripper, axes: xyz, timeout: 10}
""", robot)
    controller = Controller(robot, stack, Settings(period=PERIOD))
    q = np.array([0.4, -0.5, -0.6, 1.3, 0.5, 0.8, 0.1, -0.4, -0.5, 0.6, 1.3, -0.5, 0.8, -0.1])
    start = robot.state(q).position('right_gripper')
    errors = []
    for cycle in range(700):
        now = cycle * PERIOD
        if cycle > 400:
            controller.set_feed_forward('wave', [0.0, 0.1, 0.1, 0.0, 0.0, 0.0], now)
        q = q + PERIOD * controller.update(q, now).velocity
        state = robot.state(q)
        errors.append(angle(state.rotation('left_gripper')[:, 2],
                            state.position('right_gripper') - state.position('left_gripper')))
    assert np.linalg.norm(state.position('right_gripper') - start) > 0.3
    assert max(errors[400:]) < 2e-3


@pytest.mark.parametrize('name, keys, twist', [
    ('pointing', {}, [0.0, 0.0, 0.0, 0.3, -0.2, 0.4]),
    ('pointing', {'towards': 'point'}, [0.1, 0.2, -0.1, 0.0, 0.0, 0.0]),
    ('look_at', {'reference': 'panda_link1', 'up': '-y'}, [0.1, 0.2, -0.1, 0.0, 0.0, 0.0])])
def test_goal_that_moves_as_its_twist_says_is_followed_without_lag(name, keys, twist):
    robot = robots.panda()
    task, state = make(name, **keys), robot.state(robots.PANDA_READY)
    # At the goal, where the rate of the error is that of the turn.
    goal = task.value(state)
    task.set_goal(task.parse_goal(goal), 0.0)
    task.set_feed_forward(task.parse_feed_forward(twist), 0.0)
    level, error = task.level(state, 0.0), task.error(state)
    dt = 1e-6
    moved = Rotation.from_rotvec(dt * np.array(twist[3:])).apply(goal) + dt * np.array(twist[:3])
    task.goal = task.parse_goal(moved)
    rate = (task.error(state) - error) / dt
    np.testing.assert_allclose(level.v - task.gain * error, rate, atol=1e-5)
    assert np.abs(rate).max() > 0.05
    # A twist that is too old counts no more.
    np.testing.assert_allclose(task.level(state, 2.0).v, task.gain * task.error(state))


@given(SEEDS)
def test_half_a_turn_starts_at_full_error_and_is_not_undone_by_noise(seed):
    rng = np.random.default_rng(seed)
    robot, task, q = robots.panda(), make('pointing'), inside(rng)
    shown = robot.state(q).rotation(TOOL)[:, 2]
    task.set_goal(task.parse_goal(-shown), 0.0)
    first = task.error(robot.state(q))
    assert np.linalg.norm(first) == pytest.approx(math.pi, abs=1e-6)
    for _ in range(20):
        noisy = robot.state(q + 1e-3 * rng.normal(size=7))
        error = task.error(noisy)
        assert error @ first > 0.0 or np.linalg.norm(error) > math.pi - 0.2


# Upright

def roll_of(state, axis, up):
    """Return the turn about the axis by which `up` is off the vertical's part across it [rad]."""
    R = state.rotation(TOOL)
    a, u = R @ unit(axis), R @ unit(up)
    vertical = np.array([0.0, 0.0, 1.0]) - a[2] * a
    u = u - u @ a * a
    return math.atan2(np.cross(u, vertical) @ a, u @ vertical), math.hypot(*(R.T @ [0, 0, 1])[:2])


@given(SEEDS)
def test_third_row_is_the_roll_and_its_derivative(seed):
    rng = np.random.default_rng(seed)
    robot, h = robots.panda(), 1e-6
    task, q = make('look_at', up='-y', target=[3.0, 0.0, 0.5]), inside(rng)
    state = robot.state(q)
    roll, reach = roll_of(state, AXES['z'], AXES['-y'])
    if reach < 0.35 or abs(roll) > 3.0:
        return
    assert task.error(state)[2] == pytest.approx(roll, abs=1e-9)
    numeric = [(roll_of(robot.state(q + h * axis), AXES['z'], AXES['-y'])[0]
                - roll_of(robot.state(q - h * axis), AXES['z'], AXES['-y'])[0]) / (2 * h)
               for axis in np.eye(7)]
    np.testing.assert_allclose(task.jacobian(state)[2], np.negative(numeric), atol=1e-6)


def test_camera_gets_upright_while_it_looks():
    robot = robots.panda()
    task = make('look_at', up='-y', target=[1.5, 0.6, 0.4], gain=2.0)
    controller, q = Controller(robot, Stack([[task]]), Settings(period=PERIOD)), np.array(
        [0.2, -0.6, 0.1, -1.8, 0.1, 2.6, 0.3])
    for cycle in range(1200):
        q = q + PERIOD * controller.update(q, cycle * PERIOD).velocity
    state = robot.state(q)
    assert np.linalg.norm(task.error(state)) < 1e-4
    assert state.rotation(TOOL)[2, 0] == pytest.approx(0.0, abs=1e-4)
    assert state.rotation(TOOL)[2, 1] < 0.0


def test_row_of_the_roll_fades_out_straight_down():
    """Where no direction is upright its error is finite, and it demands nothing."""
    robot, task = robots.panda(), make('look_at', up='-y', target=[0.3, 0.0, -3.0])
    state = robot.state(robots.PANDA_READY)
    assert state.rotation(TOOL)[2, 2] < -0.9999
    assert abs(task.error(state)[2]) < 1e-3 and np.isfinite(task.jacobian(state)).all()
    assert np.abs(task.jacobian(state)[2]).max() < 0.1


# Faults

@pytest.mark.parametrize('name, keys, fault', [
    ('pointing', {'frame': 'tool'}, "frame: unknown frame 'tool'"),
    ('pointing', {'axis': 'w'}, 'axis: needs x, y, z, -x, -y, -z or three numbers'),
    ('pointing', {'axis': [0.0, 0.0, 0.0]}, 'axis: an axis needs a direction'),
    ('pointing', {'axis': 3}, 'axis: needs x'),
    ('pointing', {'towards': 'home'}, "towards: unknown kind of goal 'home'; valid: direction, p"),
    ('pointing', {'target': 'panda_link2'}, 'target: the target .* needs 3 numbers'),
    ('pointing', {'target': [0.0, 0.0, 0.0]}, 'target: the target needs a direction'),
    ('pointing', {'reference': 'x', 'gain': 0.0}, 'reference: unknown frame.*gain: must be pos'),
    ('look_at', {'target': 'x'}, "target: unknown frame 'x'"),
    ('look_at', {'target': 'panda_link2', 'reference': 'panda_link3'}, 'target: a frame as targ'),
    ('look_at', {'up': 'z'}, 'up: must be another axis than the one that points'),
    ('look_at', {'up': 'q'}, 'up: needs x, y, z'),
    ('look_at', {'axis': 'q', 'up': 'x'}, 'axis: needs x, y, z'),
])
def test_faults_of_keys_are_named_with_what_is_valid(name, keys, fault):
    with pytest.raises(TaskError, match=fault):
        make(name, **keys)


def test_goals_are_directions_or_points_as_the_key_says():
    direction, point = make('pointing'), make('pointing', towards='point')
    assert direction.goal_type == 'direction' and point.goal_type == 'point'
    assert direction.parse_goal([0.0, 0.0, 5.0]).tolist() == [0.0, 0.0, 1.0]
    assert point.parse_goal([0.0, 0.0, 5.0]).tolist() == [0.0, 0.0, 5.0]
    with pytest.raises(GoalError, match="the goal of task 'task' needs a direction"):
        direction.parse_goal([0.0, 0.0, 0.0])


def test_goal_in_another_frame_is_turned_and_moved_as_its_kind_needs():
    robot = robots.panda()
    state = robot.state(robots.PANDA_READY)
    T = state.pose('panda_link5')
    direction, point = make('pointing'), make('pointing', towards='point')
    np.testing.assert_allclose(direction.goal_in_reference(np.array([0.0, 0.0, 1.0]), T), T[:3, 2])
    np.testing.assert_allclose(point.goal_in_reference(np.array([0.0, 0.0, 1.0]), T),
                               T[:3, 2] + T[:3, 3])


def test_markers_show_the_point_or_the_turned_frame():
    robot = robots.panda()
    state = robot.state(robots.PANDA_READY)
    for keys, goal in (({}, [1.0, 0.5, -0.2]), ({'towards': 'point'}, [0.9, 0.4, 0.2]),
                       ({'reference': 'panda_link3'}, [1.0, 0.5, -0.2])):
        task = make('pointing', **keys)
        task.set_goal(task.parse_goal(goal), 0.0)
        T = state.pose(task.reference) @ task.goal_pose(state)
        if keys.get('towards') == 'point':
            np.testing.assert_allclose(T[:3, 3], goal, atol=1e-9)
            np.testing.assert_allclose(T[:3, 2], unit(goal - state.position(TOOL)), atol=1e-9)
        else:
            wanted = state.rotation(task.reference) @ unit(goal)
            np.testing.assert_allclose(T[:3, 2], wanted, atol=1e-9)
            np.testing.assert_allclose(T[:3, 3], state.position(TOOL), atol=1e-9)
