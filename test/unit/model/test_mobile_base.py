# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robots with a mobile base: its pose, how it moves, and tasks that use it."""

import math

import numpy as np
import pytest
import robots
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from tp_controller import (
    Controller,
    KinematicSimulator,
    Robot,
    RobotError,
    Settings,
    SettingsError,
    SimulatorNoise,
    Stack,
    StackError,
    TaskError,
)
from tp_controller.model.simulator import initial_positions
from tp_controller.model.spatial import inverse_pose, rotation_vector
from tp_controller.tasks import task_types

# What each base adds to the velocities: the rows of its twist, in its own axes.
COLUMNS = {'planar': [0, 1, 5], 'differential': [0, 5], 'underwater': [0, 1, 2, 5],
           'floating': [0, 1, 2, 3, 4, 5]}
NAMES = ('base_x', 'base_y', 'base_z', 'base_roll', 'base_pitch', 'base_yaw')
FLAT = ('planar', 'differential')
# Joints of the Panda in another order than in its description; the others are passive.
SOME = ('panda_joint6', 'panda_joint2', 'panda_joint3', 'panda_joint1')
CHAIN = """
<robot name="chain"><link name="l0"/><link name="l1"/><link name="l2"/><link name="l3"/>
<joint name="a" type="continuous"><parent link="l0"/><child link="l1"/><origin xyz="1 0 0.5"/>
  <axis xyz="0 1 0"/></joint>
<joint name="b" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="1 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-9" upper="9" velocity="9" effort="0"/>
  <mimic joint="a" multiplier="-2" offset="0.1"/></joint>
<joint name="c" type="prismatic"><parent link="l2"/><child link="l3"/><origin xyz="1 0 0"/>
  <axis xyz="0 0 1"/><limit lower="0.2" upper="1" velocity="1" effort="0"/></joint></robot>"""
BOAT = '<robot name="boat"><link name="hull"/></robot>'


def make(kind, base, **options):
    """Return a robot on a base."""
    if kind == 'panda':
        return Robot.from_file(robots.PANDA_DH, base=base, **options)
    if kind == 'some':
        return Robot.from_file(robots.PANDA_DH, base=base, joints=list(SOME), **options)
    if kind == 'chain':
        return Robot.from_urdf(CHAIN, base=base, joints=['a'], **options)
    return Robot.from_file(robots.CONFIG / 'robots' / f'{kind}.urdf', base=base, **options)


def random_pose(robot, rng):
    """Return where a base may be, as T_root_base (4, 4)."""
    turn = rng.normal(size=3) * ([0.0, 0.0, 1.0] if robot.base in FLAT else 1.0)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    T[:3, 3] = rng.normal(size=3) * ([1.0, 1.0, 0.0] if robot.base in FLAT else 1.0)
    return T


def random_joints(robot, rng):
    """Return positions of the driven joints within their limits."""
    joints = robot.joint_columns
    return rng.uniform(np.maximum(robot.lower[joints], -3.0), np.minimum(robot.upper[joints], 3.0))


def base_pose(robot, q):
    """Return T_root_base (4, 4), read off q alone."""
    T = np.eye(4)
    if robot.base in FLAT:
        T[:2, 3] = q[:2]
        T[:3, :3] = Rotation.from_euler('z', q[2]).as_matrix()
    else:
        T[:3, 3] = q[:3]
        T[:3, :3] = Rotation.from_quat(q[3:7]).as_matrix()
    return T


def displacement(robot, velocity, dt):
    """Return T_before_after (4, 4) of a base with constant velocities in its own axes."""
    twist = np.zeros(6)
    twist[COLUMNS[robot.base]] = velocity[:len(COLUMNS[robot.base])]
    generator = np.zeros((4, 4))
    generator[:3, :3] = np.cross(twist[3:], -np.eye(3))
    generator[:3, 3] = twist[:3]
    return expm(dt * generator)


every_base = pytest.mark.parametrize('base', COLUMNS)
every_robot = pytest.mark.parametrize('kind', ['panda', 'some', 'chain'])


# Kinematics

@every_base
@every_robot
def test_what_stands_on_the_base_moves_with_it(kind, base):
    robot, fixed = make(kind, base), make(kind, 'fixed')
    rng = np.random.default_rng(0)
    for _ in range(5):
        T_root_base, joints = random_pose(robot, rng), random_joints(robot, rng)
        state = robot.state(robot.configuration(joints, T_root_base))
        on_the_ground = fixed.state(joints)
        for frame in fixed.frame_names:
            np.testing.assert_allclose(state.pose(frame), T_root_base @ on_the_ground.pose(frame),
                                       atol=1e-12)
        np.testing.assert_array_equal(state.pose('odom'), np.eye(4))
        np.testing.assert_allclose(base_pose(robot, state.q), T_root_base, atol=1e-12)
        np.testing.assert_array_equal(state.q[robot.joint_rows], joints)


@every_base
def test_base_moves_by_its_twist_in_its_own_axes(base):
    robot, rng = make('some', base), np.random.default_rng(1)
    for dt in (0.01, 0.5, 2.0):
        joints, velocity = random_joints(robot, rng), rng.normal(size=robot.n)
        T = random_pose(robot, rng)
        moved = robot.integrate(robot.configuration(joints, T), velocity, dt)
        np.testing.assert_allclose(base_pose(robot, moved), T @ displacement(robot, velocity, dt),
                                   atol=1e-9)
        np.testing.assert_allclose(moved[robot.joint_rows],
                                   joints + dt * velocity[len(COLUMNS[base]):])


def test_differential_base_drives_a_circle():
    robot = make('mobile_arm', 'differential')
    q = robot.configuration(np.zeros(8))
    velocity = np.array([0.4, 0.2] + [0.0] * 8)
    # Radius v / w = 2 m, to the left; a quarter, a half, and the circle one and a half times.
    for angle, place in ((0.5 * math.pi, (2.0, 2.0)), (math.pi, (0.0, 4.0)),
                         (3.0 * math.pi, (0.0, 4.0))):
        moved = robot.integrate(q, velocity, angle / 0.2)
        np.testing.assert_allclose(moved[:3], [*place, angle], atol=1e-12)


@every_base
@every_robot
def test_jacobian_is_the_derivative_along_every_velocity(kind, base):
    robot, rng, h = make(kind, base), np.random.default_rng(2), 1e-6
    passive = robot.passive_neutral + 0.1
    q = robot.configuration(random_joints(robot, rng), random_pose(robot, rng))
    for frame in (robot.base_frame, robot.frame_names[-1]):
        J = robot.state(q, passive).jacobian(frame)
        assert J.shape == (6, robot.n)
        for column, velocity in enumerate(np.eye(robot.n)):
            before, after = (robot.state(robot.integrate(q, velocity, step), passive)
                             for step in (-h, h))
            moved = after.position(frame) - before.position(frame)
            turned = rotation_vector(after.rotation(frame) @ before.rotation(frame).T)
            np.testing.assert_allclose(J[:, column], np.concatenate((moved, turned)) / (2 * h),
                                       atol=1e-8)


@every_base
def test_velocities_of_the_base_are_in_its_own_axes(base):
    robot = make('panda', base)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler('z', 90, degrees=True).as_matrix()
    J = robot.state(robot.configuration(robots.PANDA_READY, T)).jacobian(robot.base_frame)
    # Turned by 90 degrees, x of the base is y of the world, and its y is -x.
    expected = {'base_x': (1, 1.0), 'base_y': (0, -1.0), 'base_z': (2, 1.0),
                'base_roll': (4, 1.0), 'base_pitch': (3, -1.0), 'base_yaw': (5, 1.0)}
    for column, name in enumerate(robot.velocity_names[:-7]):
        row, value = expected[name]
        np.testing.assert_allclose(J[:, column], value * np.eye(6)[row], atol=1e-12)
    np.testing.assert_array_equal(J[:, robot.joint_columns], 0.0)
    np.testing.assert_array_equal(robot.state(robot.neutral()).jacobian('odom'), 0.0)


# Names, limits, faults

@every_base
def test_base_comes_first_in_every_array(base):
    robot = make('some', base)
    axes = tuple(NAMES[row] for row in COLUMNS[base])
    assert robot.velocity_names == axes + SOME
    assert robot.joint_names == SOME
    assert robot.velocity_units == tuple('m' if row < 3 else 'rad' for row in COLUMNS[base]) \
        + ('rad',) * 4
    assert (robot.n, robot.nq) == (len(axes) + 4, (3 if base in FLAT else 7) + 4)
    assert len(robot.coordinate_names) == robot.nq == len(robot.neutral())
    assert (robot.root, robot.base_frame) == ('odom', 'panda_link0')
    assert robot.frame_names[:2] == ('odom', 'panda_link0')
    for index, name in enumerate(SOME, len(axes)):
        assert robot.joint_index(name) == index
    fixed = make('some', 'fixed')
    for key in ('lower', 'upper', 'velocity', 'acceleration', 'continuous'):
        assert getattr(robot, key)[robot.joint_columns].tolist() == getattr(fixed, key).tolist()
    assert (robot.velocity[:len(axes)] == 0.5).all()
    assert np.isinf([robot.lower, robot.upper, robot.acceleration])[:, :len(axes)].all()
    assert not robot.continuous[:len(axes)].any()


def test_fixed_base_adds_nothing():
    robot = robots.panda()
    assert robot.velocity_names == robot.coordinate_names == robot.joint_names
    assert robot.nq == robot.n == 7 and robot.root == robot.base_frame == 'panda_link0'
    state = robot.state(robots.PANDA_READY)
    assert state.positions is state.q


def test_limits_of_a_base_can_be_given():
    robot = make('panda', 'planar', limits={
        'base_x': {'velocity': 1.5, 'acceleration': 2}, 'panda_joint1': {'velocity': 0.1}})
    assert robot.velocity[:4].tolist() == [1.5, 0.5, 0.5, 0.1]
    assert robot.acceleration[:4].tolist() == [2.0, math.inf, math.inf, math.inf]


@pytest.mark.parametrize('limits, message', [
    ({'base_x': {'lower': -1.0}}, 'base_x: a base has no position limits'),
    ({'base_yaw': {'upper': 1.0}}, 'base_yaw: a base has no position limits'),
    ({'base_z': {'velocity': 1.0}}, "unknown driven joint 'base_z'.*valid: base_x, base_y"),
    ({'base_x': {'velocity': -1.0}}, 'base_x: velocity limit -1.0 must not be negative'),
    ({'base_x': {'acceleration': 0.0}}, 'base_x: acceleration limit 0.0 must be positive'),
    ({'base_x': 1.0}, 'base_x: limits need a mapping'),
    ({'base_x': {'speed': 1.0}}, "base_x: unknown limit 'speed'"),
])
def test_limits_of_a_base_that_make_no_sense_are_refused(limits, message):
    with pytest.raises(RobotError, match=message):
        make('panda', 'planar', limits=limits)


def test_world_frame_has_the_name_it_is_given():
    robot = make('chain', 'planar', world_frame='map')
    assert robot.frame_names == ('map', 'l0', 'l1', 'l2', 'l3')
    assert robot.check_frame('map') == 'map'


@pytest.mark.parametrize('name, message', [
    ('l2', "cannot be named like a link: 'l2'"), ('', 'needs a name'), (5, 'needs a name')])
def test_world_frame_that_cannot_be_named_so_is_refused(name, message):
    with pytest.raises(RobotError, match=message):
        make('chain', 'planar', world_frame=name)


@pytest.mark.parametrize('base', ['flying', None, ['planar'], 3])
def test_base_that_is_none_is_refused(base):
    with pytest.raises(RobotError, match='unknown base .*valid: fixed, planar, differential'):
        make('chain', base)


def test_joint_named_like_a_part_of_the_base_is_refused():
    source = CHAIN.replace('"c"', '"base_y"')
    Robot.from_urdf(source)
    for base in FLAT:
        with pytest.raises(RobotError, match='named like a velocity of the base: base_y'):
            Robot.from_urdf(source, base=base)


@pytest.mark.parametrize('q, message', [
    ([0.0] * 8, 'the quaternion base_qx, base_qy, base_qz, base_qw needs norm 1, this one has 0'),
    ([0, 0, 0, 0, 0, 0, 1.2, 0], 'needs norm 1, this one has 1.2'),
    ([0, math.nan, 0, 0, 0, 0, 1, 0], 'q is not finite for base_y'),
    ([0, 0, 0, 0, 0, math.inf, 1, 0], 'q is not finite for base_qz'),
    ([0.0] * 7, r'q needs 8 positions \(base_x, .*base_qw, a\)'),
])
def test_configuration_that_is_none_is_refused_and_the_state_stays(q, message):
    robot = make('chain', 'floating')
    state = robot.state(robot.neutral())
    before = state.pose('l3')
    with pytest.raises(RobotError, match=message):
        state.update(q, [0.9])
    state.update(robot.neutral())
    np.testing.assert_array_equal(state.pose('l3'), before)


def test_quaternion_is_normalised():
    robot = make('chain', 'underwater')
    state = robot.state([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.03, 0.4])
    assert state.q.tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.4]
    with pytest.raises(ValueError, match='read-only'):
        state.q[0] = 0.0
    np.testing.assert_allclose(np.linalg.det(state.rotation('l3')), 1.0)


def test_base_alone_is_a_robot():
    robot = Robot.from_urdf(BOAT, base='planar')
    assert (robot.n, robot.nq, robot.joint_names) == (3, 3, ())
    controller = Controller(robot, Stack.from_yaml('[stay: {type: base_pose, gain: 2.0}]', robot))
    controller.set_goal('stay', [0.3, -0.2, 0, 0, 0, math.sin(0.5), math.cos(0.5)], 0.0)
    simulator = drive(controller, 600)
    np.testing.assert_allclose(simulator.q, [0.3, -0.2, 1.0], atol=1e-3)
    with pytest.raises(RobotError, match='no joint to drive'):
        Robot.from_urdf(BOAT)


def test_frames_that_no_joint_moves_are_fixed_to_the_base():
    robot = make('mobile_arm', 'differential')
    np.testing.assert_array_equal(robot.fixed_to_base('base_link'), np.eye(4))
    np.testing.assert_allclose(robot.fixed_to_base('laser')[:3, 3], [0.26, 0.0, 0.12])
    assert robot.fixed_to_base('odom') is None and robot.fixed_to_base('tool') is None


# Tasks

def drive(controller, cycles, q=None, period=0.01, check=None):
    """Return the simulator after so many cycles from q; `check` gets each command and q."""
    simulator = KinematicSimulator(controller.robot, q)
    for cycle in range(cycles):
        command = controller.update(simulator.q, cycle * period)
        if check is not None:
            check(command, simulator.q)
        simulator.command(command.velocity)
        simulator.step(period)
    return simulator


@every_base
def test_joint_tasks_are_about_the_columns_behind_those_of_the_base(base):
    robot = make('some', base)
    rng = np.random.default_rng(4)
    state = robot.state(robot.configuration([0.1, 0.2, 0.3, 0.4], random_pose(robot, rng)))
    first = len(COLUMNS[base])
    for name, keys, rows in (
            ('joint', {'joints': ['panda_joint3', 'panda_joint6']}, [2, 0]),
            ('posture', {}, [0, 1, 2, 3]), ('joint_velocity', {}, [0, 1, 2, 3])):
        task = task_types()[name](robot, 'task', **keys)
        expected = np.eye(robot.n)[[first + row for row in rows]]
        np.testing.assert_array_equal(task.jacobian(state), expected)
        if name != 'joint_velocity':
            np.testing.assert_array_equal(task.value(state),
                                          np.array([0.1, 0.2, 0.3, 0.4])[rows])


@every_base
def test_task_relative_to_a_frame_of_the_robot_leaves_the_base_nothing_to_do(base):
    robot, rng = make('panda', base), np.random.default_rng(5)
    state = robot.state(robot.configuration(robots.PANDA_READY, random_pose(robot, rng)))
    fixed = robots.panda().state(robots.PANDA_READY)
    for reference in ('panda_link0', 'panda_link3'):
        keys = {'frame': robots.PANDA_TOOL, 'reference': reference}
        task, same = (task_types()['pose'](each, 'task', **keys)
                      for each in (robot, robots.panda()))
        J = task.jacobian(state)
        np.testing.assert_allclose(J[:, :robot.joint_columns.start], 0.0, atol=1e-12)
        np.testing.assert_allclose(J[:, robot.joint_columns], same.jacobian(fixed), atol=1e-12)
        np.testing.assert_allclose(task.value(state), same.value(fixed), atol=1e-12)


def test_posture_of_a_robot_whose_base_moves_is_not_about_all_velocities():
    assert task_types()['posture'](robots.panda(), 'rest').every_joint
    task = task_types()['posture'](robots.moving_panda(), 'rest')
    assert task._jacobian.shape == (7, 10)


@pytest.mark.parametrize('base, axes', [
    ('planar', ('x', 'y', 'rz')), ('differential', ('x', 'y', 'rz')),
    ('underwater', ('x', 'y', 'z', 'rz')), ('floating', ('x', 'y', 'z', 'rx', 'ry', 'rz'))])
def test_base_tasks_are_about_the_axes_that_the_base_can_move(base, axes):
    robot = make('chain', base)
    pose = task_types()['base_pose'](robot, 'stay')
    turn = task_types()['base_orientation'](robot, 'level')
    assert pose.axes == axes and pose.frame == 'l0' and pose.reference == 'odom'
    assert turn.axes == tuple(axis[1] for axis in axes if axis[0] == 'r')
    assert task_types()['base_pose'](robot, 'stay', axes='xy').axes == ('x', 'y')


@pytest.mark.parametrize('name', ['base_pose', 'base_orientation'])
def test_base_tasks_need_a_base_that_moves(name):
    with pytest.raises(TaskError, match=f'{name} needs a robot whose base moves.*fixed'):
        task_types()[name](robots.panda(), 'stay')
    with pytest.raises(StackError, match=f'line 1: stay, type: {name} needs a robot whose base'):
        Stack.from_yaml(f'- stay: {{type: {name}}}', robots.panda())


def test_base_is_where_it_was_sent_while_the_tool_stays():
    robot = make('mobile_arm', 'planar')
    controller = Controller(robot, Stack.from_yaml("""
- tool: {type: position, frame: tool, gain: 3.0}
- stay: {type: base_pose, gain: 1.0}
""", robot))
    q = initial_positions('{arm_2: 0.5, arm_4: 1.2, base_x: 1.0, base_yaw: 0.5}', robot)
    tool = robot.state(q).position('tool')
    controller.update(q, 0.0)
    controller.set_goal('stay', [0.9, 0.1, 0, 0, 0, math.sin(0.35), math.cos(0.35)], 0.0)
    simulator = drive(controller, 800, q, check=lambda command, q: np.testing.assert_allclose(
        robot.state(q).position('tool'), tool, atol=2e-3))
    np.testing.assert_allclose(simulator.q[:3], [0.9, 0.1, 0.7], atol=2e-3)


def test_differential_base_says_that_it_cannot_drive_sideways():
    robot = make('mobile_arm', 'differential')
    controller = Controller(robot, Stack.from_yaml('[stay: {type: base_pose}]', robot))
    controller.update(robot.neutral(), 0.0)
    controller.set_goal('stay', [0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0], 0.0)
    report = controller.update(robot.neutral(), 1.0).report
    assert 'the robot cannot move in this direction here' in report.tasks[0].reason


def closed_loop(robot, frame, q, move, cycles, settings=None, stack=None):
    """Drive a frame by a displacement (4, 4) in its own axes; check the limits; return errors."""
    goal = robot.state(q).pose(frame) @ move
    controller = Controller(robot, Stack.from_yaml(stack or f"""
- tool: {{type: pose, frame: {frame}, gain: 1.5}}
- rest: {{type: posture, gain: 0.3}}
""", robot), settings)
    velocities = [np.zeros(robot.n)]

    def check(command, q):
        velocities.append(command.velocity)
        assert (np.abs(command.velocity) <= robot.velocity * (1.0 + 1e-9)).all()
        positions = robot.positions(q)
        assert ((positions >= robot.lower - 1e-9) & (positions <= robot.upper + 1e-9)).all()

    controller.set_goal('tool', goal, 0.0)
    simulator = drive(controller, cycles, q, check=check)
    changes = np.abs(np.diff(velocities, axis=0)) / 0.01
    assert (changes <= robot.acceleration * (1.0 + 1e-6)).all()
    T = inverse_pose(robot.state(simulator.q).pose(frame)) @ goal
    return np.linalg.norm(T[:3, 3]), np.linalg.norm(rotation_vector(T[:3, :3])), simulator.q


@pytest.mark.slow
@every_base
@pytest.mark.parametrize('accelerations', [False, True])
def test_tool_reaches_what_the_arm_alone_could_not(base, accelerations):
    limits = {NAMES[row]: {'velocity': 0.4, 'acceleration': 0.8} for row in COLUMNS[base]} \
        if accelerations else {}
    robot = make('panda', base, limits=limits)
    start = robot.configuration(robots.PANDA_READY)
    move = np.eye(4)
    move[:3, :3] = Rotation.from_euler('z', -0.6).as_matrix()
    # The tool points down, so its x is forward and its y to the right.
    move[:3, 3] = [1.5, -0.4, 0.0]
    distance, angle, q = closed_loop(robot, robots.PANDA_TOOL, start, move, 1500)
    assert distance < 2e-3 and angle < 5e-3
    assert np.linalg.norm(base_pose(robot, q)[:2, 3]) > 0.7


@pytest.mark.slow
@pytest.mark.parametrize('base', FLAT)
def test_tiago_reaches_a_goal_that_its_base_has_to_drive_to(base):
    robot = Robot.from_urdf(robots.urdf_path('tiago'), base=base, joints=[
        'torso_lift_joint', *(f'arm_{number}_joint' for number in range(1, 8))])
    q = initial_positions('{torso_lift_joint: 0.15, arm_1_joint: 0.6, arm_2_joint: 0.2, '
                          'arm_3_joint: -1.5, arm_4_joint: 1.4, arm_5_joint: -1.2, '
                          'base_x: -1.0, base_y: 0.5, base_yaw: 2.5}', robot)
    move = np.eye(4)
    goal = robot.state(q).pose(robots.TOOLS['tiago'])
    # Forward, as the base sees it.
    move[:3, 3] = goal[:3, :3].T @ robot.state(q).rotation(robot.base_frame) @ [1.5, 0.3, 0.05]
    distance, angle, _ = closed_loop(robot, robots.TOOLS['tiago'], q, move, 1500)
    assert distance < 2e-3 and angle < 5e-3


def test_tiago_drives_to_a_place_and_turns_there_while_its_tool_stays():
    robot = Robot.from_urdf(robots.urdf_path('tiago'), base='planar', joints=[
        'torso_lift_joint', *(f'arm_{number}_joint' for number in range(1, 8))])
    tool = robots.TOOLS['tiago']
    q = initial_positions('{torso_lift_joint: 0.15, arm_1_joint: 0.6, arm_2_joint: 0.2, '
                          'arm_3_joint: -1.5, arm_4_joint: 1.4, arm_5_joint: -1.2}', robot)
    stack = Stack.from_yaml(f"""
- hand: {{type: position, frame: {tool}, gain: 3.0}}
- heading: {{type: base_orientation, axes: z, gain: 1.0}}
- place: {{type: base_pose, axes: xy, gain: 1.0}}
""", robot)
    controller = Controller(robot, stack, Settings(period=0.01))
    controller.update(q, 0.0)
    start, furthest = robot.state(q).position(tool), 0.0
    controller.set_goal('heading', [0.0, 0.0, np.sin(0.1), np.cos(0.1)], 0.0)
    controller.set_goal('place', [0.1, -0.05, 0.0, 0.0, 0.0, 0.0, 1.0], 0.0)
    for cycle in range(1500):
        command = controller.update(q, 0.01 * cycle)
        assert (np.abs(command.velocity) <= robot.velocity).all()
        q = robot.integrate(q, command.velocity, 0.01)
        furthest = max(furthest, np.linalg.norm(robot.state(q).position(tool) - start))
    assert furthest < 1e-3 and all(task.reached for task in command.report.tasks)
    T = robot.state(q).pose(robot.base_frame)
    np.testing.assert_allclose(T[:2, 3], [0.1, -0.05], atol=2e-3)
    assert np.arctan2(T[1, 0], T[0, 0]) == pytest.approx(0.2, abs=5e-3)


def test_underwater_arm_takes_its_vehicle_along_even_where_that_is_tilted():
    robot = make('underwater_arm', 'underwater')
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler('ZYX', [0.8, 0.2, -0.1]).as_matrix()
    T[:3, 3] = [3.0, 1.0, -5.0]
    q = robot.configuration([0.2, 0.6, 0.4, 0.0], T)
    move = np.eye(4)
    move[:3, 3] = [0.8, 0.5, -0.6]
    distance, _, end = closed_loop(robot, 'tool', q, move, 2000, stack="""
- tool: {type: pose, frame: tool, axes: xyz, gain: 1.0}
- heading: {type: base_orientation, axes: z, gain: 0.5}
- rest: {type: posture, gain: 0.3}
""")
    assert distance < 2e-3
    # It has no way to change roll and pitch, and does not.
    upright = base_pose(robot, end)[2, :3]
    np.testing.assert_allclose(upright, T[2, :3], atol=1e-6)


def test_limit_of_the_base_is_named_in_the_report():
    robot = make('mobile_arm', 'planar')
    controller = Controller(robot, Stack.from_yaml('[stay: {type: base_pose, gain: 5.0}]', robot),
                            Settings(blend=0.0))
    controller.update(robot.neutral(), 0.0)
    controller.set_goal('stay', [0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 1.0], 0.0)
    command = controller.update(robot.neutral(), 0.01)
    assert 'base_y at its velocity limit' in command.report.tasks[0].reason
    assert 'base_y at its velocity limit' == command.report.limiting
    assert command.velocity[1] == pytest.approx(0.5)


def test_weights_are_for_every_velocity():
    robot = make('panda', 'differential')
    with pytest.raises(SettingsError, match='weights needs 9 numbers, one for each of base_x, '
                                            'base_yaw, panda_joint1'):
        Controller(robot, Stack([]), Settings(weights=(1.0,) * 7))


def share_of_the_base(base_weight, joint_weight):
    """Return how much of ∫ ‖q_dot‖² dt the base has, for one motion of the tool."""
    robot = make('mobile_arm', 'differential')
    settings = Settings(weights=(base_weight,) * 2 + (joint_weight,) * 8)
    q = initial_positions('{torso_lift: 0.15, arm_1: 0.3, arm_2: 0.5, arm_4: 1.2, arm_6: -0.6}',
                          robot)
    controller = Controller(robot, Stack.from_yaml('[tool: {type: pose, frame: tool}]', robot),
                            settings)
    goal = robot.state(q).pose('tool').copy()
    goal[:3, 3] += [0.4, 0.1, -0.1]
    controller.set_goal('tool', goal, 0.0)
    squares = np.zeros(robot.n)

    def add(command, q):
        nonlocal squares
        squares = squares + command.velocity ** 2

    end = drive(controller, 800, q, check=add)
    np.testing.assert_allclose(robot.state(end.q).position('tool'), goal[:3, 3], atol=2e-3)
    return squares[:2].sum() / squares.sum()


def test_weights_move_the_motion_from_the_base_to_the_arm_and_back():
    shares = [share_of_the_base(*weights) for weights in (
        (100.0, 1.0), (10.0, 1.0), (1.0, 1.0), (1.0, 10.0))]
    assert shares == sorted(shares)
    assert shares[0] < 0.1 and shares[1] < 0.5 * shares[2] and shares[3] > 0.7


# Simulator

@every_base
def test_simulator_drives_the_base(base):
    robot, rng = make('some', base), np.random.default_rng(6)
    T = random_pose(robot, rng)
    joints = 0.5 * (robot.lower[robot.joint_columns] + robot.upper[robot.joint_columns])
    simulator = KinematicSimulator(robot, robot.configuration(joints, T), timeout=2.0)
    velocity = rng.uniform(-0.1, 0.1, robot.n)
    simulator.command(velocity)
    simulator.step(1.5)
    np.testing.assert_allclose(base_pose(robot, simulator.q),
                               T @ displacement(robot, velocity, 1.5), atol=1e-9)
    simulator.command(np.full(robot.n, 9.0))
    simulator.step(0.01)
    np.testing.assert_array_equal(simulator.velocity, robot.velocity)


def test_base_goes_on_while_a_joint_stops_at_its_limit():
    robot = make('mobile_arm', 'differential')
    simulator = KinematicSimulator(robot, timeout=20.0)
    simulator.command([0.1, 0.0, 0.07] + [0.0] * 7)
    simulator.step(10.0)
    np.testing.assert_allclose(simulator.q[:4], [1.0, 0.0, 0.0, 0.35], atol=1e-12)
    assert simulator.velocity[:3].tolist() == [0.1, 0.0, 0.0]


def test_base_and_joints_are_commanded_and_time_out_apart():
    robot = make('mobile_arm', 'differential')
    simulator = KinematicSimulator(robot, timeout=0.1)
    joints, base = robot.joint_columns, slice(0, robot.joint_columns.start)
    simulator.command(np.full(robot.n, 0.05), joints)
    simulator.step(0.06)
    assert simulator.velocity.tolist() == [0.0] * 2 + [0.05] * 8
    simulator.command(np.full(robot.n, 0.2), base)
    assert simulator.velocity.tolist() == [0.0] * 2 + [0.05] * 8
    simulator.step(0.06)
    assert simulator.velocity.tolist() == [0.2] * 2 + [0.0] * 8
    simulator.step(0.06)
    assert simulator.velocity.tolist() == [0.0] * 10
    # The joints moved for 0.1 s, and so did the base, on an arc.
    assert simulator.q[3] == pytest.approx(0.175 + 0.005)
    assert simulator.q[2] == pytest.approx(0.02)
    assert simulator.q[0] == pytest.approx(math.sin(0.02))


def test_lag_acts_on_the_velocities_of_the_base_and_delay_on_its_commands():
    robot = Robot.from_urdf(BOAT, base='planar')
    simulator = KinematicSimulator(robot, [0.0, 0.0, 0.5 * math.pi], 9.0,
                                   SimulatorNoise(lag=0.2, delay=0.1))
    simulator.command([0.4, 0.0, 0.0])
    simulator.step(0.5)
    decay = math.exp(-0.4 / 0.2)
    assert simulator.velocity[0] == pytest.approx(0.4 * (1.0 - decay))
    np.testing.assert_allclose(
        simulator.q, [0.0, 0.4 * (0.4 - 0.2 * (1.0 - decay)), 0.5 * math.pi], atol=1e-12)


@every_base
def test_noise_moves_a_measured_base_and_leaves_the_true_one_alone(base):
    robot = make('some', base)
    rng = np.random.default_rng(7)
    T = random_pose(robot, rng)
    joints = 0.5 * (robot.lower[robot.joint_columns] + robot.upper[robot.joint_columns])
    simulator = KinematicSimulator(robot, robot.configuration(joints, T),
                                   noise=SimulatorNoise(noise=0.01))
    errors = []
    for _ in range(400):
        q, _ = simulator.measure()
        robot.state(q)
        D = inverse_pose(T) @ base_pose(robot, q)
        errors.append(np.concatenate((D[:3, 3], rotation_vector(D[:3, :3]))))
    spread = np.std(errors, axis=0)
    for row in range(6):
        assert spread[row] == pytest.approx(0.01, rel=0.15) if row in COLUMNS[base] \
            else spread[row] < 1e-3
    np.testing.assert_allclose(base_pose(robot, simulator.q), T, atol=1e-12)


def test_initial_positions_say_where_the_base_is():
    robot = make('mobile_arm', 'differential')
    q = initial_positions('{base_x: 1.0, base_y: -2.0, base_yaw: 0.5, arm_2: 0.7}', robot)
    # The torso lifts from 0 to 0.35 m.
    assert q.tolist() == [1.0, -2.0, 0.5, 0.175, 0.0, 0.7] + [0.0] * 5
    assert initial_positions('{}', robot)[:3].tolist() == [0.0, 0.0, 0.0]
    free = initial_positions('{base_z: 1.0, base_roll: 0.5}', make('chain', 'floating'))
    np.testing.assert_allclose(free[:7], [0, 0, 1, math.sin(0.25), 0, 0, math.cos(0.25)])
    with pytest.raises(RobotError, match="unknown joint 'base_z'.*valid: base_x, base_y, base_y"):
        initial_positions('{base_z: 1.0}', robot)
    with pytest.raises(RobotError, match='base_x must be a finite number'):
        initial_positions('{base_x: far}', robot)


@pytest.mark.parametrize('kind', ['posture', 'joint_velocity', 'joint_limits'])
def test_joint_tasks_of_a_vehicle_without_joints_are_refused(kind):
    vehicle = Robot.from_urdf('<robot name="car"><link name="base_link"/></robot>', base='planar')
    with pytest.raises(StackError, match='car has no driven joints'):
        Stack.from_yaml(f'- task: {{type: {kind}}}\n', vehicle)
