# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""The centre of mass of all links, and the task that moves it."""

from xml.etree import ElementTree

import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack, TaskError
from tp_controller.model.spatial import pose, rotation_from_rpy
from tp_controller.tasks import CenterOfMass

PERIOD = 0.01
PLACES = {'baxter': [0.4, -0.5, -0.6, 1.3, 0.5, 0.8, 0.1, -0.4, -0.5, 0.6, 1.3, -0.5, 0.8, -0.1]}
ARMS = tuple(f'{side}_{joint}' for side in ('left', 'right')
             for joint in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2'))


def weighed(robot, state):
    """Return mass and centre of mass, link by link as the description has them."""
    total, moment = 0.0, np.zeros(3)
    for link in ElementTree.fromstring(robot.urdf).iter('link'):
        inertial = link.find('inertial')
        if inertial is None:
            continue
        mass = float(inertial.find('mass').get('value'))
        origin = inertial.find('origin')
        local = [float(word) for word in origin.get('xyz', '0 0 0').split()] \
            if origin is not None else [0.0] * 3
        total += mass
        moment += mass * (state.pose(link.get('name')) @ [*local, 1.0])[:3]
    return total, moment / total


@pytest.mark.parametrize('robot', [
    lambda: robots.urdf_robot('baxter'), lambda: robots.urdf_robot('panda'),
    lambda: Robot.from_urdf(robots.urdf_path('tiago'), base='planar')],
    ids=['standing', 'mimicking', 'driving'])
def test_all_links_count_those_that_stand_still_as_well(robot):
    robot, rng, h = robot(), np.random.default_rng(0), 1e-6
    joints = 0.3 * rng.normal(size=len(robot.joint_names))
    q = robot.configuration(joints, pose(rotation_from_rpy(0.0, 0.0, 0.8), [0.4, -0.3, 0.0]))
    state = robot.state(q)
    mass, centre = weighed(robot, state)
    found, J = state.center_of_mass()
    assert robot.mass == pytest.approx(mass, rel=1e-6)
    np.testing.assert_allclose(found, centre, atol=1e-9)
    numeric = [(robot.state(robot.integrate(q, axis, h)).center_of_mass()[0]
                - robot.state(robot.integrate(q, axis, -h)).center_of_mass()[0]) / (2 * h)
               for axis in np.eye(robot.n)]
    np.testing.assert_allclose(J, np.transpose(numeric), atol=1e-8)


def test_robot_leans_to_where_its_weight_is_wanted_and_its_hand_stays():
    robot = robots.urdf_robot('baxter', ARMS)
    stack = Stack.from_yaml("""
- hand: {type: pose, frame: left_gripper, gain: 5.0}
- balance: {type: center_of_mass, axes: xy, gain: 2.0}
- posture: {type: posture, gain: 0.3}
""", robot)
    controller, q = Controller(robot, stack, Settings(period=PERIOD)), np.array(PLACES['baxter'])
    start = robot.state(q)
    hand, goal = start.pose('left_gripper'), start.center_of_mass()[0] + [0.005, 0.008, 0.0]
    controller.update(q, 0.0)
    controller.set_goal('balance', goal, 0.0)
    for cycle in range(1, 600):
        command = controller.update(q, cycle * PERIOD)
        q = q + PERIOD * command.velocity
    state = robot.state(q)
    np.testing.assert_allclose(state.center_of_mass()[0][:2], goal[:2], atol=1e-4)
    np.testing.assert_allclose(state.pose('left_gripper'), hand, atol=1e-3)
    assert command.report.tasks[1].status == 'reached'


def test_robot_without_masses_is_refused():
    with pytest.raises(TaskError, match='the description of .* gives no link a mass'):
        CenterOfMass(robots.panda(), 'balance')
    with pytest.raises(TaskError, match='axes: needs some of x, y, z'):
        CenterOfMass(robots.urdf_robot('panda'), 'balance', axes='rx')
