# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Service ~/lock: the joint that stopped the robot is locked, the others go on; all unlocked."""

import json

from geometry_msgs.msg import PointStamped
from harness import Arm, COMMANDS, Status
import numpy as np
import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from robots import panda, PANDA_DH, PANDA_READY, PANDA_TOOL, PLANAR_DH
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from tp_controller.ros.controller_node import ControllerNode, NO_ROBOT, NOT_CONFIGURED
from tp_controller.ros.simulator_node import SimulatorNode

NAME, JOINT = 'locked_joints', 'panda_joint4'
NAMES = panda().joint_names
ACCELERATION, RATE = 8.0, 100.0
STACK = (f'- tool: {{type: position, frame: {PANDA_TOOL}, gain: 1.0}}\n'
         '- posture: {type: posture, gain: 0.5}\n')
STOPPED = 'stopped; call ~/start to go on'


class FailingSimulator(SimulatorNode):
    """A simulator in which some joints stand still, whatever is commanded."""

    standing = ()

    def _apply(self, columns, what):
        """Pass velocities on, zero for the joints that stand still."""
        self._velocity[list(self.standing)] = 0.0
        super()._apply(columns, what)


class Cell:
    """A simulated Panda and its controller."""

    def __init__(self, harness, **values):
        self.harness = harness
        self.robot = harness.make(
            FailingSimulator, robot=str(PANDA_DH), rate=200.0, command_timeout=5.0,
            initial_positions=json.dumps(dict(zip(NAMES, PANDA_READY))))
        limits = {f'limits__{name}__acceleration': ACCELERATION for name in NAMES}
        self.controller = harness.controller(**{
            'robot': str(PANDA_DH), 'stack': STACK, 'rate': RATE, 'follow_window': 0.5,
            'state_timeout': 5.0, 'watchdog_timeout': 5.0, **limits, **values})
        self.status, self.commands = Status(harness), harness.commands()
        self.goals = harness.publisher(PointStamped, '/tp_controller/tool/goal')
        self.until(lambda: self.status.head == 'running', 'motion')

    def until(self, condition, what='the condition'):
        """Spin until a condition holds."""
        self.harness.spin_until(condition, what)

    @property
    def q(self):
        """Return the positions of the robot."""
        return self.robot._simulator.q

    @property
    def locked(self):
        """Return the parameter."""
        return [name for name in self.controller.get_parameter(NAME).value if name]

    def go(self, way):
        """Send the tool by a way from where it is; return its goal."""
        goal = panda().state(self.q).position(PANDA_TOOL) + way
        message = PointStamped()
        message.point.x, message.point.y, message.point.z = goal.tolist()
        self.goals.publish(message)
        return goal

    def arrives(self, goal):
        """Spin until the tool is at a goal."""
        self.until(lambda: np.linalg.norm(
            panda().state(self.q).position(PANDA_TOOL) - goal) < 2e-3, 'the tool at its goal')

    def fail(self):
        """Hold joint 4 on the way to a goal until the robot stops; return the goal."""
        self.robot.standing = (NAMES.index(JOINT),)
        goal = self.go([-0.1, 0.1, -0.2])
        self.until(lambda: self.status.head.startswith(f'{JOINT} does not follow'), 'the stop')
        return goal

    def lock(self, data=True):
        """Call the service; return success and message."""
        return call(self.harness, data)


def call(harness, data, meanwhile=None):
    """Call the service; return success and message."""
    answer = harness.call(SetBool, '/tp_controller/lock', meanwhile, data=data)
    return answer.success, answer.message


def test_tool_arrives_without_the_joint_that_failed_and_with_it_once_it_is_unlocked(harness, log):
    cell = Cell(harness)
    goal = cell.fail()
    stands = cell.q[3]
    assert cell.status.of_node('not following') == JOINT
    assert cell.lock() == (True, f'locked {JOINT}, the others go on')
    assert cell.locked == [JOINT]
    cell.arrives(goal)
    assert cell.q[3] == stands
    cell.until(lambda: cell.status.of_node('locked') == JOINT
               and cell.status.of_node('not following') == '', 'the status')
    assert cell.status.head == 'running'
    # Repaired.
    cell.robot.standing = ()
    assert cell.lock(False) == (True, f'unlocked {JOINT}')
    assert cell.locked == []
    cell.arrives(cell.go([0.1, -0.1, 0.2]))
    assert abs(cell.q[3] - stands) > 0.05
    steps = np.abs(np.diff(np.array(cell.commands), axis=0))
    moving = np.any(cell.commands, axis=1)
    # Zeros of the stop come at once.
    assert steps[moving[1:]].max() <= ACCELERATION / RATE + 1e-9
    text = harness.spin_until_logged(log, f'unlocked: {JOINT}')
    assert f'locked: {JOINT}' in text


def test_stop_by_the_user_stays_and_the_answer_says_so(harness):
    cell = Cell(harness)
    goal = cell.fail()
    assert harness.trigger('stop').success
    assert cell.lock() == (True, f'locked {JOINT}, but the robot does not move: {STOPPED}')
    cell.until(lambda: cell.status.head == STOPPED, 'the reason')
    assert not np.any(harness.spin_for_more(cell.commands, 20))
    assert harness.trigger('start').success
    cell.arrives(goal)
    assert cell.locked == [JOINT]


def test_no_joint_is_locked_where_none_has_failed_and_the_answer_names_joints(harness):
    cell = Cell(harness)
    worked, text = cell.lock()
    assert not worked and 'no joint that does not follow has stopped the robot' in text
    assert text.endswith('locked_joints locks joints by name: panda_joint1, panda_joint2, '
                         'panda_joint3 and 4 more')
    assert cell.lock(False) == (True, 'no joint was locked')
    assert cell.locked == [] and cell.status.head == 'running'


# A stop that is made up -------------------------------------------------------------------------


FAULT = 'joint2 does not follow: made up'
TARGETS = '- swing: {type: joint, joints: [joint1, joint2], target: [3.0, 0.5], gain: 5.0}'


class Stopped:
    """A planar arm at rest whose second joint has stopped the robot."""

    def __init__(self, harness, stack=TARGETS, **values):
        self.harness = harness
        self.controller = harness.controller(stack=stack, **values)
        self.arm, self.commands = Arm(harness), harness.commands()
        self.status = Status(harness)
        self.until(lambda: self.status.head == 'running')
        self.loop.stops.latch(FAULT, joint='joint2')
        self.until(lambda: self.status.head.startswith(FAULT))

    @property
    def loop(self):
        """Return the loop."""
        return self.controller._robot.loop

    @property
    def locked(self):
        """Return the joints that do not move."""
        return list(self.controller._robot.controller.locked)

    def until(self, condition):
        """Spin, with joint states, until a condition holds."""
        self.harness.spin_until(condition, meanwhile=self.arm.publish)

    def lock(self, data=True):
        """Call the service; return success and message."""
        return call(self.harness, data, self.arm.publish)

    def start(self):
        """Call ~/start; return its message."""
        return self.harness.call(Trigger, '/tp_controller/start', self.arm.publish).message

    def rests(self):
        """Return whether zeros are commanded for a while."""
        del self.commands[:]
        return not np.any(self.harness.spin_for_more(self.commands, 20, self.arm.publish))

    def goes_on(self):
        """Spin until the first joint moves."""
        del self.commands[:]
        self.until(lambda: self.status.head == 'running' and np.any(self.commands))
        assert all(command[1] == 0.0 for command in self.commands)


@pytest.fixture
def stopped(harness):
    """Return a robot that was stopped."""
    return Stopped(harness)


def test_others_go_on_from_where_the_robot_is(harness):
    stopped = Stopped(harness, '- rest: {type: posture, gain: 5.0}')
    # By hand.
    stopped.arm.q[0] = 0.4
    stopped.until(lambda: abs(stopped.loop.measurements.joints.q[0] - 0.4) < 1e-9)
    assert stopped.lock() == (True, 'locked joint2, the others go on')
    stopped.until(lambda: stopped.status.head == 'running')
    assert stopped.rests()


def test_every_other_fault_of_the_stop_stays(stopped):
    stopped.loop.stops.latch('joint1 jumped')
    assert stopped.lock() == (True, 'locked joint2, but the robot does not move: joint1 jumped; '
                              'call ~/start to go on')
    stopped.until(lambda: stopped.status.head == 'joint1 jumped; call ~/start to go on')
    assert stopped.rests() and stopped.locked == ['joint2']
    assert not stopped.lock()[0]
    assert stopped.start() == 'started'
    stopped.goes_on()


def test_stop_for_something_else_is_not_ended(stopped):
    stopped.start()
    stopped.loop.stops.latch('joint1 jumped')
    assert not stopped.lock()[0]
    assert stopped.rests() and not stopped.locked


def test_robot_does_not_go_on_once_joint_states_come_again(stopped):
    stopped.until(lambda: stopped.loop.lasting() == '')
    stopped.harness.spin_until(lambda: stopped.loop.lasting() != '')
    worked, text = call(stopped.harness, True)
    assert worked and text.startswith('locked joint2, but the robot does not move: no joint')
    assert text.endswith('; call ~/start to go on')
    assert stopped.rests() and stopped.locked == ['joint2']
    # Asked again, or started.
    assert stopped.lock() == (True, 'locked joint2, the others go on')
    stopped.goes_on()


def test_robot_that_another_node_commands_is_left_to_it(harness):
    stopped = Stopped(harness, exclusive=True)
    rival = harness.add(Node('rival', context=harness.context))
    publisher = rival.create_publisher(Float64MultiArray, COMMANDS, 10)
    command = [0.0, 0.01, 0.0]

    def publish():
        stopped.arm.publish()
        publisher.publish(Float64MultiArray(data=command))

    harness.spin_until(lambda: stopped.loop.commands.silent, meanwhile=publish)
    other = f'/rival publishes on {COMMANDS}, too; call ~/start to go on'
    assert call(harness, True, publish) == (
        True, f'locked joint2, but the robot does not move: {other}')
    del stopped.commands[:]
    assert harness.spin_for_more(stopped.commands, 20, publish) == 20 * [command]
    # It is silent from now on, but was a reason of its own.
    stopped.until(lambda: stopped.controller._robot.lasting() == '')
    assert stopped.lock()[1].endswith(other)
    stopped.until(lambda: stopped.status.head == other)
    assert stopped.start() == 'started'
    stopped.goes_on()


def test_locked_joint_may_be_outside_its_limits(any_harness):
    stopped = Stopped(any_harness, limits__joint2__upper=1.0)
    # It has sagged.
    stopped.arm.q[1] = 1.5
    stopped.until(lambda: 'outside its position limits' in stopped.loop.lasting())
    assert stopped.lock() == (True, 'locked joint2, the others go on')
    stopped.goes_on()


def test_inactive_robot_is_told_to_be_and_goes_on_once_activated(stopped):
    assert stopped.harness.set_parameters({'keep_goals': True}) == ''
    stopped.controller.trigger_deactivate()
    assert call(stopped.harness, True) == (
        True, 'locked joint2, but the robot does not move: inactive; activate the node to go on')
    stopped.controller.trigger_activate()
    stopped.goes_on()


def test_joint_that_was_locked_by_name_needs_the_call_to_go_on(stopped):
    assert stopped.harness.set_parameters({NAME: ['joint3', 'joint2']}) == ''
    assert stopped.rests()
    assert stopped.lock() == (True, 'locked joint2, the others go on')
    assert list(stopped.controller.get_parameter(NAME).value) == ['joint3', 'joint2']
    stopped.goes_on()


def test_locks_of_the_user_and_of_the_loop_are_undone_and_the_stop_is_not(stopped):
    assert stopped.harness.set_parameters({NAME: ['joint3']}) == ''
    # Not yet in the parameter.
    stopped.loop._lock('joint1', 'joint1 does not follow')
    assert stopped.lock(False) == (True, 'unlocked joint3, joint1')
    assert not stopped.locked
    assert list(stopped.controller.get_parameter(NAME).value) == ['']
    assert stopped.rests() and stopped.status.head.startswith(FAULT)


def test_refusal_of_the_parameter_is_told_and_nothing_goes_on(stopped):
    def refuse(parameters):
        return SetParametersResult(successful=False, reason='not now')

    stopped.controller.add_on_set_parameters_callback(refuse)
    assert stopped.lock() == (False, 'joint2 is not locked: not now')
    assert stopped.rests() and not stopped.locked
    stopped.controller.remove_on_set_parameters_callback(refuse)
    assert stopped.lock()[0]
    stopped.controller.add_on_set_parameters_callback(refuse)
    assert stopped.lock(False) == (False, 'nothing unlocked: not now')
    assert stopped.locked == ['joint2']


def test_task_that_fails_at_the_start_keeps_the_stop(stopped, monkeypatch):
    task = stopped.controller._robot.controller.stack.tasks['swing']

    def fail():
        raise ZeroDivisionError('made up')

    monkeypatch.setattr(task, 'reset', fail)
    worked, text = stopped.lock()
    assert worked and text.startswith('locked joint2, but the robot does not move: task swing')
    assert stopped.rests() and stopped.status.head.startswith(FAULT)


def test_without_a_robot_joints_are_unlocked_and_none_is_locked(any_harness):
    controller = any_harness.make(ControllerNode, locked_joints=['joint9'])
    assert call(any_harness, True) == (False, f'nothing locked: {NO_ROBOT}')
    # As after another robot was refused, which lacks such a joint.
    controller.trigger_deactivate()
    controller.trigger_cleanup()
    assert call(any_harness, True) == (False, f'nothing locked: {NOT_CONFIGURED}')
    assert call(any_harness, False) == (True, 'unlocked joint9')
    assert any_harness.set_parameters({'robot': str(PLANAR_DH), 'stack': '[]'}) == ''
    controller.trigger_configure()
    assert controller._robot is not None
