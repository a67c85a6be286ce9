# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Links that keep apart and away from obstacles: distances, their derivatives, whole motions."""

import functools
import itertools
import math

import numpy as np
import pinocchio
import pytest
import robots
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation
from tp_controller import (
    Controller,
    GoalError,
    Robot,
    Settings,
    Stack,
    StackError,
    TaskError,
)
from tp_controller.model import shapes
from tp_controller.model import solids as geometry
from tp_controller.model.clearance import Clearance, PATCH_TOLERANCE
from tp_controller.model.spatial import pose
from tp_controller.model.urdf_solids import urdf_solids
from tp_controller.tasks import task_types
from tp_controller.tasks.collision import CORNER_MARGIN
from tp_controller.tasks.obstacles import MOST_OBSTACLES
from tp_controller.tasks.sketch import Gaps

TOOL = robots.PANDA_TOOL
TYPES = ('self_collision', 'obstacles')
CAPSULES = str(robots.CONFIG / 'panda_capsules.yaml')
ARM = ['panda_link4', 'panda_link5', 'panda_link6', 'panda_link7', 'panda_hand']
BALL = {'shape': {'sphere': 0.1}, 'at': [0.0, 0.0, 0.0]}
TABLE = {'shape': {'box': [1.0, 1.0, 0.2]}, 'at': [0.5, 0.0, 0.2]}
# An arm of two joints that turn about z, each with a box of its own kind.
ARM_URDF = """
<robot name="arm">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="upper"><collision><origin xyz="0.5 0 0"/><geometry>{upper}</geometry></collision>
  </link>
  <link name="plate"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="lower"><collision><origin xyz="0.5 0 0" rpy="0 1.5707963267948966 0"/>
    <geometry>{lower}</geometry></collision></link>
  <link name="tip"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="screws" type="fixed"><parent link="upper"/><child link="plate"/>
    <origin xyz="0.8 0 0"/></joint>
  <joint name="elbow" type="revolute"><parent link="plate"/><child link="lower"/>
    <origin xyz="0.2 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="wrist" type="revolute"><parent link="lower"/><child link="tip"/>
    <origin xyz="1 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>"""


def make(name, robot=None, **keys):
    """Return a task of a type, of the Panda with its capsules where there is no robot."""
    if robot is None:
        robot, keys = robots.panda(), {'capsules': CAPSULES, **keys}
    return task_types()[name](robot, 'task', **keys)


def faults(name, robot=None, **keys):
    """Return {key: message} of what is wrong with the keys of a task."""
    with pytest.raises(TaskError) as caught:
        make(name, robot, **keys)
    return dict(caught.value.faults)


def arm(upper='<box size="1 0.1 0.1"/>', lower='<cylinder radius="0.05" length="0.8"/>', **keys):
    """Return an arm of three joints whose links have the given shapes."""
    return Robot.from_urdf(ARM_URDF.format(upper=upper, lower=lower), **keys)


@functools.lru_cache(maxsize=None)
def with_meshes(name, joints=None):
    """Return a robot of example-robot-data, its meshes named by their paths."""
    path = robots.urdf_path(name)
    share = next(str(each) for each in path.parents if each.name == 'example-robot-data')
    text = path.read_text(encoding='utf-8').replace('package://example-robot-data', share)
    return Robot.from_urdf(text, joints=joints)


def srdf(name):
    """Return the SRDF of a robot of example-robot-data."""
    path = {'panda': 'panda.srdf', 'ur5': 'ur5.srdf', 'baxter': 'baxter_manipulation.srdf'}[name]
    return str(robots.urdf_path(name).parents[1] / 'srdf' / path)


def inside(robot, rng):
    """Return random positions (n,) within the limits."""
    return rng.uniform(np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0))


def rows(task, state):
    """Return {name: (distance, row of the Jacobian)} of the nearest points of pairs."""
    seen = task.observe_rows(state)
    return {name: (value, row) for (name, corner), value, row in zip(seen.keys, seen.value, seen.J)
            if not corner}


def row_names(task):
    """Return what the rows of a task are about at the ready posture of the Panda."""
    return task.evaluate(task.robot.state(robots.PANDA_READY), 0.0).row_names


# Distances of two solids

def hull(rng):
    """Return the convex hull of random points, by way of a mesh."""
    points = rng.normal(size=(30, 3)) * 0.1
    mesh = geometry.coal.BVHModelOBBRSS()
    mesh.beginModel(0, len(points))
    mesh.addVertices(points)
    mesh.endModel()
    mesh.buildConvexHull(True, 'Qt')
    return geometry.Solid('hull', 'hull', np.eye(4), mesh.convex)


def solids(frame):
    """Return a solid of each kind on a frame, some way off its origin."""
    place = pose(Rotation.from_rotvec([0.3, -0.4, 0.2]).as_matrix(), [0.02, -0.03, 0.04])
    made = {name: geometry.solid(name, frame, shape, place) for name, shape in (
        ('sphere', shapes.Sphere(0.1)), ('box', shapes.Box(0.2, 0.3, 0.1)),
        ('cylinder', shapes.Cylinder(0.08, 0.3)), ('half_space', shapes.HalfSpace()))}
    made['capsule'] = geometry.capsule('capsule', frame, np.array([0.02, 0.01, -0.15]),
                                       np.array([0.0, 0.1, 0.2]), 0.05)
    made['hull'] = hull(np.random.default_rng(5))
    made['hull'].frame = frame
    return made


PAIRS = [(one, other) for one in solids('a') for other in solids('b') if one != 'half_space']


class Loose:
    """Two frames a and b that no joint connects, and their poses: a robot and its state."""

    motion = None

    def frame_index(self, frame):
        """Return the index of a frame."""
        return 'ab'.index(frame)

    def attachment(self, frame):
        """Return the joint that moves a frame, and where on it the frame is."""
        return 'ab'.index(frame), pinocchio.SE3.Identity()

    def at(self, poses):
        """Return itself, with the frames at poses (2, 4, 4)."""
        self.poses = poses
        return self

    def place(self, model, data):
        """Place the objects of a geometry model."""
        for index, each in enumerate(model.geometryObjects):
            data.oMg[index] = pinocchio.SE3(self.poses[each.parentJoint]) * each.placement


class Pair:
    """The clearance of two solids on the frames a and b."""

    def __init__(self, one, other):
        self.frames = Loose()
        self.solids = one, other
        self.clearance = Clearance(self.frames, self.solids, [(0, 1)], 9.0)

    def nearest(self, poses, close=-math.inf):
        """Return their distance where the frames are at poses (2, 4, 4)."""
        return self.clearance.nearest(self.frames.at(poses), close)


def clearance(one, other):
    """Return the clearance of two kinds of solids on the frames a and b."""
    return Pair(solids('a')[one], solids('b')[other])


def random_poses(rng, size):
    """Return the poses (2, 4, 4) of the frames a and b."""
    return np.array([pose(Rotation.from_rotvec(rng.normal(size=3)).as_matrix(),
                          rng.uniform(-size, size, 3)) for _ in range(2)])


@pytest.mark.parametrize('one, other', PAIRS)
@pytest.mark.parametrize('size', [0.3, 0.06])
def test_distance_changes_as_normal_and_point_say(one, other, size):
    rng, pair, h, wrong = np.random.default_rng(1), clearance(one, other), 1e-5, ([], [])
    for _ in range(40):
        poses = random_poses(rng, size)
        near = pair.nearest(poses)
        for body in (0, 1):
            twist = rng.normal(size=6)
            ends = []
            for step in (h, -h):
                moved = poses.copy()
                moved[body] = pose(
                    Rotation.from_rotvec(step * twist[3:]).as_matrix() @ poses[body, :3, :3],
                    poses[body, :3, 3] + step * twist[:3])
                ends.append(pair.nearest(moved).distances[0])
            at_point = twist[:3] + np.cross(twist[3:], near.points[0] - poses[body, :3, 3])
            speed = (1.0, -1.0)[body] * near.normals[0] @ at_point
            wrong[int(near.distances[0] < 0.0)].append(
                abs((ends[0] - ends[1]) / (2 * h) - speed))
    apart, overlapping = wrong
    if size > 0.1:
        assert len(apart) > 10 and np.quantile(apart, 0.9) < 5e-4
    else:
        # What overlaps is known to 1e-6 m only where there is a cylinder.
        assert len(overlapping) > 10 and np.quantile(overlapping, 0.9) < (
            0.05 if 'cylinder' in (one, other) else 1e-4)


def spread(solid_, T):
    """Return centre, axes and radius of what is all points near a box, a line or a point."""
    T = T @ solid_.pose
    kind = solid_.geometry
    if solid_.name == 'box':
        return T[:3, 3], T[:3, :3] * kind.halfSide, 0.0
    if solid_.name == 'capsule':
        return T[:3, 3], T[:3, 2:3] * kind.halfLength, kind.radius
    return T[:3, 3], np.zeros((3, 1)), kind.radius


@pytest.mark.slow
@pytest.mark.parametrize('one', ['sphere', 'box', 'capsule'])
@pytest.mark.parametrize('other', ['sphere', 'box', 'capsule'])
def test_distance_is_that_of_bounded_least_squares(one, other):
    rng, pair, compared = np.random.default_rng(2), clearance(one, other), 0
    for _ in range(40):
        poses = random_poses(rng, 0.4)
        (c, A, r), (d, B, s) = (spread(solid_, T) for solid_, T in zip(
            (solids('a')[one], solids('b')[other]), poses))
        best = lsq_linear(np.hstack([A, -B]), d - c, (-1.0, 1.0), tol=1e-14)
        apart = math.sqrt(2.0 * best.cost)
        if apart > 0.01:
            compared += 1
            assert pair.nearest(poses).distances[0] == pytest.approx(apart - r - s, abs=1e-6)
    assert compared > 20


@pytest.mark.parametrize('other', ['box', 'cylinder', 'half_space', 'sphere'])
def test_distance_of_a_ball_is_that_of_its_centre(other):
    rng, pair = np.random.default_rng(3), clearance('sphere', other)
    shape = {'box': shapes.Box(0.2, 0.3, 0.1), 'cylinder': shapes.Cylinder(0.08, 0.3),
             'half_space': shapes.HalfSpace(), 'sphere': shapes.Sphere(0.1)}[other]
    ball, body = solids('a')['sphere'], solids('b')[other]
    for _ in range(40):
        poses = random_poses(rng, 0.3)
        centre, T = (poses[0] @ ball.pose)[:3, 3], poses[1] @ body.pose
        distance, gradient = shape.distance(T[:3, :3].T @ (centre - T[:3, 3]))
        near = pair.nearest(poses)
        assert near.distances[0] == pytest.approx(distance - 0.1, abs=2e-6)
        if distance > 1e-3:
            np.testing.assert_allclose(near.normals[0], T[:3, :3] @ gradient, atol=1e-4)


@pytest.mark.parametrize('one, other', [pair for pair in PAIRS if 'sphere' not in pair])
def test_overlap_is_the_shortest_way_apart(one, other):
    rng, pair, tried = np.random.default_rng(4), clearance(one, other), 0
    for _ in range(30):
        poses = random_poses(rng, 0.05)
        near = pair.nearest(poses)
        depth = -near.distances[0]
        if depth < 0.01:
            continue
        tried += 1

        def moved(way):
            apart = poses.copy()
            apart[0, :3, 3] += way
            return pair.nearest(apart).distances[0]

        assert moved(depth * near.normals[0]) == pytest.approx(0.0, abs=1e-5)
        for way in rng.normal(size=(5, 3)):
            assert moved(0.95 * depth * way / np.linalg.norm(way)) < 0.0
    assert tried > 10


class Lost:
    """What Coal finds where its iteration has no end."""

    penetration_depth = -math.inf
    normal = pos = np.full(3, math.nan)

    def isCollision(self):  # noqa: N802
        """Say that the pair is near."""
        return True

    def getContact(self, index):  # noqa: N802
        """Return where."""
        return self


def test_what_cannot_be_measured_counts_as_touching():
    poses = np.array([pose(np.eye(3), [0.0, 0.0, height]) for height in (0.1, 0.0)])
    for other, normal in (('cylinder', [0.0, 0.0, 1.0]),
                          ('half_space', solids('b')['half_space'].pose[:3, 2])):
        pair = clearance('box', other)
        pair.clearance._batches[0]._results = [Lost()]
        near = pair.nearest(poses)
        assert near.distances[0] == 0.0 and np.isfinite(near.points).all()
        np.testing.assert_allclose(near.normals[0], normal, atol=1e-12)


FACING = {'half-space': shapes.HalfSpace(), 'box': shapes.Box(2.0, 2.0, 0.2),
          'cylinder': shapes.Cylinder(1.0, 0.2)}


def lying(shape, other, turn=(0.0, 0.0, 0.0), height=0.06, upside_down=False, swapped=False):
    """Return the distances of a shape whose middle is above the plane z = 0 of another one."""
    shift = 0.0 if isinstance(other, shapes.HalfSpace) else -0.1
    over = geometry.solid('shape', 'a', shape, pose(np.diag([1.0, -1.0, -1.0]) if upside_down
                                                    else np.eye(3), np.zeros(3)))
    below = geometry.solid('other', 'b', other, pose(np.eye(3), [0.0, 0.0, shift]))
    poses = np.array([pose(Rotation.from_rotvec(turn).as_matrix(), [0.0, 0.0, height]), np.eye(4)])
    if swapped:
        over.frame, below.frame, poses = 'b', 'a', poses[::-1]
        return Pair(below, over).nearest(poses, 1.0)
    return Pair(over, below).nearest(poses, 1.0)


def outline(near):
    """Return the corners, as seen from above, as a set."""
    return {tuple(np.round(point[:2], 5) + 0.0) for point in near.points[1:]}


@pytest.mark.parametrize('other', FACING)
@pytest.mark.parametrize('yaw', [0.0, 0.4])
def test_flat_sides_touch_with_every_corner(other, yaw):
    near = lying(shapes.Box(0.4, 0.2, 0.1), FACING[other], (0.0, 0.0, yaw))
    assert near.pairs == [0] * 5 and near.corners == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(near.distances, 0.01, atol=1e-8)
    np.testing.assert_allclose(near.normals, [[0.0, 0.0, 1.0]] * 5, atol=1e-6)
    R = Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix()
    assert outline(near) == {tuple(np.round(R @ [x, y, 0.0], 5)[:2])
                             for x in (-0.2, 0.2) for y in (-0.1, 0.1)}


@pytest.mark.parametrize('other', FACING)
@pytest.mark.parametrize('upside_down', [False, True])
@pytest.mark.parametrize('swapped', [False, True])
def test_end_of_a_cylinder_touches_all_round(other, upside_down, swapped):
    if swapped and other == 'half-space':
        pytest.skip('only the second may be a half-space')
    near = lying(shapes.Cylinder(0.2, 0.1), FACING[other], upside_down=upside_down,
                 swapped=swapped)
    np.testing.assert_allclose(np.linalg.norm(near.points[1:, :2], axis=1), 0.2, atol=1e-6)
    assert len(near.points) > 6
    assert near.points[1:, 0].min() < -0.15 and near.points[1:, 0].max() > 0.15


def test_corners_outside_of_what_they_face_are_none():
    near = lying(shapes.Box(0.4, 0.2, 0.1), shapes.Box(0.3, 2.0, 0.2))
    assert outline(near) == {(x, y) for x in (-0.15, 0.15) for y in (-0.1, 0.1)}


@pytest.mark.parametrize('other', FACING)
def test_edge_touches_with_both_ends(other):
    for shape, turn in ((shapes.Box(0.4, 0.2, 0.1), (0.5, 0.0, 0.0)),
                        (shapes.Cylinder(0.05, 0.4), (0.0, math.pi / 2, 0.0))):
        near = lying(shape, FACING[other], turn, 0.2)
        assert near.corners == [0, 1, 2]
        assert sorted(np.round(near.points[1:, 0], 5)) == [-0.2, 0.2]


@pytest.mark.parametrize('share, count', [(0.9, 4), (1.1, 2)])
def test_side_is_flat_up_to_a_height_of_its_far_end(share, count):
    angle = math.asin(share * PATCH_TOLERANCE / 0.4)
    near = lying(shapes.Box(0.4, 0.2, 0.1), shapes.HalfSpace(), (0.0, angle, 0.0))
    assert near.corners == list(range(1 + count))


def test_corners_are_given_of_close_pairs_only():
    box, floor = (geometry.solid(name, frame, shape, np.eye(4)) for name, frame, shape in (
        ('box', 'a', shapes.Box(0.4, 0.2, 0.1)), ('floor', 'b', shapes.HalfSpace())))
    poses = np.array([pose(np.eye(3), [0.0, 0.0, 0.06]), np.eye(4)])
    for close, corners in ((0.009, [0]), (0.011, [0, 1, 2, 3, 4])):
        assert Pair(box, floor).nearest(poses, close).corners == corners


# Rows

CASES = {
    'panda capsules': (robots.panda, {'capsules': CAPSULES}),
    'panda': (lambda: with_meshes('panda'), {}),
    'ur5': (lambda: with_meshes('ur5'), {}),
    'mimic fingers': (lambda: with_meshes('panda'), {'links': ['panda_rightfinger', 'panda_link2',
                                                               'panda_link5']}),
}
WORLD = {'table': {'shape': {'box': [0.5, 0.6, 0.2]}, 'at': [0.5, 0.1, 0.2]},
         'pole': {'shape': {'cylinder': [0.1, 1.5]}, 'at': [-0.3, 0.4, 0.4, 0.1, 0.2, 0.3, 0.927]},
         'ball': {'shape': {'sphere': 0.2}, 'at': [0.3, -0.4, 0.5]},
         'wall': {'shape': 'half_space', 'at': [-0.2, 0.0, 0.0, 0.0, 0.7071068, 0.0, 0.7071068]}}


@pytest.mark.parametrize('name', ['self_collision', 'obstacles'])
@pytest.mark.parametrize('case', CASES)
@pytest.mark.parametrize('reference', [None, 'moving'])
def test_jacobian_is_the_derivative_of_the_distances(name, case, reference):
    robot, keys = CASES[case][0](), dict(CASES[case][1])
    if name == 'obstacles':
        keys['obstacles'] = WORLD
        if reference:
            keys['reference'] = robot.frame_names[3]
    elif reference:
        pytest.skip('has no reference')
    task = make(name, robot, within=0.3, **keys)
    rng, h, wrong = np.random.default_rng(1), 1e-6, []
    for _ in range(10):
        q, way = inside(robot, rng), rng.normal(size=robot.n)
        now, after, before = (rows(task, robot.state(q + step * way)) for step in (0.0, h, -h))
        for pair in set(now) & set(after) & set(before):
            speed = (after[pair][0] - before[pair][0]) / (2 * h)
            wrong.append(abs(speed - now[pair][1] @ way))
    assert len(wrong) > 20
    assert np.median(wrong) < 1e-5 and np.quantile(wrong, 0.9) < 2e-3


@pytest.mark.parametrize('size', [1, 3])
def test_distances_do_not_depend_on_how_many_pairs_are_checked_at_once(size, monkeypatch):
    # With a cylinder and a half-space, as both have a case of their own.
    around = {'table': TABLE, 'floor': {'shape': 'half_space'}, 'pole': {
        'shape': {'cylinder': [0.1, 0.4]}, 'at': [0.4, 0.1, 0.4]}}
    moved = {'pole': {**around['pole'], 'at': [0.4, -0.1, 0.4]}}

    def found():
        tasks = [make('self_collision', distance=0.1),
                 make('self_collision', arm(), distance=0.1),
                 make('obstacles', obstacles=around, distance=0.1)]
        tasks[-1].set_goal(tasks[-1].parse_goal(moved), 0.0)
        rng = np.random.default_rng(7)
        return [len(task._clearance._batches) for task in tasks], [
            task.observe_rows(task.robot.state(inside(task.robot, rng)))
            for task in tasks for _ in range(20)]

    batches, at_once = found()
    monkeypatch.setattr('tp_controller.model.clearance.PAIRS_PER_BATCH', size)
    more, in_parts = found()
    assert batches == [1, 1, 1] and min(more) > 1
    assert sum(len(seen.value) for seen in at_once) > 300
    for one, other in zip(at_once, in_parts):
        assert one.keys == other.keys
        assert np.allclose(one.value, other.value, atol=1e-12)
        assert np.allclose(one.J, other.J, atol=1e-9)


@pytest.mark.slow
def test_obstacles_that_change_give_what_new_ones_do_and_leave_the_others_alone(monkeypatch):
    monkeypatch.setattr('tp_controller.model.clearance.PAIRS_PER_BATCH', 4)
    task, rng = make('obstacles', arm(), distance=0.1), np.random.default_rng(5)
    there, kept = {}, 0
    for step in range(60):
        name, before = f'o{rng.integers(12)}', list(task._clearance._batches)
        # A new one, one that moves, that changes its shape, or goes.
        kind = rng.choice(['sphere', 'same', 'none'])
        at = rng.uniform(-0.6, 0.6, 3).tolist()
        if kind == 'none':
            there.pop(name, None)
        else:
            shape = there[name]['shape'] if kind == 'same' and name in there else {
                'sphere': float(rng.uniform(0.05, 0.2))}
            there[name] = {'shape': shape, 'at': at}
        task.set_goal(task.parse_goal({name: there.get(name)}), 0.1 * step)
        after = task._clearance._batches
        kept += sum(one is other for one, other in zip(before, after))
        assert sum(one is not other for one, other in zip(before, after)) <= 4
        new = make('obstacles', arm(), distance=0.1, obstacles=there)
        for _ in range(3):
            state = task.robot.state(inside(task.robot, rng))
            one, other = (each.observe_rows(state) for each in (task, new))
            assert sorted(one.keys) == sorted(other.keys)
            rows = [other.keys.index(key) for key in one.keys]
            assert np.allclose(one.value, other.value[rows], atol=1e-12)
            assert np.allclose(one.J, other.J[rows], atol=1e-9)
    assert kept > 200


# Capsules are parallel by chance only.
@pytest.mark.parametrize('case', ['panda', 'ur5', 'mimic fingers'])
def test_row_of_a_corner_is_how_fast_both_links_part_there(case):
    robot = CASES[case][0]()
    task = make('self_collision', robot, distance=0.1, **CASES[case][1])
    rng, h, compared = np.random.default_rng(3), 1e-6, 0
    for _ in range(30):
        q, way = inside(robot, rng), rng.normal(size=robot.n)
        now, after, before = (robot.state(q + step * way) for step in (0.0, h, -h))
        near = task._clearance.nearest(now, 0.1 + CORNER_MARGIN)
        _, J = task.observe(now)
        for row in np.flatnonzero(near.corners):
            speeds = []
            pair = near.pairs[row]
            for index in (task._clearance.first[pair], task._clearance.second[pair]):
                link = task._clearance.frames[index]
                local = np.linalg.solve(now.pose(link), [*near.points[row], 1.0])
                speeds.append((after.pose(link) - before.pose(link)) @ local / (2 * h))
            compared += 1
            parting = near.normals[row] @ (speeds[0] - speeds[1])[:3]
            assert J[row] @ way == pytest.approx(parting, abs=1e-6)
    assert compared > 5


@pytest.mark.parametrize('name', ['self_collision', 'obstacles'])
def test_no_near_pair_is_missed(name):
    robot, rng = with_meshes('panda'), np.random.default_rng(2)
    keys = {'obstacles': WORLD} if name == 'obstacles' else {}
    task, all_of_it = (make(name, robot, within=within, **keys) for within in (0.2, 99.0))
    for _ in range(20):
        state = robot.state(inside(robot, rng))
        whole = rows(all_of_it, state)
        near = rows(task, state)
        assert set(near) == {pair for pair, (value, _) in whole.items() if value < 0.2}
        for pair, (value, J) in near.items():
            assert value == whole[pair][0]
            np.testing.assert_array_equal(J, whole[pair][1])


def test_no_near_pair_makes_a_level_without_rows():
    robot = robots.panda()
    stack = Stack.from_yaml(f"""
    - clear: {{type: obstacles, capsules: {CAPSULES}, links: [panda_hand]}}
    - [also: {{type: obstacles, capsules: {CAPSULES}, links: [panda_hand]}},
       low: {{type: keep_in, frame: {TOOL}, shape: {{sphere: 2.0}}}}]
    - tool: {{type: position, frame: {TOOL}}}
    """, robot)
    controller = Controller(robot, stack)
    controller.set_goal('tool', [0.9, 0.0, 0.9], 0.0)
    command = controller.update(robots.PANDA_READY, 0.0)
    clear = command.report.tasks[0]
    assert stack.tasks['clear'].error(robot.state(robots.PANDA_READY)).shape == (0,)
    assert clear.errors == ((0.0, 'm', 1e-3),) and clear.reached and not clear.reason
    assert np.abs(command.velocity).max() > 0.1


def test_rows_are_named_by_what_they_are_about():
    task = make('obstacles', obstacles={'table': TABLE}, links=['panda_link7', 'panda_hand'])
    assert set(row_names(task)) <= {'panda_link7 – table', 'panda_hand[1] – table',
                                    'panda_hand[2] – table'}
    task = make('self_collision')
    assert 'panda_link0 – panda_hand[2]' in task.pairs


def test_error_is_how_much_is_missing_to_the_distance():
    robot = arm()
    task = make('obstacles', robot, links='tip', distance=0.1,
                obstacles={'ball': {'shape': {'sphere': 0.5}, 'at': [2.6, 0.0, 0.0]}})
    state = robot.state(np.zeros(3))
    # The tip is a ball of 0.05 m at 2 m: 0.05 m apart.
    np.testing.assert_allclose(task.error(state), [0.05], atol=1e-9)
    evaluation = task.evaluate(state, 0.0)
    assert task.reported_errors(evaluation.error, None) == ((pytest.approx(0.05), 'm', 1e-3),)
    assert evaluation.level.upper.tolist() == [math.inf]


def test_what_no_joint_can_change_is_reported_but_not_demanded():
    robot = arm(upper='<sphere radius="0.1"/>')
    floor = {'floor': {'shape': 'half_space', 'at': [0.0, 0.0, -0.09]}}
    task = make('obstacles', robot, obstacles=floor, links=['upper'])
    evaluation = task.evaluate(robot.state(np.zeros(3)), 0.0)
    assert evaluation.level.lower < -1e6
    assert evaluation.error == pytest.approx([0.03])


def test_way_back_is_never_faster_than_the_return_speed():
    task = make('obstacles', obstacles={'table': TABLE}, return_speed=0.05, links=ARM)
    state = task.robot.state(robots.PANDA_READY)
    task.set_goal(task.parse_goal({'table': {**TABLE, 'at': [0.4, 0.0, 0.5]}}), 0.0)
    values, _ = task.observe(state)
    assert values.min() < -0.1
    level = task.level(state, 0.0)
    np.testing.assert_allclose(level.lower, np.minimum(10.0 * (0.02 - values), 0.05))


def test_jump_of_the_nearest_points_is_not_taken_for_a_curve():
    robot = arm(upper='<box size="1 0.1 0.1"/>')
    task = make('obstacles', robot, links='upper', distance=0.0,
                obstacles={'wall': {'shape': 'half_space', 'at': [0.0, 0.2, 0.0, 0.7071068, 0.0,
                                                                  0.0, 0.7071068]}})

    cycle = itertools.count()

    def level(angle):
        state = robot.state([angle, 0.0, 0.0])
        state.velocity = np.array([1.0, 0.0, 0.0])
        return task.level(state, next(cycle)), 10.0 * -task.observe(state)[0]

    # Against a wall at y > 0.2 the box touches with one end, then with the other.
    before, _ = level(-0.01)
    after, free = level(0.01)
    assert abs(before.J[0, 0] - after.J[0, 0]) > 0.5
    np.testing.assert_array_equal(after.lower, free)
    # Turning on, this end goes along a circle, which leads it to the wall.
    later, free = level(0.02)
    curved = 0.5 * (later.J - after.J)[0, 0]
    assert curved != 0.0
    np.testing.assert_allclose(later.lower, free - min(curved, 0.0))
    task.reset()
    level(0.02)
    back, free = level(0.01)
    np.testing.assert_allclose(back.lower, free - min(0.5 * (back.J - later.J)[0, 0], 0.0))
    assert (back.lower != free) != (later.lower != 10.0 * -task.observe(
        robot.state([0.02, 0.0, 0.0]))[0])


# Which pairs

def pairs_of(task):
    """Return the pairs of links of a task."""
    return {tuple(part.partition('[')[0] for part in pair.split(' – ')) for pair in task.pairs}


def test_links_with_no_more_than_one_moving_joint_in_between_are_left_alone():
    assert pairs_of(make('self_collision', arm())) == {
        ('base', 'lower'), ('base', 'tip'), ('upper', 'tip'), ('plate', 'tip')}


def test_what_no_driven_joint_moves_apart_is_left_alone():
    task = make('self_collision', arm(joints=['wrist']))
    assert pairs_of(task) == {('base', 'tip'), ('upper', 'tip'), ('plate', 'tip')}


def test_shapes_that_overlap_by_design_are_left_out_and_named():
    task = make('self_collision')
    assert task.left_out == ['panda_link5 – panda_link7']
    assert not set(task.left_out) & set(task.pairs)
    assert task.remarks == ('not kept apart, as nearer than distance = 0.02 in most postures: '
                            'panda_link5 – panda_link7',)
    near = make('self_collision', distance=0.0, within=0.2)
    assert not near.left_out or near.left_out == task.left_out


def test_task_that_would_watch_nothing_is_refused():
    assert faults('self_collision', links='panda_hand')['links'].startswith(
        'no two of them can come near each other, or all pairs are ignored')
    assert faults('self_collision', links='panda_hand')['links'].endswith('got panda_hand')
    message = faults('self_collision', links=['panda_link5', 'panda_link7'])['links']
    assert message == ('all pairs are nearer than distance = 0.02 in most postures: '
                       'panda_link5 – panda_link7')


def test_half_space_is_the_floor_where_it_has_no_place():
    task = make('obstacles', obstacles={'floor': {'shape': 'half_space'}})
    np.testing.assert_array_equal(task.obstacles['floor'].pose, np.eye(4))


@pytest.mark.slow
def test_file_that_is_no_text_or_no_yaml_is_named(tmp_path):
    file = tmp_path / 'shapes.yaml'
    file.write_bytes(b'\xff\xfe')
    assert faults('self_collision', capsules=str(file))['capsules'] == (
        f'{file} is not text in UTF-8')
    assert f'{file} is not text in UTF-8' in faults('self_collision', srdf=str(file))['srdf']
    file.write_text('panda_hand: {from: [')
    assert faults('self_collision', capsules=str(file))['capsules'].startswith(f'{file}: ')


def test_pairs_that_an_srdf_or_ignore_names_are_left_alone():
    robot = with_meshes('panda')
    everything, allowed = make('self_collision', robot), make('self_collision', robot,
                                                              srdf=srdf('panda'))
    gone = pairs_of(everything) - pairs_of(allowed)
    assert ('panda_link5', 'panda_link7') in gone and ('panda_link0', 'panda_hand') not in gone
    text = '<robot name="arm"><disable_collisions link1="tip" link2="base"/></robot>'
    assert ('base', 'tip') not in pairs_of(make('self_collision', arm(), srdf=text))
    assert ('base', 'tip') not in pairs_of(make('self_collision', arm(),
                                                ignore=[['base', 'tip']]))


def test_links_limits_what_a_task_is_about():
    assert pairs_of(make('self_collision', arm(), links=['base', 'tip'])) == {('base', 'tip')}
    task = make('obstacles', links='panda_hand', obstacles={'table': TABLE})
    assert all(name.startswith('panda_hand') for name in row_names(task))


def test_links_that_do_not_move_need_no_distance_from_the_world():
    task = make('obstacles', obstacles={'table': {**TABLE, 'at': [0.0, 0.0, 0.0]}}, within=9.0)
    assert not any(name.startswith('panda_link0') for name in row_names(task))
    assert any(name.startswith('panda_link1') for name in row_names(task))


def test_base_that_moves_is_kept_away_from_the_world():
    robot = arm(base='planar')
    task = make('obstacles', robot, links='base', within=9.0,
                obstacles={'ball': {**BALL, 'at': [1.0, 0.0, 0.0]}})
    (name, (distance, row)), = rows(task, robot.state(robot.neutral())).items()
    assert name == 'base – ball' and distance == pytest.approx(0.8)
    np.testing.assert_allclose(row, [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-6)


# Shapes of the robot

@pytest.mark.parametrize('text, reach', [
    ('<box size="1 0.1 0.1"/>', 0.5), ('<sphere radius="0.3"/>', 0.3),
    ('<cylinder radius="0.1" length="0.6"/>', 0.1), ('<capsule radius="0.1" length="0.6"/>', 0.1)])
def test_shapes_of_the_urdf_have_their_sizes(text, reach):
    task = make('obstacles', arm(upper=text), links='upper', within=9.0, obstacles={
        'wall': {'shape': 'half_space', 'at': [-1.0, 0, 0, 0, 0.7071067811865476, 0,
                                               0.7071067811865476]}})
    (name, (distance, _)), = rows(task, task.robot.state(np.zeros(3))).items()
    assert name == 'upper – wall'
    # The middle of the shape is at x = 0.5, the wall at x < -1.
    assert distance == pytest.approx(1.5 - reach, abs=1e-6)


def write_mesh(path):
    """Write a tetrahedron with a corner at x = 2 and the others at x = 1."""
    corners = [[2.0, 0.0, 0.0], [1.0, 0.1, 0.0], [1.0, -0.1, 0.1], [1.0, -0.1, -0.1]]
    faces = [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]
    lines = [f'v {x} {y} {z}' for x, y, z in corners]
    lines += [f'f {a + 1} {b + 1} {c + 1}' for a, b, c in faces]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')


@pytest.mark.parametrize('prefix', ['', 'file://'])
def test_mesh_counts_as_its_convex_hull_with_its_scale(tmp_path, prefix):
    write_mesh(tmp_path / 'tetra.obj')
    robot = arm(upper=f'<mesh filename="{prefix}{tmp_path}/tetra.obj" scale="0.5 1 1"/>')
    task = make('obstacles', robot, links='upper', within=9.0, obstacles={
        'ball': {'shape': {'sphere': 0.1}, 'at': [3.0, 0.0, 0.0]}})
    (_, (distance, _)), = rows(task, robot.state(np.zeros(3))).items()
    assert distance == pytest.approx(3.0 - 0.1 - (0.5 + 1.0), abs=1e-6)


def test_mesh_of_a_package_is_found_through_the_ament_index(monkeypatch):
    pytest.importorskip('ament_index_python')
    share = next(each for each in robots.urdf_path('ur5').parents if each.name == 'share')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(share.parent))
    assert len(make('self_collision', robots.urdf_robot('ur5')).pairs) > 10


def test_missing_and_broken_meshes_are_all_named(tmp_path):
    (tmp_path / 'broken.stl').write_text('no mesh', encoding='utf-8')
    robot = arm(upper='<mesh filename="package://nowhere/upper.stl"/>',
                lower=f'<mesh filename="{tmp_path}/broken.stl"/>')
    message = faults('self_collision', robot)['links']
    assert "upper: package 'nowhere' is not found" in message
    assert 'lower: ' in message and 'broken.stl' in message
    assert 'Give capsules for these links, or name the others in links' in message
    capsule = {'from': [0, 0, 0], 'to': [1, 0, 0], 'radius': 0.1}
    assert make('self_collision', robot, capsules={'upper': capsule, 'lower': capsule}).pairs
    assert make('self_collision', robot, links=['base', 'tip']).pairs


def test_capsules_of_the_panda_hold_its_meshes():
    robot = with_meshes('panda')
    capsules = {}
    for each in make('self_collision')._solids:
        capsules.setdefault(each.frame, []).append(each)
    for link in capsules:
        mesh, = urdf_solids(robot.urdf, [link])
        corners = mesh.geometry.points() @ mesh.pose[:3, :3].T + mesh.pose[:3, 3]
        depths = []
        for each in capsules[link]:
            local = (corners - each.pose[:3, 3]) @ each.pose[:3, :3]
            local[:, 2] -= np.clip(local[:, 2], -each.geometry.halfLength,
                                   each.geometry.halfLength)
            depths.append(np.linalg.norm(local, axis=1) - each.geometry.radius)
        assert np.min(depths, axis=0).max() < 0.0, link


def test_capsule_goes_from_one_point_to_the_other():
    rng = np.random.default_rng(0)
    for _ in range(20):
        start, end = rng.normal(size=(2, 3))
        made = geometry.capsule('it', 'link', start, end, 0.1)
        half = made.geometry.halfLength * made.pose[:3, 2]
        found = {tuple(np.round(made.pose[:3, 3] + side * half, 9)) for side in (1, -1)}
        assert found == {tuple(np.round(start, 9)), tuple(np.round(end, 9))}
        assert np.linalg.det(made.pose[:3, :3]) == pytest.approx(1.0)
    ball = geometry.capsule('it', 'link', start, start, 0.1)
    assert isinstance(ball.geometry, geometry.coal.Sphere)


# Keys

CAPSULE = {'from': [0, 0, 0], 'to': [0, 0, 1], 'radius': 0.1}


@pytest.mark.parametrize('keys, key, told', [
    ({'links': 'tool'}, 'links', "unknown frame 'tool'"),
    ({'links': []}, 'links', 'needs a link or a list of links'),
    ({'links': {'base': 1}}, 'links', 'needs a link or a list of links'),
    ({'distance': -0.1}, 'distance', 'must not be negative'),
    ({'within': 0.0}, 'within', 'must be positive'),
    ({'distance': 0.3}, 'within', 'must be more than distance = 0.3, got 0.2'),
    ({'capsules': {'tool': CAPSULE}}, 'capsules', "unknown frame 'tool'"),
    ({'capsules': []}, 'capsules', 'needs a mapping'),
    ({'capsules': {'base': []}}, 'capsules', 'base needs {from'),
    ({'capsules': {'base': {'radius': 1.0}}}, 'capsules', 'base needs {from'),
    ({'capsules': {'base': {**CAPSULE, 'too': [1, 0, 0]}}}, 'capsules',
     "base: unknown key 'too' (did you mean 'to'?)"),
    ({'capsules': {'base': {**CAPSULE, 'radius': 0}}}, 'capsules',
     'base: radius must be positive'),
    ({'capsules': {'base': [CAPSULE, {**CAPSULE, 'to': [1]}]}}, 'capsules', 'base[2]: to needs'),
    ({'capsules': '/nowhere/capsules.yaml'}, 'capsules', 'no file /nowhere/capsules.yaml'),
    ({'capsules': '{'}, 'capsules', 'expected'),
    ({'gain': 0.0}, 'gain', 'must be positive'),
    ({'return_speed': 'slow'}, 'return_speed', 'needs a number'),
    ({'tolerance': {'s': 1.0}}, 'tolerance', 'unknown unit'),
])
@pytest.mark.parametrize('name', ['self_collision', 'obstacles'])
def test_key_with_a_senseless_value_is_refused(name, keys, key, told):
    found = faults(name, arm(), **keys)
    assert list(found) == [key] and told in found[key]


@pytest.mark.parametrize('keys, key, told', [
    ({'srdf': '/nowhere/arm.srdf'}, 'srdf', 'no file /nowhere/arm.srdf'),
    ({'srdf': '<robot'}, 'srdf', 'not valid XML'),
    ({'srdf': '<sdf/>'}, 'srdf', 'the outermost element is <sdf>'),
    ({'srdf': 'package://nowhere/arm.srdf'}, 'srdf', "package 'nowhere'"),
    ({'ignore': ['base', 'tip']}, 'ignore', 'needs pairs of links'),
    ({'ignore': [['base', 'tool']]}, 'ignore', "unknown frame 'tool'"),
])
def test_pairs_that_are_none_are_refused(keys, key, told):
    found = faults('self_collision', arm(), **keys)
    assert list(found) == [key] and told in found[key]


@pytest.mark.parametrize('obstacles, told', [
    ([], 'needs a mapping'), ({'table': None}, 'table needs {shape'),
    ({'table': {'at': [0, 0, 0]}}, 'table needs {shape'),
    ({'table': {'shape': {'cone': 1.0}}}, "table: unknown shape 'cone'"),
    ({'table': {'shape': {'box': [1, 0, 1]}}}, 'table: box needs x, y, z, positive numbers'),
    ({'table': {**TABLE, 'at': [0, 0]}}, 'needs 3 or 7 numbers, got [0, 0]'),
    ({'table': {'shape': {'box': [1, 1, 1]}}}, 'table: needs a place'),
    ({'table': {'shape': {'box': [1, 1, 1]}, 'at': None}}, 'table: needs a place'),
    ({'table': {'shap': {'box': [1, 1, 1]}}}, "unknown key 'shap' (did you mean 'shape'?)"),
    ({'table': {**TABLE, 'at': [0, 0, math.nan]}}, 'must be finite'),
    ({'table': {**TABLE, 'place': [0, 0, 0]}}, "table: unknown key 'place'"),
    ({5: TABLE}, 'needs a name, got 5'), ({'': TABLE}, 'needs a name'), ({'*': TABLE}, 'needs a'),
    ({str(number): TABLE for number in range(MOST_OBSTACLES + 1)}, 'at most 100 obstacles'),
])
def test_bad_obstacle_is_refused_in_the_stack_and_as_a_goal(obstacles, told):
    assert told in faults('obstacles', arm(), obstacles=obstacles)['obstacles']
    if obstacles != {'table': None}:
        with pytest.raises(GoalError) as error:
            make('obstacles', arm()).parse_goal(obstacles)
        assert told in str(error.value) and "'task'" in str(error.value)


def test_lifetime_is_for_goals_only_and_positive():
    assert 'unknown key' in faults('obstacles', arm(),
                                   obstacles={'table': {**TABLE, 'lifetime': 1.0}})['obstacles']
    with pytest.raises(GoalError, match='table: lifetime must be positive'):
        make('obstacles', arm()).parse_goal({'table': {**TABLE, 'lifetime': 0.0}})


def test_robot_without_shapes_needs_capsules():
    assert faults('self_collision', robots.panda())['type'] == (
        f'self_collision needs shapes of links; the description of {robots.panda().name} has no '
        'collision shapes: give capsules')
    message = faults('obstacles', robots.panda(), links=['panda_hand', TOOL],
                     capsules={'panda_hand': CAPSULE})['capsules']
    assert f'needed for {TOOL}:' in message


def test_links_that_cannot_move_against_the_reference_are_refused():
    assert 'move none of these links against base' in faults('obstacles', arm(),
                                                             links='base')['links']
    assert make('obstacles', arm(), links='base', reference='tip')


def test_faults_of_the_stack_have_their_lines():
    with pytest.raises(StackError) as error:
        Stack.from_yaml('- apart:\n    type: self_collision\n    links: [tool]\n'
                        '    srdf: /nowhere.srdf\n', arm())
    assert [fault.line for fault in error.value.faults] == [3, 4]


# Obstacles as goals

def around(task):
    """Return the names of what stands around."""
    return sorted(task.obstacles)


def test_goals_put_obstacles_there_move_them_and_take_them_away():
    task = make('obstacles', obstacles={'table': TABLE}, links='panda_hand', within=9.0)
    state = task.robot.state(robots.PANDA_READY)

    def distance(name):
        return min(value for pair, (value, _) in rows(task, state).items() if name in pair)

    far = distance('table')
    task.set_goal(task.parse_goal({'ball': {'shape': {'sphere': 0.1}, 'at': [0.3, 0, 1.2]}}), 0.0)
    assert around(task) == ['ball', 'table'] and distance('ball') > 0.3
    higher = {**TABLE, 'at': [0.5, 0.0, 0.25]}
    task.set_goal(task.parse_goal({'table': higher}), 1.0)
    assert distance('table') == pytest.approx(far - 0.05)
    task.set_goal(task.parse_goal({'table': None, 'nothing': None}), 2.0)
    assert around(task) == ['ball']
    task.set_goal(task.parse_goal({'*': None, 'box': TABLE}), 3.0)
    assert around(task) == ['box']
    task.set_goal(task.parse_goal({'*': None}), 4.0)
    assert around(task) == [] and task.observe(state)[0].shape == (0,)
    task.set_goal(task.parse_goal({'table': TABLE}), 5.0)
    assert distance('table') == pytest.approx(far)


def test_distances_are_drawn_at_once_by_a_task_that_replaces_another():
    def distances(task):
        return [part for part in task.sketch(state) if isinstance(part, Gaps)]

    keys = {'obstacles': {'table': TABLE}, 'links': 'panda_hand', 'within': 9.0}
    before, after = make('obstacles', **keys), make('obstacles', distance=0.05, **keys)
    state = before.robot.state(robots.PANDA_READY)
    before.observe(state)
    assert not distances(after)
    after.inherit_goal(before)
    (old,), (new,) = distances(before), distances(after)
    np.testing.assert_array_equal(new.starts, old.starts)
    assert new.least == 0.05
    # What it has found itself stays.
    before.observe(before.robot.state(before.robot.neutral()))
    after.observe(state)
    after.inherit_goal(before)
    np.testing.assert_allclose(distances(after)[0].starts, old.starts)


@pytest.mark.parametrize('reference', [None, 'panda_link5'])
@pytest.mark.parametrize('moved', [
    {'table': {**TABLE, 'at': [0.4, 0.1, 0.3]}},
    {'table': {**TABLE, 'at': [0.4, 0.1, 0.3]}, 'ball': {**BALL, 'at': [0.3, 0.3, 0.6]}},
    {'ball': {'shape': {'sphere': 0.2}, 'at': [0.3, 0.3, 0.6]}},
    {'ball': {'shape': {'box': [0.2, 0.1, 0.3]}, 'at': [0.3, 0.3, 0.6]}},
    {'ball': None, 'globe': BALL}, {'table': None, 'box': TABLE}, {'*': None, 'ball': BALL}])
def test_obstacles_that_were_moved_are_where_new_ones_would_be(moved, reference):
    there = {'table': TABLE, 'ball': {**BALL, 'at': [0.5, 0.5, 0.5]}}
    task = make('obstacles', obstacles={}, within=9.0, links=ARM, reference=reference)
    task.set_goal(task.parse_goal(there), 0.0)
    task.set_goal(task.parse_goal(moved), 1.0)
    after = {} if '*' in moved else {**there}
    after = {name: each for name, each in {**after, **moved}.items() if each is not None}
    new = make('obstacles', obstacles=after, within=9.0, links=ARM, reference=reference)
    state = task.robot.state(robots.PANDA_READY)
    found, wanted = rows(task, state), rows(new, state)
    assert len(found) == len(wanted) > 0 and set(found) == set(wanted)
    for name, (distance, row) in found.items():
        assert distance == wanted[name][0]
        np.testing.assert_array_equal(row, wanted[name][1])


def test_obstacle_is_gone_after_its_lifetime_and_no_earlier():
    task = make('obstacles', links='panda_hand', obstacles={'table': TABLE})
    state = task.robot.state(robots.PANDA_READY)
    task.set_goal(task.parse_goal({'ball': {**BALL, 'lifetime': 0.5}}), 10.0)
    task.level(state, 10.49)
    assert around(task) == ['ball', 'table']
    task.set_goal(task.parse_goal({'ball': {**BALL, 'lifetime': 0.5}}), 10.4)
    task.level(state, 10.8)
    assert around(task) == ['ball', 'table']
    task.level(state, 10.91)
    assert around(task) == ['table']


def test_goal_in_another_frame_stands_where_that_frame_is():
    robot = robots.panda()
    stack = Stack.from_yaml(f'- clear: {{type: obstacles, capsules: {CAPSULES}, '
                            'links: [panda_hand], within: 9.0}', robot)
    controller = Controller(robot, stack)
    controller.update(robots.PANDA_READY, 0.0)
    controller.set_goal('clear', {'ball': {'shape': {'sphere': 0.1}, 'at': [0.0, 0.0, 0.3]},
                                  'old': None}, 0.0, frame=TOOL)
    T = robot.state(robots.PANDA_READY).pose(TOOL)
    np.testing.assert_allclose(stack.tasks['clear'].obstacles['ball'].pose[:3, 3],
                               T[:3, 3] + 0.3 * T[:3, 2])
    with pytest.raises(GoalError, match="unknown frame 'cup'"):
        controller.set_goal('clear', {'ball': BALL}, 0.0, frame='cup')


def test_obstacles_move_with_their_reference():
    task = make('obstacles', reference='panda_link5', links='panda_hand', within=9.0,
                obstacles={'shield': {'shape': {'sphere': 0.1}, 'at': [0.0, 0.0, 0.2]}})
    q = np.array(robots.PANDA_READY)
    before, J = task.observe(task.robot.state(q))
    after, _ = task.observe(task.robot.state(q + [0.3, 0.2, -0.4, 0.5, 0.3, 0.0, 0.0]))
    np.testing.assert_allclose(before, after, atol=1e-7)
    np.testing.assert_allclose(J[:, :5], 0.0, atol=1e-7)
    assert np.abs(J[:, 5]).max() > 0.01


def test_too_many_obstacles_are_refused_and_those_there_stay():
    task = make('obstacles', obstacles={'table': TABLE}, links='panda_hand')
    many = {str(number): TABLE for number in range(MOST_OBSTACLES)}
    with pytest.raises(GoalError, match='at most 100 obstacles, got 101'):
        task.parse_goal(many)
    task.set_goal(task.parse_goal({'*': None, **many}), 0.0)
    assert len(task.obstacles) == MOST_OBSTACLES


def test_obstacles_that_came_as_goals_outlive_a_new_stack():
    robot = robots.panda()
    text = (f'- clear: {{type: obstacles, capsules: {CAPSULES}, links: [panda_hand], '
            'obstacles: {table: {shape: {box: [1, 1, 0.2]}, at: [0, 0, 0]}, '
            'pole: {shape: {sphere: 0.1}, at: [1, 0, 0]}}}')
    controller = Controller(robot, Stack.from_yaml(text, robot))
    controller.set_goal('clear', {'ball': BALL, 'pole': None}, 0.0)
    controller.replace_stack(Stack.from_yaml(text, robot))
    task = controller.stack.tasks['clear']
    assert around(task) == ['ball', 'pole', 'table']
    assert len(task._clearance.names) == 6


# Whole motions

def follow(robot, stack, q, goals, seconds, period=0.01):
    """Return how far every task with distances was from its bound, commands, positions."""
    controller = Controller(robot, Stack.from_yaml(stack, robot), Settings(period=period))
    q, apart, commands = np.array(q, dtype=float), [], []
    for cycle in range(round(seconds / period)):
        now = cycle * period
        for name, goal in goals(now).items():
            controller.set_goal(name, goal, now)
        command = controller.update(q, now)
        commands.append(command.velocity)
        q = robot.integrate(q, command.velocity, period)
        state = robot.state(q)
        apart.append(min(task.observe(state)[0].min(initial=9.0) - task.distance
                         for task in controller.stack.tasks.values() if hasattr(task, 'within')))
    return np.array(apart), np.array(commands), q, command.report


def flips(commands, size=0.01):
    """Return in how many cycles an acceleration turns round, none of its two sides small."""
    change = np.diff(commands, axis=0)
    turned = (change[1:] * change[:-1] < 0.0) & (np.abs(change[1:]) > size) & (
        np.abs(change[:-1]) > size)
    return int(turned.any(axis=1).sum())


def once(**goals):
    """Return what sets goals at the start only."""
    return lambda now: goals if now == 0.0 else {}


def tool_pose(xyz):
    """Return the pose of the Panda's tool at its start, elsewhere."""
    T = robots.panda().state(robots.PANDA_READY).pose(TOOL).copy()
    T[:3, 3] = xyz
    return T


def test_flat_hand_is_pressed_on_a_table_without_rattling():
    stack = (f'- clear: {{type: obstacles, capsules: {CAPSULES}, obstacles: {{table: {{shape: '
             '{box: [1.0, 1.0, 0.2]}, at: [0.5, 0.0, 0.2]}}, links: ['
             + ', '.join(ARM) + f']}}\n- tool: {{type: pose, frame: {TOOL}, gain: 2.0}}')
    apart, commands, q, report = follow(robots.panda(), stack, robots.PANDA_READY,
                                        once(tool=tool_pose([0.45, 0.0, 0.1])), 5.0)
    assert apart.min() > -1e-4 and apart[-1] < 1e-4
    assert flips(commands) < 10 and flips(commands[100:]) == 0
    assert np.abs(commands[-50:]).max() < 1e-3
    # It slides to over the goal.
    np.testing.assert_allclose(robots.panda().state(q).position(TOOL)[:2], [0.45, 0.0], atol=5e-3)


def test_hand_rocks_and_slides_on_a_table():
    stack = (f'- clear: {{type: obstacles, capsules: {CAPSULES}, obstacles: {{table: {{shape: '
             '{box: [1.0, 1.0, 0.2]}, at: [0.5, 0.0, 0.2]}}, links: ['
             + ', '.join(ARM) + f']}}\n- tool: {{type: pose, frame: {TOOL}, gain: 2.0}}')

    def rocking(now):
        T = tool_pose([0.45 + 0.1 * math.sin(2 * now), 0.2 * math.sin(1.5 * now), 0.1])
        T[:3, :3] = Rotation.from_rotvec([0.3 * math.sin(3 * now), 0.3 * math.sin(2 * now), 0.0]
                                         ).as_matrix() @ T[:3, :3]
        return {'tool': T}

    apart, commands, _, _ = follow(robots.panda(), stack, robots.PANDA_READY, rocking, 4.0)
    assert -1e-3 < apart.min() and np.median(apart) < 1e-3
    assert flips(commands) < 10


def test_panda_does_not_reach_into_its_own_base():
    stack = (f'- apart: {{type: self_collision, capsules: {CAPSULES}}}\n'
             f'- tool: {{type: position, frame: {TOOL}, gain: 2.0}}')
    apart, commands, _, report = follow(robots.panda(), stack, robots.PANDA_READY,
                                        once(tool=[0.02, 0.0, 0.15]), 5.0)
    assert -1e-3 < apart.min() and apart[-1] < 1e-3
    assert flips(commands) < 10
    assert report.tasks[0].reached and not report.tasks[1].reached


def test_the_same_goal_without_the_task_collides():
    stack = (f'- tool: {{type: position, frame: {TOOL}, gain: 2.0}}\n'
             f'- apart: {{type: self_collision, capsules: {CAPSULES}}}')
    apart, _, _, report = follow(robots.panda(), stack, robots.PANDA_READY,
                                 once(tool=[0.02, 0.0, 0.15]), 5.0)
    assert apart.min() < -0.05
    assert not report.tasks[1].reached


@pytest.mark.slow
def test_ur5_does_not_fold_into_itself():
    robot = with_meshes('ur5')
    stack = ('- apart: {type: self_collision}\n'
             '- tool: {type: position, frame: tool0, gain: 2.0}\n')
    start = [0.0, -1.2, 1.6, -1.0, -1.5, 0.3]
    for goal in ([0.0, 0.05, 0.2], [0.0, 0.1, 0.05], [-0.1, 0.1, 0.1]):
        apart, commands, _, report = follow(robot, stack, start, once(tool=goal), 4.0)
        assert -1e-3 < apart.min() < 5e-3, goal
        assert flips(commands) < 30, goal


@pytest.mark.slow
def test_arms_of_baxter_keep_apart_where_their_goals_cross():
    joints = tuple(f'{side}_{joint}' for side in ('left', 'right')
                   for joint in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2'))
    robot = with_meshes('baxter', joints)
    stack = (f'- apart: {{type: self_collision, srdf: {srdf("baxter")}}}\n'
             '- [left: {type: position, frame: left_gripper, gain: 1.0},\n'
             '   right: {type: position, frame: right_gripper, gain: 1.0}]\n')
    start = np.array([0.08, -1.0, -1.19, 1.94, 0.67, 1.03, -0.5,
                      -0.08, -1.0, 1.19, 1.94, -0.67, 1.03, 0.5])
    state = robot.state(start)
    left, right = state.position('left_gripper'), state.position('right_gripper')
    apart, commands, _, report = follow(robot, stack, start, once(left=right, right=left), 5.0)
    assert -1e-3 < apart.min() < 0.01
    # The rims of its cylinders slide over each other.
    assert flips(commands) < 40
    assert report.tasks[0].reached


def test_start_in_violation_is_left_at_no_more_than_the_return_speed():
    stack = (f'- clear: {{type: obstacles, capsules: {CAPSULES}, links: [panda_hand], '
             'return_speed: 0.1, obstacles: {table: {shape: {box: [1.0, 1.0, 0.2]}, '
             f'at: [0.5, 0.0, 0.45]}}}}}}\n- tool: {{type: position, frame: {TOOL}}}')
    robot = robots.panda()
    apart, commands, _, _ = follow(robot, stack, robots.PANDA_READY,
                                   once(tool=[0.45, 0.0, 0.3]), 4.0)
    assert apart[0] < -0.05 and apart[-1] > -1e-4
    assert np.diff(apart).max() < 0.1 * 0.01 * 1.1
    assert flips(commands) < 10


def test_obstacle_that_jumps_into_the_arm_makes_no_jump_of_the_command():
    robot = robots.panda()
    stack = (f'- clear: {{type: obstacles, capsules: {CAPSULES}, links: [panda_hand]}}\n'
             f'- tool: {{type: pose, frame: {TOOL}}}')

    def jumping(now):
        place = [0.5, 0.0, 0.1 if int(2 * now) % 2 else 0.45]
        return {'clear': {'box': {'shape': {'box': [0.6, 0.6, 0.2]}, 'at': place}}}

    _, commands, _, _ = follow(robot, stack, robots.PANDA_READY, jumping, 4.0)
    velocity = np.abs(commands).max()
    assert 0.05 < velocity < 1.5
    assert flips(commands) < 10


@pytest.mark.slow
def test_random_goals_among_obstacles_never_lead_too_near():
    stack = f"""
- clear:
    type: obstacles
    capsules: {CAPSULES}
    links: [panda_link3, {', '.join(ARM)}]
    obstacles:
      table: {{shape: {{box: [1.0, 1.0, 0.2]}}, at: [0.6, 0.0, 0.0]}}
      pole: {{shape: {{cylinder: [0.05, 1.5]}}, at: [0.45, 0.35, 0.5]}}
      ball: {{shape: {{sphere: 0.1}}, at: [0.4, -0.4, 0.5]}}
- apart: {{type: self_collision, capsules: {CAPSULES}}}
- tool: {{type: position, frame: {TOOL}, gain: 3.0}}
"""
    rng, near = np.random.default_rng(7), []
    for _ in range(8):
        wanted = rng.uniform([-0.7, -0.7, -0.1], [0.7, 0.7, 0.9], size=(4, 3))
        apart, commands, _, _ = follow(
            robots.panda(), stack, robots.PANDA_READY,
            lambda now, wanted=wanted: {'tool': wanted[int(now)]} if now % 1.0 == 0.0 else {}, 4.0)
        near.append(apart.min())
        # 25 where there is nothing in the way: goals and speed limits alone turn joints round.
        assert flips(commands) < 60
    assert -1e-3 < min(near) and np.median(near) < 1e-3
