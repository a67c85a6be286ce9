# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What the controller publishes: status, diagnostics, numbers and poses."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped
from harness import Arm, Status
import numpy as np
import pytest
from rclpy.parameter import Parameter
from robots import PLANAR_DH
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import rotation_from_quaternion
from tp_controller.ros.client.goal_fields import make_message
from tp_controller.ros.client.status import received, TaskStatus

STACK = """
- tip: {type: position, frame: link3, axes: xy, gain: 2.0}
- [turn: {type: orientation, frame: link3, axes: z}, slow: {type: joint, joints: joint1}]
- rest: {type: posture, target: [0.0, 0.0, 0.0]}
"""
Q = (0.0, 0.6, 0.3)
OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN


class Rig:
    """A controller of the planar arm at rest."""

    def __init__(self, harness, stack=STACK, **parameters):
        self.harness = harness
        self.controller = harness.controller(stack=stack, **parameters)
        self.status, self.arm = Status(harness), Arm(harness, Q)

    def spin_until(self, condition):
        """Spin, while the arm says where it is."""
        self.harness.spin_until(condition, meanwhile=self.arm.publish)


def test_the_status_has_the_node_first_and_then_every_task_by_priority(harness):
    rig = Rig(harness)
    rig.spin_until(lambda: rig.status.head == 'running')
    message = rig.status.messages[-1]
    assert [status.name for status in message.status] == [
        'tp_controller', 'tp_controller: tip', 'tp_controller: turn', 'tp_controller: slow',
        'tp_controller: rest']
    assert [rig.status.task(name)['level'] for name in ('tip', 'turn', 'slow', 'rest')] == [
        '1', '2', '2', '3']
    assert [value.key for value in message.status[0].values] == [
        'scale', 'limiting', 'locked', 'cycles', 'rate [Hz]', 'cycle median [ms]',
        'cycle p99 [ms]', 'cycle max [ms]', 'state to command median [ms]',
        'state to command p99 [ms]', 'state to command max [ms]', 'overruns', 'stalls',
        'missed deadlines', 'not following', 'other publishers', 'listeners', 'watchdogs',
        'lead', 'ignored description', 'solver', 'cycles left to Python']
    assert message.status[0].level == OK
    assert message.header.stamp.sec > 0


def test_a_task_reports_its_error_with_unit_and_what_holds_it_back(harness):
    rig = Rig(harness)
    publisher = harness.publisher(PointStamped, '/tp_controller/tip/goal')
    rig.spin_until(lambda: rig.status.head == 'running')
    tip = rig.controller._robot.controller.stack.tasks['tip']
    goal = tip.goal + (0.03, -0.04, 0.0)
    publisher.publish(make_message('tip', PointStamped, {'xyz': goal}))
    rig.spin_until(lambda: rig.status.task('tip')['goals accepted'] == '1')
    rig.spin_until(lambda: rig.status.knows('tip', 'error [m]'))
    task = rig.status.task('tip')
    assert float(task['error [m]']) == pytest.approx(0.05, abs=1e-6)
    assert float(task['tolerance [m]']) == 1e-3
    # The gain is 2/s.
    assert float(task['wanted speed']) == pytest.approx(0.1, abs=1e-6)
    assert task['type'] == 'position' and task['status'] in ('moving', 'limited')
    rest = rig.status.task('rest')
    assert rest['status'] == 'limited'
    assert rest['reason'] == 'blocked by tip and turn together'
    assert rest['causes'] == 'blocked by tip; blocked by turn'
    assert rest['hint'] == 'choose goals of tip, turn and rest that are compatible'
    levels = {status.name: status.level for status in rig.status.messages[-1].status}
    assert levels['tp_controller: rest'] == WARN
    texts = {status.name: status.message for status in rig.status.messages[-1].status}
    assert texts['tp_controller: rest'] == 'limited: blocked by tip and turn together'


def test_a_disabled_task_says_so_once(harness):
    rig = Rig(harness)
    rig.spin_until(lambda: rig.status.head == 'running')
    harness.enable('rest', False)
    rig.spin_until(lambda: rig.status.task('rest')['status'] == 'disabled')
    texts = {status.name: status.message for status in rig.status.messages[-1].status}
    assert texts['tp_controller: rest'] == 'disabled'
    assert rig.status.task('rest')['reason'] == rig.status.task('rest')['hint'] == ''


def test_the_limit_that_slows_the_robot_is_named(harness):
    rig = Rig(harness, '- rest: {type: posture, target: [2.0, 0.6, 0.3]}')
    rig.spin_until(lambda: rig.status.task('rest')['reason'])
    assert rig.status.task('rest')['reason'] == 'joint1 at its velocity limit'
    values = {value.key: value.value for value in rig.status.messages[-1].status[0].values}
    assert (values['scale'], values['limiting']) == ('0.5000', 'joint1 at its velocity limit')


def test_the_client_reads_what_the_controller_writes(harness):
    rig = Rig(harness, '- rest: {type: posture, target: [2.0, 0.6, 0.3]}')
    rig.spin_until(lambda: rig.status.task('rest')['reason'])
    found, written = received(rig.status.messages[-1]), rig.status.task('rest')
    assert found.from_controller and found.head == 'running'
    rest = found.tasks['rest']
    assert rest == TaskStatus(
        'rest', 'posture', '1', 'limited', {'rad': float(written['error [rad]'])},
        {'rad': float(written['tolerance [rad]'])}, float(written['wanted speed']),
        float(written['achieved speed']), 'joint1 at its velocity limit', written['hint'],
        ('joint1 at its velocity limit',), listeners={'goal': 1, 'trajectory': 1})
    assert rest.hint and 0.0 < rest.achieved_speed < rest.wanted_speed


def test_diagnostics_say_the_same(harness):
    rig = Rig(harness)
    diagnostics = harness.record(DiagnosticArray, '/diagnostics')
    rig.spin_until(lambda: diagnostics and diagnostics[-1].status[0].message == 'running')
    head, *tasks = diagnostics[-1].status
    assert head.hardware_id == 'tp_controller'
    assert [task.name for task in tasks] == [task.name for task in rig.status.messages[-1].status
                                             ][1:]


def test_while_stopped_the_status_shows_the_reason_instead_of_old_errors(harness):
    rig = Rig(harness)
    rig.spin_until(lambda: rig.status.head == 'running')
    harness.spin_until(lambda: rig.status.head == 'no joint states of joint1, joint2, joint3')
    message = rig.status.messages[-1]
    assert [status.level for status in message.status] == [WARN] * 5
    tip = rig.status.task('tip')
    assert (tip['status'], tip['error [m]'], tip['achieved speed']) == ('stopped', 'nan', '0')


def keys(message):
    """Return the keys of every entry of a status."""
    return {status.name: [value.key for value in status.values] for status in message.status}


class Conditions:
    """Whatever a controller can be in, one after the other at random."""

    def __init__(self, harness, seed):
        self._harness, self._random = harness, np.random.default_rng(seed)
        self.rig = Rig(harness, blend=0.4, state_timeout=0.2)
        self._known = True

    def change(self):
        """Do one of these at random."""
        kinds = (self._move, self._wait, self._switch, self._stop, self._send, self._configure)
        kinds[self._random.integers(len(kinds))]()

    def _move(self):
        count = len(self.rig.status.messages) + 2
        self.rig.spin_until(lambda: len(self.rig.status.messages) >= count)

    def _wait(self):
        self._harness.spin_for_more(self.rig.status.messages, 15)

    def _switch(self):
        if self._known:
            name = ('tip', 'turn', 'slow', 'rest')[self._random.integers(4)]
            self._harness.enable(name, bool(self._random.integers(2)))

    def _stop(self):
        self._harness.trigger(('stop', 'start', 'reload')[self._random.integers(3)])

    def _send(self):
        if self._known:
            goal = self._random.choice([0.5, np.nan])
            publisher = self._harness.publisher(PointStamped, '/tp_controller/tip/goal')
            publisher.publish(make_message('tip', PointStamped, {'xyz': (goal, 0.5, 0.0)}))
            self._harness.node.destroy_publisher(publisher)

    def _configure(self):
        state = self.rig.controller
        if self._known:
            state.trigger_deactivate()
            state.trigger_cleanup()
        else:
            state.trigger_configure()
            state.trigger_activate()
        self._known = not self._known


@pytest.mark.parametrize('seed', range(3))
def test_the_keys_are_the_same_in_every_condition(harness, seed):
    """Tasks are told of as long as there is a stack; the node always says all it can."""
    conditions = Conditions(harness, seed)
    diagnostics = harness.record(DiagnosticArray, '/diagnostics')
    conditions.rig.spin_until(lambda: conditions.rig.status.head == 'running')
    for _ in range(12):
        conditions.change()
    messages = conditions.rig.status.messages + diagnostics
    told = {}
    for message in messages:
        for name, entry in keys(message).items():
            told.setdefault(name, set()).add(tuple(entry))
    assert len(told) == 5 and {name: len(kinds) for name, kinds in told.items()} == \
        dict.fromkeys(told, 1)


def test_the_keys_of_the_node_are_the_same_without_a_robot_or_a_stack(harness):
    expected = set()
    for parameters in ({}, {'stack': ''}, {'robot': ''}, {'autostart': False}):
        controller, status = harness.controller(**parameters), Status(harness)
        harness.spin_until(lambda status=status: len(status.messages) > 2)
        expected |= {tuple(keys(message)['tp_controller']) for message in status.messages}
        harness.remove(controller)
    assert len(expected) == 1


def test_every_node_speaks_under_its_own_full_name(harness):
    rig = Rig.__new__(Rig)
    rig.controller = harness.controller(arguments=[
        '--ros-args', '-r', '__ns:=/left', '-r', '__node:=arm'])
    rig.status = Status(harness, '/left/arm/status')
    harness.spin_until(lambda: rig.status.messages)
    assert [status.name for status in rig.status.messages[-1].status] == [
        'left/arm', 'left/arm: swing']
    # The names of the topics are relative, so that they move, too.
    for topic in ('/left/joint_states', '/left/arm/swing/goal'):
        assert harness.node.count_subscribers(topic) == 1
    assert harness.node.count_publishers('/left/velocity_controller/commands') == 1


def test_stamps_are_simulated_time_where_it_is_used(harness):
    rig = Rig(harness, use_sim_time=True)
    clock = harness.publisher(Clock, '/clock')
    time = Clock()
    time.clock.sec = 1234
    harness.spin_until(lambda: rig.status.messages
                       and rig.status.messages[-1].header.stamp.sec == 1234,
                       meanwhile=lambda: clock.publish(time))


# Numbers --------------------------------------------------------------------------------------

LABEL = 'error [m], tolerance [m], error [rad], tolerance [rad], wanted speed, ' \
    'achieved speed, stamp [s]'


def named(message):
    """Return {name: number} of the numbers of a task."""
    dimension, = message.layout.dim
    names = dimension.label.split(', ')
    assert dimension.size == dimension.stride == len(names) == len(message.data)
    return dict(zip(names, message.data))


def test_numbers_of_a_task_are_those_of_its_status(harness):
    rig = Rig(harness, '- both: {type: pose, frame: link3, axes: [x, rz], gain: 2.0}\n'
                       '- rest: {type: posture, target: [0.0, 0.0, 0.0]}')
    before = rig.controller.get_clock().now().nanoseconds * 1e-9
    numbers = harness.record(Float64MultiArray, '/tp_controller/both/numbers')
    others = harness.record(Float64MultiArray, '/tp_controller/rest/numbers')
    publisher = harness.publisher(PoseStamped, '/tp_controller/both/goal')
    rig.spin_until(lambda: numbers and others and rig.status.head == 'running')
    assert numbers[-1].layout.dim[0].label == LABEL
    both = rig.controller._robot.controller.stack.tasks['both']
    x, y, *rest = both.goal_pose(rig.controller._robot.controller.robot.state(Q))[:2, 3]
    publisher.publish(make_message('both', PoseStamped, {'xyz': (x + 0.05, y, 0.0),
                                                         'quat_xyzw': (0.0, 0.0, 0.0, 1.0)}))
    rig.spin_until(lambda: rig.status.task('both')['goals accepted'] == '1')
    del numbers[:], others[:]

    def agree():
        """Return whether the last numbers of both tasks are those of the last status."""
        return all(value == pytest.approx(float(rig.status.task(task)[name]), rel=1e-5)
                   for messages, task in ((numbers, 'both'), (others, 'rest'))
                   for name, value in list(named(messages[-1]).items())[:-1])

    # Numbers and status are published apart, and a busy machine may stop the robot in between.
    rig.spin_until(lambda: numbers and others and rig.status.head == 'running' and agree())
    after = rig.controller.get_clock().now().nanoseconds * 1e-9
    values = named(numbers[-1])
    assert values['error [m]'] == pytest.approx(0.05) and values['error [rad]'] > 0.1
    assert before <= values['stamp [s]'] <= after


def test_numbers_that_are_not_known_are_nan_in_the_same_layout(harness):
    rig = Rig(harness)
    numbers = harness.record(Float64MultiArray, '/tp_controller/rest/numbers')

    def known():
        return [name for name, value in named(numbers[-1]).items() if not np.isnan(value)]

    names = ['error [rad]', 'tolerance [rad]', 'wanted speed', 'achieved speed', 'stamp [s]']
    at_rest = ['tolerance [rad]', 'stamp [s]']
    harness.spin_until(lambda: numbers)
    assert known() == at_rest and list(named(numbers[-1])) == names
    rig.spin_until(lambda: known() == names)
    harness.enable('rest', False)
    rig.spin_until(lambda: known() == at_rest)
    harness.enable('rest', True)
    rig.spin_until(lambda: known() == names)
    harness.spin_until(lambda: known() == at_rest)
    assert {message.layout.dim[0].label for message in numbers} == {', '.join(names)}


def test_numbers_follow_the_stack_and_cost_nothing_where_nobody_listens(harness, monkeypatch):
    monkeypatch.setattr('tp_controller.ros.interface.task_numbers.numbers',
                        lambda *_: pytest.fail('made without need'))
    rig = Rig(harness)

    def topics():
        return {name for name, _ in harness.node.get_topic_names_and_types()
                if name.endswith('/numbers')}

    harness.spin_until(lambda: topics() == {f'/tp_controller/{name}/numbers' for name in (
        'tip', 'turn', 'slow', 'rest')})
    rig.spin_until(lambda: rig.status.head == 'running')
    harness.spin_for_more(rig.status.messages, 3, rig.arm.publish)
    stack = Parameter('stack', value='- rest: {type: posture}\n- new: {type: joint_velocity}')
    assert rig.controller.set_parameters_atomically([stack]).successful
    harness.spin_until(lambda: topics() == {f'/tp_controller/{name}/numbers' for name in (
        'rest', 'new')})
    rig.controller.trigger_deactivate()
    rig.controller.trigger_cleanup()
    harness.spin_until(lambda: topics() == set())


def test_the_pose_of_a_frame_is_that_of_the_robot_even_if_it_is_stopped(harness):
    rig = Rig(harness, stack='- hand: {type: relative_pose, frame: link3, reference: link1}\n'
                             '- rest: {type: posture}')
    robot = Robot.from_file(PLANAR_DH)
    poses = harness.record(TransformStamped, '/tp_controller/hand/transform')
    assert not harness.node.count_publishers('/tp_controller/rest/transform')

    def shows(q):
        state = robot.state(q)
        R = state.rotation('link1').T
        shift, turn = poses[-1].transform.translation, poses[-1].transform.rotation
        return np.allclose([shift.x, shift.y, shift.z], R @ (
            state.position('link3') - state.position('link1'))) and np.allclose(
            rotation_from_quaternion([turn.x, turn.y, turn.z, turn.w]),
            R @ state.rotation('link3'))

    rig.spin_until(lambda: poses and shows(Q))
    assert (poses[-1].header.frame_id, poses[-1].child_frame_id) == ('link1', 'link3')
    assert poses[-1].header.stamp.sec > 0
    harness.trigger('stop')
    rig.arm.q = [0.5, -0.4, 0.2]
    rig.spin_until(lambda: shows(rig.arm.q))
