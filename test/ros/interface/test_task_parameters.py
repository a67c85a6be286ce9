# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Gains and tolerances of tasks as parameters."""

from harness import Arm, Status
import numpy as np
import pytest
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import DescribeParameters, ListParameters
from robots import PLANAR_DH
from tp_controller.ros.controller_node import ControllerNode

Q = (0.0, 0.6, 0.3)
STACK = """
- inside: {type: joint_limits, gain: 5.0}
- swing: {type: joint, joints: [joint1, joint2, joint3], target: [1, 0.5, -0.25]}
- both: {type: pose, frame: link3, axes: [x, rz], gain: [2.0, 3.0], tolerance: {m: 0.01}}
- drift: {type: joint_velocity}
"""
VALUES = {
    'tasks.inside.gain': 5.0, 'tasks.inside.tolerance': 0.005,
    'tasks.swing.gain': 1.0, 'tasks.swing.tolerance': 0.005,
    'tasks.both.gain': [2.0, 3.0], 'tasks.both.tolerance.m': 0.01,
    'tasks.both.tolerance.rad': 0.005}
# Away from the target by this, so that the gain times this is commanded.
VELOCITY = np.array([1.0, -0.1, -0.55])


class Rig:
    """A controller whose arm stands still, with what it commands and says."""

    def __init__(self, harness, **parameters):
        self.harness = harness
        parameters = {'stack': STACK, 'state_timeout': 5.0, **parameters}
        self.controller = harness.controller(**parameters)
        self.commands, self.status = harness.commands(), Status(harness)
        self.arm = Arm(harness, Q)

    def spin_until_command(self, velocity):
        """Spin until the latest command is a certain one."""
        self.harness.spin_until(
            lambda: self.commands and np.allclose(self.commands[-1], velocity, atol=1e-9),
            f'the command {velocity}', self.arm.publish)

    def change(self, values):
        """Set parameters, all or none; return why they were refused."""
        return self.harness.set_parameters(values)

    def values(self):
        """Return {parameter: value} of all tasks, as ROS lists them."""
        names = self.harness.call(ListParameters, '/tp_controller/list_parameters').result.names
        return {name: plain(self.controller.get_parameter(name).value) for name in names
                if name.startswith('tasks.')}


def plain(value):
    """Return a list instead of an array."""
    return value if isinstance(value, float) else list(value)


@pytest.fixture
def rig(harness):
    """Return a rig with several kinds of tasks."""
    return Rig(harness)


def test_every_task_of_the_stack_has_its_parameters_and_no_other(any_harness):
    rig = Rig(any_harness)
    assert rig.values() == VALUES
    assert rig.change({'stack': '- swing: {type: joint, joints: joint2, gain: 0.5}'}) == ''
    assert rig.values() == {'tasks.swing.gain': 0.5, 'tasks.swing.tolerance': 0.005}
    assert rig.change({'stack': STACK}) == ''
    assert rig.values() == VALUES
    rig.controller.trigger_deactivate()
    rig.controller.trigger_cleanup()
    assert rig.values() == {}
    rig.controller.trigger_configure()
    assert rig.values() == VALUES


def test_they_are_described_with_unit_and_range(rig):
    descriptors = rig.harness.call(DescribeParameters, '/tp_controller/describe_parameters',
                                   names=list(VALUES)).descriptors
    described = {each.name: each.description for each in descriptors}
    assert described['tasks.swing.gain'] == 'gain K, one number or one for each row [1/s]'
    assert described['tasks.both.tolerance.m'] == \
        'error below which the goal counts as reached [m]'
    assert described['tasks.inside.tolerance'] == 'violation that still counts as satisfied [rad]'
    ranges = {each.name: (each.floating_point_range[0].from_value,
                          each.floating_point_range[0].to_value) for each in descriptors}
    # 2/period and 1/period: 100 cycles a second.
    assert ranges['tasks.swing.gain'] == (0.0, 200.0)
    assert ranges['tasks.inside.gain'] == (0.0, 100.0)


def test_a_gain_that_is_set_acts(any_harness):
    rig = Rig(any_harness)
    rig.spin_until_command(VELOCITY)
    assert rig.change({'tasks.swing.gain': 0.5}) == ''
    rig.spin_until_command(0.5 * VELOCITY)
    # With others, and again.
    assert rig.change({'tasks.swing.gain': 0.25, 'damping': 0.0}) == ''
    rig.spin_until_command(0.25 * VELOCITY)


def test_a_gain_that_is_set_is_blended_in(harness):
    rig = Rig(harness, blend=60.0)
    rig.spin_until_command(VELOCITY)
    assert rig.change({'tasks.swing.gain': 0.5}) == ''
    for command in harness.spin_for_more(rig.commands, 5, rig.arm.publish):
        np.testing.assert_allclose(command, VELOCITY, atol=0.02)
    harness.spin_until(lambda: 'blended' in rig.status.task('swing')['reason'],
                       meanwhile=rig.arm.publish)


def test_a_tolerance_that_is_set_is_that_of_the_status(rig):
    rig.spin_until_command(VELOCITY)
    assert rig.change({'tasks.swing.tolerance': 5.0, 'tasks.both.tolerance.rad': 0.25}) == ''
    rig.harness.spin_until(lambda: rig.status.task('swing')['status'] == 'reached'
                           and rig.status.task('both')['tolerance [rad]'] == '0.25',
                           meanwhile=rig.arm.publish)
    assert rig.status.task('both')['tolerance [m]'] == '0.01'


@pytest.mark.parametrize('values, told', [
    ({'tasks.swing.gain': 0.0}, 'gain of task swing must be positive'),
    ({'tasks.swing.gain': -1.0}, 'parameter tasks.swing.gain must be from 0 to 200, not -1.0'),
    ({'tasks.swing.gain': True}, 'tasks.swing.gain must be a number, such as 1.0, not True'),
    ({'tasks.swing.gain': 'fast'}, "tasks.swing.gain must be a number, such as 1.0, not 'fast'"),
    ({'tasks.swing.gain': [1.0, 1.0]}, 'must be a number, such as 1.0, not [1.0, 1.0]'),
    ({'tasks.swing.gain': float('nan')}, 'must be from 0 to 200, not nan'),
    ({'tasks.swing.gain': float('inf')}, 'must be from 0 to 200, not inf'),
    ({'tasks.swing.gain': 500.0}, 'must be from 0 to 200, not 500.0 (at most 2/period, or its '
     'error would grow from cycle to cycle; 0.25/period does not overshoot, even a cycle late)'),
    ({'tasks.both.gain': [1.0, 500.0]}, 'gain 500 of task both must be at most 2/period = 200'),
    ({'tasks.both.gain': [1.0]}, 'one for each of the 2 rows, got 1'),
    ({'tasks.both.gain': [1.0, float('nan')]}, 'gain of task both needs a number'),
    ({'tasks.inside.gain': 101.0}, 'must be from 0 to 100, not 101.0 (at most 1/period, or its '
     'bounds would be crossed)'),
    ({'tasks.both.tolerance.m': 0.0}, 'tolerance of task both must be positive'),
    ({'tasks.drift.gain': 1.0}, "there is no parameter 'tasks.drift.gain'"),
    ({'tasks.swing.gian': 1.0}, "'tasks.swing.gian' (did you mean 'tasks.swing.gain'?)"),
    # All or none.
    ({'tasks.swing.gain': 2.0, 'damping': -1.0}, 'damping'),
    ({'tasks.swing.gain': 2.0, 'stack': '[]'}, 'set the stack first, and then tasks.swing.gain'),
])
def test_a_refused_value_carries_the_reason_and_changes_nothing(rig, values, told):
    rig.spin_until_command(VELOCITY)
    assert told in rig.change(values)
    assert rig.values() == VALUES
    del rig.commands[:]
    rig.harness.spin_for_more(rig.commands, 3, rig.arm.publish)
    np.testing.assert_allclose(rig.commands, [VELOCITY] * len(rig.commands), atol=1e-9)


def test_doubtful_gain_is_warned_of_in_log_and_status(harness, log):
    rig = Rig(harness)
    rig.spin_until_command(VELOCITY)
    assert rig.change({'tasks.swing.gain': 190.0}) == ''
    doubt = 'gain 190/s at '
    harness.spin_until_logged(log, f'task swing: {doubt}', rig.arm.publish)
    harness.spin_until(lambda: rig.status.task('swing')['gain warning'].startswith(doubt),
                       'the warning', rig.arm.publish)
    assert rig.status.task('both')['gain warning'] == ''
    assert rig.change({'tasks.swing.gain': 1.0}) == ''
    harness.spin_until(lambda: not rig.status.task('swing')['gain warning'], 'no warning',
                       rig.arm.publish)


def test_doubtful_gain_of_a_stack_is_warned_of(harness, log):
    Rig(harness, stack=STACK.replace('type: joint,', 'type: joint, gain: 60,'))
    assert 'task swing: gain 60/s at 100 Hz: after one cycle 0.4 of the error is left' in log()


def test_what_was_set_lasts_until_the_stack_is_read_again(harness, tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text(STACK)
    rig = Rig(harness, stack=str(path))
    assert rig.change({'tasks.swing.gain': 0.5, 'tasks.both.tolerance.m': 0.5}) == ''
    rig.spin_until_command(0.5 * VELOCITY)
    # The same stack again is no other one.
    assert rig.change({'stack': str(path)}) == ''
    assert rig.values() == {**VALUES, 'tasks.swing.gain': 0.5, 'tasks.both.tolerance.m': 0.5}
    harness.enable('swing', False)
    harness.enable('swing', True)
    rig.spin_until_command(0.5 * VELOCITY)
    assert harness.trigger('reload').success
    assert rig.values() == VALUES
    rig.spin_until_command(VELOCITY)


def test_what_the_node_was_started_with_goes_before_every_stack(harness, tmp_path, log):
    path = tmp_path / 'parameters.yaml'
    path.write_text('/tp_controller:\n  ros__parameters:\n    tasks:\n'
                    '      swing: {gain: 0.5}\n      both: {gain: [4.0, 5.0]}\n'
                    '      later: {gain: 3.0}\n      both.tolerance: {m: 0.25, km: 1.0}\n')
    rig = Rig.__new__(Rig)
    rig.harness, rig.commands = harness, harness.commands()
    rig.controller = harness.make(ControllerNode, arguments=[
        '--ros-args', '--params-file', str(path)], robot=str(PLANAR_DH), stack=STACK, blend=0.0,
        follow_window=0.0, settle_time=0.0, state_timeout=5.0)
    rig.arm = Arm(harness, Q)
    started = {**VALUES, 'tasks.swing.gain': 0.5, 'tasks.both.gain': [4.0, 5.0],
               'tasks.both.tolerance.m': 0.25}
    assert rig.values() == started
    rig.spin_until_command(0.5 * VELOCITY)
    assert 'that no task of the stack has: tasks.both.tolerance.km, tasks.later.gain' in log()
    assert rig.change({'tasks.swing.gain': 0.75}) == ''
    rig.spin_until_command(0.75 * VELOCITY)
    assert harness.trigger('reload').success
    assert rig.values() == started
    rig.spin_until_command(0.5 * VELOCITY)
    assert rig.change({'stack': '- later: {type: posture}\n'}) == ''
    assert rig.values() == {'tasks.later.gain': 3.0, 'tasks.later.tolerance': 0.005}


@pytest.mark.parametrize('values, told', [
    ({'swing.gain': True}, 'parameter tasks.swing.gain must be a number, such as 1.0, not True'),
    ({'swing.gain': -1.0}, 'parameter tasks.swing.gain: gain of task swing must be positive'),
    ({'inside.gain': 200.0}, 'parameter tasks.inside.gain: gain 200 of task inside must be at '
                             'most 1/period = 100, or its bounds would be crossed'),
    ({'both.gain': 2.0}, 'parameter tasks.both.gain must be a list of numbers'),
    ({'both.tolerance.m': 0.0, 'swing.gain': 0.0}, 'must be positive, got 0; parameter tasks.')])
def test_a_faulty_start_value_is_named_and_the_robot_stays_where_it_is(harness, values, told):
    controller = harness.controller(
        stack=STACK, **{f'tasks.{name}': value for name, value in values.items()})
    status = Status(harness)
    assert controller._robot.stack_fault.startswith('no valid stack: parameter tasks.')
    assert told in controller._robot.stack_fault
    harness.spin_until(lambda: status.head.startswith('no valid stack'))


def test_what_belongs_to_a_task_that_stays_is_not_made_anew(harness):
    rig = Rig(harness)
    rig.spin_until_command(VELOCITY)

    def parts():
        return {part for part in (*rig.controller.services, *rig.controller.subscriptions,
                                  *rig.controller.publishers)
                if '/swing/' in getattr(part, 'topic_name', getattr(part, 'srv_name', ''))}

    before, events = parts(), harness.record(ParameterEvent, '/parameter_events')
    # Goal, trajectory, its end, enabling and numbers.
    assert len(before) == 5
    assert harness.trigger('reload').success
    assert rig.change({'stack': STACK + '- later: {type: posture}\n'}) == ''
    assert rig.change({'stack': STACK.replace('gain: 5.0', 'gain: 4.0')}) == ''
    assert rig.change({'damping': 0.25}) == ''
    changed = {}
    harness.spin_until(lambda: changed.update(
        {each.name: each for event in events
         for each in (*event.new_parameters, *event.changed_parameters, *event.deleted_parameters)
         }) or 'damping' in changed, 'the events')
    assert {'tasks.later.gain', 'tasks.inside.gain'} <= set(changed)
    assert not {name for name in changed if name.startswith('tasks.swing.')}
    assert parts() == before
