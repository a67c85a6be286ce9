# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The robot model: DH tables, URDFs, driven and passive joints, limits and faults."""

import math
import re
from xml.etree import ElementTree

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Robot, RobotError
from tp_controller.model.spatial import rotation_from_rpy, rotation_vector
from tp_controller.resources import find_file

SEEDS = st.integers(0, 2 ** 32 - 1)


def rotation(axis, angle):
    """Return the 4×4 rotation about the x or z axis."""
    c, s = math.cos(angle), math.sin(angle)
    T = np.eye(4)
    i, j = {'x': (1, 2), 'z': (0, 1)}[axis]
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


def translation(axis, length):
    """Return the 4×4 translation along the x or z axis."""
    T = np.eye(4)
    T['xyz'.index(axis), 3] = length
    return T


def inside(robot, rng):
    """Return random positions (n,) within the limits."""
    return rng.uniform(np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0))


def numeric_jacobian(robot, q, frame, passive=None, h=1e-6):
    """Return the Jacobian (6, n) of a frame by central differences."""
    J = np.zeros((6, robot.n))
    R = robot.state(q, passive).rotation(frame)
    for index, step in enumerate(h * np.eye(robot.n)):
        before, after = robot.state(q - step, passive), robot.state(q + step, passive)
        J[:3, index] = (after.position(frame) - before.position(frame)) / (2 * h)
        J[3:, index] = (rotation_vector(after.rotation(frame) @ R.T)
                        - rotation_vector(before.rotation(frame) @ R.T)) / (2 * h)
    return J


# Denavit-Hartenberg tables

@given(SEEDS, st.sampled_from(['standard', 'modified']),
       st.lists(st.sampled_from(['revolute', 'continuous', 'prismatic']), min_size=1, max_size=5))
def test_dh_table_gives_the_product_of_its_transforms(seed, convention, types):
    rng = np.random.default_rng(seed)
    rows = [{'name': f'j{index}', 'type': kind, 'a': rng.normal(), 'alpha': rng.normal(),
             'd': rng.normal(), 'theta': rng.normal(), 'lower': -3.0, 'upper': 3.0}
            for index, kind in enumerate(types)]
    robot = Robot.from_dh(rows, convention)
    q = rng.normal(size=robot.n)
    state = robot.state(q)
    T = np.eye(4)
    for index, (row, position) in enumerate(zip(rows, q), start=1):
        slides = row['type'] == 'prismatic'
        theta = row['theta'] + (0.0 if slides else position)
        d = row['d'] + (position if slides else 0.0)
        x = translation('x', row['a']) @ rotation('x', row['alpha'])
        z = rotation('z', theta) @ translation('z', d)
        T = T @ (z @ x if convention == 'standard' else x @ z)
        np.testing.assert_allclose(state.pose(f'link{index}'), T, atol=1e-12)
    assert robot.joint_units == tuple('m' if kind == 'prismatic' else 'rad' for kind in types)


def test_lab_arm_is_where_plane_geometry_puts_it():
    robot = robots.planar()
    q = np.array(robots.PLANAR_START)
    angles = np.cumsum(q)
    lengths = np.array([0.75, 0.5, 0.5])
    tool = [lengths @ np.cos(angles), lengths @ np.sin(angles), 0.0]
    np.testing.assert_allclose(robot.state(q).position('link3'), tool, atol=1e-15)
    assert robot.velocity.tolist() == [1.0, 1.0, 1.0]
    assert np.isinf(robot.lower).all() and np.isinf(robot.upper).all()


def test_panda_by_dh_is_the_panda_by_urdf():
    by_table = robots.panda()
    by_urdf = robots.urdf_robot('panda', by_table.joint_names)
    common = [name for name in by_table.frame_names if name in by_urdf.frame_names]
    assert len(common) >= 10 and robots.PANDA_TOOL in common
    rng = np.random.default_rng(0)
    for _ in range(25):
        q = inside(by_table, rng)
        one, other = by_table.state(q), by_urdf.state(q)
        for frame in common:
            np.testing.assert_allclose(one.pose(frame), other.pose(frame), atol=1e-9)
            np.testing.assert_allclose(one.jacobian(frame), other.jacobian(frame), atol=1e-9)
    assert by_table.root == by_urdf.root


def test_convention_in_the_call_goes_before_the_one_in_the_table():
    rows = [{'name': 'a', 'a': 0.3, 'alpha': 0.5}, {'name': 'b', 'a': 0.2}]
    table = {'convention': 'modified', 'joints': rows}
    assert Robot.from_dh(table).state([0.1, 0.2]).position('link1') == pytest.approx([0.3, 0, 0])
    q = [0.1, 0.2]
    standard = Robot.from_dh(table, 'standard')
    np.testing.assert_allclose(standard.state(q).pose('link2'),
                               Robot.from_dh(rows).state(q).pose('link2'))


@pytest.mark.slow
def test_dh_table_as_text_as_file_and_as_list_is_the_same_robot(tmp_path):
    text = 'joints:\n- {name: a, a: 0.3}\n- {name: b, alpha: 0.2, d: 1.0}\n'
    file = tmp_path / 'arm.yaml'
    file.write_text(text, encoding='utf-8')
    rows = [{'name': 'a', 'a': 0.3}, {'name': 'b', 'alpha': 0.2, 'd': 1.0}]
    poses = [robot.state([0.4, 0.5]).pose('link2').tolist() for robot in (
        Robot.from_dh(text), Robot.from_dh(file), Robot.from_dh(str(file)), Robot.from_dh(rows),
        Robot.from_file(file))]
    assert all(pose == poses[0] for pose in poses)


def test_extra_frames_of_a_dh_table_sit_on_their_parents():
    robot = Robot.from_dh({
        'name': 'arm', 'root': 'ground', 'joints': [{'name': 'a', 'a': 1.0, 'link': 'upper_arm'}],
        'frames': [{'name': 'tool', 'xyz': [0.0, 0.2, 0.1], 'rpy': [0.1, 0.2, 0.3]},
                   {'name': 'camera', 'parent': 'ground', 'xyz': [0.0, 0.0, 2.0]}]})
    state = robot.state([math.pi / 2])
    assert state.position('tool') == pytest.approx([-0.2, 1.0, 0.1])
    np.testing.assert_allclose(
        state.rotation('tool'),
        rotation('z', math.pi / 2)[:3, :3] @ rotation_from_rpy(0.1, 0.2, 0.3), atol=1e-12)
    assert state.position('camera') == pytest.approx([0.0, 0.0, 2.0])
    assert (robot.name, robot.root) == ('arm', 'ground')


def test_limits_of_a_dh_table_arrive_and_missing_ones_are_none():
    robot = robots.mixed()
    assert robot.lower.tolist() == [-2.0, -0.2, -math.inf, -math.inf]
    assert robot.upper.tolist() == [2.5, 0.6, math.inf, math.inf]
    assert robot.velocity.tolist() == [1.5, 0.4, 2.0, 3.0]
    assert robot.continuous.tolist() == [False, False, True, True]
    assert Robot.from_dh([{'name': 'a'}]).velocity.tolist() == [math.inf]
    half = Robot.from_dh([{'name': 'a', 'lower': -1.0}, {'name': 'b', 'type': 'prismatic'}])
    assert (half.lower.tolist(), half.upper.tolist()) == ([-1.0, -math.inf], [math.inf] * 2)


@pytest.mark.parametrize('table, message', [
    ([], 'list of joints'),
    ({'joints': []}, 'list of joints'),
    ({'joints': 5}, 'joints: needs a list'),
    ([{'a': 1.0}], 'joints, row 1: needs a mapping with a name'),
    ([{'name': 'a'}, 5], 'joints, row 2'),
    ([{'name': 'a', 'alfa': 1.0}], "a: unknown key 'alfa' .did you mean 'alpha'"),
    ([{'name': 'a', 'alpha': 'x'}], "a: alpha must be a number, not 'x'"),
    ([{'name': 'a', 'alpha': True}], 'a: alpha must be a number'),
    ([{'name': 'a', 'd': math.nan}], 'a: d must be a number'),
    ([{'name': 'a', 'd': math.inf}], 'a: d must be finite'),
    ([{'name': 'a', 'type': 'ball'}], "a: unknown joint type 'ball'; valid: revolute"),
    ([{'name': 'a', 'link': 5}], 'a: link must be a name'),
    ([{'name': 'a'}, {'name': 'a'}], 'joint names used twice: a'),
    ([{'name': 'a', 'link': 'base_link'}], 'frame names used twice: base_link'),
    ([{'name': 'a', 'lower': 1.0, 'upper': 0.0}], 'joint a: lower limit 1 must'),
    ([{'name': 'a', 'velocity': -1.0}], 'a: velocity must not be negative'),
    ({'joints': [{'name': 'a'}], 'base': 'b'}, "DH table: unknown key 'base'"),
    ({'joints': [{'name': 'a'}], 'root': 5}, 'root must be a name'),
    ({'joints': [{'name': 'a'}], 'convention': 'craig'}, "unknown DH convention 'craig'"),
    ({'joints': [{'name': 'a'}], 'frames': [{'name': 'f', 'parent': 'x'}]},
     "frame f: unknown parent 'x'; valid: base_link, link1"),
    ({'joints': [{'name': 'a'}], 'frames': [{'name': 'f', 'xyz': [1, 2]}]}, 'xyz needs three'),
    ({'joints': [{'name': 'a'}], 'frames': [{'name': 'f', 'rpy': [1, 2, 'x']}]}, 'frame f: rpy'),
    ('joints: [\n', 'DH table: not valid YAML: '),
    ('joints: [{name: a, a: 2001-13-45}]', 'DH table'),
    ('no/such/table.yaml', 'robot description: no file no/such/table.yaml'),
    ('package://tp_controler/panda.yaml', "^robot description: package 'tp_controler' .did you "
                                          "mean 'tp_controller'.. is not found"),
])
def test_fault_in_a_dh_table_is_named(table, message):
    with pytest.raises(RobotError, match=message):
        Robot.from_dh(table)


# Joints without a range

RANGES = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<joint name="arm" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" velocity="2" effort="0"/></joint>
<joint name="finger" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/>
  <limit {finger} velocity="2" effort="0"/></joint>
<joint name="mimic" type="prismatic"><parent link="b"/><child link="d"/><axis xyz="1 0 0"/>
  <limit {mimic} velocity="2" effort="0"/>
  <mimic joint="finger" multiplier="{multiplier}" offset="{offset}"/></joint></robot>"""


def with_range(finger='lower="0" upper="0.5"', mimic='lower="-9" upper="9"', multiplier=1.0,
               offset=0.0):
    """Return a URDF: an arm, a finger on it and a joint that mimics the finger."""
    return RANGES.format(finger=finger, mimic=mimic, multiplier=multiplier, offset=offset)


@pytest.mark.parametrize('given', [
    {'finger': 'lower="0" upper="0"'}, {'finger': 'lower="0" upper="-0.0"'}, {'finger': ''},
    {'finger': 'lower="0.3" upper="0.3"'}, {'mimic': 'lower="0" upper="0.5"', 'multiplier': -1.0},
    # 0.3 − 0.1 is not 0.2 to the last digit.
    {'finger': 'lower="0" upper="0.2"', 'mimic': 'lower="0.3" upper="1"', 'offset': 0.1}])
def test_joint_without_a_range_is_passive_unless_it_is_named(given):
    urdf = with_range(**given)
    robot = Robot.from_urdf(urdf)
    assert (robot.joint_names, robot.passive_names) == (('arm',), ('finger',))
    with pytest.raises(RobotError, match=r'joint finger: lower limit \S+ must be below upper '
                                         r'limit .*; leave it out of the driven ones .joints.'
                       ) as error:
        Robot.from_urdf(urdf, joints=['arm', 'finger'])
    assert '-0' not in str(error.value)
    limits = {'finger': {'lower': 0.0, 'upper': 0.1}}
    assert Robot.from_urdf(urdf, limits=limits).joint_names == ('arm', 'finger')


@pytest.mark.parametrize('given', [
    {'finger': 'lower="0.5" upper="0"'}, {'mimic': 'lower="0.6" upper="0.5"'},
    {'mimic': 'lower="0.7" upper="0.8"'}])
def test_contradictory_limits_are_refused_where_the_joint_is_driven(given):
    with pytest.raises(RobotError, match='joint finger: lower limit .* leave it out'):
        Robot.from_urdf(with_range(**given))
    assert Robot.from_urdf(with_range(**given), joints=['arm']).passive_names == ('finger',)


def test_robot_whose_joints_all_lack_a_range_has_nothing_to_drive():
    still = with_range(finger='').replace('lower="-1" upper="1"', '')
    with pytest.raises(RobotError, match='no joint to drive; their limits leave no range: arm, f'):
        Robot.from_urdf(still)
    assert Robot.from_urdf(still, base='planar').passive_names == ('arm', 'finger')


# Real robots

@pytest.mark.parametrize('name, driven, passive', [
    ('pr2', 18, ('l_gripper_l_finger_joint', 'r_gripper_l_finger_joint')),
    ('centauro', 35, tuple(f'j_wheel_{number}' for number in range(1, 5))),
    ('quadruped', 4, ('BL_KFE', 'BR_KFE', 'FL_KFE', 'FR_KFE'))])
def test_real_robot_loads_without_its_joints_that_have_no_range(name, driven, passive):
    robot = robots.urdf_robot(name)
    assert (len(robot.joint_names), robot.passive_names) == (driven, passive)


@pytest.mark.parametrize('name', robots.URDFS)
def test_real_robot_has_the_limits_of_its_urdf(name):
    robot = robots.urdf_robot(name)
    elements = {joint.get('name'): joint
                for joint in ElementTree.parse(robots.urdf_path(name)).findall('joint')}
    followers = {joint.find('mimic').get('joint') for joint in elements.values()
                 if joint.find('mimic') is not None}
    assert robot.n >= 6
    for index, joint in enumerate(robot.joint_names):
        if joint in followers:
            continue
        limit = elements[joint].find('limit')
        endless = elements[joint].get('type') == 'continuous'
        assert robot.continuous[index] == endless
        if not endless:
            assert robot.lower[index] == float(limit.get('lower', 0.0))
            assert robot.upper[index] == float(limit.get('upper', 0.0))
        if limit is not None:
            assert robot.velocity[index] == float(limit.get('velocity'))


@pytest.mark.parametrize('name', robots.URDFS)
def test_jacobian_of_a_real_robot_is_the_derivative_of_its_pose(name):
    robot = robots.urdf_robot(name)
    q = inside(robot, np.random.default_rng(1))
    for frame in (robots.TOOLS[name], robot.frame_names[len(robot.frame_names) // 2]):
        np.testing.assert_allclose(robot.state(q).jacobian(frame),
                                   numeric_jacobian(robot, q, frame), atol=1e-8)


@pytest.mark.parametrize('name', robots.URDFS)
def test_driven_joints_in_any_order_move_the_robot_as_the_whole_does(name):
    whole = robots.urdf_robot(name)
    rng = np.random.default_rng(2)
    q = inside(whole, rng)
    chosen = [whole.joint_names[index] for index in rng.permutation(whole.n)[:whole.n // 2]]
    part = robots.urdf_robot(name, tuple(chosen))
    assert part.joint_names == tuple(chosen)
    assert set(part.passive_names) == set(whole.joint_names) - set(chosen)
    driven = [whole.joint_index(joint) for joint in chosen]
    passive = [whole.joint_index(joint) for joint in part.passive_names]
    one, other = whole.state(q), part.state(q[driven], q[passive])
    frame = robots.TOOLS[name]
    np.testing.assert_allclose(other.pose(frame), one.pose(frame), atol=1e-12)
    np.testing.assert_allclose(other.jacobian(frame), one.jacobian(frame)[:, driven], atol=1e-12)
    for key in ('lower', 'upper', 'velocity', 'continuous'):
        assert getattr(part, key).tolist() == getattr(whole, key)[driven].tolist()
    moved = part.integrate(q[driven], np.arange(1.0, part.n + 1), 0.5)
    np.testing.assert_allclose(moved, q[driven] + 0.5 * np.arange(1, part.n + 1))


# Passive and mimic joints

def urdf(*joints):
    """Return the URDF of a chain of links l0, l1 … with joints (name, type, inner XML)."""
    links = ''.join(f'<link name="l{index}"/>' for index in range(len(joints) + 1))
    chain = ''.join(
        f'<joint name="{name}" type="{kind}"><parent link="l{index}"/>'
        f'<child link="l{index + 1}"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>{inner}</joint>'
        for index, (name, kind, inner) in enumerate(joints))
    return f'<robot name="chain">{links}{chain}</robot>'


LIMIT = '<limit lower="-1" upper="2" velocity="3" effort="0"/>'
WIDE = '<limit lower="-9" upper="9" velocity="90" effort="0"/>'


@pytest.mark.parametrize(('kind', 'inner', 'limits', 'found'), [
    ('revolute', '<limit lower="-1" upper="2" effort="1"/>', {}, (-1.0, 2.0, math.inf)),
    ('prismatic', '<limit lower="-1" upper="2"/>', {}, (-1.0, 2.0, math.inf)),
    ('revolute', '<limit lower="-1" upper="2"/>', {'velocity': 0.5}, (-1.0, 2.0, 0.5)),
    ('revolute', '', {'lower': -1.0, 'upper': 1.0, 'velocity': 0.5}, (-1.0, 1.0, 0.5)),
    ('continuous', '<limit effort="1"/>', {}, (-math.inf, math.inf, math.inf)),
    ('revolute', '<limit lower="-1" upper="2" velocity="inf" effort="x"/>', {},
     (-1.0, 2.0, math.inf))])
def test_limits_that_a_description_lacks_are_none_or_come_from_outside(kind, inner, limits, found):
    robot = Robot.from_urdf(urdf(('a', kind, inner)), limits={'a': limits} if limits else None)
    assert (robot.lower[0], robot.upper[0], robot.velocity[0]) == found
    moved = robot.state([0.7]).position('l1') - robot.state([0.0]).position('l1')
    assert moved == pytest.approx([0.0, 0.0, 0.7 if kind == 'prismatic' else 0.0])


def test_reach_follows_the_limits_in_force():
    source = urdf(('a', 'prismatic', ''))
    for end in (0.5, 3.0):
        robot = Robot.from_urdf(source, limits={'a': {'lower': -0.1, 'upper': end}})
        # The origin of the joint is 1 m from that of its parent.
        assert robot.reach('l1') == pytest.approx(1.0 + end)


def test_position_limits_that_look_like_degrees_are_remarked():
    degrees = '<limit lower="-120" upper="120" velocity="1"/>'
    robot = Robot.from_urdf(urdf(
        ('a', 'revolute', degrees), ('b', 'revolute', LIMIT), ('c', 'prismatic', degrees),
        ('d', 'continuous', ''), ('e', 'revolute', degrees.replace('120', '12.5664'))))
    assert robot.remarks == (
        'position limits beyond two turns, which look like degrees: a (-120 to 120); limits are '
        'in rad',)
    assert Robot.from_urdf(robot.urdf, limits={'a': {'lower': -2.0, 'upper': 2.0}}).remarks == ()


def test_passive_joints_stay_where_they_were_set():
    robot = Robot.from_urdf(urdf(('a', 'revolute', LIMIT), ('b', 'revolute', LIMIT)), joints=['b'])
    assert (robot.joint_names, robot.passive_names) == (('b',), ('a',))
    state = robot.state([0.0], [math.pi / 2])
    assert state.position('l2') == pytest.approx([1.0, 1.0, 0.0])
    state.update([0.3])
    assert state.position('l2') == pytest.approx([1.0, 1.0, 0.0])
    state.update([0.3], [0.0])
    assert state.position('l2') == pytest.approx([2.0, 0.0, 0.0])
    assert robot.state([0.0]).position('l2') == pytest.approx([2.0, 0.0, 0.0])


def test_passive_joint_that_is_not_told_of_stays_within_its_limits():
    bent = '<limit lower="0.5" upper="2" velocity="3" effort="0"/>'
    robot = Robot.from_urdf(urdf(('a', 'revolute', bent), ('b', 'revolute', LIMIT)), joints=['b'])
    assert robot.state([0.0]).position('l2') == pytest.approx(
        [1.0 + math.cos(0.5), math.sin(0.5), 0.0])


def test_mimic_joints_follow_through_a_chain_of_multipliers_and_offsets():
    robot = Robot.from_urdf(urdf(
        ('a', 'revolute', LIMIT),
        ('b', 'revolute', WIDE + '<mimic joint="a" multiplier="2" offset="0.1"/>'),
        ('c', 'revolute', WIDE + '<mimic joint="b" multiplier="-0.5" offset="0.3"/>'),
        ('d', 'revolute', WIDE + '<mimic joint="a"/>')))
    assert robot.joint_names == ('a',)
    a = 0.4
    b = 2 * a + 0.1
    angles = np.cumsum([a, b, -0.5 * b + 0.3, a])
    expected = [1 + np.cos(angles[:3]).sum(), np.sin(angles[:3]).sum(), 0.0]
    state = robot.state([a])
    assert state.position('l4') == pytest.approx(expected)
    np.testing.assert_allclose(state.rotation('l4'), rotation('z', angles[3])[:3, :3], atol=1e-12)
    np.testing.assert_allclose(state.jacobian('l4'), numeric_jacobian(robot, [a], 'l4'), atol=1e-8)
    assert robot.integrate(np.array([a]), np.array([1.0]), 0.1) == pytest.approx([0.5])


def test_mimic_joint_follows_a_passive_one_too():
    robot = Robot.from_urdf(urdf(
        ('a', 'revolute', LIMIT), ('b', 'revolute', WIDE + '<mimic joint="a" multiplier="-1"/>'),
        ('c', 'revolute', LIMIT)), joints=['c'])
    state = robot.state([0.2], [math.pi / 2])
    assert state.position('l3') == pytest.approx([2.0, 1.0, 0.0])
    assert state.jacobian('l3').tolist() == [[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]]


def test_joint_that_others_mimic_keeps_their_limits_too():
    tight = '<limit lower="-1" upper="0.5" velocity="1" effort="0"/>'
    robot = Robot.from_urdf(urdf(
        ('a', 'revolute', LIMIT),
        ('b', 'revolute', tight + '<mimic joint="a" multiplier="-2" offset="0.1"/>')))
    # −1 ≤ −2 a + 0.1 ≤ 0.5 and 2 |ȧ| ≤ 1
    assert robot.lower == pytest.approx([-0.2])
    assert robot.upper == pytest.approx([0.55])
    assert robot.velocity == pytest.approx([0.5])


def test_limits_that_exclude_those_of_a_follower_can_be_replaced():
    source = urdf(('a', 'revolute', '<limit lower="0" upper="0.5" velocity="1" effort="0"/>'),
                  ('b', 'revolute', '<limit lower="0" upper="0.5" velocity="1" effort="0"/>'
                   '<mimic joint="a" multiplier="-1"/>'))
    with pytest.raises(RobotError, match=r'joint a: .*those of b included'):
        Robot.from_urdf(source, joints=['a'])
    robot = Robot.from_urdf(source, limits={'a': {'upper': 0.3}})
    assert (robot.lower[0], robot.upper[0]) == (0.0, 0.3)


def test_panda_gripper_opens_with_both_fingers():
    robot = robots.urdf_robot('panda')
    q = np.zeros(robot.n)
    q[robot.joint_index('panda_finger_joint1')] = 0.03
    state = robot.state(q)
    apart = state.position('panda_leftfinger') - state.position('panda_rightfinger')
    assert np.linalg.norm(apart) == pytest.approx(0.06)


# Limits

def test_single_limits_can_be_replaced():
    limits = {'joint2': {'lower': -0.5, 'upper': 1}, 'joint1': {'velocity': 0.2}}
    robot = Robot.from_file(robots.PLANAR_DH, limits=limits)
    assert robot.lower.tolist() == [-math.inf, -0.5, -math.inf]
    assert robot.upper.tolist() == [math.inf, 1.0, math.inf]
    assert robot.velocity.tolist() == [0.2, 1.0, 1.0]


def test_continuous_joint_of_a_urdf_has_no_position_limits_but_its_speed():
    robot = Robot.from_urdf(urdf(('a', 'continuous', LIMIT), ('b', 'continuous', '')))
    assert robot.lower.tolist() == [-math.inf] * 2 and robot.upper.tolist() == [math.inf] * 2
    assert robot.velocity.tolist() == [3.0, math.inf]
    assert robot.state([1e3, 0.0]).position('l2') == pytest.approx(
        [1 + math.cos(1e3), math.sin(1e3), 0.0])


def test_neutral_is_as_near_to_zero_as_the_limits_allow():
    robot = robots.panda()
    assert robot.neutral().tolist() == [0, 0, 0, -0.0698, 0, 0, 0]


@pytest.mark.parametrize('limits, message', [
    ({'joint9': {'lower': 0}}, "unknown driven joint 'joint9' .did you mean"),
    ({'joint1': {'low': 0}}, "joint joint1: unknown limit 'low'"),
    ({'joint1': {'lower': 'a'}}, 'joint joint1: lower limit must be a number'),
    ({'joint1': 5}, 'joint joint1: limits need a mapping'),
    ({'joint1': {'lower': 1, 'upper': 1}}, 'joint joint1: lower limit 1'),
    ({'joint1': {'lower': math.nan}}, 'joint joint1: lower limit must be a number, not nan'),
    ({'joint1': {'velocity': -1}}, 'joint joint1: velocity limit -1'),
    ({'joint1': {'velocity': math.nan}}, 'joint joint1: velocity limit must be a number, not nan'),
])
def test_limits_that_make_no_sense_are_refused(limits, message):
    with pytest.raises(RobotError, match=message):
        Robot.from_file(robots.PLANAR_DH, limits=limits)


# State

def test_arrays_are_protected_and_stay_true_to_their_configuration():
    robot = robots.panda()
    state = robot.state(robots.PANDA_READY)
    arrays = [robot.lower, robot.upper, robot.velocity, robot.continuous, state.q,
              state.rotation(robots.PANDA_TOOL), state.position(robots.PANDA_TOOL),
              state.pose(robots.PANDA_TOOL), state.jacobian(robots.PANDA_TOOL)]
    copies = [array.copy() for array in arrays]
    state.update(robot.neutral())
    for array, copy in zip(arrays, copies):
        assert (array == copy).all()
        with pytest.raises(ValueError, match='read-only'):
            array[...] = 0
    assert not np.allclose(state.position(robots.PANDA_TOOL), copies[6])


def test_state_keeps_its_own_copy_of_the_positions():
    q = np.array(robots.PANDA_READY)
    state = robots.panda().state(q)
    q[0] = 9.0
    assert state.q[0] == 0.0


@pytest.mark.parametrize('q, message', [
    ([0.0, 0.0], r'needs 3 positions .joint1, joint2, joint3.*shape \(2,\)'),
    ([[0.0, 0.0, 0.0]], 'needs 3 positions'),
    (None, 'needs 3 positions'),
    (['a', 'b', 'c'], 'needs 3 positions'),
    ([[1], [1, 2], []], 'needs 3 positions'),
    ([0.0, math.nan, 0.0], 'not finite for joint2'),
    ([math.inf, 0.0, -math.inf], 'not finite for joint1, joint3'),
])
def test_positions_that_are_none_are_refused_and_change_nothing(q, message):
    state = robots.planar().state(robots.PLANAR_START)
    with pytest.raises(RobotError, match=message):
        state.update(q)
    assert state.q.tolist() == list(robots.PLANAR_START)


def test_passive_positions_that_are_none_are_refused():
    robot = robots.urdf_robot('panda', ('panda_joint1',))
    with pytest.raises(RobotError, match='passive needs 7 positions .panda_joint2'):
        robot.state([0.0], [0.0])
    with pytest.raises(RobotError, match='passive is not finite for panda_joint3'):
        robot.state([0.0], [0.0, math.nan, *[0.0] * 5])


def test_unknown_frame_is_named_with_the_valid_ones():
    state = robots.planar().state(robots.PLANAR_START)
    for ask in (state.position, state.rotation, state.pose, state.jacobian):
        with pytest.raises(RobotError, match="unknown frame 'link4' .did you mean 'link3'"):
            ask('link4')
    with pytest.raises(RobotError, match='unknown frame'):
        robots.planar().check_frame(['link3'])
    with pytest.raises(RobotError, match='unknown driven joint'):
        robots.planar().joint_index(['joint1'])


# Faults of a URDF

@pytest.mark.parametrize('kind', ['ball', ''])
def test_joint_of_an_unsupported_type_is_named(kind):
    with pytest.raises(RobotError, match=f"joint 'a' is of type '{kind}'; valid: fixed, revol"):
        Robot.from_urdf(urdf(('a', kind, LIMIT)))


@pytest.mark.parametrize('source, message', [
    ('<robot', 'not valid XML'),
    ('<sdf/>', 'outermost element is <sdf>'),
    ('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
     'the text is a xacro: give the name of its file'),
    ('<robot name="r"><link name="a"/><link name="b"/></robot>', 'robot description'),
    (urdf(), 'no joint to drive'),
    (urdf(('a', 'fixed', '')), 'no joint to drive'),
    (urdf(('a', 'revolute', '<mimic joint="b"/>' + LIMIT)), "'a' mimics unknown joint 'b'"),
    (urdf(('a', 'revolute', '<mimic joint="b"/>' + LIMIT),
          ('b', 'revolute', '<mimic joint="a"/>' + LIMIT)), "joint 'a' mimics itself"),
    (urdf(('a', 'revolute', '<limit lower="x" upper="1" velocity="1" effort="0"/>')),
     "joint 'a', limit: lower needs a finite number, got 'x'"),
    (urdf(('a', 'revolute', LIMIT + '<axis xyz="0 1"/>')),
     "joint 'a', axis: xyz needs 3 finite numbers, got '0 1'"),
    (urdf(('a', 'revolute', LIMIT + '<axis xyz="0 0 0"/>')), "'a', axis: an axis needs a direct"),
    (urdf(('a', 'fixed', '<origin rpy="0 nan 0"/>')), "joint 'a', origin: rpy needs 3 finite"),
    (urdf(('a', 'revolute', LIMIT)).replace(
        '<link name="l1"/>', '<link name="l1"><inertial><mass value="k"/></inertial></link>'),
     "link 'l1', mass: value needs a finite number, got 'k'"),
    ('no/such/robot.urdf', 'no file no/such/robot.urdf'),
    ('package://no_such_package/robot.urdf', 'no_such_package'),
    ('~no_such_user_here/robot.urdf', 'no file ~no_such_user_here'),
])
def test_fault_in_a_description_is_named(source, message):
    with pytest.raises(RobotError, match=message):
        Robot.from_urdf(source)


@pytest.mark.parametrize('joints, message', [
    (['a', 'x'], "unknown joint 'x'"),
    (['a', 'a'], 'named twice'),
    (['b'], "joint 'b' mimics 'a': drive that one"),
    ([], 'no joint to drive'),
])
def test_wrong_choice_of_driven_joints_is_refused(joints, message):
    source = urdf(('a', 'revolute', LIMIT), ('b', 'revolute', WIDE + '<mimic joint="a"/>'))
    with pytest.raises(RobotError, match=message):
        Robot.from_urdf(source, joints=joints)


def test_unknown_base_is_refused():
    with pytest.raises(RobotError, match="unknown base 'rolling'; valid: fixed, planar"):
        Robot.from_urdf(urdf(('a', 'revolute', LIMIT)), base='rolling')


# Files

def test_own_files_are_found_by_package_name():
    name = 'package://tp_controller/config/robots/planar_3r.yaml'
    assert find_file(name).read_bytes() == robots.PLANAR_DH.read_bytes()
    assert Robot.from_file(name).joint_names == robots.planar().joint_names


def test_urdf_by_path_and_by_text_is_the_same_robot():
    path = robots.urdf_path('panda')
    by_text = Robot.from_urdf(path.read_text(encoding='utf-8'))
    assert Robot.from_file(str(path)).joint_names == by_text.joint_names
    # Meshes of a file are found without it.
    by_path = Robot.from_urdf(path).urdf
    assert by_text.urdf == by_path.replace(f'file://{path.parents[3]}',
                                           'package://example-robot-data')


def test_urdf_of_a_dh_table_gives_the_same_robot_again():
    robot = robots.panda()
    again = Robot.from_urdf(robot.urdf)
    q = robots.PANDA_READY
    np.testing.assert_array_equal(again.state(q).pose(robots.PANDA_TOOL),
                                  robot.state(q).pose(robots.PANDA_TOOL))
    assert again.lower.tolist() == robot.lower.tolist()


@pytest.mark.parametrize('text, named', [
    (urdf(('a', 'revolute', '')), 'leave no range: a'),
    (urdf(('a', 'revolute', '<limit lower="0" upper="1" velocity="x"/>')),
     "joint a: velocity limit 'x' is not a number"),
    (urdf(('a', 'revolute', LIMIT)).replace('child link="l1"', 'child link="nowhere"'),
     "joint 'a', child: unknown link 'nowhere'"),
    (urdf(('a', 'revolute', LIMIT), ('a', 'revolute', LIMIT)), "joint .*'a'"),
    (urdf(('a', 'revolute', LIMIT)).replace('</robot>', '<link name="l1"/></robot>'),
     "link .*'l1'"),
    (urdf(('a', 'revolute', LIMIT)).replace('</robot>', '<link name="lost"/></robot>'),
     'without a parent are: .*lost'),
])
def test_what_makes_a_description_no_tree_is_named(text, named):
    with pytest.raises(RobotError, match=named) as caught:
        Robot.from_urdf(text)
    assert '\n' not in str(caught.value)


def test_robot_without_a_name_is_called_robot():
    text = re.sub('<robot name="[^"]*">', '<robot>', urdf(('a', 'revolute', LIMIT)))
    assert Robot.from_urdf(text).name == 'robot'
