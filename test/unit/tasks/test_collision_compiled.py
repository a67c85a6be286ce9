# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What is compiled of the tasks of collision avoidance does what the reference does."""

import itertools

import numpy as np
import pytest
import robots
from scipy.spatial.transform import Rotation
from tp_controller.model import shapes
from tp_controller.model.clearance import Clearance
from tp_controller.model.solids import capsule, solid
from tp_controller.model.spatial import pose
from tp_controller.solver.compiled import core
from tp_controller.tasks.collision import rows_of

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')

MAKERS = {
    'panda': robots.panda, 'baxter': lambda: robots.urdf_robot('baxter'),
    'tiago': lambda: robots.urdf_robot('tiago'), 'DH arm': robots.mixed,
    **{base: lambda base=base: robots.moving_panda(base)
       for base in ('planar', 'differential', 'underwater', 'floating')},
}


def somewhere(robot, rng):
    """Return a state of a robot at random positions."""
    rows = robot.joint_columns
    return robot.state(robot.configuration(rng.uniform(
        np.maximum(robot.lower[rows], -3.0), np.minimum(robot.upper[rows], 3.0))))


def turned(rng, angle=None):
    """Return a random rotation, or one by an angle about a random axis."""
    axis = rng.normal(size=3)
    return Rotation.from_rotvec(axis if angle is None else
                                angle * axis / np.linalg.norm(axis)).as_matrix()


def compare(clearance, state, close=0.05):
    """Check the core against Coal alone; return how many pairs are near, and how many it left."""
    found, core_alone = clearance.nearest(state, close), clearance._compiled
    clearance._compiled = None
    expected = clearance.nearest(state, close)
    clearance._compiled = core_alone
    assert (found.pairs, found.corners) == (expected.pairs, expected.corners)
    for name in ('distances', 'normals', 'points'):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0.0,
                                   atol=1e-12, err_msg=name)
    left = core_alone.measure(state.motion, close)[1]
    return len(set(found.pairs)), len(left)


def some_solids(rng, frames, size):
    """Return a solid of each kind on each of some frames."""
    made = []
    for frame in frames:
        T = pose(turned(rng), rng.normal(0.0, size, 3))
        made += [capsule('line', frame, *rng.normal(0.0, size, (2, 3)), rng.uniform(0.01, 0.1)),
                 solid('ball', frame, shapes.Sphere(rng.uniform(0.01, 0.1)), T),
                 solid('box', frame, shapes.Box(*rng.uniform(0.02, 0.2, 3)), T),
                 solid('cylinder', frame, shapes.Cylinder(*rng.uniform(0.02, 0.2, 2)), T)]
    plane = solid('plane', frames[0], shapes.HalfSpace(),
                  pose(turned(rng), rng.normal(0.0, size, 3)))
    return [*made, plane]


@pytest.mark.parametrize('name', MAKERS)
@pytest.mark.parametrize('size', [0.3, 0.05])
def test_distances_are_those_of_coal(name, size):
    robot, rng, near, left = MAKERS[name](), np.random.default_rng(1), 0, 0
    for _ in range(4):
        solids = some_solids(rng, rng.choice(robot.frame_names, 4, replace=False), size)
        pairs = [*itertools.combinations(range(len(solids)), 2)]
        clearance = Clearance(robot.kinematics, solids, pairs, 0.2)
        for _ in range(4):
            counts = compare(clearance, somewhere(robot, rng))
            near, left = near + counts[0], left + counts[1]
    # The half with a box or cylinder is left to Coal where it may be near.
    assert near > 300 and left < 0.9 * near


BENT = (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-4, 1e-3, 0.01, 0.029, 0.031, 0.1, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize('bend', BENT)
@pytest.mark.parametrize('length', [0.0, 1e-9, 1e-6, 1e-4, 0.3])
def test_distances_of_special_cases_are_those_of_coal(bend, length):
    """Nearly parallel, crossing, touching, overlapping, one in the other, in line, tiny."""
    robot, rng = robots.panda(), np.random.default_rng(2)
    root, state = robot.frame_names[0], robot.state(robots.PANDA_READY)
    for _ in range(8):
        R, at = turned(rng), rng.normal(0.0, 0.3, 3)
        along = R[:, 2]
        one = capsule('one', root, at - 0.2 * along, at + 0.2 * along, 0.05)
        plane = solid('plane', root, shapes.HalfSpace(), pose(
            turned(rng, bend) @ R[:, [2, 0, 1]], at + rng.uniform(-0.2, 0.0) * R[:, 1]))
        for offset in ([0.0, 0.0, 0.0], [0.09, 0.0, 0.0], [0.1, 0.0, 0.0], [0.12, 0.0, 0.1],
                       [0.0, 0.0, 0.5], [0.0, 0.0, 0.2], [1e-4, 0.0, 0.0], [1e-7, 0.0, 0.0],
                       [0.0, 0.15, 0.45]):
            middle, way = at + R @ offset, turned(rng, bend) @ along
            other = capsule('other', root, middle - 0.5 * length * way,
                            middle + 0.5 * length * way, 0.05)
            clearance = Clearance(robot.kinematics, [one, other, plane], [(0, 1), (0, 2), (1, 2)],
                                  0.2)
            compare(clearance, state)


@pytest.mark.parametrize('apart', [0.2 - 1e-9, 0.2, 0.2 + 1e-9, 0.2 + 1e-5])
def test_pairs_at_the_edge_of_what_is_near_are_those_of_coal(apart):
    robot, state = robots.panda(), robots.panda().state(robots.PANDA_READY)
    root, T = robot.frame_names[0], np.eye(4)
    T[0, 3] = apart + 0.25
    for shape in (shapes.Sphere(0.1), shapes.Box(0.2, 0.2, 0.2), shapes.Cylinder(0.1, 0.2)):
        both = [solid('one', root, shapes.Box(0.3, 0.3, 0.3), np.eye(4)),
                solid('other', root, shape, T)]
        compare(Clearance(robot.kinematics, both, [(0, 1)], 0.2), state)


def test_what_coal_has_not_found_is_guessed_beside_what_the_core_has(monkeypatch):
    robot, state = robots.panda(), robots.panda().state(robots.PANDA_READY)
    root, made = robot.frame_names[0], []
    for x, shape in ((0.0, shapes.Sphere(0.1)), (0.3, shapes.Box(0.2, 0.2, 0.2)),
                     (-0.3, shapes.Sphere(0.1))):
        made.append(solid(f'at {x}', root, shape, pose(np.eye(3), np.array([x, 0.0, 0.0]))))
    clearance = Clearance(robot.kinematics, made, [(0, 1), (0, 2)], 0.2)
    contacts = clearance._contacts

    def lost(*arguments):
        found = contacts(*arguments)
        found.ways[0] = np.full(3, np.nan)
        return found

    monkeypatch.setattr(clearance, '_contacts', lost)
    near = clearance.nearest(state)
    assert near.pairs == [0, 1] and near.corners == [0, 0]
    np.testing.assert_allclose(near.distances, [0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(near.normals, [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], atol=1e-12)


def test_clearances_that_make_no_sense_are_refused():
    robot = robots.panda()
    motion, row = robot.state(robots.PANDA_READY).motion, [1.0, 1.0] + [0.1] * 15
    solids = np.array([row, row])
    assert core.Clearance(solids, [(0, 1)], 0.2).measure(motion, 0.0)[1:] is not None
    for wrong in ((solids[:, 1:], [(0, 1)]), (solids, [(0, 2)]), (solids, [(0, -1)]),
                  (solids, [(0, None)]), (solids, [[0, 1]]), (solids, [(0,)]),
                  (np.array([[0.5, *row[1:]]]), []), (np.array([[1.0, 3.0, *row[2:]]]), []),
                  (np.array([row, [1.0, 2.0, *row[2:]]]), [(1, 0)]), (None, [])):
        with pytest.raises(ValueError, match='solids'):
            core.Clearance(*wrong, 0.2)
    its = core.Clearance(solids, [(0, 1)], 0.2)
    found, nan = [np.ones(3)], [np.full(3, np.nan)]
    assert its.merge([0], 1, [0.5], found, found) is not None
    for wrong in (([1], 1, [0.5], found, found), ([0], 1, [1], found, found),
                  ([-1], 1, [0.5], found, found), (['x'], 1, [0.5], found, found),
                  ([0], 1, [0.5], nan, found), ([0], 1, [0.5], [None], found),
                  ([0], 1, [0.5], found, [np.ones(2)])):
        assert its.merge(*wrong) is None
    for wrong in ((), ([0], 1, [], found, found), ([0], 'x', [0.5], found, found),
                  ((0,), 1, (0.5,), found, found), ([0], -1, [0.5], found, found)):
        with pytest.raises(ValueError, match='merge'):
            its.merge(*wrong)
    far = core.Clearance(np.array([[999.0, *row[1:]]]), [], 0.2)
    for its, wrong in ((far, (motion, 0.0)), (far, ()), (far, (None, 0.0)),
                       (core.Clearance(solids, [], 0.2), (motion, 'x'))):
        with pytest.raises(ValueError, match='measure'):
            its.measure(*wrong)


@pytest.mark.parametrize('name', MAKERS)
def test_rows_of_pairs_are_those_of_the_reference(name):
    robot, rng, compared = MAKERS[name](), np.random.default_rng(0), 0
    frames = rng.choice(robot.frame_names, 6)
    solids = [capsule(f'c{index}', frame, *rng.normal(0.0, 0.3, (2, 3)), 0.1)
              for index, frame in enumerate(frames)]
    pairs = [(one, other) for other in range(6) for one in range(other)]
    clearance = Clearance(robot.kinematics, solids, pairs, 0.5)
    ids = [robot.kinematics.frame_index(frame) for frame in clearance.frames]
    ends = [(ids[one], ids[other]) for one, other in zip(clearance.first, clearance.second)]
    for _ in range(20):
        state = somewhere(robot, rng)
        near = clearance.nearest(state)
        J = np.full((len(near.pairs), robot.n), 7.0)
        assert core.parting(state.motion, ends, near.pairs, near.normals, near.points, J) is True
        np.testing.assert_allclose(J, rows_of(state, clearance, near), rtol=0.0, atol=1e-12)
        compared += len(J)
    assert compared > 50


def test_what_does_not_fit_is_left_to_the_reference():
    robot = robots.panda()
    motion, two, J = robot.state(robots.PANDA_READY).motion, np.ones((2, 3)), np.empty((2, 7))
    fits = [motion, [(0, 1), (1, 2)], [0, 1], two, two, J]
    assert core.parting(*fits) is True
    for place, wrong in ((1, [(0, 1)]), (1, [(0, 1), (1, 99)]), (1, [(0, 1), (-1, 2)]),
                         (1, [(0, 1), [1, 2]]), (1, [(0, 1), (1, None)]), (1, [(0, 1), (1,)]),
                         (2, [0]), (2, [0, -1]), (2, [0, 'x']), (2, [0, 2 ** 70]), (3, two[:1]),
                         (3, two.tolist()), (4, np.ones((2, 2))), (4, None), (5, J[:, :6]),
                         (5, None), (5, two)):
        given = [*fits]
        given[place] = wrong
        assert core.parting(*given) is False, (place, wrong)
    for place, wrong in ((0, None), (1, ()), (2, (0, 1))):
        given = [*fits]
        given[place] = wrong
        with pytest.raises(ValueError, match='parting'):
            core.parting(*given)
    with pytest.raises(ValueError, match='parting'):
        core.parting(*fits[1:])
