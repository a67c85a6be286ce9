# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The recorder of the demos hears all of a robot, its base included."""

from types import SimpleNamespace

import numpy as np
import pytest
from robots import CONFIG, PLANAR_DH
from sensor_msgs.msg import JointState
from tp_controller import Robot
from tp_controller.tools.demos.motion_recorder import PositionDifferences, Recorder


def recorder_of(harness, robot):
    """Return a recorder that listens with the node of the harness."""
    return Recorder(SimpleNamespace(node=harness.node, controller='tp_controller'), robot)


def is_complete(recorder):
    """Return whether states, commands and errors were received."""
    return bool(recorder.states and recorder.commands and recorder.curves.columns)


def test_configurations_and_commands_of_a_base_and_its_joints_are_recorded(harness):
    file = str(CONFIG / 'robots' / 'mobile_arm.urdf')
    robot = Robot.from_file(file, base='differential')
    recorder = recorder_of(harness, robot)
    assert not is_complete(recorder)
    given = {'robot': file, 'base': 'differential'}
    harness.controller(**given, stack='- park: {type: base_pose}\n'
                                      '- swing: {type: joint, joints: arm_1, target: [1.0]}\n')
    harness.simulator(**given, initial_positions='{base_x: 2.0, base_yaw: 1.0, arm_4: 0.5}')
    harness.spin_until(lambda: is_complete(recorder), 'all that is recorded')
    arm = robot.joint_index('arm_1')
    harness.spin_until(lambda: recorder.commands[-1][1][arm] > 0.1, 'motion')
    q, velocity = np.array(recorder.states[0][1]), np.array(recorder.commands[-1][1])
    assert q.shape == (robot.nq,) and velocity.shape == (robot.n,)
    np.testing.assert_allclose(q[:3], [2.0, 0.0, 1.0], atol=0.05)
    assert q[robot.joint_rows][robot.joint_names.index('arm_4')] == pytest.approx(0.5, abs=0.05)
    harness.spin_until(lambda: recorder.curves.plotted()[2].keys() == {'park', 'swing'},
                       'reasons')
    assert {task for task, _ in recorder.curves.columns} == {'park', 'swing'}
    assert all(np.isfinite(values).all() for rows in (recorder.states, recorder.commands)
               for _, values in rows)


# The executor of a client: the other one passes on no times.
@pytest.mark.parametrize('any_harness', ['standard'], indirect=True)
@pytest.mark.parametrize('output', ['position', 'trajectory'])
def test_velocities_of_commanded_positions_are_recorded(any_harness, output):
    harness = any_harness
    recorder = recorder_of(harness, Robot.from_file(PLANAR_DH))
    harness.controller(output=output, limits__joint1__velocity=0.3)
    harness.simulator()
    harness.spin_until(lambda: is_complete(recorder), 'all that is recorded')
    harness.spin_until(lambda: recorder.commands[-1][1][0] == pytest.approx(0.3, abs=0.02),
                       'its velocity')


def test_velocities_are_the_mean_over_a_moment_whatever_the_times_of_receipt():
    differences, random = PositionDifferences(), np.random.default_rng(0)
    found = []
    for step in range(100):
        now = 0.01 * step
        found.append(differences.velocities([2.0 * now, -now], now + random.uniform(0.0, 4e-3)))
    assert found[:10] == [None] * 10
    np.testing.assert_allclose(found[12:], np.tile([2.0, -1.0], (88, 1)), rtol=0.05)
    # A pause, in which the robot may have been elsewhere.
    assert differences.velocities([9.0, 9.0], 5.0) is None


def test_time_counts_from_the_last_start(harness):
    recorder = recorder_of(harness, Robot.from_file(PLANAR_DH))
    harness.simulator()
    harness.spin_until(lambda: recorder.states, 'states')
    recorder.restart(10.0)
    assert recorder.states == [] and -10.0 <= recorder.now() < 0.0
    harness.spin_until(lambda: recorder.states, 'states')
    assert -10.0 <= recorder.states[0][0] <= recorder.now()


def test_nothing_is_recorded_of_a_base_whose_odometry_is_missing(harness):
    # The simulator has the robot on a fixed base, so there is no odometry.
    file = str(CONFIG / 'robots' / 'mobile_arm.urdf')
    recorder = recorder_of(harness, Robot.from_file(file, base='planar'))
    states = harness.record(JointState, '/joint_states')
    harness.simulator(robot=file)
    harness.spin_until(lambda: len(states) > 5, 'joint states')
    assert recorder.states == [] and not is_complete(recorder)


def test_arm_on_a_fixed_base_is_recorded_without_odometry(harness):
    recorder = recorder_of(harness, Robot.from_file(PLANAR_DH))
    harness.controller()
    harness.simulator()
    harness.spin_until(lambda: is_complete(recorder), 'all that is recorded')
    assert len(recorder.states[-1][1]) == len(recorder.commands[-1][1]) == 3
