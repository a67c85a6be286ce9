# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inputs that allow motion, ramped stops and activation, through real topics and services."""

import math
import time
from types import SimpleNamespace

from fault_table import BY_ITSELF, Outcome, outcomes, RAMPED, START
from harness import Arm, Status
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool, Float64, Int32, String
from std_srvs.srv import Trigger
from tp_controller.errors import SettingsError
from tp_controller.ros.loop.permits import Condition, Input

ZEROS = [0.0, 0.0, 0.0]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
SWING = '- swing: {type: joint, joints: joint1, target: [1.5], gain: 0.1}\n'


class Cell:
    """A controller, an arm at rest, and inputs that a test publishes with its joint states."""

    def __init__(self, harness, **parameters):
        self.harness, self.inputs = harness, {}
        harness.controller(stack=SWING, **parameters)
        self.commands, self.status, self.arm = harness.commands(), Status(harness), Arm(harness)

    def feed(self, kind, topic, value=None, qos=10):
        """Publish a value from now on."""
        self.inputs[topic] = self.harness.node.create_publisher(kind, topic, qos), kind, value

    def publish(self):
        """Publish everything."""
        self.arm.publish()
        for publisher, kind, value in self.inputs.values():
            if value is not None:
                publisher.publish(kind(data=value))

    def until(self, head):
        """Spin until the status says so, and whether it moves fits to that."""
        self.harness.spin_until(lambda: self.status.head == head, head, self.publish)
        if head == 'running':
            # A busy machine may hold up joint states for longer than the node waits for them.
            self.harness.spin_until(lambda: any(self.commands[-1]), 'motion', self.publish)
        else:
            assert not any(self.harness.spin_for_more(self.commands, 3, self.publish)[-1])

    def start(self):
        """Call ~/start; return why not."""
        answer = self.harness.call(Trigger, '/tp_controller/start', self.publish)
        return '' if answer.success else answer.message


@outcomes('Decisions', [
    Outcome('the enable switch is off', RAMPED, BY_ITSELF, 'not enabled', math.inf),
    Outcome('the enable switch is not received', RAMPED, BY_ITSELF, 'nothing received on', 0.5)])
def test_the_robot_moves_only_while_the_enable_switch_is_pressed(any_harness):
    cell = Cell(any_harness, enable_topic='/enable', enable_timeout=0.2)
    cell.until('not enabled: nothing received on /enable')
    cell.feed(Bool, '/enable', False)
    cell.until('not enabled: /enable is false')
    cell.feed(Bool, '/enable', True)
    cell.until('running')
    cell.feed(Bool, '/enable', False)
    cell.until('not enabled: /enable is false')
    cell.feed(Bool, '/enable', True)
    cell.until('running')
    # A hand that is still on the switch of a cable that was pulled.
    cell.inputs['/enable'] = (*cell.inputs['/enable'][:2], None)
    cell.until('not enabled: nothing received on /enable')


def test_an_enable_switch_without_timeout_is_heard_once(harness):
    cell = Cell(harness, enable_topic='/enable', enable_timeout=0.0)
    cell.feed(Bool, '/enable', qos=LATCHED)
    cell.inputs['/enable'][0].publish(Bool(data=True))
    cell.until('running')
    harness.spin_for_more(cell.commands, 100, cell.publish)
    cell.until('running')


@outcomes('Decisions', [Outcome('a state of the robot (`permit_topics`) is lost', RAMPED, START,
                                '/safety_mode is 3', math.inf)])
def test_a_state_of_the_robot_that_is_lost_stops_it_until_a_start(any_harness):
    cell = Cell(any_harness, permit_topics=['/program_running', '/safety_mode:data == 1'])
    cell.until('nothing received on /program_running')
    # As robots publish it: latched, when it changes.
    cell.feed(Bool, '/program_running', qos=LATCHED)
    cell.inputs['/program_running'][0].publish(Bool(data=True))
    cell.feed(Int32, '/safety_mode', 3)
    cell.until('/safety_mode is 3')
    assert cell.start() == 'not started: /safety_mode is 3'
    cell.feed(Int32, '/safety_mode', 1)
    cell.until('running')
    cell.feed(Int32, '/safety_mode', 3)
    cell.until('/safety_mode is 3; call ~/start to go on')
    assert cell.start() == 'not started: /safety_mode is 3'
    # A robot that may move again goes on only when somebody says so.
    cell.feed(Int32, '/safety_mode', 1)
    any_harness.spin_for_more(cell.commands, 20, cell.publish)
    cell.until('/safety_mode is 3; call ~/start to go on')
    any_harness.spin_until(lambda: not cell.start(), 'a start', cell.publish)
    cell.until('running')


def test_a_publisher_of_a_state_that_has_gone_is_no_permit(harness):
    cell = Cell(harness, permit_topics=['/program_running'])
    cell.feed(Bool, '/program_running', True)
    cell.until('running')
    publisher, *_ = cell.inputs.pop('/program_running')
    harness.node.destroy_publisher(publisher)
    cell.until('nothing received on /program_running; call ~/start to go on')


def test_an_input_that_is_no_number_is_named(harness, log):
    cell = Cell(harness, permit_topics=['/program_running:state.mode'])
    cell.feed(Bool, '/program_running', True)
    told = ('/program_running is published as std_msgs/msg/Bool, which has no number '
            "'state.mode'; its fields: data")
    harness.spin_until_logged(log, told, cell.publish)
    cell.until(told)
    assert not any(map(any, cell.commands))


@pytest.mark.parametrize('parameters, kind, told', [
    ({'enable_topic': '/state'}, Float64,
     'not enabled: /state is published as std_msgs/msg/Float64; it must be std_msgs/msg/Bool'),
    *(({name: value}, String, '/state is published as std_msgs/msg/String, which has no number '
       "'data'; its fields: data")
      for name, value in (('speed_scaling_topic', '/state'), ('permit_topics', ['/state'])))])
def test_another_type_is_named(harness, parameters, kind, told):
    cell = Cell(harness, **parameters)
    harness.node.create_publisher(kind, '/state', 10)
    cell.until(told)


def test_another_type_is_a_fault_until_there_is_the_right_one_only(harness):
    right = harness.publisher(Bool, '/right', connected=False)
    harness.publisher(Int32, '/wrong', connected=False)
    topics, found = ['/wrong'], Input('/right', kind='std_msgs/msg/Bool')
    # Within one process ROS allows one type a topic.
    graph = SimpleNamespace(get_publishers_info_by_topic=lambda _: [
        info for topic in topics for info in harness.node.get_publishers_info_by_topic(topic)])

    def received():
        found.look(graph, harness.node, time.monotonic)
        right.publish(Bool(data=True))
        return found.value == 1.0

    assert not received()
    assert found.fault == '/right is published as std_msgs/msg/Int32; it must be std_msgs/msg/Bool'
    topics[:] = ['/right']
    harness.spin_until(received)
    assert not found.fault
    topics[:] = ['/right', '/wrong']
    assert not received() and not list(harness.node.subscriptions)
    assert found.fault == ('/right is published as std_msgs/msg/Bool and std_msgs/msg/Int32; only '
                           'one type can be received')
    topics[:] = ['/right']
    harness.spin_until(received)


@pytest.mark.parametrize('qos', [LATCHED, 10, BEST_EFFORT], ids=['latched', 'reliable', 'lossy'])
def test_a_publisher_that_replaces_another_one_is_received_whatever_it_offers(harness, qos):
    cell = Cell(harness, permit_topics=['/program_running'])
    cell.feed(Bool, '/program_running', True, LATCHED)
    cell.until('running')
    # Within one interval in which publishers are looked for.
    harness.node.destroy_publisher(cell.inputs.pop('/program_running')[0])
    cell.feed(Bool, '/program_running', qos=qos)
    cell.until('nothing received on /program_running; call ~/start to go on')
    cell.inputs['/program_running'] = (*cell.inputs['/program_running'][:2], True)
    harness.spin_until(lambda: not cell.start(), 'a start', cell.publish)
    cell.until('running')


@pytest.mark.parametrize('parameters, told', [
    ({'permit_topics': ['/a', '/a == 1']}, '/a:data is named by permit_topics and permit_topics'),
    ({'permit_topics': ['a:data'], 'enable_topic': '/a'},
     '/a:data is named by enable_topic and permit_topics'),
    ({'speed_scaling_topic': '/a', 'enable_topic': '/a'},
     '/a:data is named by enable_topic and speed_scaling_topic')])
@pytest.mark.parametrize('robot', [{}, {'robot': ''}], ids=['a file', 'a topic'])
def test_a_state_that_is_named_twice_is_refused(harness, parameters, told, robot):
    with pytest.raises(SettingsError, match=f'{told}; it can be named once'):
        harness.controller(stack=SWING, **parameters, **robot)


def test_two_fields_of_a_topic_are_two_states(harness):
    harness.controller(stack=SWING, permit_topics=['/a:mode == 1', '/a:fault == 0'])


@pytest.mark.parametrize('scaling, follows', [(10.0, True), (None, False)])
def test_a_robot_that_says_it_is_slowed_down_follows(harness, scaling, follows):
    cell = Cell(harness, speed_scaling_topic='/speed_scaling', follow_window=0.5)
    cell.feed(Float64, '/speed_scaling', scaling)

    def publish():
        # A tenth of what is commanded, 200 times a second.
        if cell.commands:
            cell.arm.q[0] += 0.1 * 0.005 * cell.commands[-1][0]
        cell.publish()

    harness.spin_until(lambda: len(cell.commands) > 200, meanwhile=publish)
    assert ('does not follow' not in cell.status.head) == follows


@pytest.mark.parametrize('text', ['', '/a b', '/mode == on', '/mode ==', '== 1', '/mode = 1'])
def test_what_is_no_condition_is_refused(text):
    with pytest.raises(SettingsError, match='is no condition; valid: topic, topic:field or'):
        Condition(text, str)


@pytest.mark.parametrize('name', ['enable_topic', 'speed_scaling_topic'])
def test_what_is_no_name_of_a_topic_is_refused(harness, name):
    with pytest.raises(SettingsError, match=f"{name}: 'bad name' is no name of a topic"):
        harness.controller(stack=SWING, **{name: 'bad name'})


@pytest.mark.parametrize('text, value, holds', [
    ('/a', 1.0, True), ('/a', 0.0, False), ('/a', -1.0, False), ('/a == 3', 3.0, True),
    ('/a == true', 1.0, True), ('/a == false', 1.0, False), ('/a:x.y >= 2', 2.0, True),
    ('/a > 2', 2.0, False), ('/a < 2', 1.0, True), ('/a <= 2', 2.5, False),
    ('/a != 2', 2.0, False)])
def test_conditions_are_what_they_look_like(text, value, holds):
    condition = Condition(text, str)
    assert condition.fault() == 'nothing received on /a'
    condition.input.value, condition.input.received = value, 0.0
    bound = text.partition('<')[1:] if '<' in text else text.partition('>')[1:]
    told = f'/a is not {"".join(bound)}' if bound[0] else f'/a is {value:g}'
    assert condition.fault() == ('' if holds else told)


@pytest.mark.parametrize('text', ['/a', '/a != 3', '/a < 3'])
def test_a_state_that_is_no_number_is_no_permit(text):
    condition = Condition(text, str)
    condition.input.received = 0.0
    assert condition.fault()


def test_the_reason_of_a_state_that_changes_all_the_time_stays_the_same():
    condition = Condition('/temperature:data <= 60', str)
    faults = set()
    for value in np.random.default_rng(1).uniform(61.0, 70.0, 20):
        condition.input.value, condition.input.received = value, 0.0
        faults.add(condition.fault())
    assert faults == {'/temperature is not <= 60'}


# Activation -----------------------------------------------------------------------------------

def change(harness, name, meanwhile):
    """Ask for a transition."""
    number = getattr(Transition, f'TRANSITION_{name.upper()}')
    assert harness.call(ChangeState, '/tp_controller/change_state', meanwhile,
                        transition=Transition(id=number)).success


@pytest.mark.parametrize('keep', [False, True])
def test_after_a_deactivation_the_robot_stays_where_it_is_unless_told_otherwise(any_harness, keep):
    harness, cell = any_harness, Cell(any_harness, keep_goals=keep)
    cell.until('running')
    change(harness, 'deactivate', cell.publish)
    # Somebody moves the arm by hand.
    cell.arm.q[0] = -1.0
    harness.spin_until(lambda: cell.status.head.startswith('inactive'), meanwhile=cell.publish)
    # On a busy machine earlier joint states may still be waiting: more than wait take their place.
    for _ in range(30):
        cell.publish()
    cell.commands.clear()
    change(harness, 'activate', cell.publish)
    harness.spin_until(lambda: cell.status.head == 'running', meanwhile=cell.publish)
    commands = harness.spin_for_more(cell.commands, 20, cell.publish)
    assert any(map(any, commands)) == keep


def test_a_stop_and_a_deactivation_are_ramped(any_harness):
    harness = any_harness
    # What a busy machine holds up is no reason for zeros here.
    cell = Cell(harness, stop_deceleration=0.2, state_timeout=2.0, watchdog_timeout=2.0)
    cell.until('running')
    for act in (lambda: harness.call(Trigger, '/tp_controller/stop', cell.publish),
                lambda: change(harness, 'deactivate', cell.publish)):
        fast = abs(cell.commands[-1][0])
        cell.commands.clear()
        act()
        harness.spin_until(lambda: cell.commands and cell.commands[-1] == ZEROS,
                           meanwhile=cell.publish)
        speeds = [abs(command[0]) for command in cell.commands]
        slower = [speed for speed in speeds if 0.0 < speed < fast - 1e-9]
        assert len(slower) > 5 and speeds == sorted(speeds, reverse=True)
        if not cell.status.head.startswith('inactive'):
            harness.spin_until(lambda: not cell.start(), 'a start', cell.publish)
            cell.until('running')
    harness.spin_until(lambda: cell.status.head.startswith('inactive'), meanwhile=cell.publish)
    harness.spin_until(lambda: cell.commands[-3:] == 3 * [ZEROS])
