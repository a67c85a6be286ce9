# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""The URDF of a Pinocchio model: the same kinematics, limits, masses and frames."""

import math

import coal
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pinocchio
import pytest
import robots
from tp_controller import Robot, RobotError
from tp_controller.model.model_urdf import urdf_from_model
from tp_controller.model.urdf_solids import urdf_solids

SEEDS = st.integers(0, 2 ** 32 - 1)
# Turns with a pitch of a right angle, where roll and yaw are not unique, and random ones.
TURNS = (pinocchio.rpy.rpyToMatrix(0.4, math.pi / 2, -0.7),
         pinocchio.rpy.rpyToMatrix(-1.0, -math.pi / 2, 2.0), np.diag([-1.0, 1.0, -1.0]))
FEATURES = {
    'revolute': lambda axis: pinocchio.JointModelRevoluteUnaligned(*axis),
    'x': lambda axis: pinocchio.JointModelRX(),
    'continuous': lambda axis: pinocchio.JointModelRUBY(),
    'prismatic': lambda axis: pinocchio.JointModelPrismaticUnaligned(*axis),
    'planar': lambda axis: pinocchio.JointModelPlanar(),
    'translation': lambda axis: pinocchio.JointModelTranslation(),
    'zyx': lambda axis: pinocchio.JointModelSphericalZYX(),
}


def placement(rng):
    """Return a random placement, one in three with a pitch of a right angle or a half turn."""
    R = TURNS[rng.integers(3)] if rng.integers(3) == 0 else pinocchio.SE3.Random().rotation
    return pinocchio.SE3(R, rng.normal(size=3))


def random_model(rng, floating=False):
    """Return a tree of joints of all kinds, with a body and a tool at each."""
    pinocchio.seed(int(rng.integers(2 ** 31)))
    model = pinocchio.Model()
    model.name = 'tree'
    if floating:
        model.addJoint(0, pinocchio.JointModelFreeFlyer(), pinocchio.SE3.Identity(), 'root')
        model.addBodyFrame('trunk', 1, pinocchio.SE3.Identity(), 0)
    model.appendBodyToJoint(int(floating), pinocchio.Inertia.Random(), pinocchio.SE3.Identity())
    for number, kind in enumerate(rng.permutation(list(FEATURES))):
        axis = rng.normal(size=3)
        joint = FEATURES[kind](axis / np.linalg.norm(axis))
        parent = int(rng.integers(int(floating), model.njoints))
        index = model.addJoint(parent, joint, placement(rng), f'j{number}_{kind}')
        model.appendBodyToJoint(index, pinocchio.Inertia.Random(), pinocchio.SE3.Identity())
        model.addFrame(pinocchio.Frame(f'body{number}', index, 0, placement(rng),
                                       pinocchio.FrameType.BODY))
        model.addFrame(pinocchio.Frame(f'tool{number}', index, 0, placement(rng),
                                       pinocchio.FrameType.OP_FRAME))
    return model


def configuration(model, rng):
    """Return a random configuration of a model, and {joint of the URDF: position}."""
    q, values = pinocchio.neutral(model), {}
    for joint, name in zip(model.joints[1:], model.names[1:]):
        kind, row, angle = name.rpartition('_')[2], joint.idx_q, rng.uniform(-3.0, 3.0)
        x, y, z = rng.uniform(-1.0, 1.0, 3)
        if kind == 'planar':
            q[row:row + 4] = x, y, math.cos(angle), math.sin(angle)
            values.update({f'{name}_x': x, f'{name}_y': y, f'{name}_yaw': angle})
        elif kind == 'translation':
            q[row:row + 3] = x, y, z
            values.update({f'{name}_x': x, f'{name}_y': y, f'{name}_z': z})
        elif kind == 'zyx':
            q[row:row + 3] = z, y, x
            values.update({f'{name}_yaw': z, f'{name}_pitch': y, f'{name}_roll': x})
        elif joint.nq == 2:
            q[row:row + 2] = math.cos(angle), math.sin(angle)
            values[name] = angle
        elif joint.nq == 1:
            q[row] = values[name] = angle
    return q, values


@pytest.mark.slow
@given(SEEDS, st.booleans())
def test_forward_kinematics_are_those_of_the_model(seed, floating):
    rng = np.random.default_rng(seed)
    model = random_model(rng, floating)
    robot = Robot.from_urdf(model)
    q, values = configuration(model, rng)
    state = robot.state([values[name] for name in robot.joint_names])
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    assert robot.name == 'tree' and robot.root == ('trunk' if floating else 'world')
    T = data.oMi[int(floating)].inverse()
    for name in (f'{kind}{number}' for kind in ('body', 'tool')
                 for number in range(len(FEATURES))):
        expected = T * data.oMf[model.getFrameId(name)]
        np.testing.assert_allclose(state.pose(name), expected.homogeneous, rtol=0.0, atol=1e-12)


@pytest.mark.slow
@given(SEEDS)
def test_centre_of_mass_is_that_of_the_model(seed):
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    robot = Robot.from_urdf(model)
    q, values = configuration(model, rng)
    own, data = robot.kinematics.model, model.createData()
    assert own.nq == len(values)
    order = np.array([values[name] for name in own.names[1:]])
    np.testing.assert_allclose(
        pinocchio.centerOfMass(own, own.createData(), order),
        pinocchio.centerOfMass(model, data, q), rtol=0.0, atol=1e-10)
    assert robot.mass == pytest.approx(sum(each.mass for each in model.inertias), rel=1e-12)


@pytest.mark.parametrize('name', sorted(robots.URDFS))
def test_a_robot_read_by_pinocchio_is_the_robot_of_its_urdf(name):
    path = robots.urdf_path(name)
    robot, own = Robot.from_urdf(pinocchio.buildModelFromUrdf(str(path), mimic=True)), \
        Robot.from_urdf(path)
    assert set(robot.frame_names) == set(own.frame_names) and robot.root == own.root
    assert set(robot.joint_names) == set(own.joint_names)
    rows = [robot.joint_names.index(joint) for joint in own.joint_names]
    np.testing.assert_array_equal(robot.velocity[rows], own.velocity)
    q = np.clip(np.linspace(-1.0, 1.0, own.n), own.lower, own.upper)
    state, other = own.state(q), robot.state(q[np.argsort(rows)])
    for frame in own.frame_names:
        np.testing.assert_allclose(state.pose(frame), other.pose(frame), rtol=0.0, atol=1e-12)


def hinge(lower, upper, velocity=math.inf, joint=None):
    """Return a model of one joint with limits."""
    model = pinocchio.Model()
    model.addJoint(0, joint or pinocchio.JointModelRX(), pinocchio.SE3.Identity(), 'hinge',
                   np.array([7.0]), np.array([velocity]), np.array([lower]), np.array([upper]))
    return model


@pytest.mark.parametrize('lower, upper, velocity', [
    (-1.25, 0.5, 2.0), (0.25, math.inf, 0.125), (-math.inf, 3.0, math.inf)])
@pytest.mark.parametrize('joint', [pinocchio.JointModelRX(), pinocchio.JointModelPZ()])
def test_limits_are_those_of_the_model(lower, upper, velocity, joint):
    robot = Robot.from_urdf(hinge(lower, upper, velocity, joint))
    assert (robot.lower[0], robot.upper[0], robot.velocity[0]) == (lower, upper, velocity)
    assert not robot.continuous[0]


def test_a_hinge_without_limits_turns_without_end_and_a_slide_slides():
    turning = Robot.from_urdf(hinge(-math.inf, math.inf))
    sliding = Robot.from_urdf(hinge(-math.inf, math.inf, joint=pinocchio.JointModelPX()))
    assert turning.continuous[0] and not sliding.continuous[0]
    assert np.isinf([*turning.upper, *sliding.lower, *sliding.upper]).all()


def test_mimic_joints_follow():
    model = pinocchio.buildModelFromXML(robots.CHAIN.replace(
        '<axis xyz="1 2 -0.5"/>', '<axis xyz="1 2 -0.5"/><limit velocity="3" effort="0"/>'
    ).replace('type="continuous"', 'type="revolute"').replace(
        '<limit velocity="3"', '<limit lower="-3" upper="3" velocity="3"'), mimic=True)
    robot, own = Robot.from_urdf(model), Robot.from_urdf(robots.CHAIN)
    assert robot.joint_names == own.joint_names == ('a', 'c')
    for frame in own.frame_names:
        np.testing.assert_allclose(robot.state([0.4, 0.3]).pose(frame),
                                   own.state([0.4, 0.3]).pose(frame), rtol=0.0, atol=1e-12)


def test_parts_of_a_composite_joint_are_numbered():
    joint = pinocchio.JointModelComposite()
    joint.addJoint(pinocchio.JointModelRZ(), pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 1.0])))
    joint.addJoint(pinocchio.JointModelPX(), pinocchio.SE3(TURNS[0], np.array([0.5, 0.0, 0.0])))
    model = pinocchio.Model()
    at = pinocchio.SE3(TURNS[1], np.array([0.1, 0.2, 0.3]))
    model.addJoint(0, joint, at, 'both')
    robot = Robot.from_urdf(model)
    assert robot.joint_names == ('both_1', 'both_2')
    data = model.createData()
    pinocchio.forwardKinematics(model, data, np.array([0.3, -0.2]))
    np.testing.assert_allclose(robot.state([0.3, -0.2]).pose('both_link'),
                               data.oMi[1].homogeneous, rtol=0.0, atol=1e-12)


def test_a_free_flyer_that_moves_the_robot_becomes_its_base():
    model = random_model(np.random.default_rng(1), floating=True)
    resting, moving = Robot.from_urdf(model), Robot.from_urdf(model, base='floating')
    assert resting.base_frame == moving.base_frame == 'trunk'
    assert 'the root floats in the description, by joint root' in resting.remarks[0]
    assert moving.remarks == () and moving.n == resting.n + 6


def two_floating():
    """Return a model of two objects that float."""
    model = pinocchio.Model()
    for name in ('one', 'other'):
        model.addJoint(0, pinocchio.JointModelFreeFlyer(), pinocchio.SE3.Identity(), name)
    return model


def floating_hand(joint=None):
    """Return a model with an object that floats relative to a joint."""
    model = pinocchio.Model()
    model.addJoint(0, joint or pinocchio.JointModelRX(), pinocchio.SE3.Identity(), 'hinge')
    model.addJoint(1, pinocchio.JointModelFreeFlyer(), pinocchio.SE3.Identity(), 'hand')
    return model


@pytest.mark.parametrize('model, message', [
    (hinge(-1.0, 1.0, joint=pinocchio.JointModelHX(0.1)), "'hinge' is of type HX; valid: revol"),
    (two_floating(), "joint 'other' floats; only the one joint"),
    (floating_hand(), "joint 'hand' floats; only the one joint"),
    (floating_hand(pinocchio.JointModelFreeFlyer()), "joint 'hand' floats; only the one joint"),
    (pinocchio.Model(), 'no joint to drive')])
def test_joints_that_a_urdf_cannot_express_are_named(model, message):
    with pytest.raises(RobotError, match=message):
        Robot.from_urdf(model)


def test_a_ball_joint_is_named():
    model = pinocchio.Model()
    model.addJoint(0, pinocchio.JointModelSpherical(), pinocchio.SE3.Identity(), 'hip')
    with pytest.raises(RobotError, match="'hip' is of type Spherical; valid: revolute, contin"):
        Robot.from_urdf(model)


def test_names_that_are_used_twice_or_empty_are_changed():
    model = hinge(-1.0, 1.0)
    for name, kind in (('hinge_link', pinocchio.FrameType.OP_FRAME),
                       ('', pinocchio.FrameType.BODY), ('a', pinocchio.FrameType.BODY),
                       ('a', pinocchio.FrameType.OP_FRAME)):
        model.addFrame(pinocchio.Frame(name, 1, 0, pinocchio.SE3(TURNS[0], np.ones(3)), kind),
                       False)
    robot = Robot.from_urdf(model)
    assert set(robot.frame_names) == {'world', 'hinge_link', 'link', 'a'}


SHAPES = [(coal.Box(1.0, 2.0, 3.0), 'Box', [0.5, 1.0, 1.5]), (coal.Sphere(0.5), 'Sphere', [0.5]),
          (coal.Capsule(0.1, 0.6), 'Capsule', [0.1, 0.3]),
          (coal.Cylinder(0.2, 0.8), 'Cylinder', [0.2, 0.4]),
          (coal.Ellipsoid(0.1, 0.3, 0.2), 'Sphere', [0.3])]


@pytest.mark.parametrize('shape, kind, sizes', SHAPES)
def test_shapes_keep_their_sizes_and_places(shape, kind, sizes):
    model, at = hinge(-1.0, 1.0), pinocchio.SE3(TURNS[0], np.array([0.1, 0.2, 0.3]))
    tip = pinocchio.SE3(TURNS[1], np.array([1.0, 0.0, 0.5]))
    frame = model.addFrame(pinocchio.Frame('tip', 1, 0, tip, pinocchio.FrameType.BODY))
    found = urdf_from_model(model, shapes=[
        pinocchio.GeometryObject('s', 1, frame, at, shape)])
    solid, = urdf_solids(found.urdf, ['tip', 'hinge_link'])
    assert solid.frame == 'tip' and type(solid.geometry).__name__ == kind
    own = solid.geometry
    given_sizes = own.halfSide.tolist() if kind == 'Box' else [
        own.radius, *([own.halfLength] if hasattr(own, 'halfLength') else [])]
    assert given_sizes == pytest.approx(sizes)
    np.testing.assert_allclose(tip.homogeneous.dot(solid.pose), at.homogeneous, atol=1e-12)


def test_planes_are_left_out_and_unknown_shapes_are_refused_where_they_are_needed():
    model = hinge(-1.0, 1.0)
    found = urdf_from_model(model, shapes=[
        pinocchio.GeometryObject('floor', 0, pinocchio.SE3.Identity(),
                                 coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)),
        pinocchio.GeometryObject('cone', 1, pinocchio.SE3.Identity(), coal.Cone(0.1, 0.2))])
    assert urdf_solids(found.urdf, ['world']) == []
    with pytest.raises(RobotError, match="unknown collision shape 'cone'; valid: box"):
        urdf_solids(found.urdf, ['hinge_link'])
