# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""What every task with bounds promises, checked on all of them; then each on its own."""

import inspect
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from tp_controller import (
    Controller,
    GoalError,
    Robot,
    Settings,
    SettingsError,
    Stack,
    StackError,
    TaskError,
)
from tp_controller.model.shapes import parse_shape
from tp_controller.tasks import BoundedTask, task_types
from tp_controller.tasks.collision import CollisionTask
from tp_controller.tasks.speed_limit import DIRECTIONS, INSCRIBED_RADIUS

SEEDS = st.integers(0, 2 ** 32 - 1)
TOOL, ELBOW = robots.PANDA_TOOL, 'panda_link4'
PERIOD = 0.01
TILTED = [0.5, 0.1, 0.4, *Rotation.from_rotvec([0.4, -0.3, 0.8]).as_quat().tolist()]
# More cases than the example of a type: keys.
CASES = {
    'joint_limits': [{}, {'joints': ['panda_joint4', 'panda_joint2'], 'margin': 0.3}],
    'keep_in': [
        {'frame': TOOL, 'shape': {'box': [0.6, 0.8, 0.5]}, 'at': TILTED, 'radius': 0.05},
        {'frame': TOOL, 'shape': {'sphere': 0.5}, 'at': [0.3, 0.0, 0.4]},
        {'frame': TOOL, 'shape': {'cylinder': [0.6, 0.8]}, 'at': [0.1, -0.2, 0.3],
         'reference': ELBOW},
        {'frame': ELBOW, 'shape': 'half_space', 'at': TILTED, 'radius': 0.1}],
    'keep_out': [
        {'frame': TOOL, 'shape': {'box': [0.2, 0.3, 0.4]}, 'at': TILTED, 'radius': 0.05},
        {'frame': TOOL, 'shape': {'sphere': 0.2}, 'at': [0.3, 0.0, 0.4], 'gain': 5.0},
        {'frame': TOOL, 'shape': {'cylinder': [0.1, 0.4]}, 'at': TILTED, 'reference': ELBOW},
        {'frame': ELBOW, 'shape': 'half_space'}],
    'field_of_view': [
        {'frame': TOOL, 'half_angle': 0.4, 'target': [1.0, 0.2, -0.3]},
        {'frame': TOOL, 'half_angle': 1.2, 'axis': [1.0, 0.5, 0.0], 'target': 'panda_link2'},
        {'frame': TOOL, 'half_angle': 0.9, 'axis': '-x', 'target': [0.1, 0.6, 0.2],
         'reference': 'panda_link2'}],
    'tilt': [
        {'frame': TOOL, 'axis': '-z', 'within': 1.0},
        {'frame': TOOL, 'axis': [1.0, 0.5, 0.0], 'direction': [0.2, -0.3, 2.0], 'within': 2.0},
        {'frame': TOOL, 'axis': 'y', 'direction': '-x', 'within': 0.8, 'reference': ELBOW}],
    'distance': [
        {'frame': TOOL, 'minimum': 0.3},
        {'frame': TOOL, 'reference': ELBOW, 'maximum': 0.45},
        {'frame': TOOL, 'at': [0.4, 0.1, 0.5], 'minimum': 0.2, 'maximum': 0.6, 'gain': 4.0}],
    'orientation_range': [
        {'frame': TOOL, 'maximum': 0.7},
        {'frame': TOOL, 'axes': 'zx', 'minimum': [-0.5, 0.1], 'maximum': [0.2, 1.5],
         'target': TILTED[3:], 'reference': ELBOW},
        {'frame': TOOL, 'maximum': 3.1, 'target': [0.0, 0.0, 1.0, 0.0]}],
    'com_polygon': [
        {'contacts': {'panda_link0': [[-0.2, -0.2, 0.0], [0.3, -0.1, 0.1], [0.1, 0.3, -0.2]]},
         'margin': 0.01, 'up': [0.1, -0.2, 1.0]},
        {'contacts': ['panda_link0', TOOL, 'panda_link5'], 'margin': 0.0}],
    'manipulability_above': [{'frame': TOOL, 'minimum': 0.05},
                             {'frame': TOOL, 'minimum': 0.2, 'axes': 'xz'}],
    'speed_limit': [{'frame': TOOL, 'linear': 0.25},
                    {'frame': TOOL, 'angular': 0.5, 'reference': ELBOW},
                    {'frame': TOOL, 'linear': 0.1, 'angular': 0.3}],
}
# Tasks of pairs of shapes, whose rows change, have a contract of their own.
KINDS = {name: kind for name, kind in task_types().items()
         if issubclass(kind, BoundedTask) and not issubclass(kind, CollisionTask)}
CONTRACT = [pytest.param(name, dict(kind.example), id=f'{name}-example')
            for name, kind in KINDS.items()]
CONTRACT += [pytest.param(name, keys, id=f'{name}-{index}')
             for name, cases in CASES.items() for index, keys in enumerate(cases)]
WITH_VALUE = [case for case in CONTRACT if case.values[0] != 'speed_limit']


def make(name, keys, robot=None):
    """Return a task of a type."""
    return KINDS[name](robot or robots.robot_for(KINDS[name]), 'task', **keys)


def inside(robot, rng):
    """Return random positions (n,), some way within the limits."""
    lower, upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    return rng.uniform(lower + 0.1, upper - 0.1)


def random_states(task, count, seed=0):
    """Yield states of the task's robot; the task has started at the first."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        state = task.robot.state(inside(task.robot, rng))
        if number == 0:
            task.start(state)
        yield state


# The contract

@pytest.mark.parametrize('name, keys', WITH_VALUE)
def test_jacobian_is_the_derivative_of_the_value(name, keys):
    task, h = make(name, keys), 1e-6
    for state in random_states(task, 6):
        numeric = np.array([(task.value(task.robot.state(state.q + h * axis))
                             - task.value(task.robot.state(state.q - h * axis))) / (2 * h)
                            for axis in np.eye(7)]).T
        np.testing.assert_allclose(task.jacobian(state), numeric, atol=1e-6)
        assert task.jacobian(state).shape == (len(task.value(state)), 7)
        assert task.rows == len(task.units)
        # Those of a support polygon are as many as it has edges.
        assert name == 'com_polygon' or len(task.value(state)) == task.rows


@pytest.mark.parametrize('name, keys', CONTRACT)
def test_a_value_between_its_bounds_is_left_alone(name, keys):
    """Rest is allowed, there is no error, and no goal is needed."""
    task, seen = make(name, keys), 0
    for state in random_states(task, 150):
        evaluation = task.evaluate(state, 0.0)
        level = evaluation.level
        assert level.v is None and task.bounded
        assert (level.lower <= level.upper).all()
        if name == 'speed_limit' or (
                (task.value(state) >= task.lower) & (task.value(state) <= task.upper)).all():
            seen += 1
            assert (level.lower <= 0.0).all() and (level.upper >= 0.0).all()
            assert not task.error(state).any() and not evaluation.error.any()
    assert seen


@pytest.mark.parametrize('name, keys', WITH_VALUE)
def test_bounds_are_approached_and_come_back_to_at_the_rate_of_the_gain(name, keys):
    task = make(name, {**keys, 'return_speed': 0.3})
    gain = keys.get('gain', 10.0)
    for state in random_states(task, 40):
        evaluation, value = task.evaluate(state, 0.0), task.value(state)
        level = evaluation.level
        moved = np.linalg.norm(level.J, axis=1)
        # Nor does it ask for more than 0.5 rad/s of all joints together.
        most = np.minimum(0.3, 0.5 * moved)
        rate = (np.minimum(gain * (task.lower - value), most),
                np.maximum(gain * (task.upper - value), -most))
        strong = moved > 0.05
        np.testing.assert_allclose(level.lower[strong], rate[0][strong])
        np.testing.assert_allclose(level.upper[strong], rate[1][strong])
        # But for rounding: the core computes its own value. Near half a turn the rotation vector
        # magnifies it.
        rounding = 1e-9 if name == 'orientation_range' else 1e-13
        assert (level.lower <= rate[0] + rounding).all()
        assert (level.upper >= rate[1] - rounding).all()
        way_back = np.clip(value, task.lower, task.upper) - value
        np.testing.assert_allclose(evaluation.error, way_back)
        (error, unit, tolerance), = task.reported_errors(evaluation.error, None)
        assert abs(error - np.abs(way_back).max()) < rounding
        assert unit == task.units[0] and tolerance > 0.0


def test_region_that_replaces_one_of_another_shape_begins_without_history():
    robot = robots.panda()
    box, ball, other_ball = (make('keep_in', {'frame': TOOL, 'shape': shape}, robot) for shape in (
        {'box': [2.0, 2.0, 2.0]}, {'sphere': 1.0}, {'sphere': 1.0}))
    here, there = robot.state(robot.neutral()), robot.state(robot.neutral() + 0.05)
    there.velocity = np.ones(robot.n)
    for task in (box, ball, other_ball):
        task.start(here)
    box.evaluate(here, 0.0)
    ball.inherit_goal(box)
    found, expected = (task.make_evaluation(there, 0.01).level for task in (ball, other_ball))
    assert np.array_equal(found.upper, expected.upper) and found.upper.shape == (1,)


def test_row_that_hardly_moves_demands_little_and_is_relaxed_where_its_bound_is_unreachable():
    def joint_bound(arm, outside):
        """Return how fast a joint has to turn back from a wall that a tool is beyond."""
        robot = Robot.from_dh([{'name': 'joint', 'a': arm, 'velocity': 1.0}])
        task = make('keep_in', {'frame': robot.frame_names[-1], 'shape': 'half_space', 'at': [
            0.0, -outside, 0.0, -np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]}, robot)
        evaluation = task.evaluate(robot.state([0.0]), 0.0)
        level = evaluation.level
        assert evaluation.error == pytest.approx([-outside])
        assert level.lower[0] == -np.inf and level.J[0, 0] == pytest.approx(arm)
        return -level.upper[0] / arm

    assert [joint_bound(arm, 0.1) for arm in (2.0, 0.5, 0.3, 0.11)] == pytest.approx(
        [0.1, 0.4, 0.5, 0.5])
    # It is not relaxed either where a turn by 1 rad would reach the bound.
    assert [joint_bound(arm, 0.9 * arm) for arm in (0.01, 0.001)] == pytest.approx([0.5, 0.5])
    # Where it would not, the joint may turn further, and the more the less that moves the tool.
    # The bound falls by 0.5 rad/s for each 0.01 m/rad, and below 0.001 m/rad without end.
    free = [joint_bound(arm, 0.1) for arm in (0.0205, 0.019, 0.015, 0.005, 1e-3, 1e-6)]
    assert free[:5] == pytest.approx([0.5, 0.45, 0.25, -0.25, -0.45])
    assert free[5] < -1e3
    # Without a jump in between.
    nearly = [joint_bound(0.01, outside) for outside in (0.01, 0.0101, 0.0199, 0.02)]
    assert nearly[0] == pytest.approx(0.5) and nearly[0] - 0.02 < nearly[1] < nearly[0]
    assert nearly[3] == pytest.approx(0.0, abs=1e-9) and nearly[3] < nearly[2] < nearly[3] + 0.02


def slips(commands):
    """Return in how many cycles a velocity jumps; what presses may slip once in a while."""
    return np.count_nonzero(np.abs(np.diff(commands, axis=0)).max(axis=1) > 0.5)


@pytest.mark.parametrize('minimum', [0.12, 0.14, 0.5])
@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
@pytest.mark.slow
def test_minimum_that_no_posture_has_is_missed_without_rattling(minimum, scaling):
    """At the ridge of the measure its gradient turns round with every step that crosses it."""
    robot, q = robots.panda(), np.array(robots.PANDA_READY)
    text = f"""
- mobile: {{type: manipulability_above, frame: {TOOL}, minimum: {minimum}}}
- tool: {{type: position, frame: {TOOL}}}
- posture: {{type: posture}}
"""
    settings = Settings(period=PERIOD, scaling=scaling)
    # Up to 14 s the manipulability grows on, from one ridge to a higher one.
    _, _, commands, reports = loop(robot, text, q, [robot.state(q).position(TOOL)], 16.0, settings)
    assert slips(commands[300:]) == 0 and np.abs(commands[-100:]).max() < 0.2
    mobile = reports[-1].tasks[0]
    assert mobile.status == ('satisfied' if minimum < 0.13 else 'limited')
    assert mobile.status == 'satisfied' or mobile.reason


@pytest.mark.parametrize('region', [
    'type: keep_in, shape: {sphere: 0.2}, at: [2, 0.3, 0.5]',
    'type: keep_in, shape: {box: [0.2, 0.2, 0.2]}, at: [2, 0.3, 0.5]',
    'type: keep_out, shape: {sphere: 2}, at: [0.1, 0.1, 0.1]',
    'type: keep_out, shape: half_space, at: [0, 0, 3]'])
@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
@pytest.mark.slow
def test_region_that_is_out_of_reach_does_not_make_the_robot_rattle(region, scaling):
    robot, q = robots.panda(), np.array(robots.PANDA_READY)
    text = f"""
- guard: {{frame: {TOOL}, {region}}}
- tool: {{type: position, frame: {TOOL}}}
- posture: {{type: posture}}
"""
    settings = Settings(period=PERIOD, scaling=scaling)
    _, _, commands, reports = loop(robot, text, q, [robot.state(q).position(TOOL)], 10.0, settings)
    assert slips(commands[500:]) < 10
    assert 'limited' in {report.tasks[0].status for report in reports[-100:]}


@pytest.mark.parametrize('name, keys', WITH_VALUE)
def test_a_row_that_curves_outwards_keeps_a_clearance_for_that(name, keys):
    task, rng, period, seen = make(name, keys), np.random.default_rng(3), 1e-4, 0.0
    for state in list(random_states(task, 8)):
        velocity = rng.normal(size=7)

        def moved(periods, task=task, state=state, velocity=velocity):
            return task.robot.state(state.q + periods * period * velocity)

        task.start(state)
        free = task.level(state, 0.0)
        task.start(state)
        task.level(moved(-1), 0.0)
        now = moved(0)
        now.velocity = velocity
        level = task.level(now, period)
        # What a period of this velocity adds to the value, beyond J q_dot, per second.
        curved = task.value(moved(1)) - 2 * task.value(now) + task.value(moved(-1))
        curved /= 2 * period
        np.testing.assert_allclose(
            level.upper, np.maximum(free.upper - np.maximum(curved, 0.0), free.lower),
            rtol=1e-3, atol=1e-6)
        np.testing.assert_allclose(
            level.lower, np.minimum(free.lower - np.minimum(curved, 0.0), free.upper),
            rtol=1e-3, atol=1e-6)
        seen = max(seen, np.abs(curved).max())
    assert name == 'joint_limits' or seen > 1e-5


@pytest.mark.parametrize('name', KINDS)
def test_every_type_says_what_it_takes_and_what_it_is(name):
    kind = KINDS[name]
    assert kind.type_name == name and inspect.getdoc(kind)
    assert kind.goal_type in (None, 'pose', 'point', 'direction', 'quaternion')


@pytest.mark.parametrize('name, keys', CONTRACT)
def test_bad_goals_are_refused_with_the_name_of_the_task(name, keys):
    task = make(name, keys)
    for goal in (None, 'goal', [], [math.nan] * 3, [0.0] * 17, np.zeros((3, 4)), {'x': 1.0}):
        with pytest.raises(GoalError, match="'task'"):
            task.parse_goal(goal)
    if task.feed_forward_type is None:
        with pytest.raises(GoalError, match="'task' takes no feed-forward"):
            task.parse_feed_forward([0.0] * 6)


@pytest.mark.parametrize('name, keys, fault', [
    ('joint_limits', {'joints': 'elbow'}, 'joints: unknown driven joint'),
    ('joint_limits', {'margin': -0.1}, 'margin: must be positive'),
    ('joint_limits', {'margin': 2.0},
     'margin: must be less than half the range of panda_joint4, 1.50'),
    ('keep_in', {'frame': TOOL, 'shape': {'box': [1.0, 1.0]}}, 'shape: box needs x, y, z, posit'),
    ('keep_in', {'frame': TOOL, 'shape': {'ball': 1.0}}, "shape: unknown shape 'ball'"),
    ('keep_in', {'frame': TOOL, 'shape': 'box'}, 'shape: box needs x, y, z'),
    ('keep_in', {'frame': TOOL, 'shape': {'sphere': -1.0}}, 'shape: sphere needs radius'),
    ('keep_in', {'frame': TOOL, 'shape': {'half_space': 1.0}}, 'half_space needs no sizes'),
    ('keep_in', {'frame': TOOL, 'shape': {}}, 'shape: needs one shape with its sizes'),
    ('keep_in', {'frame': TOOL, 'shape': {'box': 1.0, 'sphere': 1.0}}, 'shape: needs one shape'),
    ('keep_in', {'frame': TOOL, 'shape': [1.0]}, 'shape: needs one shape'),
    ('keep_in', {'frame': TOOL, 'shape': {'sphere': 0.2}, 'radius': 0.2},
     'radius: must fit into the shape, so be less than 0.2, got 0.2'),
    ('keep_in', {'frame': TOOL, 'shape': {'cylinder': [0.5, 0.2]}, 'radius': 0.1}, 'than 0.1, g'),
    ('keep_out', {'frame': 'x', 'shape': {'sphere': 0.2}, 'radius': -1.0},
     'frame: unknown frame.*radius: must not be negative'),
    ('keep_out', {'frame': TOOL, 'shape': {'sphere': 0.2}, 'at': [0.0, 0.0]}, 'at: a place'),
    ('keep_out', {'frame': TOOL, 'shape': {'sphere': 0.2}, 'reference': 'x'}, 'reference: unkn'),
    ('field_of_view', {'frame': TOOL, 'half_angle': 3.2}, 'half_angle: must be less than π'),
    ('field_of_view', {'frame': TOOL, 'half_angle': 0.5, 'axis': 'w'}, 'axis: needs x, y, z, -x'),
    ('field_of_view', {'frame': TOOL, 'half_angle': 0.5, 'axis': [0, 0, 0]}, 'axis: an axis need'),
    ('field_of_view', {'frame': TOOL, 'half_angle': 0.5, 'target': 'tool'},
     "target: unknown frame 'tool'"),
    ('field_of_view', {'frame': TOOL, 'half_angle': 0.5, 'target': ELBOW, 'reference': ELBOW},
     'target: a frame as target is its own reference'),
    ('tilt', {'frame': TOOL, 'within': 3.2}, 'within: must be less than π'),
    ('tilt', {'frame': TOOL, 'within': 0.1, 'direction': 'up'}, 'direction: needs x, y, z, -x'),
    ('tilt', {'frame': TOOL, 'within': 0.1, 'direction': [0, 0, 0]}, 'an axis needs a direc'),
    ('distance', {'frame': TOOL}, 'minimum: needs a bound: give minimum, maximum or both'),
    ('distance', {'frame': TOOL, 'maximum': -1.0}, 'task: maximum: must be positive, got -1$'),
    ('distance', {'frame': TOOL, 'minimum': 0.5, 'maximum': 0.5},
     'minimum: must be less than maximum = 0.5, got 0.5'),
    ('distance', {'frame': TOOL, 'minimum': 0.5, 'at': [0.0] * 7}, 'at: the point .* needs 3 num'),
    ('orientation_range', {'frame': TOOL, 'maximum': [0.1, 0.2]}, 'maximum: a range needs 3 n'),
    ('orientation_range', {'frame': TOOL, 'maximum': 4.0}, 'maximum: needs angles of at most π'),
    ('orientation_range', {'frame': TOOL, 'maximum': 'x'}, 'maximum: a range needs 3 numbers'),
    ('orientation_range', {'frame': TOOL, 'maximum': 0.2, 'minimum': [0.0, 0.2, 0.1]},
     'minimum: must be less than maximum about every axis, got'),
    ('orientation_range', {'frame': TOOL, 'maximum': 0.2, 'axes': 'w'}, 'axes: needs some of x'),
    ('orientation_range', {'frame': TOOL, 'maximum': 0.2, 'target': [0, 0, 0, 0]},
     'target: the target: a quaternion'),
    ('com_polygon', {'contacts': [TOOL, ELBOW]}, 'contacts: needs 3 to 32 contact points, got 2'),
    ('com_polygon', {'contacts': TOOL}, 'contacts: needs a list of frames, or {frame: '),
    ('com_polygon', {'contacts': [TOOL, 'foot', ELBOW]}, "contacts: unknown frame 'foot'"),
    ('com_polygon', {'contacts': {TOOL: [[0, 0], [1, 0], [0, 1]]}}, 'a contact of panda_hand_tcp'),
    ('com_polygon', {'contacts': {TOOL: [[0, 0, 0], [1, 1, 0], [2, 2, 0], [3, 3, 1e-4]]}},
     'contacts: needs contact points that are not all on one line'),
    ('com_polygon', {'contacts': [TOOL, ELBOW, 'panda_link0'], 'margin': -1, 'up': 'w'},
     'margin: must not be negative.*up: needs x, y, z'),
    ('manipulability_above', {'frame': TOOL, 'minimum': 0.0}, 'minimum: must be positive'),
    ('speed_limit', {'frame': TOOL}, 'linear: needs a speed: give linear, angular or both'),
    ('speed_limit', {'frame': TOOL, 'linear': 0.0, 'angular': -1.0},
     'linear: must be positive.*angular: must be positive'),
    ('keep_out', {'frame': TOOL, 'shape': 'half_space', 'gain': 0.0}, 'gain: must be positive'),
    ('keep_out', {'frame': TOOL, 'shape': 'half_space', 'return_speed': 'x'}, 'return_speed'),
])
def test_faults_of_keys_are_named_with_what_is_valid(name, keys, fault):
    with pytest.raises(TaskError, match=fault):
        make(name, keys)


# Shapes: distances that an independent search agrees with

def surface(kind, sizes, count, rng):
    """Return random points (count, 3) of a solid that lies about the origin, its surface too."""
    if kind == 'box':
        points = rng.uniform(-0.5, 0.5, (count, 3))
        face = rng.integers(3, size=count)
        points[np.arange(count), face] = rng.choice([-0.5, 0.5], count)
        return points * sizes
    if kind == 'sphere':
        points = rng.normal(size=(count, 3))
        return sizes * points / np.linalg.norm(points, axis=1)[:, np.newaxis]
    radius, length = sizes
    turn = rng.uniform(0.0, 2 * np.pi, count)
    reach = np.where(rng.random(count) < 0.5, 1.0, np.sqrt(rng.random(count)))
    height = np.where(reach == 1.0, rng.uniform(-0.5, 0.5, count), rng.choice([-0.5, 0.5], count))
    return np.column_stack([radius * reach * np.cos(turn), radius * reach * np.sin(turn),
                            length * height])


def holds(kind, sizes, point):
    """Say whether a point is within a solid about the origin."""
    if kind == 'box':
        return (np.abs(point) <= np.array(sizes) / 2).all()
    if kind == 'sphere':
        return np.linalg.norm(point) <= sizes
    return math.hypot(*point[:2]) <= sizes[0] and abs(point[2]) <= sizes[1] / 2


@pytest.mark.slow
@pytest.mark.parametrize('kind, sizes', [
    ('box', [0.3, 0.5, 0.8]), ('sphere', 0.4), ('cylinder', [0.3, 0.5])])
def test_distance_from_a_shape_is_that_to_the_nearest_point_of_its_surface(kind, sizes):
    rng = np.random.default_rng(4)
    shape, points = parse_shape({kind: sizes}), surface(kind, sizes, 200_000, rng)
    for point in rng.uniform(-0.7, 0.7, (40, 3)):
        distance, gradient = shape.distance(point)
        ways = np.linalg.norm(points - point, axis=1)
        assert abs(distance) == pytest.approx(ways.min(), abs=0.01)
        assert (distance <= 0.0) == holds(kind, sizes, point)
        # The gradient leads from the nearest point of the surface outwards.
        assert np.linalg.norm(gradient) == pytest.approx(1.0)
        assert shape.distance(point - distance * gradient)[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize('kind, sizes', [
    ('box', [0.3, 0.5, 0.8]), ('sphere', 0.4), ('cylinder', [0.3, 0.5]), ('half_space', [])])
def test_point_is_in_a_shape_where_all_its_values_are_within_their_bounds(kind, sizes):
    shape, rng = parse_shape({kind: sizes}), np.random.default_rng(5)
    lower, upper = shape.inner_bounds()
    inner = 0
    for point in rng.uniform(-0.5, 0.5, (300, 3)):
        values, gradients = shape.within(point)
        assert gradients.shape == (len(values), 3)
        within = ((values >= lower) & (values <= upper)).all()
        assert within == (point[2] <= 0.0 if kind == 'half_space' else holds(kind, sizes, point))
        inner += within
    assert 10 < inner < 290


def test_centre_of_a_round_shape_has_a_direction_away_from_it():
    for shape in (parse_shape({'sphere': 0.2}), parse_shape({'cylinder': [0.2, 1.0]})):
        distance, gradient = shape.distance(np.zeros(3))
        assert distance == pytest.approx(-0.2) and np.linalg.norm(gradient) == pytest.approx(1.0)
        assert np.isfinite(shape.within(np.zeros(3))[1]).all()


# Regions and views that move

# {type: whether its goals translate, and turn}
MOVED = {'keep_in': (1, 1), 'keep_out': (1, 1), 'distance': (1, 0), 'field_of_view': (1, 0),
         'tilt': (0, 1), 'orientation_range': (0, 1)}


@pytest.mark.parametrize('name, keys', [
    case for case in CONTRACT if case.values[0] in MOVED])
def test_bounds_that_move_as_a_twist_says_are_kept_ahead_of(name, keys):
    task, rng, dt = make(name, keys), np.random.default_rng(6), 1e-6
    for state in random_states(task, 5):
        twist = rng.normal(size=6) * np.repeat(MOVED[name], 3)
        still = task.level(state, 0.0)
        task.set_feed_forward(task.parse_feed_forward(twist), 0.0)
        task.start(state)
        level, value, goal = task.level(state, 0.1), task.value(state), task.goal
        if name == 'field_of_view':
            task.goal = goal + dt * twist[:3]
        elif name == 'tilt':
            task.goal = goal + dt * np.cross(twist[3:], goal)
        elif name == 'orientation_range':
            task.goal = Rotation.from_rotvec(dt * twist[3:]).as_matrix() @ goal
        else:
            task.goal = goal.copy()
            task.goal[:3, :3] = Rotation.from_rotvec(dt * twist[3:]).as_matrix() @ goal[:3, :3]
            task.goal[:3, 3] += dt * twist[:3]
        rate = (task.value(state) - value) / dt
        task.goal = goal
        for side in ('lower', 'upper'):
            finite = np.isfinite(getattr(still, side))
            np.testing.assert_allclose(
                getattr(still, side)[finite] - getattr(level, side)[finite], rate[finite],
                atol=1e-4)
        # An old twist is believed no more.
        task.start(state)
        np.testing.assert_array_equal(task.level(state, 0.7).lower, still.lower)


def test_region_is_where_its_place_says_and_a_goal_moves_it():
    robot = robots.panda()
    state = robot.state(robots.PANDA_READY)
    task = make('keep_in', {'frame': TOOL, 'shape': {'sphere': 0.5}, 'reference': ELBOW})
    task.start(state)
    assert task.value(state) == pytest.approx(
        [np.linalg.norm(state.position(TOOL) - state.position(ELBOW))])
    task.set_goal(task.parse_goal([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]), 0.0)
    centre = (state.pose(ELBOW) @ [0.1, 0.2, 0.3, 1.0])[:3]
    assert task.value(state) == pytest.approx([np.linalg.norm(state.position(TOOL) - centre)])
    task.start(state)
    np.testing.assert_allclose(task.goal_pose(state)[:3, 3], [0.1, 0.2, 0.3])


def test_view_without_a_target_keeps_what_is_straight_ahead():
    robot, task = robots.panda(), make('field_of_view', {'frame': TOOL, 'half_angle': 0.4})
    state = robot.state(robots.PANDA_READY)
    task.start(state)
    assert task.angle(state) == pytest.approx(0.0, abs=1e-9)
    # Without a slope there, and at half the half angle with that of the angle.
    level = task.level(state, 0.0)
    np.testing.assert_allclose(level.J, 0.0, atol=1e-9)
    assert level.upper == pytest.approx([10.0 * (0.4 - 0.1)])


# Speed

def test_directions_of_a_speed_limit_hold_a_sphere_of_the_stated_radius():
    hull = ConvexHull(np.vstack([DIRECTIONS, -DIRECTIONS]))
    assert INSCRIBED_RADIUS <= -hull.equations[:, 3].max() < INSCRIBED_RADIUS + 1e-4
    np.testing.assert_allclose(np.linalg.norm(DIRECTIONS, axis=1), 1.0)


@pytest.mark.slow
@given(SEEDS)
def test_no_speed_within_the_bounds_is_above_the_limit_and_all_far_below_it_are(seed):
    rng = np.random.default_rng(seed)
    task = make('speed_limit', {'frame': TOOL, 'linear': 0.25, 'angular': 0.5})
    state = robots.panda().state(inside(robots.panda(), rng))
    level = task.level(state, 0.0)
    velocity = rng.normal(size=7)
    # The fastest along this velocity.
    velocity *= np.min(level.upper / np.maximum(np.abs(level.J @ velocity), 1e-12))
    twist = state.jacobian(TOOL) @ velocity
    shares = np.linalg.norm(twist[:3]) / 0.25, np.linalg.norm(twist[3:]) / 0.5
    assert max(shares) <= 1.0 and max(shares) >= 0.9225


# In the stack

def fault(text, robot=None):
    """Return what is wrong with a stack."""
    with pytest.raises(StackError) as caught:
        Stack.from_yaml(text, robot or robots.panda())
    return str(caught.value)


def test_inequality_tasks_and_equality_tasks_cannot_share_a_level():
    text = fault(f"""
- [view: {{type: field_of_view, frame: {TOOL}, half_angle: 0.4}},
   tool: {{type: position, frame: {TOOL}}}]
""")
    assert text == 'line 2: inequality tasks (view) and other tasks (tool) cannot share a level'


def test_a_task_that_keeps_its_direction_cannot_stand_below_bounds():
    text = fault(f"""
- wall: {{type: keep_out, frame: {TOOL}, shape: half_space}}
- tool: {{type: position, frame: {TOOL}, mode: scale}}
""")
    assert text == ('line 3: mode scale would stop in front of the bounds of wall above instead '
                    'of sliding along them; use least_squares')
    Stack.from_yaml(f"""
- tool: {{type: position, frame: {TOOL}, mode: scale}}
- wall: {{type: keep_out, frame: {TOOL}, shape: half_space}}
""", robots.panda())


def test_faults_without_a_key_are_reported_at_the_task():
    text = fault(f'- slow: {{type: speed_limit, frame: {TOOL}}}\n')
    assert text == 'line 1: slow, linear: needs a speed: give linear, angular or both'


def test_bounds_that_share_a_level_are_all_kept():
    stack = Stack.from_yaml(f"""
- [wall: {{type: keep_out, frame: {TOOL}, shape: half_space}},
   cell: {{type: keep_in, frame: {TOOL}, shape: {{box: [2, 2, 2]}}}}]
""", robots.panda())
    state = robots.panda().state(robots.PANDA_READY)
    stack.start(state)
    level, = stack.levels(state, 0.0)
    assert level.J.shape == (4, 7) and level.v is None
    z = state.position(TOOL)[2]
    assert level.lower[0] == pytest.approx(-10.0 * z) and level.upper[0] == np.inf
    assert level.upper[3] == pytest.approx(10.0 * (1.0 - z))


def test_gain_of_bounds_must_suit_the_period():
    robot = robots.panda()
    stack = Stack.from_yaml(f'- wall: {{type: keep_out, frame: {TOOL}, shape: half_space, '
                            'gain: 60}\n', robot)
    message = 'gain 60 of task wall must be at most 1/period = 50, or its bounds would be crossed'
    with pytest.raises(SettingsError, match=message):
        Controller(robot, stack, Settings(period=0.02, braking_gain=10.0))
    controller = Controller(robot, Stack([]), Settings(period=0.02))
    with pytest.raises(SettingsError, match=message):
        controller.replace_stack(stack)
    controller.replace_stack(stack, Settings(period=0.01))
    assert controller.settings.period == 0.01
    with pytest.raises(SettingsError, match=message):
        controller.settings = Settings(period=0.02)
    assert controller.settings.period == 0.01


# Closed loops

def loop(robot, text, q, goals, seconds, settings=None, tool=TOOL):
    """Return states, commands and reports of a closed loop; goals are set one after the other."""
    stack = Stack.from_yaml(text, robot)
    controller = Controller(robot, stack, settings or Settings(period=PERIOD))
    controller.update(q, 0.0)
    count = int(seconds / PERIOD)
    states, commands, reports = [], [], []
    for cycle in range(count):
        now = cycle * PERIOD
        if cycle % (count // len(goals)) == 0 and cycle // (count // len(goals)) < len(goals):
            controller.set_goal('tool', goals[cycle // (count // len(goals))], now)
        command = controller.update(q, now)
        q = q + PERIOD * command.velocity
        states.append(robot.state(q))
        commands.append(command.velocity)
        reports.append(command.report)
    return stack, states, np.array(commands), reports


WALL = ('{type: keep_out, frame: panda_hand_tcp, shape: {box: [0.2, 0.2, 0.4]}, '
        'at: [0.5, 0.3, 0.4]}')
LOOPS = {
    'joint_limits': '{type: joint_limits, joints: panda_joint1, margin: 2.6}',
    'keep_in': '{type: keep_in, frame: panda_hand_tcp, shape: {cylinder: [0.15, 0.5]}, '
               'at: [0.31, 0.0, 0.59], radius: 0.05}',
    'keep_out': WALL,
    'field_of_view': '{type: field_of_view, frame: panda_hand_tcp, half_angle: 0.3, '
                     'target: [0.3, 0.0, -0.2]}',
    'tilt': '{type: tilt, frame: panda_hand_tcp, axis: -z, within: 0.2}',
    'orientation_range': '{type: orientation_range, frame: panda_hand_tcp, maximum: '
                         '[0.1, 0.15, 0.3]}',
    'distance': '{type: distance, frame: panda_hand_tcp, at: [0.3, 0.1, 0.3], minimum: 0.2, '
                'maximum: 0.6}',
    'manipulability_above': '{type: manipulability_above, frame: panda_hand_tcp, minimum: 0.07}',
    'speed_limit': '{type: speed_limit, frame: panda_hand_tcp, linear: 0.1, angular: 0.2}',
}
FAR = ([0.5, 0.45, 0.4], [0.75, -0.2, 0.2], [0.2, 0.1, 1.15])


def excess(task, state, velocity):
    """Return how far outside of its bounds a task is."""
    if task.type_name == 'speed_limit':
        twist = state.jacobian(TOOL) @ velocity
        return max(np.linalg.norm(twist[:3]) - 0.1, np.linalg.norm(twist[3:]) - 0.2)
    return np.abs(task.error(state)).max()


@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
@pytest.mark.parametrize('name', LOOPS)
@pytest.mark.slow
def test_bounds_are_kept_against_goals_beyond_them_and_only_then_give_a_reason(name, scaling):
    robot, q = robots.panda(), np.array(robots.PANDA_READY)
    text = f"""
- guard: {LOOPS[name]}
- tool: {{type: position, frame: {TOOL}, gain: 2.0}}
- posture: {{type: posture, gain: 0.5}}
"""
    settings = Settings(period=PERIOD, scaling=scaling)
    stack, states, commands, reports = loop(robot, text, q, FAR, 6.0, settings)
    guard = stack.tasks['guard']
    outside = [excess(guard, state, velocity)
               for state, velocity in zip([robot.state(q), *states], commands)]
    assert max(outside) < (1e-3 if guard.units[0] == 'm' else 3.4e-3)
    assert all(report.tasks[0].status == 'satisfied' for report in reports)
    assert (np.abs(commands) <= robot.velocity).all()
    named = {text for report in reports for task in report.tasks[1:] for text in task.phrases}
    # With uniform scaling the tool finds its way beside joint 1, and takes nothing of the guard.
    assert any('guard' in text for text in named) or (name, scaling) == (
        'joint_limits', 'uniform')
    # The goals are beyond the bounds: without the guard they are not kept.
    free = text.replace(f'- guard: {LOOPS[name]}\n', '')
    _, states, commands, _ = loop(robot, free, q, FAR, 6.0, settings)
    outside = [excess(guard, state, velocity)
               for state, velocity in zip([robot.state(q), *states], commands)]
    assert max(outside) > 0.02


def slide_in_a_ball(cycles, told):
    """Return how far outside a tool was, and how fast it was last; `told`: where the ball is."""
    robot, q, centre = robots.panda(), np.array(robots.PANDA_READY), np.array([0.31, 0.0, 0.49])
    stack = Stack.from_yaml(f"""
- ball: {{type: keep_in, frame: {TOOL}, shape: {{sphere: 0.15}}, at: {centre.tolist()}}}
- tool: {{type: twist, frame: {TOOL}, axes: xyz, timeout: 10}}
""", robot)
    controller, outside = Controller(robot, stack, Settings(period=PERIOD)), []
    for cycle in range(cycles):
        now, way = cycle * PERIOD, robot.state(q).position(TOOL) - centre
        outward = way / max(np.linalg.norm(way), 1e-6)
        if told:
            controller.set_goal('ball', [*centre, 0.0, 0.0, 0.0, 1.0], now)
        twist = [*np.cross([0.3, 1.0, 0.2], outward) + 0.5 * outward, 0.0, 0.0, 0.0]
        controller.set_feed_forward('tool', twist, now)
        velocity = controller.update(q, now).velocity
        q = q + PERIOD * velocity
        outside.append(np.linalg.norm(robot.state(q).position(TOOL) - centre) - 0.15)
    return outside, np.linalg.norm(robot.state(q).jacobian(TOOL)[:3] @ velocity)


def test_bounds_are_kept_at_speed_because_the_curvature_of_the_way_is_known():
    """A tool that slides along the inside of a ball; by its tangents it would be 5 mm outside."""
    outside, speed = slide_in_a_ball(400, told=False)
    assert speed > 0.9
    assert -1e-4 < max(outside) < 3e-4


def test_tool_that_presses_against_a_wall_beside_a_singularity_does_not_swing():
    """By 2 rad/s from one cycle to the next, and 2 cm outside, if nothing pulled towards rest."""
    robot = robots.urdf_robot('ur5')
    centre = np.array([-0.184, -0.621, -0.491])
    text = f"""
- ball: {{type: keep_in, frame: tool0, shape: {{sphere: 0.133}}, at: {centre.tolist()}}}
- tool: {{type: pose, frame: tool0, gain: 2.0}}
- posture: {{type: posture, gain: 0.5}}
"""
    goal = [-0.015, -0.114, 0.813, 0.944, 0.062, 0.278, -0.166]
    _, states, commands, _ = loop(
        robot, text, np.array([1.456, 2.5701, -0.5744, -1.2002, -2.0321, -1.8904]), [goal], 2.5)
    outside = [np.linalg.norm(state.position('tool0') - centre) - 0.133 for state in states]
    assert -1e-4 < max(outside) < 1e-4
    change = np.diff(commands, axis=0)
    turned = (change[1:] * change[:-1] < 0.0) & (np.abs(change[1:]) > 0.1)
    assert turned.sum() < 10


def test_beginning_anew_forgets_how_the_value_curved_before():
    task = make('keep_in', CASES['keep_in'][1])
    first, second = list(random_states(task, 2))
    task.level(first, 0.0)
    task.start(second)
    second.velocity = (task.jacobian(second) - task.jacobian(first))[0]
    level, value = task.level(second, PERIOD), task.value(second)
    most = np.minimum(0.2, 0.5 * np.linalg.norm(level.J, axis=1))
    np.testing.assert_allclose(level.upper, np.maximum(10.0 * (task.upper - value), -most))
    task.set_goal(task.goal, 0.0)
    np.testing.assert_array_equal(task.level(second, 0.02).upper, level.upper)


@pytest.mark.parametrize('name', [name for name in LOOPS if name != 'speed_limit'])
@pytest.mark.slow
def test_start_outside_of_bounds_comes_back_and_never_gets_deeper(name):
    robot = robots.panda()
    text = f'- guard: {LOOPS[name]}\n- posture: {{type: posture, gain: 0.5}}\n'
    guard, rng = Stack.from_yaml(text, robot).tasks['guard'], np.random.default_rng(7)
    found = 0
    for _ in range(500):
        q = inside(robot, rng)
        state = robot.state(q)
        guard.start(state)
        start = np.abs(guard.error(state)).max()
        if start < 0.01 or found == 2:
            continue
        found += 1
        controller = Controller(robot, Stack.from_yaml(text, robot), Settings(period=PERIOD))
        controller.stack.tasks['guard'].goal = guard.goal
        depths = [start]
        for cycle in range(1500):
            q = q + PERIOD * controller.update(q, cycle * PERIOD).velocity
            depths.append(np.abs(guard.error(robot.state(q))).max())
        assert max(depths) <= start + 1e-3 and depths[-1] < 1e-3, (name, start, depths[-1])
    assert found >= 2


def test_bounds_below_a_task_give_way_to_it_and_say_so():
    robot = robots.panda()
    text = f"""
- tool: {{type: position, frame: {TOOL}, gain: 2.0}}
- guard: {WALL}
- posture: {{type: posture, gain: 0.5}}
"""
    _, states, _, reports = loop(robot, text, np.array(robots.PANDA_READY), [[0.5, 0.3, 0.4]], 6.0)
    assert np.linalg.norm(states[-1].position(TOOL) - [0.5, 0.3, 0.4]) < 1e-3
    assert reports[-1].tasks[0].status == 'reached' and not reports[-1].tasks[0].reason
    guard = reports[-1].tasks[1]
    assert guard.status == 'limited' and guard.reason == 'blocked by tool'
    assert guard.errors[0][0] == pytest.approx(0.1, abs=1e-3)


def test_region_that_comes_nearer_pushes_the_robot_away():
    robot, q = robots.panda(), np.array(robots.PANDA_READY)
    stack = Stack.from_yaml(f"""
- ball: {{type: keep_out, frame: {TOOL}, shape: {{sphere: 0.15}}, at: [1.2, 0.05, 0.5]}}
- tool: {{type: position, frame: {TOOL}, gain: 2.0}}
- posture: {{type: posture, gain: 0.5}}
""", robot)
    controller, distances = Controller(robot, stack, Settings(period=PERIOD)), []
    for cycle in range(900):
        now, x = cycle * PERIOD, max(1.2 - 0.2 * cycle * PERIOD, 0.2)
        controller.set_goal('ball', [x, 0.05, 0.5, 0.0, 0.0, 0.0, 1.0], now)
        controller.set_feed_forward('ball', [-0.2 if x > 0.2 else 0.0, 0, 0, 0, 0, 0], now)
        q = q + PERIOD * controller.update(q, now).velocity
        tool = robot.state(q).position(TOOL)
        ball = np.array([max(1.2 - 0.2 * (cycle + 1) * PERIOD, 0.2), 0.05, 0.5])
        distances.append(np.linalg.norm(tool - ball))
    assert min(distances) > 0.15 - 1e-3 and min(distances) < 0.16


@pytest.mark.parametrize('change', ['goal', 'setting', 'halt'])
def test_bounds_below_a_task_stay_below_it_while_a_change_fades_out(change):
    robot = robots.panda()
    stack = Stack.from_yaml(f"""
- tool: {{type: position, frame: {TOOL}}}
- cell: {{type: keep_in, frame: {TOOL}, shape: {{sphere: 0.1}}, at: [0.3, 0.3, 0.3]}}
- posture: {{type: posture, gain: 0.5}}
""", robot)
    controller, q = Controller(robot, stack, Settings(period=PERIOD)), np.array(robots.PANDA_READY)
    start = robot.state(q).position(TOOL)
    for cycle in range(100):
        now = cycle * PERIOD
        if cycle == 50:
            if change == 'goal':
                controller.set_goal('tool', start + [1e-5, 0.0, 0.0], now)
            elif change == 'setting':
                controller.settings = Settings(period=PERIOD, blend=0.3)
            else:
                controller.halt(now)
        q = q + PERIOD * controller.update(q, now).velocity
        assert np.linalg.norm(robot.state(q).position(TOOL) - start) < 2e-5


def test_region_that_is_told_where_it_is_in_every_cycle_is_kept_as_well():
    outside, _ = slide_in_a_ball(300, told=True)
    assert -1e-4 < max(outside) < 3e-4


def test_level_that_is_made_twice_in_a_cycle_is_the_same():
    """As where a program computes the levels besides the controller."""
    task = make('keep_in', CASES['keep_in'][1])
    first, second = list(random_states(task, 2))
    second.velocity = (task.jacobian(second) - task.jacobian(first))[0] * 0.1
    task.level(first, 0.0)
    once, again = task.level(second, PERIOD), task.level(second, PERIOD)
    np.testing.assert_array_equal(once.upper, again.upper)


def test_way_that_curves_is_seen_while_the_clock_stands_still():
    """Or what J has changed by since it stopped would be taken for one cycle's."""
    robot, uppers = robots.panda(), []
    for times in ((0.0, 0.01, 0.02), (0.0, 0.0, 0.0), (0.0,)):
        task = make('keep_in', CASES['keep_in'][1], robot)
        task.start(robot.state(robots.PANDA_READY))
        for cycle, now in enumerate(times, 3 - len(times)):
            state = robot.state(np.add(robots.PANDA_READY, 0.01 * cycle))
            state.velocity = np.full(7, 1.0)
            level = task.level(state, now)
        uppers.append(level.upper)
    np.testing.assert_array_equal(*uppers[:2])
    assert (uppers[2] != uppers[0]).any()


def test_what_no_joint_moves_is_outside_for_a_reason():
    robot = robots.panda()
    stack = Stack.from_yaml('- stand: {type: keep_out, frame: panda_link0, shape: {sphere: 0.2}, '
                            'at: [0.05, 0, 0]}\n', robot)
    controller = Controller(robot, stack)
    task = controller.update(robots.PANDA_READY, 0.0).report.tasks[0]
    assert task.status == 'limited' and task.reason == 'no joint can move it back within bounds'


def test_link_that_only_turns_about_itself_is_named_and_keeps_no_joint_from_moving():
    """Or the sign of a row of 1e-4 m/rad would say where joint 1 may go."""
    robot, q = robots.panda(), np.array(robots.PANDA_READY)
    stack = Stack.from_yaml(f"""
- clear: {{type: obstacles, capsules: {robots.CONFIG / 'panda_capsules.yaml'},
          obstacles: {{foot: {{shape: {{box: [0.3, 0.3, 0.1]}}, at: [0.2, 0.0, 0.15]}}}}}}
- tool: {{type: position, frame: {TOOL}, gain: 3.0}}
""", robot)
    controller = Controller(robot, stack, Settings(period=PERIOD))
    controller.update(q, 0.0)
    start = robot.state(q).position(TOOL)
    for began, side in ((0.0, 1.0), (5.0, -1.0)):
        controller.set_goal('tool', [0.7 * start[0], 0.7 * side * start[0], start[2]], began)
        for cycle in range(500):
            command = controller.update(q, began + cycle * PERIOD)
            q = q + PERIOD * command.velocity
        assert command.report.tasks[1].reached
        assert command.report.tasks[0].reason == (
            'no joint can move panda_link1 – foot back within bounds')


def test_bounds_of_a_level_that_contradict_each_other_are_reported_as_that():
    robot = robots.panda()
    stack = Stack.from_yaml(f"""
- [left: {{type: keep_in, frame: {TOOL}, shape: {{sphere: 0.1}}, at: [0.3, 0.4, 0.5]}},
   right: {{type: keep_in, frame: {TOOL}, shape: {{sphere: 0.1}}, at: [0.3, -0.4, 0.5]}}]
""", robot)
    controller, q = Controller(robot, stack, Settings(period=PERIOD)), np.array(robots.PANDA_READY)
    for cycle in range(100):
        command = controller.update(q, cycle * PERIOD)
        q = q + PERIOD * command.velocity
    left, right = command.report.tasks
    assert left.status == right.status == 'limited'
    assert 'higher levels' not in left.reason + right.reason


def test_speed_limit_goes_with_any_period():
    robot = robots.panda()
    stack = Stack.from_yaml(f'- slow: {{type: speed_limit, frame: {TOOL}, linear: 0.1}}\n', robot)
    Controller(robot, stack, Settings(period=0.5, braking_gain=1.0))
