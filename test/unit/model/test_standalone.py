# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""A URDF that stands alone: located meshes, planar and floating joints."""

import math
import sys

import numpy as np
import pinocchio
import pytest
from tp_controller import Robot, RobotError
from tp_controller.model.standalone import with_located_meshes, with_simple_joints
from tp_controller.resources import package_share

LIMIT = '<limit lower="-1" upper="1" velocity="2" effort="0"/>'


def joint(name, kind, parent, child, more=''):
    """Return the element of a joint."""
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/>{more}</joint>')


def robot_of(*joints, links='abc'):
    """Return a URDF."""
    return '<robot name="r">' + ''.join(f'<link name="{name}"/>' for name in links) \
        + ''.join(joints) + '</robot>'


PLANAR = robot_of(
    joint('p', 'planar', 'a', 'b', '<origin xyz="1 2 3" rpy="0.4 -0.2 0.9"/>'
          '<limit velocity="0.5" effort="3" acceleration="2"/>'),
    joint('h', 'revolute', 'b', 'c', '<origin xyz="0.1 0 0.5"/><axis xyz="0 1 0"/>' + LIMIT))


def test_a_planar_joint_is_that_of_pinocchio():
    robot = Robot.from_urdf(PLANAR)
    assert robot.joint_names == ('p_x', 'p_y', 'p_yaw', 'h')
    model = pinocchio.buildModelFromXML(PLANAR)
    data, q = model.createData(), np.array([0.3, -0.7, math.cos(2.5), math.sin(2.5), -0.4])
    pinocchio.framesForwardKinematics(model, data, q)
    for frame in 'bc':
        np.testing.assert_allclose(
            robot.state([0.3, -0.7, 2.5, -0.4]).pose(frame),
            data.oMf[model.getFrameId(frame, pinocchio.FrameType.BODY)].homogeneous, atol=1e-12)


def test_a_planar_joint_has_velocity_limits_and_no_position_limits():
    robot = Robot.from_urdf(PLANAR)
    assert np.isinf([robot.lower[:3], robot.upper[:3]]).all()
    assert robot.velocity[:3].tolist() == [0.5] * 3 and robot.acceleration[:3].tolist() == [2] * 3
    assert robot.continuous.tolist() == [False, False, True, False]


def test_a_floating_joint_below_the_root_becomes_the_base():
    urdf = robot_of(joint('f', 'floating', 'a', 'b'), joint('h', 'revolute', 'b', 'c', LIMIT))
    found = with_simple_joints(urdf)
    assert found.floating == 'f'
    robot = Robot.from_urdf(urdf, base='floating')
    assert robot.frame_names == ('odom', 'b', 'c') and robot.remarks == ()
    remark, = Robot.from_urdf(urdf).remarks
    assert remark.startswith('the root floats in the description, by joint f, and stands still')
    # The description that a robot publishes gives the same robot.
    assert Robot.from_urdf(robot.urdf).joint_names == ('h',)


@pytest.mark.parametrize('joints', [
    [joint('h', 'revolute', 'a', 'b', LIMIT), joint('f', 'floating', 'b', 'c')],
    [joint('h', 'revolute', 'a', 'b', LIMIT), joint('f', 'floating', 'a', 'c')],
    [joint('e', 'floating', 'a', 'b'), joint('f', 'floating', 'b', 'c')]])
def test_other_floating_joints_are_named(joints):
    with pytest.raises(RobotError, match="joint 'f' is of type floating; only the one joint"):
        Robot.from_urdf(robot_of(*joints))


def test_a_urdf_with_simple_joints_is_not_changed():
    urdf = robot_of(joint('h', 'revolute', 'a', 'b', LIMIT), joint('i', 'fixed', 'b', 'c'))
    assert with_simple_joints(urdf) == (urdf, '', ())


def with_mesh(name):
    """Return an element that names a mesh."""
    return f'<mesh scale="1 1 1" filename="{name}"/>'


@pytest.mark.parametrize('name, expected', [
    ('meshes/part.stl', 'file://{}/arm/urdf/meshes/part.stl'),
    ('../part.stl', 'file://{}/arm/part.stl'),
    ('package://arm/part.stl', 'file://{}/arm/part.stl'),
    ('model://arm/part.stl', 'file://{}/arm/part.stl'),
    ('package://beside/part.stl', 'file://{}/beside/part.stl'),
    ('package://given/part.stl', 'file:///elsewhere/part.stl'),
    ('package://tp_controller/package.xml', None), ('package://none/part.stl', None),
    ('package://arm/none.stl', None), ('package://arm/../beside/part.stl', None),
    ('package://etc/passwd', None), ('package://../beside/part.stl', None), ('package://', None),
    ('none.stl', None), ('/absolute/part.stl', None), ('file:///part.stl', None),
    ('http://host/part.stl', None)])
def test_meshes_are_located(tmp_path, name, expected):
    for folder in ('arm/urdf/meshes', 'arm', 'beside'):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        (tmp_path / folder / 'part.stl').touch()
    found = with_located_meshes(with_mesh(name), tmp_path / 'arm' / 'urdf' / 'arm.urdf',
                                {'given': type(tmp_path)('/elsewhere')})
    assert found == with_mesh(expected.format(tmp_path.resolve()) if expected else name)


@pytest.mark.parametrize('package', ['..', '.', '', '/', 'arm/../beside'])
def test_what_is_no_name_of_a_package_is_not_searched_for(tmp_path, monkeypatch, package):
    monkeypatch.setitem(sys.modules, 'ament_index_python', None)
    monkeypatch.setitem(sys.modules, 'ament_index_python.packages', None)
    (tmp_path / 'arm').mkdir()
    with pytest.raises(FileNotFoundError, match='is not found'):
        package_share(package, tmp_path / 'arm' / 'arm.urdf')


def test_names_of_meshes_stay_valid_xml(tmp_path):
    (tmp_path / 'a&b "c".stl').touch()
    for quote, name in (('"', 'a&amp;b &quot;c&quot;.stl'), ("'", 'a&amp;b "c".stl')):
        text = f'<mesh filename={quote}{name}{quote}/>'
        assert with_located_meshes(text, tmp_path / 'r.urdf', {}) == \
            f'<mesh filename={quote}file://{tmp_path.resolve()}/a&amp;b &quot;c&quot;.stl{quote}/>'
