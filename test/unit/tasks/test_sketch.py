# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What can be drawn of a task, compared with placements that Pinocchio computes on its own."""

import math
import queue
import threading

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pinocchio
import pytest
import robots
from scipy.spatial.transform import Rotation
from tp_controller import Controller, Stack
from tp_controller.control.sketcher import Sketcher
from tp_controller.tasks import Posture, sketch, task_types

SEEDS = st.integers(0, 2 ** 32 - 1)
TOOL, ELBOW = robots.PANDA_TOOL, 'panda_link4'
CAPSULES = str(robots.CONFIG / 'panda_capsules.yaml')
BOX = {'box': [0.3, 0.2, 0.4]}
KINDS = {name: kind for name, kind in task_types().items()
         if kind.__module__.startswith('tp_controller.')}
# Keys of tests about some types, in place of those of their examples.
KEYS = {
    'look_at': {'frame': TOOL, 'up': '-y'},
    'keep_in': {'frame': TOOL, 'shape': BOX, 'radius': 0.05},
    'keep_out': {'frame': TOOL, 'shape': {'sphere': 0.8}},
    'self_collision': {'capsules': CAPSULES, 'within': 2.0},
    'obstacles': {'capsules': CAPSULES, 'within': 2.0, 'obstacles': {
        'box': {'shape': BOX, 'at': [0.5, 0.3, 0.2]}}},
}
# {type: the rows of a twist, x to rz, that its axes can be}
MASKED = {name: range(6)[kind.twist_rows] for name, kind in KINDS.items()
          if 'axes' in kind.accepted_keys() and 'goal' in kind.sketch_parts and not kind.bounded}
AXES = ('x', 'y', 'z', 'rx', 'ry', 'rz')


def make(name, **more):
    """Return a task of a type, about a Panda that can have it."""
    kind = KINDS[name]
    return kind(robots.robot_for(kind), 'task', **{**KEYS.get(name, kind.example), **more})


def random_q(robot, rng):
    """Return a random configuration (nq,) within the limits."""
    lower, upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    zero = robot.configuration(np.zeros(len(robot.joint_names)))
    return robot.integrate(zero, rng.uniform(lower, upper), 1.0)


def random_pose(rng):
    """Return a random pose (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=int(rng.integers(2 ** 31))).as_matrix()
    T[:3, 3] = rng.uniform(-1.0, 1.0, 3)
    return T


class Placements:
    """Where the frames of a robot are, by a model of Pinocchio made from its URDF."""

    def __init__(self, robot, q):
        base = (pinocchio.JointModelPlanar(),) if robot.moves else ()
        self.model = pinocchio.buildModelFromXML(robot.urdf, *base)
        self.data = self.model.createData()
        # Fingers stay at zero.
        everywhere = pinocchio.neutral(self.model)
        if robot.moves:
            # Pinocchio turns by cosine and sine.
            q = [*q[:2], math.cos(q[2]), math.sin(q[2]), *q[3:]]
        everywhere[:len(q)] = q
        pinocchio.framesForwardKinematics(self.model, self.data, everywhere)

    def __getitem__(self, frame):
        """Return T_root_frame (4, 4)."""
        return self.data.oMf[self.model.getFrameId(frame)].homogeneous

    def center_of_mass(self):
        """Return the centre of mass (3,), with what does not move."""
        masses = [inertia.mass for inertia in self.model.inertias]
        centres = [(self.data.oMi[joint].act(inertia.lever))
                   for joint, inertia in enumerate(self.model.inertias)]
        return np.average(centres, axis=0, weights=masses)


def drawn(task, state):
    """Return {part: sketch} of a task."""
    parts = list(task.sketch(state))
    assert len({part.part for part in parts}) == len(parts)
    return {part.part: part for part in parts}


def started(name, seed, goal=None, **more):
    """Return a task with a goal, a random state, where its frames are, and random numbers."""
    rng, task = np.random.default_rng(seed), make(name, **more)
    task.start(task.robot.state(random_q(task.robot, rng)))
    if goal is not None:
        task.set_goal(task.parse_goal(goal(rng)), 0.0)
    q = random_q(task.robot, rng)
    return task, task.robot.state(q), Placements(task.robot, q), rng


def angle(one, other):
    """Return the angle between two vectors (3,) [rad]."""
    return math.atan2(np.linalg.norm(np.cross(one, other)), one @ other)


close = np.testing.assert_allclose


# All types

@pytest.mark.slow
@pytest.mark.parametrize('name', KINDS)
def test_type_draws_the_parts_that_it_declares(name):
    kind, seen = KINDS[name], set()
    always = {part for part, drawn_always in kind.sketch_parts.items() if drawn_always}
    for seed in range(8):
        task, state, _, _ = started(name, seed, **kind.example)
        task.evaluate(state, 0.0)
        parts = {part.partition('/')[0] for part in drawn(task, state)}
        assert always <= parts <= set(kind.sketch_parts)
        seen |= parts
    assert seen == set(kind.sketch_parts)


@pytest.mark.slow
@pytest.mark.parametrize('name', [name for name, kind in KINDS.items()
                                  if 'frame' in kind.sketch_parts
                                  and 'frame' in kind._fields])
@given(seed=SEEDS)
def test_frame_is_where_the_robot_has_it(name, seed):
    task, state, placements, _ = started(name, seed)
    close(drawn(task, state)['frame'].T, placements[task.frame], atol=1e-9)


@pytest.mark.parametrize('name', KINDS)
def test_a_task_without_a_goal_can_be_drawn(name):
    task = make(name)
    task.goal = None
    state = task.robot.state(random_q(task.robot, np.random.default_rng(0)))
    parts = {part.partition('/')[0] for part in drawn(task, state)}
    unseen = {'goal', 'error', 'turn'} if task.goal_type else set()
    assert parts <= set(KINDS[name].sketch_parts) - unseen


# Frames and goals

@pytest.mark.slow
@pytest.mark.parametrize('name', ['pose', 'relative_pose', 'keep_in', 'keep_out'])
@given(seed=SEEDS)
def test_goal_is_placed_by_its_reference(name, seed):
    task, state, placements, _ = started(name, seed, random_pose)
    close(drawn(task, state)['goal'].T, placements[task.reference] @ task.goal, atol=1e-9)


def goal_of(name, rng):
    """Return a random pose (4, 4), and what of it is a goal of a type."""
    T = random_pose(rng)
    part = {range(3): T[:3, 3], range(3, 6): T[:3, :3], range(6): T}
    return T, part[MASKED[name]]


@pytest.mark.parametrize('name', MASKED)
@given(data=st.data(), seed=SEEDS)
@pytest.mark.slow
def test_goal_is_where_the_frame_is_along_and_about_axes_that_do_not_count(name, data, seed):
    rows = data.draw(st.sets(st.sampled_from(MASKED[name]), min_size=1))
    axes = [AXES[row] if len(MASKED[name]) == 6 else AXES[row][-1] for row in sorted(rows)]
    wanted, goal = goal_of(name, np.random.default_rng(seed))
    task, state, placements, _ = started(name, seed, lambda _: goal, axes=axes)
    T_reference = np.eye(4) if task.robot.moves else placements[task.reference]
    T = placements[task.frame] if task.frame else np.block([
        [np.eye(3), placements.center_of_mass()[:, np.newaxis]], [np.zeros(3), 1.0]])
    now = np.linalg.inv(T_reference) @ T
    turn = Rotation.from_matrix(wanted[:3, :3] @ now[:3, :3].T).as_rotvec()
    turn[[row not in rows for row in range(3, 6)]] = 0.0
    expected = np.eye(4)
    expected[:3, 3] = np.where([row in rows for row in range(3)], wanted[:3, 3], now[:3, 3])
    expected[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ now[:3, :3]
    parts = drawn(task, state)
    close(parts['goal'].T, T_reference @ expected, atol=1e-7)
    # What is left to do ends there.
    if 'error' in parts:
        close(parts['error'].end, parts['goal'].T[:3, 3], atol=1e-9)
    if 'turn' in parts:
        tips = (parts['turn'].points[[0, -1]] - T[:3, 3]) / sketch.AXES_LENGTH
        axis = int((T[:3, :3].T @ tips[0]).argmax())
        close(tips[-1], parts['goal'].T[:3, axis], atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize('axes', [None, 'xz', 'y'])
@pytest.mark.parametrize('reference', [None, ELBOW])
@given(seed=SEEDS)
def test_error_is_an_arrow_along_the_axes_that_count(axes, reference, seed):
    task, state, placements, _ = started('position', seed, lambda rng: rng.uniform(-1, 1, 3),
                                         axes=axes, reference=reference)
    T, T_reference = placements[TOOL], placements[task.reference]
    way = T_reference[:3, :3].T @ (T_reference[:3, :3] @ task.goal + T_reference[:3, 3]
                                   - T[:3, 3])
    way[[axis not in (axes or 'xyz') for axis in 'xyz']] = 0.0
    parts = drawn(task, state)
    close(parts['error'].start, T[:3, 3], atol=1e-9)
    close(parts['error'].end, T[:3, 3] + T_reference[:3, :3] @ way, atol=1e-9)
    if reference is None:
        assert 'reference' not in parts
    else:
        close(parts['reference'].points, [T_reference[:3, 3], parts['goal'].T[:3, 3]], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize('name', ['pose', 'orientation'])
@given(seed=SEEDS)
def test_arc_leads_an_axis_of_the_frame_to_that_of_the_goal(name, seed):
    task, state, placements, _ = started(
        name, seed, lambda rng: random_pose(rng) if name == 'pose' else random_pose(rng)[:3, :3])
    parts, T = drawn(task, state), placements[TOOL]
    tips = (parts['turn'].points - T[:3, 3]) / sketch.AXES_LENGTH
    axis = int((T[:3, :3].T @ tips[0]).argmax())
    close(tips[0], T[:3, axis], atol=1e-9)
    close(tips[-1], parts['goal'].T[:3, axis], atol=1e-9)
    close(np.linalg.norm(tips, axis=1), 1.0)
    # The shorter way round: no piece turns back.
    assert sum(map(angle, tips, tips[1:])) <= math.pi + 1e-9


@given(seed=SEEDS)
def test_arc_turns_about_the_axes_that_count(seed):
    task, state, placements, _ = started('orientation', seed,
                                         lambda rng: random_pose(rng)[:3, :3], axes='z',
                                         reference=ELBOW)
    parts, T = drawn(task, state), placements[TOOL]
    if 'turn' in parts:
        tips, z = parts['turn'].points - T[:3, 3], placements[ELBOW][:3, 2]
        close(tips @ z, tips[0] @ z, atol=1e-9)


def test_what_cannot_be_seen_is_left_out():
    task = make('pose')
    state = task.robot.state(robots.PANDA_READY)
    task.start(state)
    assert set(drawn(task, state)) == {'frame', 'goal'}


# Axes that point

@pytest.mark.slow
@pytest.mark.parametrize('name', ['pointing', 'look_at', 'field_of_view'])
@pytest.mark.parametrize('axis', ['z', '-x', [1.0, 2.0, -0.5]])
@given(seed=SEEDS)
def test_line_of_sight_leads_to_the_point(name, axis, seed):
    more = {'towards': 'point'} if name == 'pointing' else {}
    task, state, placements, _ = started(name, seed, lambda rng: rng.uniform(-1, 1, 3), axis=axis,
                                         reference=ELBOW, **more)
    parts, T = drawn(task, state), placements[TOOL]
    letters = {'z': (0.0, 0.0, 1.0), '-x': (-1.0, 0.0, 0.0)}
    local = np.array(letters[axis] if isinstance(axis, str) else axis)
    point = placements[ELBOW][:3, :3] @ task.goal + placements[ELBOW][:3, 3]
    close(parts['goal'].T[:3, 3], point, atol=1e-9)
    close([parts['sight'].start, parts['sight'].end], [T[:3, 3], point], atol=1e-9)
    pointed = T[:3, :3] @ local / np.linalg.norm(local)
    close(parts['axis'].end - T[:3, 3], sketch.RAY_LENGTH * pointed, atol=1e-9)
    cone, sight = parts['cone'], point - T[:3, 3]
    close(cone.T[:3, 3], T[:3, 3], atol=1e-9)
    close(cone.T[:3, :3].T @ cone.T[:3, :3], np.eye(3), atol=1e-9)
    assert np.linalg.det(cone.T) == pytest.approx(1.0)
    if name == 'field_of_view':
        close(cone.T[:3, 2], pointed, atol=1e-9)
        assert cone.half_angle == 0.4
    else:
        # The axis that points is on the cone about the direction to the point.
        close(cone.T[:3, 2], sight / np.linalg.norm(sight), atol=1e-7)
        assert cone.half_angle == pytest.approx(angle(sight, pointed), abs=1e-6)
        tips = parts['turn'].points - T[:3, 3]
        close(tips[0], sketch.RAY_LENGTH * pointed, atol=1e-9)
        close(tips[-1], sketch.RAY_LENGTH * sight / np.linalg.norm(sight), atol=1e-6)


@given(seed=SEEDS)
def test_direction_is_drawn_from_the_frame(seed):
    task, state, placements, _ = started('pointing', seed, lambda rng: rng.normal(size=3),
                                         reference=ELBOW)
    parts, T = drawn(task, state), placements[TOOL]
    direction = placements[ELBOW][:3, :3] @ task.goal
    close(parts['sight'].end - T[:3, 3], sketch.RAY_LENGTH * direction, atol=1e-9)
    close(parts['goal'].T[:3, 3], T[:3, 3], atol=1e-9)
    close(parts['goal'].T[:3, 2], direction, atol=1e-6)


def test_cone_of_an_axis_that_points_right_is_as_wide_as_the_tolerance():
    task = make('pointing', tolerance=0.03)
    state = task.robot.state(robots.PANDA_READY)
    task.start(state)
    parts = drawn(task, state)
    assert parts['cone'].half_angle == 0.03 and 'turn' not in parts


# Regions, obstacles and distances

def test_region_is_drawn_with_what_is_inside_or_outside():
    for name, allowed in (('keep_in', True), ('keep_out', False)):
        task, state, placements, _ = started(name, 1, random_pose, radius=0.04)
        parts = drawn(task, state)
        close(parts['region'].T, task.goal)
        assert parts['region'].allowed is allowed and parts['region'].shape is task.shape
        close(parts['sphere'].T[:3, 3], placements[TOOL][:3, 3], atol=1e-9)
        assert parts['sphere'].shape.radius == 0.04


@pytest.mark.slow
@pytest.mark.parametrize('name', ['keep_in', 'keep_out'])
@given(seed=SEEDS)
def test_arrow_leads_back_to_the_bound_of_a_region(name, seed):
    task, state, placements, rng = started(name, seed, shape={'sphere': 0.5}, radius=0.1,
                                           reference=ELBOW)
    task.set_goal(np.block([[np.eye(3), rng.uniform(-0.6, 0.6, (3, 1))],
                            [np.zeros(3), 1.0]]), 0.0)
    centre = (placements[ELBOW] @ task.goal)[:3, 3]
    place, parts = placements[TOOL][:3, 3], drawn(task, state)
    distance = np.linalg.norm(place - centre)
    bound = 0.4 if name == 'keep_in' else 0.6
    outside = distance - bound if name == 'keep_in' else bound - distance
    assert ('error' in parts) == (outside >= sketch.MIN_ARROW_LENGTH)
    if 'error' in parts:
        close(parts['error'].start, place, atol=1e-9)
        close(np.linalg.norm(parts['error'].end - centre), bound, atol=1e-9)
        close(np.linalg.norm(parts['error'].end - place), outside, atol=1e-9)


@pytest.mark.slow
@given(seed=SEEDS)
def test_cone_of_a_tilt_is_about_its_direction(seed):
    task, state, placements, _ = started('tilt', seed, lambda rng: rng.normal(size=3),
                                         reference=ELBOW, within=0.3)
    cone, T = drawn(task, state)['cone'], placements[TOOL]
    close(cone.T[:3, 2], placements[ELBOW][:3, :3] @ task.goal, atol=1e-9)
    close(cone.T[:3, 3], T[:3, 3], atol=1e-9)
    assert cone.half_angle == 0.3


@pytest.mark.slow
@given(seed=SEEDS)
def test_arc_of_a_range_turns_an_axis_of_the_goal_from_one_bound_to_the_other(seed):
    task, state, placements, _ = started(
        'orientation_range', seed, lambda rng: random_pose(rng)[:3, :3], reference=ELBOW,
        axes='zy', minimum=[-0.3, 0.2], maximum=[0.4, 1.0], target=None)
    parts, R = drawn(task, state), placements[ELBOW][:3, :3] @ task.goal
    assert {part for part in parts if part.startswith('range')} == {'range/y', 'range/z'}
    for axis, shown, ends in ((1, 2, (-0.3, 0.4)), (2, 0, (0.2, 1.0))):
        tips = parts[f'range/{"xyz"[axis]}'].points - placements[TOOL][:3, 3]
        assert len(tips) > 10
        for tip, turn in zip((tips[0], tips[-1]), ends):
            expected = Rotation.from_rotvec(turn * R[:, axis]).apply(R[:, shown])
            close(tip, sketch.AXES_LENGTH * expected, atol=1e-9)


@given(seed=SEEDS)
def test_bounds_of_a_distance_are_spheres_about_the_point_and_an_arrow_leads_back(seed):
    task, state, placements, _ = started(
        'distance', seed, lambda rng: rng.uniform(-1, 1, 3), reference=ELBOW, minimum=0.5,
        maximum=0.9)
    parts, place = drawn(task, state), placements[TOOL][:3, 3]
    point = (placements[ELBOW] @ task.goal)[:3, 3]
    close(parts['line'].points, [point, place], atol=1e-9)
    for name, radius, allowed in (('minimum', 0.5, False), ('maximum', 0.9, True)):
        region = parts[f'region/{name}']
        close(region.T[:3, 3], point, atol=1e-9)
        assert (region.shape.radius, region.allowed) == (radius, allowed)
    distance = np.linalg.norm(place - point)
    if 'error' in parts:
        close(np.linalg.norm(parts['error'].end - point), np.clip(distance, 0.5, 0.9), atol=1e-9)
        close(parts['error'].start, place, atol=1e-9)


@pytest.mark.slow
@given(seed=SEEDS)
def test_distances_are_lines_from_surface_to_surface(seed):
    capsule = {'from': [0.0, 0.0, -0.1], 'to': [0.0, 0.0, 0.05], 'radius': 0.07}
    task, state, placements, _ = started(
        'obstacles', seed, links=TOOL, capsules={TOOL: capsule}, reference=ELBOW, within=5.0,
        obstacles={'ball': {'shape': {'sphere': 0.1}, 'at': [0.5, 0.3, 0.2]},
                   'far': {'shape': {'sphere': 0.2}, 'at': [0.5, -0.8, 0.2]}})
    task.evaluate(state, 0.0)
    parts = drawn(task, state)
    gaps, T = parts['distance'], placements[TOOL]
    centres = {name: (placements[ELBOW] @ [*task.obstacles[name].pose[:3, 3], 1.0])[:3]
               for name in ('ball', 'far')}
    for name, centre in centres.items():
        close(parts[f'obstacle/{name}'].T[:3, 3], centre, atol=1e-9)
    assert not parts['obstacle/ball'].allowed
    assert gaps.distances[0] <= gaps.distances[1] and len(gaps.distances) == 2
    assert (gaps.least, gaps.within) == (0.02, 5.0)
    for start, end, distance in zip(gaps.starts, gaps.ends, gaps.distances):
        name = min(centres, key=lambda name: abs(
            np.linalg.norm(end - centres[name]) - task.obstacles[name].shape.radius))
        close(np.linalg.norm(end - centres[name]), task.obstacles[name].shape.radius, atol=1e-6)
        # The nearest point of the line inside the capsule.
        local = np.linalg.inv(T) @ [*start, 1.0]
        height = min(max(local[2], -0.1), 0.05)
        close(np.linalg.norm(local[:3] - [0.0, 0.0, height]), 0.07, atol=1e-6)
        close(np.linalg.norm(end - start), abs(distance), atol=1e-6)


def test_only_the_nearest_pairs_are_drawn_each_once():
    task = make('self_collision', within=2.0)
    state = task.robot.state(robots.PANDA_READY)
    seen = task.observe_rows(state)
    gaps = drawn(task, state)['distance']
    nearest = sorted({name: value for value, name in zip(
        seen.value[::-1], seen.names[::-1])}.values())[:30]
    close(gaps.distances, nearest, atol=1e-12)


def test_pair_that_faces_each_other_flatly_is_one_line():
    capsule = {'from': [0.0, 0.0, -0.1], 'to': [0.0, 0.0, 0.1], 'radius': 0.07}
    T = Placements(robots.panda(), robots.PANDA_READY)[TOOL]
    beside = np.eye(4)
    beside[0, 3] = 0.07 + 0.03 + 0.05
    task = make('obstacles', links=TOOL, capsules={TOOL: capsule}, obstacles={
        'wall': {'shape': {'box': [0.1, 0.4, 0.4]}, 'at': (T @ beside).tolist()}})
    state = task.robot.state(robots.PANDA_READY)
    assert len(task.observe_rows(state).value) > 1
    close(drawn(task, state)['distance'].distances, [0.03], atol=1e-6)


def test_distances_are_those_of_the_last_cycle():
    task = make('self_collision')
    assert drawn(task, task.robot.state(robots.PANDA_READY)) == {}


def test_center_of_mass_is_where_the_masses_are():
    task, state, placements, _ = started('center_of_mass', 3, lambda rng: rng.uniform(-1, 1, 3),
                                         axes='xz')
    parts, place = drawn(task, state), placements.center_of_mass()
    close(parts['frame'].p, place, atol=1e-9)
    close(parts['goal'].T[:3, 3], [task.goal[0], place[1], task.goal[2]], atol=1e-9)
    close(parts['error'].end, parts['goal'].T[:3, 3])


# Beside the cycles

STACK = f"""
- [clear: {{type: self_collision, capsules: {CAPSULES}}}, inside: {{type: keep_in, frame: {ELBOW},
    shape: {{sphere: 1.0}}}}]
- tool: {{type: pose, frame: {TOOL}, gain: 2.0}}
- look: {{type: pointing, frame: panda_link5}}
- turn: {{type: orientation, frame: panda_link6, reference: {ELBOW}}}
"""
GOAL = [0.4, 0.3, 0.5, 0.0, 1.0, 0.0, 0.0]


def velocities(controller, cycles=300, meanwhile=lambda: None):
    """Return what a robot that follows exactly is told to do (cycles, n)."""
    q, found = np.array(robots.PANDA_READY), []
    for cycle in range(cycles):
        command = controller.update(q, 0.01 * cycle)
        if cycle == 0:
            controller.set_goal('tool', GOAL, 0.0)
        found.append(command.velocity)
        q = q + 0.01 * command.velocity
        if cycle % 10 == 9:
            meanwhile()
    return np.array(found)


def test_pictures_change_no_command():
    robot = robots.panda()
    expected = velocities(Controller(robot, Stack.from_yaml(STACK, robot)))
    controller = Controller(robot, Stack.from_yaml(STACK, robot))
    sketcher, made, over = Sketcher(robot, pytest.fail), queue.SimpleQueue(), threading.Event()

    def draw():
        while not over.is_set():
            if picture := sketcher.sketch(controller):
                made.put(picture)

    beside, pictures = threading.Thread(target=draw), []
    beside.start()
    try:
        # The loop waits for pictures: on a busy machine it may otherwise be over before one.
        found = velocities(controller, meanwhile=lambda: pictures.append(made.get(timeout=60.0)))
    finally:
        over.set()
        beside.join()
    assert np.array_equal(found, expected)
    assert set(pictures[-1]) == {'clear', 'inside', 'tool', 'look', 'turn'}


def test_picture_is_of_the_last_cycle():
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml(STACK, robot))
    sketcher = Sketcher(robot, pytest.fail)
    assert sketcher.sketch(controller) == {}
    for q in (np.array(robots.PANDA_READY), np.array(robots.PANDA_READY) + 0.1):
        controller.update(q, 0.0)
        frame = sketcher.sketch(controller)['tool'][0]
        close(frame.T, Placements(robot, q)[TOOL], atol=1e-9)
    controller.enable('tool', False)
    assert 'tool' not in sketcher.sketch(controller)


class Careless(Posture):
    """A posture that is another one once it has been drawn."""

    type_name = ''

    def sketch(self, state):
        """Forget the goal."""
        self.goal = self.gain = None
        return super().sketch(state)


def test_what_a_task_changes_while_it_is_drawn_is_a_copy():
    robot = robots.panda()
    controller = Controller(robot, Stack([[Careless(robot, 'careless')]]))
    controller.update(robots.PANDA_READY, 0.0)
    assert Sketcher(robot, pytest.fail).sketch(controller) == {'careless': []}
    task, = controller.stack.active_tasks
    close(task.goal, robots.PANDA_READY)
    assert controller.update(robots.PANDA_READY, 0.01).report.tasks[0].status == 'reached'
