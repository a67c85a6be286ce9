# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""The lifecycle of the controller, through its services, and what is said there."""

from harness import Arm, PLANAR_DH, Status
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

ZEROS = [0.0, 0.0, 0.0]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def change(harness, name):
    """Ask for a transition; return whether it was carried out."""
    number = getattr(Transition, f'TRANSITION_{name.upper()}')
    return harness.call(ChangeState, '/tp_controller/change_state',
                        transition=Transition(id=number)).success


def state(harness):
    """Return the state of the controller."""
    return harness.call(GetState, '/tp_controller/get_state').current_state.label


def start(harness, **parameters):
    """Return a controller that waits for its services, its commands and its status."""
    controller = harness.controller(autostart=False, **parameters)
    return controller, harness.commands(), Status(harness)


def test_the_services_configure_activate_deactivate_clean_up_and_shut_down(any_harness):
    harness = any_harness
    _, commands, status = start(harness, keep_goals=True)
    harness.spin_until(lambda: status.head.startswith('not configured'))
    assert state(harness) == 'unconfigured' and commands == []
    assert change(harness, 'configure') and state(harness) == 'inactive'
    arm = Arm(harness)
    harness.spin_until(lambda: status.head.startswith('inactive'), meanwhile=arm.publish)
    assert commands == []
    assert change(harness, 'activate') and state(harness) == 'active'
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)
    assert change(harness, 'deactivate') and state(harness) == 'inactive'
    harness.spin_until(lambda: commands[-3:] == [ZEROS] * 3)
    # And then nothing any more, however much is heard.
    count = len(commands)
    harness.spin_for_more(status.messages, 10, arm.publish)
    assert len(commands) == count
    assert change(harness, 'activate')
    harness.spin_until(lambda: any(commands[-1]), 'motion', meanwhile=arm.publish)
    assert change(harness, 'deactivate') and change(harness, 'cleanup')
    assert state(harness) == 'unconfigured'
    assert change(harness, 'unconfigured_shutdown') and state(harness) == 'finalized'


def test_shutdown_of_an_active_controller_commands_zeros_first(harness):
    _, commands, status = start(harness)
    assert change(harness, 'configure') and change(harness, 'activate')
    arm = Arm(harness)
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)
    assert change(harness, 'active_shutdown') and state(harness) == 'finalized'
    harness.spin_until(lambda: commands[-3:] == [ZEROS] * 3)
    harness.spin_until(lambda: status.head.startswith('not configured'))


@pytest.mark.parametrize('steps, refused', [
    ((), ('cleanup', 'activate', 'deactivate', 'active_shutdown')),
    (('configure',), ('configure', 'deactivate', 'unconfigured_shutdown')),
    (('configure', 'activate'), ('configure', 'cleanup', 'activate'))])
def test_a_transition_that_is_none_from_here_is_refused_and_ends_nothing(any_harness, steps,
                                                                         refused):
    start(any_harness)
    assert all(change(any_harness, name) for name in steps)
    before = state(any_harness)
    for name in refused:
        assert not change(any_harness, name)
    assert not any_harness.call(ChangeState, '/tp_controller/change_state',
                                transition=Transition(id=200)).success
    assert state(any_harness) == before


def test_what_cannot_be_configured_is_refused_and_can_be_repaired(harness, log, tmp_path):
    controller, commands, status = start(harness, robot=str(tmp_path / 'arm.urdf'))
    assert not change(harness, 'configure') and state(harness) == 'unconfigured'
    harness.spin_until_logged(log, 'no file')
    result, = controller.set_parameters([Parameter('robot', value=str(PLANAR_DH))])
    assert result.successful
    assert change(harness, 'configure') and change(harness, 'activate')
    arm = Arm(harness)
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)


def test_after_a_cleanup_fixed_parameters_can_be_others(harness):
    controller, commands, _ = start(harness)
    assert change(harness, 'configure')
    fixed, = controller.set_parameters([Parameter('rate', value=50.0)])
    assert not fixed.successful and 'fixed while the node is configured' in fixed.reason
    assert change(harness, 'cleanup')
    for name, value in (('rate', 0.0), ('command_joints', ['joint3', 'joint1', 'joint2'])):
        result, = controller.set_parameters([Parameter(name, value=value)])
        assert result.successful, result.reason
    assert change(harness, 'configure') and change(harness, 'activate')
    arm = Arm(harness)
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)
    assert commands[-1] == pytest.approx([-0.55, 1.0, -0.1])


def test_an_inactive_controller_takes_goals_and_parameters(harness):
    controller, commands, _ = start(harness)
    assert change(harness, 'configure')
    assert controller.set_parameters([Parameter('damping', value=0.2)])[0].successful
    assert harness.enable('swing', False).success and harness.enable('swing', True).success
    assert harness.trigger('stop').success
    assert commands == []
    assert change(harness, 'activate')
    arm = Arm(harness)
    harness.spin_for_more(commands, 5, arm.publish)
    assert commands[-5:] == [ZEROS] * 5
    harness.start(arm.publish)
    harness.spin_until(lambda: any(commands[-1]), 'motion', meanwhile=arm.publish)


def test_another_description_is_named_and_taken_after_a_cleanup(harness, log):
    urdf = """<robot name="arm"><link name="base"/><link name="tip"/>
        <joint name="turn" type="revolute"><parent link="base"/><child link="tip"/>
        <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="{}" effort="1"/></joint>
        </robot>"""
    _, commands, status = start(
        harness, robot_description='', robot='',
        stack='- swing: {type: joint, joints: turn, target: [1.9], gain: 10}\n')
    assert change(harness, 'configure') and change(harness, 'activate')
    descriptions = harness.publisher(String, '/robot_description', LATCHED)
    descriptions.publish(String(data=urdf.format(1.0)))
    arm = Arm(harness, (0.0,), ('turn',))
    harness.spin_until(lambda: commands and commands[-1] == [1.0], 'motion',
                       meanwhile=arm.publish)
    descriptions.publish(String(data=urdf.format(0.25)))
    harness.spin_until_logged(log, 'another description has arrived', arm.publish)
    assert commands[-1] == [1.0]

    def spin_until_ignored(told):
        harness.spin_until(lambda: status.of_node('ignored description') == told, told or 'none',
                           meanwhile=arm.publish)

    ignored = 'another description has arrived; deactivate, clean up and configure the node ' \
        'to take it'
    spin_until_ignored(ignored)
    descriptions.publish(String(data=urdf.format(1.0)))
    spin_until_ignored('')
    descriptions.publish(String(data=urdf.format(0.25)))
    spin_until_ignored(ignored)
    for name in ('deactivate', 'cleanup', 'configure', 'activate'):
        assert change(harness, name)
    harness.spin_until(lambda: commands[-1] == [0.25], 'slower motion', meanwhile=arm.publish)
    spin_until_ignored('')


def test_a_cycle_that_was_called_before_the_last_zeros_commands_nothing_after_them(harness):
    controller, commands, _ = start(harness)
    assert change(harness, 'configure') and change(harness, 'activate')
    arm = Arm(harness)
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)
    loop = controller._robot.loop
    loop.deactivate('over')
    loop._cycle()
    harness.spin_until(lambda: commands[-3:] == [ZEROS] * 3, 'the last zeros')
    assert change(harness, 'deactivate')
    harness.spin_until(lambda: commands[-6:] == [ZEROS] * 6, 'the zeros of the transition')


def test_a_controller_that_was_halted_moves_no_more_whatever_is_activated(harness):
    controller, commands, status = start(harness)
    assert change(harness, 'configure') and change(harness, 'activate')
    arm = Arm(harness)
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)
    controller.halt('ended by SIGINT')
    harness.spin_until(lambda: status.head == 'ended by SIGINT')
    assert change(harness, 'deactivate') and change(harness, 'activate')
    harness.spin_until(lambda: commands[-10:] == [ZEROS] * 10, meanwhile=arm.publish)
    assert status.head == 'ended by SIGINT'
