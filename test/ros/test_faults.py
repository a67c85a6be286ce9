# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of joint states: a hostile publisher, and a robot that does not do as it is told."""

import math
import time

from fault_table import AT_ONCE, BY_ITSELF, NOTHING, Outcome, outcomes, START
from harness import Arm, COMMANDS, JOINTS, MOVING_STACK, Status
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from robots import PLANAR_DH
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from tp_controller.errors import SettingsError
from tp_controller.ros.controller_node import ControllerNode
from tp_controller.ros.loop.other_publishers import LOOKING, NEW_SECONDS
from tp_controller.ros.loop.state_checks import FollowCheck, Following
from tp_controller.ros.watchdog_node import WatchdogNode

Q = (0.0, 0.6, 0.3)
ZEROS = [0.0, 0.0, 0.0]
# A motion that lasts longer than a test.
SLOW = '- swing: {type: joint, joints: joint1, target: [1.8], gain: 0.05}\n'
STRICT = {'follow_window': 0.5, 'jump_tolerance': 0.1, 'settle_time': 0.3}


class Robot:
    """An arm that follows its commands, as far as a test lets it."""

    def __init__(self, harness, commands, follows=1.0):
        self.arm, self.commands, self.follows = Arm(harness, Q), commands, follows
        self._last = time.monotonic()
        self.stamp = time.time

    def publish(self):
        """Move on, and publish where the joints are."""
        now = time.monotonic()
        if self.commands:
            self.arm.q = [q + self.follows * (now - self._last) * velocity
                          for q, velocity in zip(self.arm.q, self.commands[-1])]
        self._last = now
        self.arm.publish(self.stamp())


@pytest.fixture
def robot(harness):
    """Return a robot that moves, its commands and the status of its controller."""
    controller = harness.controller(
        **STRICT, limits__joint1__lower=-2.0, limits__joint1__upper=2.0,
        stack='- swing: {type: joint, joints: joint1, target: [1.8], gain: 0.2}\n')
    commands, status = harness.commands(), Status(harness)
    robot = Robot(harness, commands)
    robot.status, robot.controller = status, controller
    harness.spin_until(lambda: commands and any(commands[-1]), 'motion', meanwhile=robot.publish)
    return robot


def goes_on(harness, robot, status=None):
    """Spin until the robot is not stopped, but for a moment if the machine is busy."""
    status = status or robot.status
    harness.spin_until(lambda: status.head == 'running', 'running', meanwhile=robot.publish)


def only_moves(harness, robot):
    """Wait for twenty commands in turn that move the robot, of one node or of several."""
    robot.commands.clear()
    harness.spin_until(lambda: len(robot.commands) >= 20
                       and all(any(each) for each in robot.commands[-20:]),
                       'commands that move', meanwhile=robot.publish)


def wait_until_stopped(harness, robot, told, meanwhile=None):
    """Spin until the robot is stopped for a reason, and check that zeros are commanded."""
    harness.spin_until(lambda: told in robot.status.head, told,
                       meanwhile=meanwhile or robot.publish)
    assert harness.spin_for_more(robot.commands, 3, meanwhile or robot.publish)[-1] == ZEROS


def start(harness):
    """Call ~/start and return (whether it was, what it said)."""
    answer = harness.trigger('start')
    return answer.success, answer.message


def test_a_robot_that_follows_goes_on(harness, robot):
    end = time.monotonic() + 3.0
    harness.spin_until(lambda: time.monotonic() > end, meanwhile=robot.publish)
    goes_on(harness, robot)


@pytest.mark.parametrize('told, stamp', [
    ('s by its stamp)', lambda: 1000.0), ('s by its stamp)', lambda: time.time() - 5.0),
    ('ahead of the ones before)', lambda: time.time() + 5.0)])
def test_stamps_that_stand_still_or_are_of_another_time_stop_the_robot_for_a_while(
        harness, robot, told, stamp):
    robot.stamp = stamp
    wait_until_stopped(harness, robot, told)
    robot.stamp = time.time
    harness.spin_until(lambda: any(robot.commands[-1]), 'motion', meanwhile=robot.publish)


def told(harness, robot, part):
    """Return which of 20 more reasons contain a part, each once."""
    messages = harness.spin_for_more(robot.status.messages, 20, robot.publish)
    return {message.status[0].message for message in messages
            if part in message.status[0].message}


@pytest.mark.parametrize('least', [0.2, -0.4])
def test_the_reason_stays_the_same_while_joint_states_come_by_varying_times_late(harness, robot,
                                                                                 least):
    random = np.random.default_rng(1)
    robot.stamp = lambda: time.time() - random.uniform(least, least + 0.2)
    wait_until_stopped(harness, robot, '(ignored:')
    assert told(harness, robot, '(ignored:') <= {
        f'no joint states of joint1, joint2, joint3 (ignored: {fault})' for fault in (
            'older than 0.1 s by its stamp', 'stamped more than 0.1 s ahead of the ones before')}


def test_the_reason_stays_the_same_while_joint_states_are_ignored_now_and_then(harness, robot):
    robot.stamp, due = (lambda: 1000.0), [0.0]

    def publish():
        if time.monotonic() > due[0]:
            robot.publish()
            due[0] = time.monotonic() + 0.3

    wait_until_stopped(harness, robot, '(ignored:', publish)
    messages = harness.spin_for_more(robot.status.messages, 40, publish)
    assert {message.status[0].message for message in messages
            if 'no joint states' in message.status[0].message} == {
        'no joint states of joint1, joint2, joint3 (ignored: older than 0.1 s by its stamp)'}


def test_the_reason_stays_the_same_while_cycles_take_too_long(harness, robot):
    controller = robot.controller._robot.loop._controller
    update, random = controller.update, np.random.default_rng(1)

    def slow(*arguments):
        time.sleep(random.uniform(0.11, 0.2))
        return update(*arguments)

    controller.update = slow
    harness.spin_until(lambda: 'longer than' in robot.status.head, meanwhile=robot.publish)
    assert told(harness, robot, ' longer than ') <= {
        f'{cause} longer than 0.1 s{end}' for cause in ('a cycle took', 'the node stood still for')
        for end in ('', ', until a moment ago')}


def test_a_robot_that_does_not_follow_is_stopped_until_a_start(harness, robot):
    robot.follows = 0.0
    wait_until_stopped(harness, robot, 'joint1 does not follow')
    robot.follows = 1.0
    harness.spin_for_more(robot.commands, 30, robot.publish)
    assert robot.commands[-1] == ZEROS
    harness.start(robot.publish)
    harness.spin_until(lambda: any(robot.commands[-1]), 'motion', meanwhile=robot.publish)


def test_a_pause_of_the_joint_states_stops_the_robot_for_a_while_only(harness, robot):
    robot.publish = lambda: None
    wait_until_stopped(harness, robot, 'no joint states')
    del robot.publish
    robot._last = time.monotonic()
    harness.spin_until(lambda: any(robot.commands[-1]), 'motion', meanwhile=robot.publish)
    since = time.monotonic()
    harness.spin_until(lambda: time.monotonic() > since + 1.5, meanwhile=robot.publish)
    goes_on(harness, robot)


def test_a_driver_that_begins_with_zeros_does_not_stop_the_robot(harness):
    harness.controller(**STRICT)
    commands, status = harness.commands(), Status(harness)
    first, arm = Arm(harness, (0.0,), JOINTS[1:2]), Arm(harness, Q)
    first.publish()
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)
    assert status.head in ('', 'running') or 'jumped' not in status.head


def test_a_joint_that_jumps_stops_the_robot_until_a_start(harness, robot):
    robot.arm.q[0] += 1.5
    wait_until_stopped(harness, robot, 'joint1 jumped by 1.5')
    assert 'call ~/start' in robot.status.head
    end = time.monotonic() + 1.2
    harness.spin_until(lambda: time.monotonic() > end, meanwhile=robot.publish)
    harness.start(robot.publish)
    harness.spin_until(lambda: any(robot.commands[-1]), 'motion', meanwhile=robot.publish)


def test_publishers_that_disagree_stop_the_robot_and_start_is_refused_meanwhile(harness, robot):
    other = Arm(harness, (1.5, 0.6, 0.3))

    def both():
        robot.publish()
        other.publish(time.time())

    wait_until_stopped(harness, robot, 'joint1 jumped by', meanwhile=both)
    harness.spin_for_more(robot.commands, 5, both)
    success, message = start(harness)
    assert not success and 'not started: joint1 jumped by' in message


def test_joint_states_that_name_a_joint_twice_count_as_missing(harness, robot):
    other = Arm(harness, (*Q, 0.0), (*JOINTS, 'joint1'))
    wait_until_stopped(harness, robot, 'no joint states of joint1, joint2, joint3 (ignored: '
                       'joint1 is named twice)', meanwhile=other.publish)
    harness.spin_until(lambda: any(robot.commands[-1]), 'motion', meanwhile=robot.publish)


def test_a_joint_that_passes_its_limit_stops_the_robot(harness, robot):
    checks = robot.controller._robot.loop.checks
    checks.follow = FollowCheck(JOINTS, np.zeros(3, bool), Following(0.0))
    robot.follows, positions = 0.0, iter([0.01 * step for step in range(250)])

    def drift():
        robot.arm.q[0] = next(positions, 2.5)
        robot.publish()

    wait_until_stopped(harness, robot, 'joint1 has passed its position limit', meanwhile=drift)


def test_a_task_that_raises_stops_the_robot_until_a_start(harness, robot, monkeypatch):
    task = robot.controller._robot.controller.stack.tasks['swing']

    def fail(*arguments):
        raise ZeroDivisionError('division by zero')

    with monkeypatch.context() as patch:
        patch.setattr(task, 'evaluate', fail)
        wait_until_stopped(harness, robot, 'ZeroDivisionError: division by zero; call ~/start')
    harness.spin_for_more(robot.commands, 30, robot.publish)
    assert robot.commands[-1] == ZEROS
    harness.start(robot.publish)
    harness.spin_until(lambda: any(robot.commands[-1]), 'motion', meanwhile=robot.publish)


def test_the_rest_goes_on_without_a_task_that_raises_where_that_is_wanted(
        harness, robot, monkeypatch):
    result, = robot.controller.set_parameters([Parameter('task_faults', value='switch off')])
    assert result.successful

    def fail(*arguments):
        raise ZeroDivisionError('division by zero')

    monkeypatch.setattr(robot.controller._robot.controller.stack.tasks['swing'], 'evaluate', fail)
    harness.spin_until(lambda: robot.status.task('swing')['status'] == 'failed', 'failed',
                       meanwhile=robot.publish)
    assert robot.status.task('swing')['reason'] == (
        'fail raised ZeroDivisionError: division by zero')
    goes_on(harness, robot)


@pytest.mark.parametrize('text', ['[' * 300, '- a: &a [*a]', '? [a]\n: b', '- \ud7ff: 1'])
def test_no_stack_ends_the_node(harness, robot, text):
    result, = robot.controller.set_parameters([Parameter('stack', value=text)])
    assert not result.successful and result.reason
    harness.spin_until(lambda: any(robot.commands[-1]), 'motion', meanwhile=robot.publish)


def test_the_last_status_says_why_the_node_ends(harness, robot):
    robot.controller.close('ended by SIGHUP')
    harness.spin_until(lambda: robot.status.head == 'ended by SIGHUP')
    assert robot.commands[-1] == ZEROS


def second_controller(harness, **parameters):
    """Return the status of a second controller of the same robot."""
    harness.make(ControllerNode, **{
        'robot': str(PLANAR_DH), 'stack': MOVING_STACK, 'status_rate': 50.0, **parameters},
        arguments=['--ros-args', '-r', '__node:=second'])
    return Status(harness, '/second/status')


def wait(harness, robot, seconds):
    """Spin for so long: to see that something does not happen."""
    since = time.monotonic()
    harness.spin_until(lambda: time.monotonic() > since + seconds, meanwhile=robot.publish)


@pytest.fixture
def exclusive(harness):
    """Return a robot that moves, whose controller is alone and no newcomer any more."""
    # What a busy machine holds up is no reason for zeros here.
    node = harness.controller(**STRICT, exclusive=True, stack=SLOW, state_timeout=2.0,
                              watchdog_timeout=2.0)
    robot = Robot(harness, harness.commands())
    robot.controller = node
    robot.status = Status(harness)
    harness.spin_until(lambda: robot.status.head == LOOKING, meanwhile=robot.publish)
    assert not robot.commands
    harness.spin_until(lambda: robot.commands and any(robot.commands[-1]), 'motion',
                       meanwhile=robot.publish)
    wait(harness, robot, NEW_SECONDS)
    return robot


@outcomes('Other nodes', [Outcome('another node publishes commands when this one starts', NOTHING,
                                  START, 'publishes on', math.inf)])
def test_a_newcomer_publishes_nothing_beside_another_controller(harness, exclusive, log):
    robot, others = exclusive, '/tp_controller publishes on /velocity_controller/commands, too'
    status = second_controller(harness)
    robot.commands.clear()
    harness.spin_until(lambda: status.head == f'{others}; call ~/start to go on',
                       meanwhile=robot.publish)
    harness.spin_until_logged(log, others, robot.publish)
    for each in (robot.status, status):
        harness.spin_until(lambda each=each: each.of_node('other publishers') == '1',
                           meanwhile=robot.publish)
    # Both would command the robot.
    answer = harness.call(Trigger, '/second/start', robot.publish)
    assert (answer.success, answer.message) == (False, f'not started: {others}')
    wait(harness, robot, 1.0)
    # The one that was there goes on, and is the only one that the robot hears.
    goes_on(harness, robot)
    only_moves(harness, robot)
    # It is handed over: one that is inactive does not stand in the way.
    assert harness.call(ChangeState, '/tp_controller/change_state', robot.publish,
                        transition=Transition(id=Transition.TRANSITION_DEACTIVATE)).success
    harness.spin_until(lambda: harness.call(Trigger, '/second/start', robot.publish).success,
                       meanwhile=robot.publish)
    harness.spin_until(lambda: status.head == 'running', meanwhile=robot.publish)
    harness.remove(robot.controller)
    harness.spin_until(lambda: status.of_node('other publishers') == '0',
                       meanwhile=robot.publish)


def test_a_silent_newcomer_does_not_stop_a_robot_that_has_just_begun_to_move(harness):
    harness.controller(**STRICT, exclusive=True, stack=SLOW, state_timeout=2.0,
                       watchdog_timeout=2.0)
    robot, status = Robot(harness, harness.commands()), Status(harness)
    harness.spin_until(lambda: robot.commands and any(robot.commands[-1]), 'motion',
                       meanwhile=robot.publish)
    harness.node.create_publisher(Float64MultiArray, COMMANDS, 10)
    harness.spin_until(lambda: status.of_node('other publishers') == '1',
                       meanwhile=robot.publish)
    wait(harness, robot, 0.5)
    goes_on(harness, robot, status)


@outcomes('Other nodes', [Outcome('commands of another node are received in motion', AT_ONCE
                                  + f', then {NOTHING}', START, 'publishes on', math.inf,
                                  NOTHING)])
def test_commands_of_another_node_stop_a_robot_that_moves_and_name_the_node(harness, exclusive):
    robot, rival = exclusive, harness.add(Node('rival', namespace='/cell',
                                               context=harness.context))
    publisher = rival.create_publisher(Float64MultiArray, COMMANDS, 10)
    message = Float64MultiArray(data=[0.0, 0.01, 0.0])
    others = f'/cell/rival publishes on {COMMANDS}, too'
    harness.spin_until(lambda: robot.status.of_node('other publishers') == '1',
                       meanwhile=robot.publish)
    # One that is silent, or said something once, as by hand, is no reason.
    publisher.publish(message)
    wait(harness, robot, 1.2)
    goes_on(harness, robot)

    def publish():
        robot.publish()
        publisher.publish(message)

    harness.spin_until(lambda: robot.status.head == f'{others}; call ~/start to go on',
                       meanwhile=publish)
    robot.commands.clear()
    harness.spin_for_more(robot.commands, 100, publish)
    assert ZEROS not in robot.commands
    answer = harness.call(Trigger, '/tp_controller/start', publish)
    assert (answer.success, answer.message) == (False, f'not started: {others}')
    # It is silent again: the robot can be started, and is the controller's.
    harness.spin_until(lambda: harness.call(Trigger, '/tp_controller/start',
                                            robot.publish).success, meanwhile=robot.publish)
    harness.spin_until(lambda: robot.status.head == 'running', meanwhile=robot.publish)


def test_rare_commands_of_another_node_stop_a_robot_that_moves(harness, exclusive):
    robot, others = exclusive, f'/rival publishes on {COMMANDS}, too; call ~/start to go on'
    rival = harness.add(Node('rival', context=harness.context))
    publisher = rival.create_publisher(Float64MultiArray, COMMANDS, 10)
    message = Float64MultiArray(data=[0.0, 0.01, 0.0])
    harness.spin_until(lambda: robot.status.of_node('other publishers') == '1',
                       meanwhile=robot.publish)
    publisher.publish(message)
    # Less than one a second.
    wait(harness, robot, 1.5)
    goes_on(harness, robot)
    for _ in range(2):
        publisher.publish(message)
        harness.spin_until(lambda: robot.status.head == others, meanwhile=robot.publish)
        # After a start a single one is enough.
        harness.start(robot.publish)
        harness.spin_until(lambda: robot.status.head == 'running', meanwhile=robot.publish)
    # What one node sent does not count for the next one.
    harness.remove(rival)
    harness.spin_until(lambda: robot.status.of_node('other publishers') == '0',
                       meanwhile=robot.publish)
    publisher = harness.node.create_publisher(Float64MultiArray, COMMANDS, 10)
    harness.spin_until(lambda: robot.status.of_node('other publishers') == '1',
                       meanwhile=robot.publish)
    publisher.publish(message)
    wait(harness, robot, 0.5)
    goes_on(harness, robot)


def test_a_controller_that_is_stopped_leaves_the_robot_to_another_one(harness, exclusive):
    robot = exclusive
    rival = harness.add(Node('rival', context=harness.context))
    publisher = rival.create_publisher(Float64MultiArray, COMMANDS, 10)
    harness.spin_until(lambda: robot.status.of_node('other publishers') == '1',
                       meanwhile=robot.publish)
    assert harness.call(Trigger, '/tp_controller/stop', robot.publish).success
    message = Float64MultiArray(data=[0.0, 0.01, 0.0])

    def publish():
        robot.publish()
        publisher.publish(message)

    harness.spin_until(lambda: robot.commands[-20:] == 20 * [list(message.data)],
                       meanwhile=publish)


def test_two_controllers_of_the_same_name_do_not_command_one_robot(harness, exclusive):
    robot = exclusive
    harness.make(ControllerNode, robot=str(PLANAR_DH), stack=MOVING_STACK)
    wait(harness, robot, 1.5)
    # On a busy machine the first one stands still while the second one is made.
    goes_on(harness, robot)
    only_moves(harness, robot)


@outcomes('Other nodes', [Outcome(f'no {what} listens, and it is required', AT_ONCE, BY_ITSELF,
                                  f'no {what} listens', math.inf)
                          for what in ('node', 'watchdog')])
def test_motion_waits_for_a_listener_and_a_watchdog_where_they_are_required(harness):
    harness.controller(require_listener=True, require_watchdog=True)
    status, arm = Status(harness), Arm(harness)
    harness.spin_until(lambda: status.head == f'no node listens to {COMMANDS}',
                       meanwhile=arm.publish)
    commands = harness.commands()
    harness.spin_until(lambda: status.head == f'no watchdog listens to {COMMANDS}',
                       meanwhile=arm.publish)
    assert not any(map(any, commands))
    watchdog = harness.make(WatchdogNode)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    harness.spin_until(lambda: (status.of_node('listeners'), status.of_node('watchdogs'))
                       == ('1', '1'), meanwhile=arm.publish)
    assert harness.spin_for_more(commands, 3, arm.publish) != 3 * [ZEROS]
    harness.remove(watchdog)
    harness.spin_until(lambda: status.head == f'no watchdog listens to {COMMANDS}',
                       meanwhile=arm.publish)
    assert harness.spin_for_more(commands, 3, arm.publish)[-1] == ZEROS


def test_a_watchdog_that_does_not_answer_is_none(harness):
    harness.controller(require_watchdog=True)
    status, arm = Status(harness), Arm(harness)
    watchdog = harness.make(WatchdogNode)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    # ROS shows its topics all the same.
    harness.executor.remove_node(watchdog)
    harness.spin_until(lambda: status.head == f'no watchdog listens to {COMMANDS}',
                       meanwhile=arm.publish)
    assert status.of_node('watchdogs') == '0'
    answer = harness.call(Trigger, '/tp_controller/start', arm.publish)
    assert answer.message == f'not started: no watchdog listens to {COMMANDS}'
    harness.executor.add_node(watchdog)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)


def test_a_watchdog_of_another_package_counts_by_its_name(harness):
    harness.controller(require_watchdog=True)
    status, arm = Status(harness), Arm(harness)
    watchdog = harness.add(Node('drive_watchdog', context=harness.context))
    watchdog.create_subscription(Float64MultiArray, COMMANDS, lambda message: None, 10)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    wait(harness, arm, 1.2)
    goes_on(harness, arm, status)


def test_a_controller_that_need_not_be_alone_starts_beside_another(harness, robot):
    second = harness.make(ControllerNode, robot=str(PLANAR_DH), stack=MOVING_STACK,
                          exclusive=False, follow_window=0.0,
                          arguments=['--ros-args', '-r', '__node:=second'])
    status, since = Status(harness, '/second/status'), time.monotonic()
    harness.spin_until(lambda: time.monotonic() > since + 1.5, meanwhile=robot.publish)
    goes_on(harness, robot, status)
    harness.remove(second)


def test_a_node_of_the_same_name_is_reported(harness, log):
    harness.add(Node('tp_controller', context=harness.context))
    harness.controller()
    status, arm = Status(harness), Arm(harness)
    harness.spin_until(lambda: 'another node has the name /tp_controller' in log(),
                       meanwhile=arm.publish)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)


def test_a_watchdog_watches_over_a_base_that_moves_only(harness):
    for number, (base, count) in enumerate((('fixed', 0), ('planar', 1))):
        harness.make(WatchdogNode, base=base,
                     arguments=['--ros-args', '-r', f'__node:=watchdog{number}'])
        assert harness.node.count_publishers('/cmd_vel') == count
    with pytest.raises(SettingsError, match="unknown base 'boat'"):
        harness.make(WatchdogNode, base='boat')
