# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""No task ends the program: what it raises is a fault of its own; only signals end a node."""

import asyncio
import signal

from harness import Arm, Status
import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from tp_controller.tasks import Posture, Task
from visualization_msgs.msg import MarkerArray

STACK = '- swing: {type: joint, joints: joint1, target: [30.0]}\n' \
    '- faulty: {type: leaver, gain: 0.5}'


class Fatal(BaseException):
    """No `Exception`, and nobody's but ours."""


LEAVING = (SystemExit, KeyboardInterrupt, GeneratorExit, asyncio.CancelledError, Fatal)


class Leaver(Posture):
    """A posture with a method that leaves the program."""

    # Which one, and what it raises.
    broken, error_type = '', SystemExit

    def __init__(self, robot, name, *, gain=1.0):
        if Leaver.broken == '__init__':
            raise Leaver.error_type('out')
        super().__init__(robot, name, gain=gain)

    def __getattribute__(self, name):
        """Return an attribute, or what leaves in its place."""
        if name != Leaver.broken:
            return super().__getattribute__(name)

        def leave(*arguments, **options):
            raise Leaver.error_type('out')
        leave.__name__ = name
        return leave


@pytest.fixture(params=LEAVING)
def leaver(request, monkeypatch):
    """Return the type of a task that leaves, in a process whose signals raise nothing."""
    monkeypatch.setitem(Task.types, 'leaver', Leaver)
    monkeypatch.setattr(Leaver, 'type_name', 'leaver')
    monkeypatch.setattr(Leaver, 'broken', '')
    monkeypatch.setattr(Leaver, 'error_type', request.param)
    before = signal.signal(signal.SIGINT, lambda *_: None)
    yield Leaver
    signal.signal(signal.SIGINT, before)


def test_a_node_goes_on_whatever_its_tasks_raise(harness, leaver, log):
    harness.controller(stack=STACK, task_faults='switch off', state_timeout=5.0)
    arm, commands, status = Arm(harness), harness.commands(), Status(harness)
    told = f'{leaver.error_type.__name__}: out'
    harness.record(MarkerArray, '/tp_controller/markers')
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)
    leaver.broken = '__init__'
    answer = harness.trigger('reload')
    assert not answer.success and told in answer.message
    assert told in harness.set_parameters({'stack': STACK + ' '})
    leaver.broken = 'parse_goal'
    harness.publisher(JointState, '/tp_controller/faulty/goal').publish(
        JointState(name=['joint1'], position=[0.5]))
    harness.spin_until(lambda: told in status.task('faulty')['last refusal'],
                       meanwhile=arm.publish)
    leaver.broken = 'sketch'
    harness.spin_until_logged(log, f'task faulty is not drawn: sketch raised {told}', arm.publish)
    leaver.broken = 'reported_errors'
    harness.spin_until(lambda: status.task('faulty')['status'] == 'failed', meanwhile=arm.publish)
    leaver.broken = 'set_gain'
    assert harness.set_parameters({'tasks.faulty.gain': 0.25}) == ''
    harness.spin_until_logged(log, f'parameters tasks.faulty.gain: {told}', arm.publish)
    leaver.broken = 'evaluate'
    harness.spin_until(lambda: status.task('faulty')['level'] == 'disabled',
                       meanwhile=arm.publish)
    leaver.broken = 'reset'
    answer = harness.enable('faulty', True)
    assert not answer.success and told in answer.message
    harness.spin_for_more(commands, 5, arm.publish)
    harness.spin_until(lambda: any(commands[-1]), 'motion', meanwhile=arm.publish)


def test_a_task_that_leaves_stops_the_robot_until_a_start(harness, leaver):
    harness.controller(stack=STACK, state_timeout=5.0)
    arm, commands, status = Arm(harness), harness.commands(), Status(harness)
    harness.spin_until(lambda: any(commands and commands[-1]), 'motion', meanwhile=arm.publish)
    leaver.broken = 'evaluate'
    harness.spin_until(lambda: status.head == 'task faulty: evaluate raised '
                       f'{leaver.error_type.__name__}: out; call ~/start to go on',
                       meanwhile=arm.publish)
    leaver.broken = ''
    assert harness.call(Trigger, '/tp_controller/start', arm.publish).success
    harness.spin_until(lambda: any(commands[-1]), 'motion', meanwhile=arm.publish)
