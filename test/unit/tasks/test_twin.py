# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Twins of tasks: what the compiled core evaluates is what Python does."""

from functools import partial
from inspect import Parameter
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
    FRAME,
    JOINT_LIMITS,
    JOINTS,
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


LAW = (6, False, np.array(2.0), None, 0.0, 1.0)
FITS = {
    FRAME: (LAW, (1, -1, bytes(range(6)), np.eye(4), np.zeros(4))),
    JOINTS: ((2, *LAW[1:]), (np.arange(2.0), False, np.zeros(2), np.zeros(2))),
    JOINT_LIMITS: ((2, *LAW[1:]), (np.arange(2.0), -np.ones(2), np.ones(2), 0.2)),
    AXIS: ((3, *LAW[1:]), (1, -1, True, np.zeros(3), np.eye(3)[2], np.eye(3)[:2], np.eye(3)[:2],
                           np.zeros(4))),
    CENTER_OF_MASS: ((2, *LAW[1:]), (bytes(range(2)), np.zeros(3), 2.0)),
}


@pytest.mark.parametrize('kind, part, place, wrong', [
    *((kind, 0, *each) for kind in FITS for each in (
        (0, 0), (0, -1), (0, 7), (0, 10 ** 9), (0, 'x'), (2, np.ones(5)), (2, 2.0), (2, None),
        (2, np.array(2)), (3, np.ones(5)), (3, 'x'), (4, None), (5, 'x'))),
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
        (2, 'x')))])
def test_inputs_that_do_not_fit_are_refused(kind, part, place, wrong):
    parts = [list(each) for each in FITS[kind]]
    core.Task(kind, *map(tuple, parts))
    parts[part][place] = wrong
    with pytest.raises(ValueError, match='inputs'):
        core.Task(kind, *map(tuple, parts))
    for short in (parts[0][:-1], [*parts[0], 0.0]):
        with pytest.raises(ValueError, match='inputs'):
            core.Task(kind, tuple(short), FITS[kind][1])
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
    fits = [motion, np.zeros(n), 0.0, np.empty(m), J, np.empty(m)]
    assert task.evaluate(*fits) is True
    for place, wrong in (
            (0, None), (0, task), (1, np.zeros(6)), (1, None), (3, np.empty(5)),
            (3, np.empty((m, 1))), (3, np.empty(m, int)), (3, locked(np.empty(m))), (3, None),
            (4, np.empty((m, n + 1))), (4, J.T), (4, J[::-1]), (4, J[0]), (4, J.astype(int)),
            (4, None), (5, np.empty(7)), (5, None), (5, locked(np.empty(m)))):
        given_ = [*fits]
        given_[place] = wrong
        # Called like this, Python notices an exception that is left behind, too.
        assert partial(task.evaluate, *given_)() is False, (place, wrong)
    with pytest.raises(ValueError, match='evaluate'):
        task.evaluate(*fits[1:])
    # A frame, and a joint, that the robot does not have; bounds.
    for kind, law, inputs in ((FRAME, LAW, (10 ** 6, *FITS[FRAME][1][1:])),
                              (FRAME, LAW, (1, 10 ** 6, *FITS[FRAME][1][2:])),
                              (AXIS, FITS[AXIS][0], (10 ** 6, *FITS[AXIS][1][1:])),
                              (AXIS, FITS[AXIS][0], (1, 10 ** 6, *FITS[AXIS][1][2:])),
                              (JOINTS, (1, *LAW[1:]), (np.array([7.0]), False, None, np.zeros(1))),
                              (JOINT_LIMITS, *FITS[JOINT_LIMITS])):
        rows = law[0]
        other = core.Task(kind, law, inputs)
        assert other.evaluate(motion, np.zeros(n), 0.0, np.empty(rows), np.empty((rows, n)),
                              np.empty(rows)) is False


def test_objects_that_are_lent_are_given_back():
    motion = robots.panda().state(robots.panda().neutral()).motion
    arrays = (np.zeros(7), np.empty(6), np.empty((6, 7)), np.empty(6))
    inputs = [each for _, its in FITS.values() for each in its if isinstance(each, np.ndarray)]
    objects = (motion, *arrays, *LAW[2:4], *inputs, core.Task)

    def use():
        task = core.Task(FRAME, *FITS[FRAME])
        assert task.evaluate(motion, arrays[0], 0.0, *arrays[1:])
        assert not task.evaluate(motion, arrays[0], 0.0, *arrays[1:3], arrays[0])
        for kind, (law, its) in FITS.items():
            core.Task(kind, law, its)
            with pytest.raises(ValueError):
                core.Task(kind, law, FITS[(kind + 1) % len(FITS)][1])

    use()
    before = [sys.getrefcount(each) for each in objects]
    use()
    assert [sys.getrefcount(each) for each in objects] == before
