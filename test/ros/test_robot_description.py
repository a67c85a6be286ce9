# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Where the robot comes from: a file, a parameter or a latched topic."""

from harness import LATCHED, Status
import pytest
from robots import PANDA_DH, PLANAR_DH
from std_msgs.msg import String
from tp_controller import Robot
from tp_controller.errors import RobotError, SettingsError
from tp_controller.ros.controller_node import ControllerNode
from tp_controller.ros.simulator_node import SimulatorNode

POSTURE = '- rest: {type: posture}'
URDF = Robot.from_file(PLANAR_DH).urdf
PANDA_URDF = Robot.from_file(PANDA_DH).urdf
WAITING = 'no robot description yet'


def waiting_controller(harness, **parameters):
    """Return the status of a controller that waits for its robot, and where it gets it."""
    harness.make(ControllerNode, stack=POSTURE, status_rate=50.0, **parameters)
    return Status(harness), harness.publisher(String, '/robot_description', LATCHED)


def test_a_description_on_the_topic_is_taken(any_harness):
    status, description = waiting_controller(any_harness)
    any_harness.spin_until(lambda: status.head == WAITING)
    description.publish(String(data=URDF))
    any_harness.spin_until(lambda: status.head == 'no joint states of joint1, joint2, joint3')


@pytest.mark.parametrize('kind', [ControllerNode, SimulatorNode])
def test_a_xacro_is_expanded_with_its_arguments(harness, log, tmp_path, kind):
    pytest.importorskip('xacro')
    path = tmp_path / 'robot.urdf.xacro'
    path.write_text('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
                    '<link name="a"/><link name="b"/><joint name="$(arg name)" '
                    'type="continuous"><parent link="a"/><child link="b"/></joint></robot>')
    node = harness.make(kind, robot=str(path), xacro_arguments=['name:=elbow'],
                        **({'stack': POSTURE} if kind is ControllerNode else {}))
    assert node.get_parameter('limits.elbow.velocity').value == float('inf')
    if kind is ControllerNode:
        told = 'no velocity limit for elbow; give it, with the values of the data sheet, by '
        harness.spin_until(lambda: f'{told}limits: {{elbow: {{velocity: 0.5}}}}' in log())


def test_tasks_name_groups_of_joints(harness):
    stack = '- tip: {type: position, frame: link3, axes: xy, joints: first}'
    harness.make(ControllerNode, robot=str(PLANAR_DH), stack=stack, status_rate=50.0,
                 groups='first: [joint1, joint2]')
    status = Status(harness)
    harness.spin_until(lambda: status.head == 'no joint states of joint1, joint2, joint3')


def test_a_description_that_cannot_even_be_decoded_is_refused(harness, log):
    status, description = waiting_controller(harness)
    description.publish(String(data='<?xml version="1.0" encoding="foo"?><robot name="a"/>'))
    harness.spin_until(lambda: 'topic robot_description: ' in log())
    description.publish(String(data=URDF))
    harness.spin_until(lambda: status.head == 'no joint states of joint1, joint2, joint3')


def test_a_description_that_was_there_before_is_taken(harness):
    harness.node.create_publisher(String, '/robot_description', LATCHED).publish(
        String(data=URDF))
    harness.make(ControllerNode, stack=POSTURE, status_rate=50.0)
    status = Status(harness)
    harness.spin_until(lambda: status.task('rest'))


def test_a_node_without_a_description_logs_where_it_waits_for_one(harness, log):
    waiting_controller(harness)
    harness.spin_until(lambda: 'waiting for the robot on /robot_description' in log())


def test_the_simulator_brings_the_description(harness):
    harness.make(ControllerNode, stack=POSTURE, status_rate=50.0)
    harness.simulator()
    status = Status(harness)
    harness.spin_until(lambda: status.task('rest').get('status') == 'reached')


def test_a_description_as_parameter_needs_no_topic(harness):
    harness.controller(robot_description=URDF, stack=POSTURE)
    assert harness.node.count_subscribers('/robot_description') == 0
    assert harness.node.count_subscribers('/joint_states') == 1


def test_nothing_is_commanded_before_the_robot_is_known(harness):
    commands = harness.commands()
    status, description = waiting_controller(harness)
    harness.spin_for_more(status.messages, 10)
    assert status.head == WAITING
    assert not commands
    assert harness.node.count_publishers('/velocity_controller/commands') == 0
    for service in ('stop', 'start'):
        assert harness.trigger(service).success
    reload = harness.trigger('reload')
    assert not reload.success and reload.message == WAITING
    assert not commands
    description.publish(String(data=URDF))
    harness.spin_for_more(commands)
    assert commands[-1] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize('bad, told', [
    ('', "robot_description must be URDF text, not ''"),
    ('/etc/hostname', "must be URDF text, not '/etc/hostname'"),
    ('<robot', 'not valid XML'),
    ('<sdf/>', 'the outermost element is <sdf>'),
    ('<robot name="r"><link name="a"/></robot>', 'no joint to drive'),
    (PANDA_URDF, 'unknown parameter limits.joint2.velocity'),
])
def test_a_bad_description_is_named_in_one_line_and_the_next_one_taken(harness, log, bad, told):
    status, description = waiting_controller(harness, limits__joint2__velocity=0.5)
    description.publish(String(data=bad))
    lines = []

    def told_so():
        lines.extend(log().splitlines())
        return any('topic robot_description' in line for line in lines)

    harness.spin_until(told_so)
    line, = (line for line in lines if 'topic robot_description' in line)
    assert told in line
    assert 'Traceback' not in ''.join(lines)
    harness.spin_for_more(status.messages, 3)
    assert status.head == WAITING
    description.publish(String(data=URDF))
    harness.spin_until(lambda: status.task('rest'))
    assert 'ERROR' not in log()


def test_two_bad_descriptions_in_a_row_are_survived(harness, log):
    status, description = waiting_controller(harness, weights=[1.0, 2.0, 3.0])
    for _ in range(2):
        description.publish(String(data=PANDA_URDF))
        harness.spin_until(lambda: 'weights needs 7 numbers' in log())
    description.publish(String(data=URDF))
    harness.spin_until(lambda: status.task('rest'))


def test_only_the_first_description_counts(harness):
    commands = harness.commands()
    status, description = waiting_controller(harness)
    description.publish(String(data=URDF))
    harness.spin_until(lambda: status.task('rest'))
    description.publish(String(data=PANDA_URDF))
    harness.spin_for_more(status.messages, 5)
    harness.spin_for_more(commands, 5)
    assert {len(command) for command in commands} == {3}


def test_limits_of_the_topics_robot_are_no_unknown_parameters(harness, log):
    status, description = waiting_controller(harness, limits__joint1__velocity=0.5)
    description.publish(String(data=URDF))
    harness.spin_until(lambda: status.task('rest'))
    assert 'unknown' not in log()


@pytest.mark.parametrize('kind', [ControllerNode, SimulatorNode])
@pytest.mark.parametrize('parameters, told', [
    ({'limits__joint7__velocity': 1.0}, 'unknown parameter limits.joint7.velocity; valid: '),
    ({'limits__joint1__speed': 1.0}, 'unknown parameter limits.joint1.speed; valid: '),
    ({'limits__joint1__velocity': True}, 'limits.joint1.velocity must be a number'),
    ({'limits__joint1__velocity': -1.0}, 'joint joint1: velocity limit -1.0'),
    ({'limits__joint1__lower': float('nan')}, 'joint joint1: lower limit must be a number, '
     'not nan'),
    ({'command_joints': ['joint1', 'joint2', 'joint9']}, 'parameter command_joints'),
    ({'command_joints': ['joint1', 'joint2', 'joint2']}, 'parameter command_joints'),
    ({'robot': '/nowhere/arm.urdf'}, 'no file /nowhere/arm.urdf'),
    ({'robot': '/nowhere/arm.yaml'}, 'no file /nowhere/arm.yaml'),
    ({'robot': 'package://nobody/arm.urdf'}, "package 'nobody'"),
    ({'robot': 'robot_descriptions:nobody_description'}, 'nobody_description'),
    ({'robot': str(PLANAR_DH), 'xacro_arguments': ['a:=1']}, 'are for the file of a xacro'),
    ({'robot': str(PLANAR_DH), 'xacro_arguments': ['a=1']}, 'a xacro argument is name:=value'),
    ({'robot_description': 'arm.urdf'}, "must be URDF text, not 'arm.urdf'"),
])
def test_a_faulty_robot_parameter_is_refused_with_its_name(harness, kind, parameters, told):
    make = harness.controller if kind is ControllerNode else harness.simulator
    with pytest.raises((RobotError, SettingsError)) as error:
        make(**parameters)
    assert told in str(error.value)
    assert '\n' not in str(error.value)


def test_the_driven_joints_and_their_order_can_be_chosen(harness):
    harness.controller(joints=['joint3', 'joint1'], stack=POSTURE)
    commands = harness.commands()
    harness.spin_for_more(commands)
    assert len(commands[-1]) == 2
