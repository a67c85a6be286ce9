# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Services and parameters: what changes while the robot moves."""

from array import array
import time

from geometry_msgs.msg import PointStamped, PoseStamped, QuaternionStamped
from harness import Arm, JOINTS, MOVING_STACK, Status
import numpy as np
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, ListParameters, SetParametersAtomically
from rclpy.parameter import Parameter
import robots
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from tp_controller.errors import SettingsError
from tp_controller.solver import compiled

ZEROS = [0.0, 0.0, 0.0]
Q = (0.0, 0.6, 0.3)
VELOCITY = [1.0, -0.1, -0.55]
SLOW = MOVING_STACK.replace('{', '{gain: 0.5, ')


class Rig:
    """A controller whose arm stands still, with what it commands and says."""

    def __init__(self, harness, **parameters):
        self.harness = harness
        # While the test waits for an answer the arm says nothing.
        parameters.setdefault('state_timeout', 5.0)
        self.controller = harness.controller(**parameters)
        self.commands, self.status = harness.commands(), Status(harness)
        self.arm = Arm(harness, Q)

    def spin_until(self, condition):
        """Spin, while the arm says where it is."""
        self.harness.spin_until(condition, meanwhile=self.arm.publish)

    def spin_until_command(self, velocity):
        """Spin until the latest command is a certain one."""
        self.spin_until(lambda: self.commands and np.allclose(self.commands[-1], velocity,
                                                              atol=1e-9))

    def change(self, **values):
        """Set parameters, all or none; return why they were refused."""
        return self.harness.set_parameters({name.replace('__', '.'): value
                                            for name, value in values.items()})


@pytest.fixture
def rig(harness):
    """Return a rig of the moving stack."""
    return Rig(harness)


# Stop, start, reload, enable ------------------------------------------------------------------

def test_stop_latches_until_start(any_harness):
    rig = Rig(any_harness)
    rig.spin_until_command(VELOCITY)
    assert any_harness.trigger('stop').success
    rig.spin_until(lambda: rig.status.head == 'stopped; call ~/start to go on')
    del rig.commands[:]
    any_harness.spin_for_more(rig.commands, 10, rig.arm.publish)
    assert rig.commands == [ZEROS] * len(rig.commands)
    # Goals do not unlock it.
    any_harness.publisher(JointState, '/tp_controller/swing/goal').publish(
        JointState(name=['joint1'], position=[-0.5]))
    rig.spin_until(lambda: rig.status.task('swing')['goals accepted'] == '1')
    assert rig.status.task('swing')['status'] == 'stopped'
    assert rig.commands[-1] == ZEROS
    any_harness.start(rig.arm.publish)
    rig.spin_until_command([-0.5, *VELOCITY[1:]])
    any_harness.start(rig.arm.publish)
    rig.spin_until(lambda: rig.status.head == 'running')


def test_stop_commands_zeros_at_once_without_a_rate_too(harness):
    rig = Rig(harness, rate=0.0, state_timeout=1.0, braking_gain=1.0)
    rig.spin_until_command(VELOCITY)
    assert harness.trigger('stop').success
    harness.spin_until(lambda: rig.commands[-1] == ZEROS)
    rig.spin_until(lambda: rig.status.head.startswith('stopped'))


def test_stop_is_said_even_where_joint_states_are_missing(harness):
    rig = Rig(harness, rate=0.0, state_timeout=0.1)
    assert harness.trigger('stop').success
    harness.spin_until(lambda: rig.status.head.startswith('stopped'))
    assert rig.commands[-1] == ZEROS


def test_a_start_is_refused_while_joint_states_are_missing(harness):
    rig = Rig(harness, state_timeout=0.2)
    rig.spin_until_command(VELOCITY)
    assert harness.trigger('stop').success
    end = time.monotonic() + 0.3
    harness.spin_until(lambda: time.monotonic() > end)
    answer = harness.trigger('start')
    assert (answer.success, answer.message) == (
        False, 'not started: no joint states of joint1, joint2, joint3')
    # They come back, and nothing moves until a start that was not refused.
    harness.spin_for_more(rig.commands, 30, rig.arm.publish)
    assert rig.commands[-1] == ZEROS
    harness.start(rig.arm.publish)
    rig.spin_until_command(VELOCITY)


def test_after_start_tasks_without_a_goal_keep_their_current_values(harness):
    rig = Rig(harness, stack='- rest: {type: posture}')
    rig.spin_until(lambda: rig.status.head == 'running')
    harness.trigger('stop')
    rig.spin_until(lambda: rig.status.head.startswith('stopped'))
    # Somebody moves the arm by hand.
    rig.arm.q = [0.5, 0.5, 0.5]
    for _ in range(3):
        harness.spin_for_more(rig.commands, 2, rig.arm.publish)
    harness.start(rig.arm.publish)
    del rig.commands[:]
    rig.spin_until(lambda: rig.status.head == 'running')
    assert rig.commands == [ZEROS] * len(rig.commands)


def test_reload_reads_the_file_again(any_harness, tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text(MOVING_STACK)
    rig = Rig(any_harness, stack=str(path))
    rig.spin_until_command(VELOCITY)
    path.write_text(SLOW)
    assert any_harness.trigger('reload').success
    rig.spin_until_command(0.5 * np.array(VELOCITY))


@pytest.mark.parametrize('text, told', [
    ('- swing: {type: joint, joints: joint9}', "unknown driven joint or group 'joint9'"),
    ('- [', 'not valid YAML'), ('', 'a stack must be a list'), (None, 'no file')])
def test_reload_of_a_faulty_file_keeps_the_old_stack_and_says_why(harness, tmp_path, text, told):
    path = tmp_path / 'stack.yaml'
    path.write_text(MOVING_STACK)
    rig = Rig(harness, stack=str(path))
    rig.spin_until_command(VELOCITY)
    path.unlink() if text is None else path.write_text(text)
    answer = harness.trigger('reload')
    assert not answer.success and told in answer.message
    del rig.commands[:]
    harness.spin_for_more(rig.commands, 3, rig.arm.publish)
    np.testing.assert_allclose(rig.commands, [VELOCITY] * len(rig.commands), atol=1e-9)


def test_a_stack_that_was_faulty_at_the_start_can_be_repaired(harness, tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text('- swing: {}')
    rig = Rig(harness, stack=str(path))
    rig.spin_until(lambda: rig.status.head.startswith('no valid stack'))
    path.write_text(MOVING_STACK)
    assert harness.trigger('reload').success
    rig.spin_until_command(VELOCITY)


def test_goals_of_tasks_that_stay_survive_a_reload(harness, tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text('- rest: {type: posture}')
    rig = Rig(harness, stack=str(path))
    publisher = harness.publisher(JointState, '/tp_controller/rest/goal')
    rig.spin_until(lambda: rig.status.head == 'running')
    publisher.publish(JointState(name=list(JOINTS), position=[0.5, 0.6, 0.3]))
    rig.spin_until_command([0.5, 0.0, 0.0])
    path.write_text('- rest: {type: posture, gain: 2.0}\n- swing: {type: joint_velocity}')
    assert harness.trigger('reload').success
    rig.spin_until_command([1.0, 0.0, 0.0])
    # The topic is still the same, and counts go on.
    publisher.publish(JointState(name=['joint1'], position=[0.25]))
    rig.spin_until_command([0.5, 0.0, 0.0])
    rig.spin_until(lambda: rig.status.task('rest')['goals accepted'] == '2')


def test_services_of_tasks_that_stay_are_kept(harness, tmp_path):
    """A new one of the same name loses the requests that are under way."""
    path = tmp_path / 'stack.yaml'
    path.write_text(MOVING_STACK)
    rig = Rig(harness, stack=str(path))
    rig.spin_until_command(VELOCITY)
    before = list(rig.controller.services)
    assert '/tp_controller/swing/enable' in [service.service_name for service in before]
    path.write_text(SLOW)
    assert harness.trigger('reload').success
    rig.spin_until_command(0.5 * np.array(VELOCITY))
    assert rig.change(stack=f'{MOVING_STACK}\n- rest: {{type: posture}}') == ''
    rig.spin_until_command(VELOCITY)
    kept = list(rig.controller.services)
    assert [service for service in before if service not in kept] == []


def test_topics_and_services_follow_the_stack(any_harness):
    rig = Rig(any_harness)
    node = any_harness.node
    any_harness.spin_until(lambda: node.count_subscribers('/tp_controller/swing/goal') == 1)
    assert rig.change(stack='- other: {type: joint_velocity}') == ''
    any_harness.spin_until(lambda: node.count_subscribers('/tp_controller/other/goal') == 1
                           and node.count_subscribers('/tp_controller/swing/goal') == 0)
    services = dict(node.get_service_names_and_types())
    assert '/tp_controller/other/enable' in services
    assert '/tp_controller/swing/enable' not in services


def test_messages_and_calls_on_their_way_survive_the_end_of_their_task(any_harness):
    """What the executor has collected already arrives after the task is gone."""
    rig = Rig(any_harness)
    rig.spin_until_command(VELOCITY)
    publisher = any_harness.publisher(JointState, '/tp_controller/swing/goal')
    enable = any_harness.node.create_client(SetBool, '/tp_controller/swing/enable')
    change = any_harness.node.create_client(SetParametersAtomically,
                                            '/tp_controller/set_parameters_atomically')
    any_harness.spin_until(lambda: enable.service_is_ready() and change.service_is_ready())
    parameter = Parameter('stack', value='- other: {type: joint_velocity}')

    def send_more():
        for _ in range(5):
            publisher.publish(JointState(name=['joint1'], position=[0.5]))
            enable.call_async(SetBool.Request(data=False))

    # The one way within a callback, the other way between two.
    send_more()
    answer = change.call_async(SetParametersAtomically.Request(
        parameters=[parameter.to_parameter_msg()]))
    send_more()
    rig.spin_until(answer.done)
    rig.spin_until(lambda: rig.status.task('other')['status'] == 'reached')
    assert rig.change(stack=MOVING_STACK) == ''
    rig.spin_until_command(VELOCITY)
    send_more()
    assert rig.controller.set_parameters_atomically([parameter]).successful
    send_more()
    rig.spin_until(lambda: rig.status.task('other')['status'] == 'reached')
    rig.spin_until_command(ZEROS)


def test_a_task_that_becomes_another_type_gets_the_messages_of_that_type(any_harness):
    rig = Rig(any_harness)
    rig.spin_until_command(VELOCITY)
    publisher = any_harness.publisher(JointState, '/tp_controller/swing/goal')
    for _ in range(3):
        publisher.publish(JointState(name=['joint1'], position=[0.5]))
    parameter = Parameter('stack', value='- swing: {type: joint_velocity}')
    assert rig.controller.set_parameters_atomically([parameter]).successful
    message = JointState(name=['joint1'], velocity=[0.25])
    rig.spin_until(lambda: publisher.publish(message) or rig.commands[-1] == [0.25, 0.0, 0.0])


def test_a_topic_whose_type_changes_is_opened_anew(any_harness):
    rig = Rig(any_harness)
    kinds = {'pose': PoseStamped, 'position': PointStamped, 'orientation': QuaternionStamped}

    def change_to(kind):
        assert rig.change(stack=f'- tip: {{type: {kind}, frame: link3}}') == ''

    # Faster than the old topic goes.
    for kind in [*kinds] * 5:
        change_to(kind)
    for count, (kind, message) in enumerate(kinds.items(), 1):
        change_to(kind)
        rig.spin_until(lambda message=message: (
            '/tp_controller/tip/goal', [f'geometry_msgs/msg/{message.__name__}'])
            in any_harness.node.get_topic_names_and_types())
        publisher = any_harness.publisher(message, '/tp_controller/tip/goal')
        publisher.publish(message())
        rig.spin_until(lambda count=count: rig.status.task('tip')['goals accepted'] == str(count))
        any_harness.node.destroy_publisher(publisher)


def test_a_task_can_be_disabled_and_enabled_again(any_harness):
    rig = Rig(any_harness, stack=MOVING_STACK + '\n- rest: {type: posture, target: [0, 0, 0]}')
    rig.spin_until_command(VELOCITY)
    answer = any_harness.enable('swing', False)
    assert answer.success and answer.message == 'task swing is disabled'
    rig.spin_until_command([0.0, -0.6, -0.3])
    rig.spin_until(lambda: rig.status.task('swing')['status'] == 'disabled')
    assert rig.status.task('rest')['level'] == '1'
    answer = any_harness.enable('swing', True)
    assert answer.success and answer.message == 'task swing is enabled'
    rig.spin_until_command(VELOCITY)
    any_harness.enable('swing', False)
    any_harness.enable('rest', False)
    rig.spin_until_command(ZEROS)


# Parameters -----------------------------------------------------------------------------------

def test_parameters_change_while_the_robot_moves(any_harness):
    rig = Rig(any_harness)
    rig.spin_until_command(VELOCITY)
    # Where every direction is damped, J = I gives v / (1 + λ²).
    assert rig.change(damping=0.5, singular_region=float('inf')) == ''
    rig.spin_until_command(np.array(VELOCITY) / 1.25)
    assert rig.change(damping=0.0) == ''
    rig.spin_until_command(VELOCITY)
    assert rig.change(stack=SLOW) == ''
    rig.spin_until_command(0.5 * np.array(VELOCITY))


@pytest.mark.parametrize('values, told', [
    ({'damping': -0.5}, 'damping'),
    ({'damping': float('nan')}, 'damping'),
    ({'damping': True}, 'parameter damping must be a number, such as 1.0, not True'),
    ({'damping': 'much'}, "must be a number, such as 1.0, not 'much'"),
    ({'braking_gain': 1000.0}, 'braking_gain 1000 must be at most 1/period = 100, or position '
     'limits would be crossed (period is 1/rate)'),
    ({'scaling': 'none'}, 'scaling must be one of redistribute, uniform'),
    ({'weights': [1.0, 2.0]}, 'weights needs 3 numbers'),
    ({'weights': [1.0, 2.0, float('nan')]}, 'weights must be positive numbers'),
    ({'weights': [1.0, 2.0, 0.0]}, 'weights must be positive numbers'),
    ({'stack': ''}, 'parameter stack is empty'),
    ({'stack': '- swing: {type: joint, joints: 7}'}, 'line 1: swing, joints: '),
    ({'stack': '/nowhere/stack.yaml'}, 'no file /nowhere/stack.yaml'),
    ({'rate': 50.0}, 'fixed while the node is configured'),
    ({'command_joints': ['joint1']}, 'fixed while the node is configured'),
    ({'limits__joint1__velocity': 5.0}, 'at most 1 rad/s'),
    ({'limits__joint1__upper': 5.0}, 'fixed while the node is configured'),
    # All or none.
    ({'stack': SLOW, 'damping': -1.0}, 'damping'),
])
def test_a_refused_value_carries_the_reason_and_changes_nothing(rig, values, told):
    rig.spin_until_command(VELOCITY)
    before = {name: rig.controller.get_parameter_or(name.replace('__', '.')).value
              for name in values}
    assert told in rig.change(**values)
    assert before == {name: rig.controller.get_parameter_or(name.replace('__', '.')).value
                      for name in values}
    del rig.commands[:]
    rig.harness.spin_for_more(rig.commands, 3, rig.arm.publish)
    np.testing.assert_allclose(rig.commands, [VELOCITY] * len(rig.commands), atol=1e-9)


def test_weights_can_be_set_and_are_used(harness):
    rig = Rig(harness, stack='- sum: {type: position, frame: %s, axes: x}' % 'link3')
    rig.spin_until(lambda: rig.status.head == 'running')
    assert rig.change(weights=[1.0, 2.0, 4.0]) == ''
    assert rig.controller._robot.controller.settings.weights == (1.0, 2.0, 4.0)
    assert list(rig.controller.get_parameter('weights').value) == [1.0, 2.0, 4.0]


def test_setting_the_same_stack_reads_its_file_again_and_refuses_faults(harness, tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text(MOVING_STACK)
    rig = Rig(harness, stack=str(path))
    rig.spin_until_command(VELOCITY)
    path.write_text('- swing: {}')
    assert 'needs a type' in rig.change(stack=str(path))
    harness.spin_for_more(rig.commands, 3, rig.arm.publish)
    rig.spin_until_command(VELOCITY)
    path.write_text(SLOW)
    assert rig.change(stack=str(path)) == ''
    rig.spin_until_command(0.5 * np.array(VELOCITY))


def test_parameters_can_be_set_before_the_robot_is_known(harness):
    rig = Rig.__new__(Rig)
    rig.harness, rig.controller = harness, harness.controller(robot='')
    assert rig.change(damping=0.5, stack=SLOW) == ''
    assert 'weights must be' in rig.change(weights=[-1.0])
    assert rig.controller._settings.damping == 0.5


def test_a_value_may_come_as_any_array(harness):
    rig = Rig(harness, weights=array('d', [1.0, 1.0, 2.0]))
    rig.spin_until_command(VELOCITY)


def test_every_parameter_is_described(harness):
    harness.controller()
    names = harness.call(ListParameters, '/tp_controller/list_parameters').result.names
    own = [name for name in names if name != 'use_sim_time'
           and not name.startswith(('start_type_description_service', 'qos_overrides'))]
    assert {'robot', 'stack', 'rate', 'damping', 'weights', 'limits.joint3.lower'} <= set(own)
    descriptors = harness.call(DescribeParameters, '/tp_controller/describe_parameters',
                               names=own).descriptors
    for descriptor in descriptors:
        assert descriptor.description, descriptor.name
    units = {descriptor.name: descriptor.description.rpartition('[')[2]
             for descriptor in descriptors}
    assert units['rate'] == 'Hz]' and units['limits.joint1.velocity'] == 'rad/s]'
    ranges = {descriptor.name: descriptor.floating_point_range for descriptor in descriptors}
    assert ranges['damping'][0].from_value == 0.0 and ranges['damping'][0].to_value == 10.0
    whole = {descriptor.name: (descriptor.integer_range[0].from_value,
                               descriptor.integer_range[0].to_value)
             for descriptor in descriptors if descriptor.type == ParameterType.PARAMETER_INTEGER}
    assert whole == {'command_delay': (0, 100), 'realtime_priority': (0, 99),
                     'processor': (-1, 8191)}


def test_unknown_parameters_are_named_in_one_warning(harness, log):
    harness.controller(dampnig=0.5, foo__bar=1, qos_overrides__x=1)
    lines = [line for line in log().splitlines() if 'unknown parameters' in line]
    assert len(lines) == 1 and 'WARN' in lines[0]
    assert lines[0].endswith('unknown parameters, ignored: '
                             "'dampnig' (did you mean 'damping'?), 'foo.bar'")


@pytest.mark.parametrize('chosen, told', [('', 1), ('python', 0)])
def test_a_missing_core_is_one_warning_unless_python_was_chosen(
        harness, log, monkeypatch, chosen, told):
    monkeypatch.setattr(compiled, 'core', None)
    monkeypatch.setenv(compiled.VARIABLE, chosen)
    harness.controller()
    lines = [line for line in log().splitlines() if 'C++ compiler' in line]
    assert len(lines) == told and all('WARN' in line for line in lines)


@pytest.mark.parametrize('values, told', [
    ({'rate': True}, 'parameter rate must be a number, such as 1.0, not True'),
    ({'rate': -1.0}, 'parameter rate must be from 0 to 2000, not -1.0'),
    ({'rate': float('nan')}, 'parameter rate must be from 0 to 2000, not nan'),
    ({'realtime_priority': 100}, 'parameter realtime_priority must be from 0 to 99, not 100'),
    ({'rate': 0.5}, 'period must be a number from 1e-05 to 1, not 2.0 (period is 1/rate)'),
    ({'rate': 0.0, 'state_timeout': 0.5}, 'braking_gain 10 must be at most 1/period = 2, or '
     'position limits would be crossed (period is state_timeout, because rate is 0)'),
    ({'joints': 'joint1'}, 'parameter joints must be a list of strings, such as [a, b], not '
     "'joint1'"),
    ({'weights': ['a']}, 'parameter weights must be a list of numbers, such as [1.0, 2.0], not '),
    ({'stack': 5}, 'parameter stack must be a string, not 5'),
    ({'scaling': 'none'}, 'scaling must be one of'),
    ({'damping': 'a', 'rate': [1]}, 'parameter rate must be a number, such as 1.0, not '
     "[1]; parameter damping must be a number, such as 1.0, not 'a'"),
])
def test_a_faulty_value_at_the_start_is_refused_with_its_name(harness, values, told):
    with pytest.raises(SettingsError) as error:
        harness.controller(**values)
    assert told in str(error.value)
    assert '\n' not in str(error.value)


def test_weights_that_do_not_fit_the_robot_are_refused_at_the_start(harness):
    with pytest.raises(SettingsError, match='weights needs 3 numbers'):
        harness.controller(weights=[1.0, 2.0])


def test_what_a_task_leaves_out_is_a_warning(harness, log):
    shapes = robots.CONFIG / 'panda_capsules.yaml'
    harness.controller(robot=str(robots.PANDA_DH),
                       stack=f'- apart: {{type: self_collision, capsules: {shapes}}}\n')
    lines = [line for line in log().splitlines() if 'task apart: not kept apart' in line]
    assert len(lines) == 1 and 'WARN' in lines[0] and 'panda_link5 – panda_link7' in lines[0]
