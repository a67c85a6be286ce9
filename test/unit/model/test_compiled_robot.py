# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What is compiled of a robot does what Pinocchio and the reference in Python do."""

from contextlib import nullcontext
import sys
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pinocchio
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import LIMITS, VelocityLimits
from tp_controller.model import compiled
from tp_controller.model.limits import LIMIT_KEYS, POSITIVE_KEYS
from tp_controller.model.spatial import rotation_from_vector
from tp_controller.solver import compiled as solver
from tp_controller.solver.compiled import core

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')

seeds = st.integers(0, 2 ** 32 - 1)


@pytest.mark.parametrize('name', robots.EVERY)
def test_frames_are_where_pinocchio_has_them_and_move_as_it_says(name):
    rng, its = np.random.default_rng(0), robots.named(name)
    here, there = (its.state(its.neutral()) for _ in range(2))
    assert here.motion is not None
    there.motion = None
    for _ in range(5):
        place = robots.anywhere(its, rng)
        here.update(*place)
        there.update(*place)
        for frame in its.frame_names:
            assert np.abs(here.pose(frame) - there.pose(frame)).max() < 1e-12
            assert np.abs(here.jacobian(frame) - there.jacobian(frame)).max() < 1e-12
        if not its.kinematics.mass:
            continue
        one, other = (each.center_of_mass() for each in (here, there))
        assert all(np.array_equal(*pair) for pair in zip(one, other))


def test_joints_of_other_kinds_are_left_to_pinocchio():
    model = pinocchio.Model()
    model.addJoint(0, pinocchio.JointModelSpherical(), pinocchio.SE3.Identity(), 'ball')
    assert compiled.numbers_of(model, 3, 0, (), np.zeros((1, 1))) is None
    model = pinocchio.Model()
    model.addJoint(0, pinocchio.JointModelHelicalUnaligned(np.array([0.0, 0.0, 1.0]), 0.1),
                   pinocchio.SE3.Identity(), 'screw')
    assert compiled.numbers_of(model, 1, 0, (), np.ones((1, 1))) is None
    assert compiled.make_motion(None) is None


READY, ZEROS = np.array(robots.PANDA_READY), np.zeros(7)


@pytest.mark.parametrize('positions', [
    (READY[:-1], ZEROS, None), (READY, ZEROS[1:], None), (READY.astype(np.float32), ZEROS, None),
    (READY + np.nan, ZEROS, None), (READY + 1e10, ZEROS, None), (None, ZEROS, None),
    (READY, ZEROS + np.nan, None), (READY, ZEROS, READY)])
def test_positions_that_are_none_change_nothing(positions):
    its = robots.named('Panda')
    here = its.state(its.neutral())
    before, after = np.empty((4, 4)), np.empty((4, 4))
    index = its.kinematics.frame_index(robots.PANDA_TOOL)
    here.motion.place(index, before)
    with pytest.raises(ValueError, match='no positions'):
        here.motion.move(*positions)
    here.motion.place(index, after)
    assert np.array_equal(before, after)


@pytest.mark.parametrize('place', [
    None, np.ones(6), np.ones((7, 1)), np.ones(7, int), np.full(7, np.nan), [1.0] * 7])
def test_places_of_a_base_that_are_none_change_nothing(place):
    its = robots.named('floating')
    here = its.state(its.neutral())
    q, offset = its.neutral(), np.zeros(len(its.kinematics.offset))
    before, after = np.empty((4, 4)), np.empty((4, 4))
    index = its.kinematics.frame_index(robots.PANDA_TOOL)
    here.motion.move(q, offset, np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]))
    here.motion.place(index, before)
    with pytest.raises(ValueError, match='no positions'):
        here.motion.move(q, offset, place)
    here.motion.place(index, after)
    assert np.array_equal(before, after)


def locked(array):
    """Return an array that cannot be written to."""
    array.setflags(write=False)
    return array


def test_what_does_not_fit_is_refused():
    its = robots.named('Panda')
    motion = its.state(its.neutral()).motion
    index, n = its.kinematics.frame_index(robots.PANDA_TOOL), its.n
    crooked = memoryview(bytearray(8 * 16 + 1))[1:].cast('d', (4, 4))
    for arguments in ((index, np.empty((3, 4))), (-1, np.empty((4, 4))), (index,),
                      (index, np.empty((4, 4), np.float32)), (index, crooked),
                      (index, np.empty((4, 4), int)), (index, locked(np.empty((4, 4))))):
        with pytest.raises(ValueError, match='place'):
            motion.place(*arguments)
    with pytest.raises(ValueError, match='jacobian'):
        motion.jacobian(index, np.empty((6, n - 1)))


def test_robots_that_do_not_fit_together_are_refused():
    hanging = [*np.ravel(np.eye(3)), *np.zeros(3)]
    still = [0.0, 0.0, -1.0, *np.zeros(4), *hanging, *np.zeros(4)]
    turns = [2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, *hanging, *np.zeros(4)]
    fits = [2, 0, np.zeros(0), np.array([still, turns]), np.array([[1.0, *hanging]])]
    core.Motion(*fits)

    def body(place, value):
        changed = fits[3].copy()
        changed[1, place] = value
        return changed
    for place, wrong in (
            # Fewer joints than columns, or more than there can be; no row of a configuration.
            (0, 0), (0, 10 ** 4), (1, -1), (1, 10 ** 4), (1, 2 ** 31 - 1),
            # A base of other rows than those of a twist, or more of them than velocities.
            (2, np.array([6.0])), (2, np.array([-1.0])), (2, np.array([np.nan])), (2, np.zeros(3)),
            (2, np.zeros((1, 1))), (2, None),
            # No root, a root that moves, numbers for less than a body, none.
            (3, fits[3][:0]), (3, fits[3][1:]), (3, fits[3][:, 1:]), (3, fits[3][0]), (3, None),
            # A second root, a kind that there is not, a base that has no velocities.
            (3, body(0, 0.0)), (3, body(0, 4.0)), (3, body(0, -1.0)), (3, body(0, np.nan)),
            (3, body(0, 2.5)), (3, body(0, 1e30)), (3, body(0, 1.0)),
            # A parent, or a column, that there is not.
            (3, body(1, 1.0)), (3, body(1, -1.0)), (3, body(2, 2.0)), (3, body(2, -2.0)),
            # A frame of no body, none.
            (4, np.array([[2.0, *hanging]])), (4, np.array([[-1.0, *hanging]])),
            (4, np.array([[np.nan, *hanging]])), (4, fits[4][:, 1:]), (4, None)):
        given_ = [*fits]
        given_[place] = wrong
        with pytest.raises(ValueError, match='base|bodies'):
            core.Motion(*given_)
    root, frame = np.array([still]), np.array([[0.0, *hanging]])
    core.Motion(2, 0, np.zeros(2), root, frame)
    # No bodies, a root that turns, more rows of a base than velocities.
    for given_ in ([2, 0, np.zeros(0), root[:0], frame[:0]],
                   [2, 0, np.zeros(0), np.array([turns]), frame],
                   [1, 0, np.zeros(2), root, frame]):
        with pytest.raises(ValueError, match='bodies'):
            core.Motion(*given_)


def test_robots_with_more_frames_than_fit_are_left_to_pinocchio():
    count = solver.MOST // 2 + 1
    links = ''.join(f'<link name="l{number}"/>' for number in range(count))
    hang = ''.join(f'<joint name="j{number}" type="{"fixed" if number else "continuous"}">'
                   f'<parent link="l{number}"/><child link="l{number + 1}"/></joint>'
                   for number in range(count - 1))
    its = Robot.from_urdf(f'<robot name="long">{links}{hang}</robot>')
    here = its.state([1.0])
    assert here.motion is None
    assert np.allclose(here.pose(f'l{count - 1}')[:3, :3], rotation_from_vector([1.0, 0.0, 0.0]))


@pytest.mark.parametrize('key', [limit.key for limit in LIMITS if limit.compiled])
def test_limits_that_do_not_fit_together_are_refused(key):
    fits = dict.fromkeys(LIMIT_KEYS, np.ones(2))
    core.Limits(0.01, 100.0, fits)
    for wrong in (np.ones(3), np.ones((2, 1)), np.ones(2, int), [1.0, 1.0], None):
        with pytest.raises(ValueError, match='limits'):
            core.Limits(0.01, 100.0, fits | {key: wrong})
    # Only the limits of accelerations may be missing.
    del fits[key]
    with nullcontext() if key in POSITIVE_KEYS else pytest.raises(ValueError, match='limits'):
        core.Limits(0.01, 100.0, fits)


def test_limits_are_for_arrays_of_one_number_for_each_joint():
    ones, lower, upper = np.ones(2), np.empty(2), np.empty(2)
    limits = core.Limits(0.01, 100.0, dict.fromkeys(LIMIT_KEYS, ones))
    fits = JointMotion(ones, ones, 0.01, (ones, ones, ones), 0.01)
    limits.box(fits, lower, upper)
    for wrong in (np.ones(3), ones.astype(int), np.ones((2, 1)), 'x', None):
        for motion in (fits._replace(positions=wrong), fits._replace(velocity=wrong),
                       fits._replace(elapsed=wrong), fits._replace(duration=wrong),
                       fits._replace(pending=wrong), fits._replace(pending=(ones, wrong)), wrong):
            with pytest.raises(ValueError, match='the motion'):
                limits.box(motion, lower, upper)
        with pytest.raises(ValueError, match='box.motion'):
            limits.box(fits, wrong, upper)
        with pytest.raises(ValueError, match='box.motion'):
            limits.box(fits, lower, wrong)
    with pytest.raises(ValueError, match='box.motion'):
        limits.box(fits, lower)


def test_limits_of_more_joints_than_fit_are_those_of_the_reference():
    many = np.ones(solver.MOST + 1)
    limits = VelocityLimits(SimpleNamespace(limits=dict.fromkeys(LIMIT_KEYS, many)), 0.01, 100.0)
    motion = JointMotion(0.0 * many, many, 0.01)
    assert np.array_equal(limits.box(motion), limits.box_by_reference(motion))


def test_all_objects_that_are_lent_are_given_back():
    hanging = [*np.ravel(np.eye(3)), *np.zeros(3)]
    base, bodies = np.zeros(0), np.array([
        [0.0, 0.0, -1.0, *np.zeros(4), *hanging, *np.zeros(4)],
        [2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, *hanging, *np.zeros(4)]])
    frames, one, two, T = np.array([[1.0, *hanging]]), np.ones(1), np.ones(2), np.eye(4)
    J, bounds, elapsed, index = np.empty((6, 1)), np.empty(2), np.pi * 1.0, 10 ** 6
    pending = two.copy(),
    moved = JointMotion(two, two, elapsed, pending, elapsed)
    values = dict.fromkeys(LIMIT_KEYS, two)
    others = moved._replace(pending=(two, one))
    objects = (base, bodies, frames, one, two, T, J, bounds, moved, values, others, *pending,
               pending, elapsed, index, core.Motion, core.Limits)

    def use():
        motion = core.Motion(1, 0, base, bodies, frames)
        limits = core.Limits(0.01, 100.0, values)
        motion.move(one, one, None)
        motion.place(0, T)
        motion.jacobian(0, J)
        limits.box(moved, bounds, bounds)
        for call in (lambda: core.Motion(1, 0, two, bodies, frames),
                     lambda: core.Motion(1, 0, base, frames, bodies),
                     lambda: core.Limits(0.01, 100.0, values | {'upper': one}),
                     lambda: motion.move(one, two, None), lambda: motion.move(one, one, T),
                     lambda: motion.place(index, T), lambda: motion.place(0, J),
                     lambda: motion.jacobian(0, T), lambda: limits.box(moved, bounds),
                     lambda: limits.box(others, bounds, bounds),
                     lambda: limits.box(moved, bounds, T)):
            with pytest.raises(ValueError):
                call()
    use()
    before = [sys.getrefcount(each) for each in objects]
    use()
    assert [sys.getrefcount(each) for each in objects] == before


@given(seed=seeds, accelerated=st.sampled_from(['all', 'some', 'none']),
       endless=st.booleans(), period=st.sampled_from([1e-3, 0.013, 0.1]),
       share=st.floats(0.05, 1.0), delay=st.integers(0, 4))
def test_limits_are_those_of_the_reference(seed, accelerated, endless, period, share, delay):
    rng, n = np.random.default_rng(seed), 20
    upper = np.where(rng.random(n) < 0.5 * endless, np.inf, rng.uniform(0.1, 3.0, n)
                     * rng.choice([0.01, 1.0], n))
    its = dict.fromkeys(LIMIT_KEYS, np.full(n, np.inf)) | {
        'lower': -upper, 'upper': upper, 'velocity': rng.uniform(0.1, 20.0, n),
        'acceleration': {'all': rng.uniform(0.1, 20.0, n), 'none': np.full(n, np.inf),
                         'some': np.where(np.arange(n) % 2, 2.0, np.inf)}[accelerated]}
    limits = VelocityLimits(SimpleNamespace(limits=its), period, share / period)
    assert limits.compiled is not None
    wide = np.minimum(upper, 100.0)
    q = np.where(rng.random(n) < 0.3, wide + rng.normal(size=n) * 1e-3,
                 rng.uniform(-1.3, 1.3, n) * wide)
    q[0] *= rng.choice([1.0, 1e7])
    previous, elapsed = rng.normal(size=n), rng.uniform(1e-4, 0.2)
    motion = JointMotion(q, previous, elapsed, tuple(rng.normal(size=(delay, n))),
                         rng.uniform(0.0, period))
    assert np.array_equal(limits.box(motion), limits.box_by_reference(motion))


@pytest.mark.parametrize('name, frames', [
    ('Panda', [robots.PANDA_TOOL]), ('floating', [robots.PANDA_TOOL]),
    ('baxter', ['left_gripper', 'right_gripper'])])
def test_a_robot_moves_as_with_pinocchio(name, frames, monkeypatch):
    its = robots.named(name)
    text = ''.join(f'- tool{number}: {{type: pose, frame: {frame}, gain: 2.0}}\n'
                   for number, frame in enumerate(frames)) + '- rest: {type: posture, gain: 0.5}'
    ends = []
    for uses in (True, False):
        if not uses:
            monkeypatch.setattr(type(its.kinematics), 'motion', lambda self: None)
        controller = Controller(its, Stack.from_yaml(text, its), Settings(period=0.01))
        q = its.neutral()
        for cycle in range(100):
            now = 0.01 * cycle
            if cycle == 5:
                for number, frame in enumerate(frames):
                    T = its.state(q).pose(frame).copy()
                    T[:3, 3] += 0.1
                    controller.set_goal(f'tool{number}', T, now)
            q = its.integrate(q, controller.update(q, now).velocity, 0.01)
        ends.append(q)
    assert np.abs(ends[0] - ends[1]).max() < 1e-9
