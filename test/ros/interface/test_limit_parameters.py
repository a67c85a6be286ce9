# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Limits of the joints as parameters, lowered at any time."""

from harness import Arm, Status
import numpy as np
import pytest
from rclpy.parameter import Parameter
from robots import CONFIG, planar, PLANAR_DH
from tp_controller.ros.simulator_node import SimulatorNode

STACK = '- swing: {type: joint, joints: joint1, target: [3.0], gain: 5.0}'
SPEED, ACCELERATION, PERIOD = 1.5, 2.0, 0.01
FAST = {f'limits__joint{index}__{key}': value for index in (1, 2, 3)
        for key, value in (('acceleration', ACCELERATION), ('velocity', SPEED))}
NAME = 'limits.joint1.velocity'


@pytest.fixture
def moving(harness):
    """Return a controller whose first joint moves as fast as it may, and what it commands."""
    controller = harness.controller(stack=STACK, state_timeout=5.0, **FAST)
    arm, commands = Arm(harness), harness.commands()
    harness.spin_until(lambda: commands and commands[-1][0] == pytest.approx(SPEED),
                       'full speed', arm.publish)
    return controller, arm, commands


def test_a_velocity_limit_is_lowered_and_raised_again_without_a_jump(harness, moving):
    _, arm, commands = moving
    for speed in (0.2, 0.05, 1.0, SPEED):
        assert harness.set_parameters({NAME: speed}) == ''
        harness.spin_until(lambda: commands[-1][0] == pytest.approx(speed), f'{speed} rad/s',
                           arm.publish)
        assert np.abs(commands[-1]).max() <= speed + 1e-9
    steps = np.abs(np.diff(np.array(commands)[:, 0]))
    assert steps.max() <= ACCELERATION * PERIOD + 1e-9


def test_a_lowered_limit_outlives_another_stack_and_changes_with_it(harness, moving):
    _, arm, commands = moving
    assert harness.set_parameters({NAME: 0.25, 'stack': STACK + '\n'}) == ''
    harness.spin_until(lambda: commands[-1][0] == pytest.approx(0.25), meanwhile=arm.publish)
    assert harness.trigger('reload').success
    assert harness.set_parameters({'damping': 0.05}) == ''
    new = harness.spin_for_more(commands, 20, arm.publish)
    assert max(command[0] for command in new) <= 0.25 + 1e-9
    harness.spin_until(lambda: commands[-1][0] == pytest.approx(0.25), meanwhile=arm.publish)


@pytest.mark.parametrize('name, value, told', [
    (NAME, 0.0, 'velocity limit of joint1 must be above 0 and at most 1.5 rad/s, that of the '
     'robot, not 0.0; for a higher one deactivate and clean up the node, set it, and configure'),
    (NAME, -1.0, 'must be above 0'), (NAME, 1.6, 'at most 1.5 rad/s'),
    (NAME, float('inf'), 'at most 1.5 rad/s'), (NAME, float('nan'), 'at most 1.5 rad/s'),
    ('limits.joint1.acceleration', 1.0,
     'parameter limits.joint1.acceleration is 2.0, fixed while the node is configured'),
    ('limits.joint1.upper', 1.0, 'fixed while the node is configured')])
def test_a_limit_that_cannot_be_is_refused_with_the_reason(harness, moving, name, value, told):
    controller, arm, commands = moving
    before = controller.get_parameter(name).value
    assert told in harness.set_parameters({name: value})
    assert controller.get_parameter(name).value == before
    harness.spin_for_more(commands, 5, arm.publish)
    harness.spin_until(lambda: commands[-1][0] == pytest.approx(SPEED), meanwhile=arm.publish)


def reconfigured(harness, controller, values):
    """Set parameters of a controller that is not configured, then configure and activate it."""
    controller.trigger_deactivate()
    controller.trigger_cleanup()
    assert harness.set_parameters(values) == ''
    controller.trigger_configure()
    controller.trigger_activate()


def test_limits_that_are_set_while_unconfigured_are_those_of_the_robot(harness, moving):
    controller, arm, commands = moving
    reconfigured(harness, controller, {NAME: 3.0, 'limits.joint1.acceleration': 4.0})
    harness.spin_until(lambda: commands[-1][0] == pytest.approx(3.0), meanwhile=arm.publish)
    assert np.abs(np.diff(np.array(commands)[:, 0])).max() > 1.5 * ACCELERATION * PERIOD
    # What it was started with goes on in other respects.
    assert controller.get_parameter('limits.joint2.velocity').value == SPEED
    assert 'at most 3 rad/s' in harness.set_parameters({NAME: 3.1})


def test_a_lowered_limit_is_kept_for_the_next_configuration(harness, moving):
    controller, arm, commands = moving
    assert harness.set_parameters({NAME: 0.25}) == ''
    reconfigured(harness, controller, {'damping': 0.1})
    harness.spin_until(lambda: commands[-1][0] == pytest.approx(0.25), meanwhile=arm.publish)
    assert 'at most 0.25 rad/s' in harness.set_parameters({NAME: 0.5})


def test_limits_that_nobody_changed_are_those_of_each_description(harness):
    controller = harness.controller(
        robot='', robot_description=planar().urdf, autostart=False, limits__joint1__velocity=0.5)
    controller.trigger_configure()
    assert controller.get_parameter('limits.joint2.velocity').value == 1.0
    controller.trigger_cleanup()
    other = planar().urdf.replace('velocity="1.0"', 'velocity="0.75"')
    assert harness.set_parameters({'robot_description': other}) == ''
    controller.trigger_configure()
    assert controller.get_parameter('limits.joint2.velocity').value == 0.75
    assert controller.get_parameter(NAME).value == 0.5


def test_a_robot_without_the_joints_of_the_one_before_says_which_limits_are_ignored(harness,
                                                                                    capfd):
    controller = harness.controller(autostart=False)
    controller.trigger_configure()
    controller.trigger_cleanup()
    assert harness.set_parameters(
        {NAME: 0.5, 'robot': str(CONFIG / 'robots' / 'panda.yaml'), 'stack': '[]'}) == ''
    controller.trigger_configure()
    assert 'Ignoring limits of joints that the robot does not have: limits.joint1.velocity\n' in \
        capfd.readouterr().err
    assert not controller.has_parameter(NAME)
    assert controller.has_parameter('limits.panda_joint1.velocity')


def test_a_limit_of_a_bad_value_can_be_mended_while_unconfigured(harness):
    controller = harness.controller(autostart=False, limits__joint1__velocity=-1.0)
    status = Status(harness)
    controller.trigger_configure()
    harness.spin_until(lambda: status.head.startswith('not configured'))
    assert harness.set_parameters({NAME: 0.5}) == ''
    controller.trigger_configure()
    harness.spin_until(lambda: status.head.startswith('inactive'))


def test_limits_of_a_simulator_stay(harness):
    simulator = harness.make(SimulatorNode, robot=str(PLANAR_DH))
    result, = simulator.set_parameters([Parameter(NAME, value=0.1)])
    assert not result.successful and 'fixed' in result.reason
