# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""MJCF: what Pinocchio reads of it, includes, names, equalities, shapes and faults."""

import struct

import numpy as np
import pinocchio
import pytest
from tp_controller import Robot, RobotError
from tp_controller.model.mjcf import urdf_from_mjcf
from tp_controller.model.urdf_solids import urdf_solids

ARM = """<mujoco model="arm"><compiler angle="degree" {compiler}/>
<default><default class="hinge"><joint axis="0 1 0" range="-90 45"/></default></default>
<worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="base" {base}>
<body name="upper" pos="0 0 0.5" quat="0.6 0 0.8 0"><joint name="shoulder" class="hinge"/>
<joint name="slide" type="slide" axis="0 0 1" range="0 0.2"/>
<geom type="capsule" size="0.05 0.2" mass="2"/>
<body name="lower" pos="0.3 0.1 0" euler="10 20 30"><joint name="elbow" class="hinge"/>
<geom type="sphere" size="0.1" mass="1"/><site name="tip" pos="0 0 0.4"/>
<body name="finger"><joint name="left" type="slide" axis="0 1 0" range="0 0.04"/>
<geom type="box" size="0.1 0.1 0.1"/></body>
<body name="thumb"><joint name="right" type="slide" axis="0 -1 0" range="0 0.04"/>
<geom type="box" size="0.1 0.1 0.1"/></body></body></body></body></worldbody>
{rest}</mujoco>""".format


def write(path, **parts):
    """Write a model to a file, and return its path."""
    path.write_text(ARM(**{'compiler': '', 'base': '', 'rest': '', **parts}))
    return path


@pytest.mark.slow
@pytest.mark.parametrize('as_text', [False, True])
def test_forward_kinematics_are_those_of_pinocchio(tmp_path, as_text):
    path = write(tmp_path / 'arm.xml')
    robot = Robot.from_file(path.read_text() if as_text else path)
    assert robot.joint_names == ('shoulder', 'slide', 'elbow', 'left', 'right')
    assert (robot.name, robot.root, robot.remarks) == ('arm', 'base', ())
    np.testing.assert_allclose(robot.lower, [-np.pi / 2, 0.0, -np.pi / 2, 0.0, 0.0])
    model = pinocchio.buildModelFromMJCF(str(path))
    data, q = model.createData(), np.array([0.4, 0.1, -0.7, 0.01, 0.03])
    pinocchio.framesForwardKinematics(model, data, q)
    for name in ('upper', 'lower', 'finger', 'thumb', 'tip'):
        np.testing.assert_allclose(robot.state(q).pose(name),
                                   data.oMf[model.getFrameId(name)].homogeneous, atol=1e-12)
    assert robot.mass == pytest.approx(pinocchio.computeTotalMass(model))


@pytest.mark.slow
def test_linear_equalities_of_two_joints_are_mimic_joints(tmp_path):
    path = write(tmp_path / 'arm.xml', rest="""<equality>
<joint joint1="right" joint2="left" polycoef="0.01 0.5 0 0 0"/>
<joint joint1="elbow" joint2="shoulder" polycoef="0 1 1 0 0"/>
<joint joint1="slide" joint2="shoulder" active="false"/>
<connect name="loop" body1="finger" body2="thumb" anchor="0 0 0"/></equality>""")
    robot = Robot.from_file(path)
    remark, = robot.remarks
    assert remark.endswith('those joints move by themselves: joint elbow, connect loop')
    assert robot.joint_names == ('shoulder', 'slide', 'elbow', 'left')
    state = robot.state([0.0, 0.0, 0.0, 0.02])
    T = np.linalg.inv(state.pose('lower'))
    assert T.dot(state.pose('thumb'))[1, 3] == pytest.approx(-0.02)
    assert T.dot(state.pose('finger'))[1, 3] == pytest.approx(0.02)


@pytest.mark.slow
@pytest.mark.parametrize('joint', ['<freejoint name="root"/>', '<joint type="free" name="root"/>'])
def test_a_free_joint_of_the_robot_becomes_its_base(tmp_path, joint):
    text = ARM(compiler='', base='', rest='').replace('<body name="base" >',
                                                      f'<body name="base">{joint}')
    path = tmp_path / 'arm.xml'
    path.write_text(text)
    robot = Robot.from_file(path, base='floating')
    assert (robot.base_frame, robot.n, robot.remarks) == ('base', 11, ())
    assert 'the root floats' in Robot.from_file(path).remarks[0]


def test_classes_of_joints_count_for_position_and_axis(tmp_path):
    robot = Robot.from_urdf("""<mujoco><compiler angle="radian"/><default><joint pos="0.5 0 0"/>
<default class="outer"><joint axis="0 1 0"/><default class="inner"><joint pos="0.2 0 0" ref="9"/>
</default></default></default><worldbody><body name="base"><body name="a" childclass="inner">
<joint name="one" class="outer"/></body><body name="c" childclass="outer"><body name="d">
<joint name="three"/></body></body><body name="b"><joint name="two"/></body></body>
</worldbody></mujoco>""")
    state = robot.state([np.pi / 2, np.pi / 2, np.pi / 2])
    np.testing.assert_allclose(state.position('d'), [0.5, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(state.position('a'), [0.5, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(state.position('b'), [0.5, -0.5, 0.0], atol=1e-12)


@pytest.mark.parametrize('joint, expected', [
    ('type="slide" range="-0.1 0.2" ref="0.05"', (-0.1, 0.2)), ('range="-90 45" ref="10"', None),
    ('range="-90 45" limited="false"', (-np.inf, np.inf)), ('', (-np.inf, np.inf)),
    ('type="slide"', (-np.inf, np.inf))])
@pytest.mark.parametrize('several', [False, True])
def test_ranges_are_those_of_mujoco(joint, expected, several):
    more = '<joint name="other" axis="1 0 0" range="-1 1"/>' if several else ''
    robot = Robot.from_urdf(f'<mujoco><worldbody><body name="base"><body name="a"><joint {joint}/>'
                            f'{more}</body></body></worldbody></mujoco>')
    lower, upper = expected or (-np.pi / 2, np.pi / 4)
    assert robot.joint_names == ('a_joint1', *(['other'] if several else []))
    np.testing.assert_allclose([robot.lower[0], robot.upper[0]], [lower, upper])


def test_all_bodies_of_the_world_are_read_and_loose_objects_left_out():
    arm = '<body name="{0}" pos="{1} 0 0"><body name="{0}1"><joint name="{0}2"/></body></body>'
    robot = Robot.from_urdf('<mujoco><worldbody>' + arm.format('left', -1) + arm.format('right', 2)
                            + '<body name="ball"><freejoint/><geom size="1"/></body>'
                            '</worldbody></mujoco>')
    assert robot.joint_names == ('left2', 'right2') and robot.root == 'world'
    assert robot.state([0.0, 0.0]).position('right1').tolist() == [2.0, 0.0, 0.0]
    assert robot.remarks == ('MJCF: without the objects that float: ball',)


@pytest.mark.slow
def test_included_files_are_merged(tmp_path):
    write(tmp_path / 'arm.xml', rest='<keyframe><key qpos="1 2"/></keyframe>')
    (tmp_path / 'scene.xml').write_text(
        '<mujoco model="scene"><include file="arm.xml"/><compiler autolimits="true"/>'
        '<worldbody><light pos="0 0 1"/></worldbody></mujoco>')
    robot = Robot.from_file(tmp_path / 'scene.xml')
    assert robot.joint_names == ('shoulder', 'slide', 'elbow', 'left', 'right')
    # The unit of angles is that of the included file, unless the model has another one after it.
    assert robot.lower[0] == pytest.approx(-np.pi / 2)
    scene = tmp_path / 'scene.xml'
    scene.write_text(scene.read_text().replace('autolimits="true"', 'angle="radian"'))
    assert Robot.from_file(scene).lower[0] == -90.0


def test_collision_shapes_are_on_their_bodies(tmp_path):
    found = urdf_from_mjcf(ARM(compiler='', base='', rest=''))
    solids = {solid.frame: solid for solid in urdf_solids(
        found.urdf, ['base', 'upper', 'lower', 'finger', 'thumb'])}
    assert set(solids) == {'upper', 'lower', 'finger', 'thumb'}
    assert solids['upper'].geometry.radius == 0.05 and solids['upper'].geometry.halfLength == 0.2
    assert solids['finger'].geometry.halfSide.tolist() == [0.1, 0.1, 0.1]


MESH = '<asset><mesh name="part" file="part.stl"/></asset>'
WITH_MESH = '<body name="base" ><geom type="mesh" mesh="part" mass="1"/>'


@pytest.mark.slow
def test_meshes_are_found_in_their_folder(tmp_path):
    (tmp_path / 'assets').mkdir()
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = [corners[list(face)] for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    (tmp_path / 'assets' / 'part.stl').write_bytes(
        bytes(80) + struct.pack('<I', 4) + b''.join(
            struct.pack('<12fH', 0, 0, 1, *face.ravel(), 0) for face in faces))
    path = tmp_path / 'arm.xml'
    path.write_text(ARM(compiler='meshdir="assets"', base='', rest=MESH).replace(
        '<body name="base" >', WITH_MESH))
    robot = Robot.from_file(path)
    assert f'file://{tmp_path}/assets/part.stl' in robot.urdf and robot.remarks == ()
    assert urdf_solids(robot.urdf, ['base'])[0].geometry.num_points == 4


@pytest.mark.slow
@pytest.mark.parametrize('change, message', [
    (('<joint name="elbow" class="hinge"/>', '<joint name="elbow" type="ball"/>'),
     "joint 'elbow' is of type Spherical; valid"),
    (('<joint name="slide" type="slide"', '<joint name="slide" type="ball"'),
     "joint 'slide' is of type Spherical"),
    (('<body name="finger">', '<body name="finger"><freejoint name="loose"/>'), 'arm.xml'),
    (('class="hinge"/>\n<joint', 'class="none"/>\n<joint'),
     "arm.xml: unknown class 'none'; valid: main, hinge"),
    (('<body name="finger">', '<frame pos="1 0 0"/><body name="finger">'),
     '<frame> is not read. Let MuJoCo write'),
    (('<body name="finger">', '<replicate count="3"/><body name="finger">'), '<replicate> is not'),
    (('<worldbody>', '<include file="none.xml"/><worldbody>'), 'no file .*none.xml'),
    (('<worldbody>', '<include file="arm.xml"/><worldbody>'), 'arm.xml: more than 100 includes'),
    (('</mujoco>', ''), 'arm.xml: not valid XML'),
    (('<mujoco', '<!DOCTYPE mujoco><mujoco'), 'document type'),
])
def test_faults_are_named(tmp_path, change, message):
    path = tmp_path / 'arm.xml'
    path.write_text(ARM(compiler='', base='', rest='').replace(*change))
    with pytest.raises(RobotError, match=message):
        Robot.from_file(path)


def test_a_text_cannot_include_files():
    with pytest.raises(RobotError, match='MJCF: a text cannot include the file arm.xml'):
        Robot.from_urdf('<mujoco><include file="arm.xml"/></mujoco>')


@pytest.mark.slow
def test_a_robot_without_its_meshes_has_no_shapes_and_says_so(tmp_path):
    path = tmp_path / 'arm.xml'
    path.write_text(ARM(compiler='', base='', rest=MESH).replace('<body name="base" >', WITH_MESH))
    remark, = Robot.from_file(path).remarks
    assert f'{path}: without collision shapes, which cannot be read' in remark
    assert 'part.stl' in remark
