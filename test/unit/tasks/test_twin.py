# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Twins of tasks: what the compiled core evaluates is what Python does."""

from functools import partial
from inspect import Parameter
import itertools
import sys

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller.model.spatial import pose, rotation_from_vector, shorter_rotation
from tp_controller.solver.compiled import core
from tp_controller.tasks import Task
from tp_controller.tasks.aim import DirectionAim
from tp_controller.tasks.center_of_mass import CenterOfMass
from tp_controller.tasks.needs import lacks
from tp_controller.tasks.pointing import Pointing
from tp_controller.tasks.pose import Pose
from tp_controller.tasks.position import Position
from tp_controller.tasks.twin import (
    AXIS,
    CENTER_OF_MASS,
    COM_POLYGON,
    CONE,
    FRAME,
    JOINT_LIMIT_DISTANCE,
    JOINT_LIMITS,
    JOINTS,
    ORIENTATION_RANGE,
    REGION,
    SPEED_LIMIT,
    Watch,
)

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')
seeds = st.integers(0, 2 ** 32 - 1)
# Axes that are selected, by type.
AXES = {
    'pose': ['x', 'rx', 'z'], 'relative_pose': ['ry', 'z'], 'base_pose': ['rz', 'x'],
    'position': ['y', 'z'], 'relative_position': ['x'], 'orientation': ['z'],
    'base_orientation': ['z'], 'twist': ['x', 'rz'], 'center_of_mass': ['x', 'z'], 'pointing': [],
    'look_at': []}
GOALS = {'pose': lambda T: T, 'point': lambda T: T[:3, 3], 'direction': lambda T: T[0, :3],
         'quaternion': lambda T: T[:3, :3], None: lambda T: np.arange(6.0)}


def drawn_keys(kind, robot, rng, some):
    """Return keys of a type; `some`: with those that can be left out."""
    frame, reference = (str(each) for each in rng.choice(robot.frame_names, 2))
    axis, across, _ = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    drawn = {
        'frame': frame, 'reference': reference, 'axes': AXES[kind], 'axis': axis,
        'up': across - 2.0 * axis, 'towards': str(rng.choice(['direction', 'point'])),
        'gain': rng.uniform(0.1, 9.0)}
    keys = Task.types[kind].accepted_keys()
    if kind == 'look_at' and rng.random() < 0.3 and frame != reference:
        # A frame as the target is its own reference.
        drawn['target'] = drawn.pop('reference')
    return {key: value for key, value in drawn.items() if key in keys and (
        some or keys[key] is Parameter.empty or key in ('gain', 'target'))}


@pytest.mark.slow
@pytest.mark.parametrize('kind', AXES)
@given(seed=seeds, name=st.sampled_from(sorted(robots.EVERY)), some=st.booleans(),
       gains=st.booleans(), fed=st.booleans())
def test_tasks_are_those_of_the_reference(kind, seed, name, some, gains, fed):
    rng, its = np.random.default_rng(seed), robots.named(name)
    assume(not lacks(kind, Task.types[kind].needs, its, {}))
    keys = drawn_keys(kind, its, rng, some)
    one, other = (Task.types[kind](its, 'task', **keys) for _ in range(2))
    other.make_twin = lambda: None
    T = pose(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    for task in (one, other):
        if gains and 'gain' in keys:
            task.gain = np.arange(1.0, task.rows + 1.0)
        if 'target' not in keys:
            task.set_goal(GOALS[task.goal_type](T), 0.0)
        if fed:
            task.set_feed_forward(np.arange(1.0, 7.0), 0.0)
    assert one.twin is not None and other.twin is None
    # Near half a turn, the logarithm of Pinocchio is less exact.
    near = 1e-9 if kind.endswith(('pose', 'orientation')) else 1e-12
    # Some states, one after the other: the direction of a turn is remembered.
    for _ in range(3):
        here = its.state(*robots.anywhere(its, rng))
        found, expected = one._evaluation_by_twin(here, 0.0), other.evaluate(here, 0.0)
        for this, that, tolerance in (
                (found.error, expected.error, near), (found.level.J, expected.level.J, 1e-12),
                (found.level.v, expected.level.v, near)):
            np.testing.assert_allclose(this, that, rtol=tolerance, atol=tolerance)


def moving_pair(kind, seed):
    """Return two equal tasks with goals that move, their states, and goals of the type."""
    rng, its = np.random.default_rng(seed), robots.named('chain')
    tasks = [Task.types[kind](its, 'task', **{
        **({'joints': ['a', 'c']} if kind == 'joint' else {}),
        **({'frame': 'l3'} if kind in AXES and kind != 'center_of_mass' else {}),
        'gain': 3.0}) for _ in range(2)]

    def goal():
        if kind in ('joint', 'posture'):
            return rng.normal(size=tasks[0].rows)
        T = pose(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
        return GOALS[tasks[0].goal_type](T).copy()

    fed = tasks[0].rows if kind in ('joint', 'posture') else 6
    return tasks, its.state(*robots.anywhere(its, rng)), goal, lambda: rng.normal(size=fed)


MOVING = ['pose', 'position', 'orientation', 'joint', 'posture', 'center_of_mass', 'pointing']


@pytest.mark.slow
@pytest.mark.parametrize('kind', MOVING)
@given(seed=seeds)
def test_goal_that_moves_is_set_in_place_and_gives_the_same_numbers(kind, seed):
    (one, other), here, goal, velocity = moving_pair(kind, seed)
    for task in (one, other):
        task.set_goal(goal(), 0.0)
        task.set_feed_forward(velocity(), 0.0)
    # The direction of a turn is remembered, also while a goal moves: both begin from the same one.
    other.set_goal(one.goal, 0.0)
    for task in (one, other):
        task.evaluate(here, 0.0)
    before, found, moves = one.twin, goal(), velocity()
    one.move_goal(found.copy(), moves, 0.3)
    other.goal = found.copy()
    other.set_feed_forward(moves, 0.3)
    assert one.twin is before and other.twin is not before
    np.testing.assert_array_equal(one.goal, found)
    this, that = one.evaluate(here, 0.5), other.evaluate(here, 0.5)
    for mine, its in ((this.error, that.error), (this.level.J, that.level.J),
                      (this.level.v, that.level.v)):
        np.testing.assert_array_equal(mine, its)
    # The velocity times out as any other one.
    assert not np.array_equal(one.evaluate(here, 9.0).level.v, this.level.v)
    assert not one.goal.flags.writeable


@pytest.mark.parametrize('kind', MOVING)
def test_goal_that_moves_begins_with_a_new_twin_where_it_does_not_fit(kind):
    (one, _), here, goal, velocity = moving_pair(kind, 1)
    one.set_goal(goal(), 0.0)
    before = one.twin
    # The twin has no velocity yet.
    one.move_goal(goal(), velocity(), 0.0)
    assert one.twin is not before
    for faulty in ((np.zeros((5, 5)), velocity(), 0.0), (goal(), np.zeros(5), 0.0),
                   (None, velocity(), 0.0), (goal(), None, 0.0), (goal(), velocity(), 'x')):
        assert one.twin.task.move_goal(*faulty) is False
    with pytest.raises(ValueError, match='move_goal'):
        one.twin.task.move_goal(goal())


def test_type_that_takes_velocities_itself_is_told_those_of_goals_that_move():
    class Own(Position):
        def set_feed_forward(self, velocity, now):
            super().set_feed_forward(2.0 * velocity, now)

    task = Own(robots.panda(), 'task', frame='panda_hand_tcp')
    for _ in range(2):
        task.move_goal(np.zeros(3), np.ones(6), 0.0)
        assert task.twin is not None and task.feed_forward(0.0).tolist() == [2.0] * 6


@pytest.mark.slow
@given(seed=seeds, name=st.sampled_from(sorted(robots.EVERY)), gains=st.booleans(),
       most=st.sampled_from([0.01, 100.0]))
def test_distance_from_joint_limits_is_that_of_the_reference(seed, name, gains, most):
    rng, its = np.random.default_rng(seed), robots.named(name)
    kind = Task.types['joint_limit_distance']
    assume(not lacks(kind.type_name, kind.needs, its, {}))
    gain = rng.uniform(0.1, 9.0, its.n if gains else ())
    task = kind(its, 'task', gain=gain, max_speed=most)
    here = its.state(*robots.anywhere(its, rng))
    found, expected = task._evaluation_by_twin(here, 0.0), task.make_evaluation(here, 0.0)
    for this, that in ((found.error, expected.error), (found.level.v, expected.level.v),
                       (found.level.J, expected.level.J)):
        np.testing.assert_allclose(this, that, rtol=1e-12, atol=1e-12)
    assert found.level.is_identity


SHAPES = {'box': [0.3, 0.5, 0.2], 'sphere': 0.3, 'cylinder': [0.2, 0.6], 'half_space': []}


def bounded_pair(kind, robot, rng, moving):
    """Return two equal bounded tasks; the reference evaluates the second one."""
    frame, reference = (str(each) for each in rng.choice(robot.frame_names, 2))
    keys = {'speed_limit': {'frame': frame, 'linear': 0.3, **({'angular': 0.5} if moving else {})},
            'field_of_view': {'frame': frame, 'half_angle': 0.5, 'axis': rng.normal(size=3)},
            'tilt': {'frame': frame, 'within': 0.5, 'axis': rng.normal(size=3)},
            'orientation_range': {
                'frame': frame, **({'axes': 'zx', 'maximum': [0.2, 0.4]} if moving
                                   else {'minimum': [-0.5, 0.1, -0.2], 'maximum': 0.3})},
            'joint_limits': {'margin': 1e-3}}.get(kind)
    if keys is None:
        shape = str(rng.choice(list(SHAPES)))
        keys = {'frame': frame, 'shape': {shape: SHAPES[shape]}, 'radius': rng.uniform(0.0, 0.05),
                'gain': rng.uniform(1.0, 9.0), 'return_speed': rng.uniform(0.1, 0.5)}
    if moving and kind != 'joint_limits':
        keys['reference'] = reference
    one, other = (Task.types[kind](robot, 'task', **keys) for _ in range(2))
    other.make_twin = lambda: None
    return one, other


def assert_same_bounds(found, expected, tolerance=1e-12):
    """Assert that two evaluations of a bounded task agree."""
    for this, that in ((found.error, expected.error), (found.level.J, expected.level.J),
                       (found.level.lower, expected.level.lower),
                       (found.level.upper, expected.level.upper)):
        np.testing.assert_allclose(this, that, rtol=tolerance, atol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize('kind', [
    'keep_in', 'keep_out', 'field_of_view', 'tilt', 'speed_limit', 'joint_limits',
    'orientation_range'])
@given(seed=seeds, name=st.sampled_from(sorted(robots.EVERY)), moving=st.booleans(),
       fed=st.booleans())
def test_bounds_are_those_of_the_reference_whichever_way_evaluated_the_cycle_before(
        kind, seed, name, moving, fed):
    rng, its = np.random.default_rng(seed), robots.named(name)
    assume(not lacks(kind, Task.types[kind].needs, its, {}))
    one, other = bounded_pair(kind, its, rng, moving)
    (q, passive), now = robots.anywhere(its, rng), 0.0
    here = its.state(q, passive)
    if one.goal_type:
        # The frame is near the surface.
        place = rng.normal(size=3) * rng.choice([0.02, 0.3])
        if one.goal_type == 'direction':
            # The axis is nearly aligned.
            place = one.parse_goal(one.aim.current(here, one.axis) + place)
        elif one.goal_type == 'quaternion':
            place = one._motion.rotation(here).dot(rotation_from_vector(6.0 * place))
        elif one.goal_type == 'pose':
            place = pose(rotation_from_vector(rng.normal(size=3)),
                         one._motion.position(here) + place)
        for task in (one, other):
            task.set_goal(place, now)
            if fed:
                task.set_feed_forward(np.arange(1.0, 7.0), now)
    assert one.twin is not None and other.twin is None
    for _ in range(8):
        by_twin, step, tick = rng.choice([True, False]), rng.choice([0.0, 0.01, 1.0]), \
            rng.choice([0.0, 0.01])
        here.velocity = rng.normal(size=its.n)
        found = (one._evaluation_by_twin if by_twin else one.make_evaluation)(here, now)
        # Near half a turn, the logarithm of Pinocchio is less exact.
        far = kind == 'orientation_range' and np.linalg.norm(one._turn(here)) > 2.0
        assert_same_bounds(found, other.evaluate(here, now), 1e-9 if far else 1e-12)
        # The robot may rest, jump, and move while the clock stands still.
        q, now = its.integrate(q, step * rng.normal(size=its.n), 1.0), now + tick
        here.update(q)


@pytest.mark.slow
@pytest.mark.parametrize('shape', SHAPES)
@pytest.mark.parametrize('kind', ['keep_in', 'keep_out'])
def test_distances_from_faces_edges_and_corners_are_those_of_the_reference(kind, shape):
    its = robots.panda()
    here = its.state(its.neutral())
    one, other = (Task.types[kind](its, 'task', frame=robots.PANDA_TOOL,
                                   shape={shape: SHAPES[shape]}) for _ in range(2))
    other.make_twin = lambda: None
    for point in itertools.product((-0.3, -0.1, 0.0, 0.1, 0.25, 0.4), repeat=3):
        T = pose(np.eye(3), here.position(robots.PANDA_TOOL) - point)
        for task in (one, other):
            task.set_goal(T, 0.0)
        assert one.twin is not None
        assert_same_bounds(one.evaluate(here, 0.0), other.evaluate(here, 0.0))


def test_copy_of_a_bounded_task_has_a_history_of_its_own():
    its = robots.panda()
    here, there = its.state(its.neutral()), its.state(its.neutral() + 0.05)
    one, other = bounded_pair('keep_out', its, np.random.default_rng(0), False)
    for task in (one, other):
        task.start(here)
        task.evaluate(here, 0.0)
    one.probe().evaluate(its.state(its.neutral() + 0.1), 0.005)
    there.velocity = np.ones(its.n)
    assert_same_bounds(one.evaluate(there, 0.01), other.evaluate(there, 0.01))
    # Without the cycle before, the bounds would be others.
    other.reset()
    assert np.abs(one.evaluate(there, 0.01).level.lower
                  - other.evaluate(there, 0.01).level.lower).max() > 1e-4


def test_velocity_of_a_region_times_out():
    its = robots.panda()
    here = its.state(its.neutral())
    task, still = (Task.types['keep_out'](its, 'task', frame=robots.PANDA_TOOL, timeout=0.1,
                                          shape={'sphere': 0.3}) for _ in range(2))
    for each in (task, still):
        each.start(here)
    task.set_feed_forward(np.arange(1.0, 7.0), 0.0)
    assert task.evaluate(here, 0.05).level.lower != still.evaluate(here, 0.05).level.lower
    assert task.evaluate(here, 0.2).level.lower == still.evaluate(here, 0.2).level.lower
    assert task.feed_forward(0.0) is None


# About all axes, those of the frame and ones next to them, too.
@given(seed=seeds, angle=st.one_of(st.floats(0.0, 1e-6), st.floats(0.0, np.pi),
                                   st.floats(np.pi - 1e-3, np.pi)),
       flat=st.tuples(*3 * [st.sampled_from([0.0, 1e-9, 1.0])]).filter(any))
def test_turns_are_exact_however_small_or_large(seed, angle, flat):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3) * flat
    vector = angle * axis / np.linalg.norm(axis)
    its = robots.panda()
    here = its.state(its.neutral())
    R = here.rotation(robots.PANDA_TOOL)
    task = Task.types['orientation'](its, 'task', frame=robots.PANDA_TOOL)
    # In the direction of `vector`, where both are equally long.
    task._rotation_error.follow(vector)
    task.goal = rotation_from_vector(vector).dot(R)
    error = task.evaluate(here, 0.0).error
    assert np.abs(rotation_from_vector(error).dot(R) - task.goal).max() < 1e-14
    assert np.abs(error - vector).max() < 1e-13 or np.abs(
        shorter_rotation(error, vector) - vector).max() < 1e-7
    assert np.array_equal(task._rotation_error.previous, error)


def test_type_that_evaluates_in_its_own_way_has_no_twin():
    class Shifted(Position):

        def error(self, state):
            return super().error(state) + 1.0

    class Renamed(Pose):
        pass

    its = robots.panda()
    here = its.state(its.neutral())
    task, renamed = (kind(its, 'task', frame=robots.PANDA_TOOL) for kind in (Shifted, Renamed))
    for each in (task, renamed):
        assert each.twin is None
        each.start(here)
    assert np.array_equal(task.evaluate(here, 0.0).error, np.ones(3))
    assert task.twin is None and renamed.twin is not None
    renamed.error = lambda state: np.ones(6)
    assert renamed.twin is None

    class Higher(CenterOfMass):

        def value(self, state):
            return super().value(state) + 1.0

    class Behind(DirectionAim):

        def sight(self, state, goal):
            direction, J = super().sight(state, goal)
            return -direction, J

    heavy = robots.named('chain')
    higher, pointing = Higher(heavy, 'task'), Pointing(its, 'task', frame=robots.PANDA_TOOL)
    higher.start(heavy.state(heavy.neutral()))
    pointing.start(here)
    assert higher.twin is None and pointing.twin is not None
    pointing.aim = Behind(robots.PANDA_TOOL, its.root)
    assert pointing.twin is None
    assert np.linalg.norm(pointing.evaluate(here, 0.0).error) == pytest.approx(np.pi)


def test_twin_follows_every_input_and_none_is_changed_in_place():
    its = robots.panda()
    here, watch = its.state(its.neutral()), Watch()
    task = Position(its, 'task', frame=robots.PANDA_TOOL, gain=1.0)
    task.start(here)
    task.watch(watch)
    watch.changed = False
    assert task.evaluate(here, 0.0).level.v.tolist() == [0.0, 0.0, 0.0] and not watch.changed
    goal = here.position(robots.PANDA_TOOL) + 0.5
    for change, expected in (
            (lambda: task.set_goal(goal, 0.0), 0.5), (lambda: task.set_gain(2.0), 1.0),
            (lambda: task.set_feed_forward(np.full(6, 0.1), 0.0), 1.1),
            (lambda: setattr(task, 'gain', np.full(3, 4.0)), 2.1)):
        change()
        assert watch.changed
        watch.changed = False
        assert np.allclose(task.evaluate(here, 0.0).level.v, expected)
    task.mode = 'scale'
    assert task.evaluate(here, 0.0).level.mode == task.twin.mode == 'scale'
    for array in (task.goal, task.gain):
        with pytest.raises(ValueError, match='read-only'):
            array[0] = 7.0
    # A copy is watched by nobody.
    watch.changed = False
    other = task.probe()
    other.goal = goal - 0.5
    assert not watch.changed and other.twin is not task.twin
    assert np.allclose(other.evaluate(here, 0.0).level.v, 0.1)
    # After the timeout, and with a clock that is set back.
    assert np.allclose(task.evaluate(here, 9.0).level.v, 2.0)
    assert np.allclose(task.evaluate(here, 0.0).level.v, 2.0)


LAW = (6, False, np.array(2.0), None, 0.0, 1.0, None, None)
BOUNDED = JOINT_LIMITS, SPEED_LIMIT, REGION, CONE, ORIENTATION_RANGE
FITS = {
    FRAME: (LAW, (1, -1, bytes(range(6)), np.eye(4), np.zeros(4))),
    JOINTS: ((2, *LAW[1:]), (np.arange(2.0), False, np.zeros(2), np.zeros(2))),
    JOINT_LIMITS: ((2, *LAW[1:]), (np.arange(2.0), -np.ones(2), np.ones(2), 0.2)),
    AXIS: ((3, *LAW[1:]), (1, -1, True, np.zeros(3), np.eye(3)[2], np.eye(3)[:2], np.eye(3)[:2],
                           np.zeros(4))),
    CENTER_OF_MASS: ((2, *LAW[1:]), (bytes(range(2)), np.zeros(3), 2.0)),
    SPEED_LIMIT: ((2, *LAW[1:]), (1, -1, np.ones((2, 6)), np.ones(2))),
    REGION: ((1, *LAW[1:]), ((1, -1, False, 1, np.ones(1), np.eye(4)),
                             (np.zeros(1), np.ones(1), 0.2, 0.5, np.zeros(22)))),
    JOINT_LIMIT_DISTANCE: ((4, *LAW[1:]), (np.zeros(4), np.ones(4), 0.5)),
    CONE: ((1, *LAW[1:]), (1, -1, True, np.zeros(3), np.eye(3)[2], (
        np.array(-1.0), np.ones(1), 0.2, 0.5, np.zeros(22)))),
    ORIENTATION_RANGE: ((2, *LAW[1:]), (1, -1, bytes(range(2)), np.eye(3), np.zeros(4), (
        np.array(-1.0), np.ones(2), 0.2, 0.5, np.zeros(36)))),
    COM_POLYGON: ((3, *LAW[1:]), (np.arange(3.0), np.eye(3), np.eye(3)[:2], (
        np.array(0.0), np.array(1.0), 0.2, 0.5, np.zeros(56)))),
}


def changed(inputs, place, value):
    """Return nested inputs with another value at a place, an index or several."""
    first, *rest = place if isinstance(place, tuple) else (place,)
    return tuple((changed(each, tuple(rest), value) if rest else value) if index == first else each
                 for index, each in enumerate(inputs))


@pytest.mark.parametrize('kind, part, place, wrong', [
    *((kind, 0, *each) for kind in FITS for each in (
        (0, 0), (0, -1), (0, 7), (0, 10 ** 9), (0, 'x'), (2, np.ones(5)), (2, 2.0), (2, None),
        (2, np.array(2)), (3, np.ones(5)), (3, 'x'), (4, None), (5, 'x'), (6, 'x'),
        (6, np.ones(7)), (6, np.ones((1, 7), bool)), (6, np.ones(0, bool)), (6, 1),
        (7, 'x'), (7, np.ones(7)))),
    *((FRAME, 1, *each) for each in (
        (0, -1), (0, 'tool'), (0, 10 ** 30), (1, -2), (1, None), (2, b''), (2, bytes(7)),
        (2, bytes([6] * 6)), (2, 'x'), (3, np.eye(2)), (3, np.zeros(3)), (3, np.eye(4)[0]),
        (3, np.eye(4, dtype=int)), (3, 'x'), (4, None), (4, np.zeros(3)), (4, b''))),
    *((JOINTS, 1, *each) for each in (
        (0, np.arange(3.0)), (0, np.array([0.0, -1.0])), (0, np.array([0.0, 0.5])),
        (0, np.array([0.0, 1e30])), (0, np.array([0.0, np.nan])), (0, np.arange(2)), (0, None),
        (2, np.zeros(3)), (2, 'x'), (3, np.zeros(3)), (3, None))),
    *((JOINT_LIMITS, 1, *each) for each in (
        (0, None), (0, np.arange(3.0)), (1, np.ones(3)), (2, None), (3, None))),
    *((AXIS, 1, *each) for each in (
        (0, -1), (0, None), (1, -2), (1, 10 ** 30), (3, np.zeros(2)), (3, np.full(3, np.nan)),
        (3, None), (4, np.eye(3)), (4, None), (5, np.eye(3)), (5, None), (6, np.zeros(3)),
        (6, None), (7, np.zeros(3)), (7, None))),
    *((CENTER_OF_MASS, 1, *each) for each in (
        (0, b''), (0, bytes(3)), (0, bytes([0, 3])), (0, 'x'), (1, np.zeros(2)), (1, None),
        (2, 'x'))),
    *((SPEED_LIMIT, 1, *each) for each in (
        (0, -1), (1, -2), (1, None), (2, np.ones((3, 6))), (2, np.ones((2, 3))), (2, None),
        (3, np.ones(3)), (3, 'x'))),
    *((REGION, 1, *each) for each in (
        (0, None), (1, ()), ((0, 0), -1), ((0, 1), -2), ((0, 3), -1), ((0, 3), 4), ((0, 3), 2),
        ((0, 4), np.ones(2)), ((0, 4), None), ((0, 5), np.eye(3)), ((0, 5), np.zeros(3)),
        ((0, 5), None), ((1, 0), np.zeros(2)), ((1, 1), None), ((1, 2), None), ((1, 3), 'x'),
        ((1, 4), np.zeros((2, 2))), ((1, 4), None), ((1, 4), np.zeros(22, int)))),
    *((JOINT_LIMIT_DISTANCE, 1, *each) for each in (
        (0, np.zeros(6)), (0, None), (1, np.ones(8)), (1, 'x'), (2, None))),
    *((CONE, 1, *each) for each in (
        (0, -1), (1, -2), (3, np.zeros(2)), (3, np.full(3, np.nan)), (3, None), (4, np.eye(3)),
        (4, None), (5, None), ((5, 0), np.zeros(2)), ((5, 4), 'x'))),
    *((ORIENTATION_RANGE, 1, *each) for each in (
        (0, -1), (1, -2), (2, bytes(3)), (2, bytes([0, 3])), (3, np.zeros(3)), (3, None),
        (4, np.zeros(3)), (4, None), (5, None), ((5, 0), np.zeros(3)), ((5, 4), 'x'))),
    *((COM_POLYGON, 1, *each) for each in (
        (0, np.arange(4.0)), (0, np.array([0.0, 0.5, 1.0])), (0, None), (1, np.eye(4)[:, :3]),
        (1, np.full((3, 3), np.nan)), (1, None), (2, np.eye(3)), (2, None), (3, None),
        ((3, 1), np.zeros(4)), ((3, 4), 'x')))])
def test_inputs_that_do_not_fit_are_refused(kind, part, place, wrong):
    parts = [*FITS[kind]]
    core.Task(kind, *parts)
    parts[part] = changed(parts[part], place, wrong)
    with pytest.raises(ValueError, match='inputs'):
        core.Task(kind, *parts)
    for short in (parts[0][:-1], (*parts[0], 0.0)):
        with pytest.raises(ValueError, match='inputs'):
            core.Task(kind, short, FITS[kind][1])
    for number in (-1, len(FITS)):
        with pytest.raises(ValueError, match='inputs'):
            core.Task(number, *FITS[kind])


def locked(array):
    """Return an array that cannot be written to."""
    array.setflags(write=False)
    return array


def test_arrays_that_do_not_fit_are_left_to_the_reference():
    motion, n, m = robots.panda().state(robots.panda().neutral()).motion, 7, 6
    task, J = core.Task(FRAME, *FITS[FRAME]), np.empty((m, n))
    fits = [motion, np.zeros(n), np.zeros(n), 0.0, np.empty(m), J, np.empty(m), None]
    assert task.evaluate(*fits) is True
    for place, wrong in (
            (0, None), (0, task), (1, np.zeros(6)), (1, None), (2, np.zeros(6)), (2, None),
            (4, np.empty(5)), (4, np.empty((m, 1))), (4, np.empty(m, int)),
            (4, locked(np.empty(m))), (4, None), (5, np.empty((m, n + 1))), (5, J.T),
            (5, J[::-1]), (5, J[0]), (5, J.astype(int)), (5, None), (6, np.empty(7)), (6, None),
            (6, locked(np.empty(m))), (7, np.empty(m))):
        given_ = [*fits]
        given_[place] = wrong
        # Called like this, Python notices an exception that is left behind, too.
        assert partial(task.evaluate, *given_)() is False, (place, wrong)
    with pytest.raises(ValueError, match='evaluate'):
        task.evaluate(*fits[1:])
    # A frame, and a joint, that the robot does not have; a history of another size.
    for kind, law, inputs in ((FRAME, LAW, (10 ** 6, *FITS[FRAME][1][1:])),
                              (FRAME, LAW, (1, 10 ** 6, *FITS[FRAME][1][2:])),
                              (AXIS, FITS[AXIS][0], (10 ** 6, *FITS[AXIS][1][1:])),
                              (AXIS, FITS[AXIS][0], (1, 10 ** 6, *FITS[AXIS][1][2:])),
                              (JOINTS, (1, *LAW[1:]), (np.array([7.0]), False, None, np.zeros(1))),
                              (SPEED_LIMIT, FITS[SPEED_LIMIT][0], changed(
                                  FITS[SPEED_LIMIT][1], 1, 10 ** 6)),
                              (REGION, FITS[REGION][0], changed(
                                  FITS[REGION][1], (0, 0), 10 ** 6)),
                              (REGION, FITS[REGION][0], changed(
                                  FITS[REGION][1], (1, 4), np.zeros(23))),
                              (CONE, FITS[CONE][0], changed(
                                  FITS[CONE][1], 0, 10 ** 6)),
                              (ORIENTATION_RANGE, FITS[ORIENTATION_RANGE][0], changed(
                                  FITS[ORIENTATION_RANGE][1], 1, 10 ** 6)),
                              (ORIENTATION_RANGE, FITS[ORIENTATION_RANGE][0], changed(
                                  FITS[ORIENTATION_RANGE][1], (5, 4), np.zeros(37))),
                              (JOINT_LIMIT_DISTANCE, (6, *LAW[1:]), (
                                  np.zeros(6), np.ones(6), 0.5))):
        rows, bounded = law[0], kind in BOUNDED
        assert core.Task(kind, law, inputs).evaluate(
            motion, *fits[1:4], np.empty(rows), np.empty((rows, n)), np.empty(rows),
            np.empty(rows) if bounded else None) is False
    for kind in BOUNDED:
        rows = FITS[kind][0][0]
        outputs = (np.empty(rows), np.empty((rows, n)), np.empty(rows))
        one = core.Task(kind, *FITS[kind])
        assert one.evaluate(motion, *fits[1:4], *outputs, np.empty(rows)) is True
        for upper in (None, np.empty(rows + 1), locked(np.empty(rows))):
            assert one.evaluate(motion, *fits[1:4], *outputs, upper) is False
    # The number of rows is not known before.
    assert core.Task(COM_POLYGON, *FITS[COM_POLYGON]).evaluate(
        motion, *fits[1:4], *(np.empty(size) for size in (3, (3, n), 3, 3))) is False


def test_objects_that_are_lent_are_given_back():
    motion = robots.panda().state(robots.panda().neutral()).motion
    arrays = (np.zeros(7), np.empty(6), np.empty((6, 7)), np.empty(6))
    its_inputs = [each for _, its in FITS.values() for part in (its, *its)
                  for each in (part if isinstance(part, tuple) else ())]
    objects = (motion, *arrays, *LAW[2:4], *its_inputs, core.Task)

    def use():
        task = core.Task(FRAME, *FITS[FRAME])
        assert task.evaluate(motion, arrays[0], arrays[0], 0.0, *arrays[1:], None)
        assert not task.evaluate(motion, arrays[0], arrays[0], 0.0, *arrays[1:3], arrays[0], None)
        for kind, (law, its) in FITS.items():
            core.Task(kind, law, its)
            with pytest.raises(ValueError):
                core.Task(kind, law, FITS[(kind + 1) % len(FITS)][1])
        with pytest.raises(ValueError):
            core.Task(REGION, FITS[REGION][0], changed(FITS[REGION][1], (1, 3), 'x'))

    use()
    before = [sys.getrefcount(each) for each in objects]
    use()
    assert [sys.getrefcount(each) for each in objects] == before
