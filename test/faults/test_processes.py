# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Nodes as processes that are stopped, killed, fail, or run tasks that do not return.

A monitor hears every command. Tests that take seconds run with five seeds; with
``TP_CONTROLLER_SEEDS=20`` in the environment they run with twenty.
"""

import os
import re
import signal
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from monitor import promise_of
import numpy as np
from processes_harness import DEADLINE
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from robots import PLANAR_DH
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from tp_controller import Robot
from tp_controller.ros.watchdog_node import CommandTimeout
from tp_controller.tools.demos.processes import NodeProcess
from visualization_msgs.msg import MarkerArray

SEEDS = range(int(os.environ.get('TP_CONTROLLER_SEEDS', '5')))
ACCELERATION = 2.0
JOINTS = ('joint1', 'joint2', 'joint3')
# Motion that goes on for as long as any test takes.
STACK = '[{swing: {type: joint, joints: [joint1, joint2, joint3], target: [30, 20, 10]}}]'
LIMITED = [each for name in JOINTS
           for each in ('-p', f'limits.{name}.acceleration:={ACCELERATION}')]
# What replaces a part of the program, and then runs the node; the file `switch` turns it on.
SCRIPT = """
import sys, time
from pathlib import Path
from tp_controller.ros.controller_node import main
{imports}
switch = Path({switch!r})
{patch}
sys.exit(main())
"""
# A type of the same name, as of another package, which Python evaluates.
TASK = ('from tp_controller.tasks.joint import Joint', """
class AtFault(Joint):
    type_name = Joint.type_name
    def evaluate(self, *arguments):
        if switch.exists():
            {act}
        return super().evaluate(*arguments)
""")
CYCLE = ('from tp_controller.ros.loop.control_loop import ControlLoop', """
cycle = ControlLoop._cycle
def at_fault(self):
    if switch.exists():
        {act}
    return cycle(self)
ControlLoop._cycle = at_fault
""")
SKETCH = ('from tp_controller.tasks.joint import JointTask', """
sketch = JointTask.sketch
def at_fault(self, *arguments):
    if switch.exists():
        {act}
    return sketch(self, *arguments)
JointTask.sketch = at_fault
""")
PARSING = ('from tp_controller.tasks.joint import Joint', """
parse = Joint.parse_goal
def at_fault(self, goal):
    if switch.exists():
        {act}
    return parse(self, goal)
Joint.parse_goal = at_fault
""")
READING = ('from tp_controller.tasks.stack import Stack', """
read = Stack.from_yaml.__func__
def at_fault(cls, source, robot):
    if switch.exists():
        {act}
    return read(cls, source, robot)
Stack.from_yaml = classmethod(at_fault)
""")
PARAMETERS = ('from tp_controller.ros.controller_node import ControllerNode', """
check = ControllerNode._check_parameters
def at_fault(self, parameters):
    if switch.exists():
        {act}
    return check(self, parameters)
ControllerNode._check_parameters = at_fault
""")
STATUS = ('from tp_controller.ros.interface.reporter import Reporter', """
message = Reporter._message
def at_fault(self):
    if switch.exists():
        {act}
    return message(self)
Reporter._message = at_fault
""")
# Of each node that moves nothing: what hangs in it.
OTHERS = {'ros.simulator_node': ('SimulatorNode', '_on_timer'),
          'ros.watchdog_node': ('WatchdogNode', '_on_timer'),
          'tools.view.viewer_node': ('Page', 'update')}


class ScriptProcess(NodeProcess):
    """A controller of which a part was replaced, as a process."""

    def __init__(self, script, arguments, environment, log):
        self.log = log
        with open(log, 'w') as output:
            self.process = subprocess.Popen(
                [sys.executable, '-c', script, '--ros-args', *arguments], env=environment,
                stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT)


@pytest.fixture
def heads(listener):
    """Return a list that grows by what the controller says about itself."""
    heads = []
    listener.client.node.create_subscription(
        DiagnosticArray, '/tp_controller/status',
        lambda message: heads.append(message.status[0].message), 1000)
    return heads


@pytest.fixture
def limited(listener, start):
    """Return what starts a moving planar arm with limited accelerations at a rate."""
    def make(rate=100.0):
        robot = Robot.from_file(PLANAR_DH, limits={
            name: {'acceleration': ACCELERATION} for name in JOINTS})
        listener.promise = promise_of(robot, 1.0 / rate if rate else 0.1, 0.1)
        nodes = (start('controller_node', '-p', f"stack:='{STACK}'", '-p', f'rate:={rate}',
                       *LIMITED), start('simulator_node'))
        listener.wait(listener.moving, 'motion', nodes)
        return nodes
    return make


@pytest.fixture
def replaced(listener, start, domain, tmp_path):
    """Return what starts a moving planar arm whose controller has a part replaced."""
    controllers = []

    def make(part, act, *arguments):
        imports, patch = part
        script = SCRIPT.format(imports=imports, switch=str(tmp_path / 'switch'),
                               patch=patch.format(act=act))
        controllers.append(ScriptProcess(
            script, ['-p', f'robot:={PLANAR_DH}', '-p', f"stack:='{STACK}'", *arguments], domain,
            tmp_path / 'replaced.log'))
        simulator = start('simulator_node')
        listener.wait(listener.moving, 'motion', [controllers[-1], simulator])
        return controllers[-1]

    yield make
    for controller in controllers:
        controller.stop(5.0)


def since(listener, begin):
    """Return (time, velocity) of all commands that were sent after a time."""
    return [(sent, velocity) for sent, velocity, _ in listener.monitor.commands if sent > begin]


def wait_until(listener, end, nodes=()):
    """Listen until a time."""
    listener.wait(lambda: time.time() > end, 'the end', nodes)


# Stopped processes ----------------------------------------------------------------------------

@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('rate', [100.0, 0.0])
def test_a_process_that_was_stopped_begins_from_rest(limited, listener, heads, rate, seed):
    controller, simulator = limited(rate)
    wait_until(listener, time.time() + np.random.default_rng(seed).uniform(0.1, 0.5))
    controller.process.send_signal(signal.SIGSTOP)
    wait_until(listener, time.time() + 2.0, [simulator])
    begin = time.time()
    assert since(listener, begin - 1.5) == []
    controller.process.send_signal(signal.SIGCONT)

    def sent():
        """Return what was sent since, but for a command that it was sending when it stopped."""
        found = since(listener, begin)
        return found[1:] if found and found[0][1].any() else found

    listener.wait(lambda: any(velocity.any() for _, velocity in sent()), 'motion',
                  [controller, simulator])
    resumed = sent()
    first = next(index for index, (_, velocity) in enumerate(resumed) if velocity.any())
    # Until everything has been in order for a while, and then slowly.
    assert first > 0 and resumed[first][0] - resumed[0][0] > 0.2
    passed = 1.0 / rate if rate else 0.1
    assert np.abs(resumed[first][1]).max() <= ACCELERATION * passed + 1e-9
    # Whichever thread runs first after it says so.
    told = 'the node stood still for', 'no cycle was completed within watchdog_timeout'
    listener.wait(lambda: any(head.startswith(told) for head in heads), 'the reason', [controller])


# Ends -----------------------------------------------------------------------------------------

@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_is_answered_with_several_zeros_and_told(limited, listener, heads, number):
    controller, _ = limited()
    controller.process.send_signal(number)
    assert controller.process.wait(DEADLINE) == 0
    listener.wait(lambda: heads and heads[-1] == f'ended by {number.name}', 'the last status')
    listener.catch_up()
    assert not any(velocity.any() for velocity in listener.commands[-3:])


def test_a_fault_of_the_loop_ends_the_node_with_several_zeros_and_is_told(
        replaced, listener, heads, tmp_path):
    controller = replaced(CYCLE, "raise RuntimeError('broken')")
    (tmp_path / 'switch').touch()
    assert controller.process.wait(DEADLINE) != 0
    listener.wait(lambda: heads and heads[-1] == 'ended: RuntimeError: broken', 'the last status')
    listener.catch_up()
    assert not any(velocity.any() for velocity in listener.commands[-3:])
    assert 'RuntimeError: broken' in controller.output()


# Signals while something hangs ----------------------------------------------------------------

# In C code that a signal does not interrupt.
DEADLOCK = ('import ctypes; lock = ctypes.create_string_buffer(64); library = ctypes.CDLL(None); '
            'library.pthread_mutex_lock(lock); library.pthread_mutex_lock(lock)')
SLEEP = 'time.sleep(3600.0)'
BUSY = 'exec("while True: pass")'
# Nobody waits for this one but the interpreter when it ends.
THREAD = 'import threading; threading.Thread(target=time.sleep, args=(3600.0,)).start()'


def buttons(listener, *names, nodes=()):
    """Return the clients of services of the controller, which are ready."""
    found = [listener.client.node.create_client(Trigger, f'/tp_controller/{name}')
             for name in names]
    for each in found:
        listener.wait(each.service_is_ready, 'the service', nodes)
    return found


def call_reload(listener):
    """Call ~/reload, and return what has to be alive for it."""
    reload, = buttons(listener, 'reload')
    return reload.call_async(Trigger.Request())


def begin_reading(listener, reload, switch, nodes):
    """Call ~/reload, and return its future once the stack is being read."""
    switch.touch()
    answer = reload.call_async(Trigger.Request())
    listener.wait(lambda: not switch.exists(), 'the beginning', nodes)
    return answer


def look_at_markers(listener):
    """Subscribe to the markers."""
    return listener.client.node.create_subscription(
        MarkerArray, '/tp_controller/markers', lambda message: None, 10)


def set_a_parameter(listener):
    """Set a parameter, and return what has to be alive for it."""
    client = listener.client.node.create_client(SetParameters, '/tp_controller/set_parameters')
    listener.wait(client.service_is_ready, 'the service')
    return client, client.call_async(SetParameters.Request(
        parameters=[Parameter('damping', value=0.2).to_parameter_msg()]))


def look_at_the_status(listener):
    """Do nothing: somebody looks already."""


def send_goal(listener):
    """Publish a goal."""
    publisher = listener.client.node.create_publisher(JointState, '/tp_controller/swing/goal', 10)
    listener.wait(publisher.get_subscription_count, 'a subscriber')
    publisher.publish(JointState(name=list(JOINTS), position=[40.0, 30.0, 20.0]))
    return publisher


@pytest.mark.parametrize('part, trigger, act, number', [
    (READING, call_reload, SLEEP, signal.SIGINT), (READING, call_reload, BUSY, signal.SIGTERM),
    (READING, call_reload, DEADLOCK, signal.SIGHUP), (READING, call_reload, THREAD, signal.SIGINT),
    (SKETCH, look_at_markers, SLEEP, signal.SIGQUIT), (PARSING, send_goal, SLEEP, signal.SIGINT),
    (PARAMETERS, set_a_parameter, SLEEP, signal.SIGTERM),
    (STATUS, look_at_the_status, SLEEP, signal.SIGINT)],
    ids=['sleep', 'busy', 'deadlock', 'thread', 'sketch', 'goal', 'parameter', 'status'])
def test_a_signal_stops_the_robot_whatever_hangs(replaced, listener, heads, tmp_path, part,
                                                 trigger, act, number):
    controller = replaced(part, f'switch.rename(f"{{switch}}ed"); {act}')
    (tmp_path / 'switch').touch()
    triggered = trigger(listener)
    listener.wait((tmp_path / 'switched').exists, 'the fault', [controller])
    listener.wait(lambda: listener.moving(), 'motion', [controller])
    controller.process.send_signal(number)
    listener.wait(lambda: not listener.moving(), 'zeros')
    listener.wait(lambda: heads and heads[-1] == f'ended by {number.name}', 'the last status')
    assert controller.process.wait(DEADLINE) == 1
    listener.catch_up()
    assert not any(velocity.any() for velocity in listener.commands[-3:])
    del triggered


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('module', OTHERS)
def test_a_signal_ends_a_node_that_moves_nothing_and_hangs(domain, tmp_path, module, number):
    if module.startswith('tools'):
        pytest.importorskip('viser')
    kind, name = OTHERS[module]
    hang = (f'def hang(self):\n    Path({str(tmp_path / "hangs")!r}).touch()\n'
            f'    time.sleep(3600.0)\n{kind}.{name} = hang')
    script = SCRIPT.replace('ros.controller_node', module).format(
        imports=f'from tp_controller.{module} import {kind}', switch=str(tmp_path / 'switch'),
        patch=hang)
    node = ScriptProcess(script, ['-p', f'robot:={PLANAR_DH}'], domain, tmp_path / 'log')
    end = time.monotonic() + 60.0
    while not (tmp_path / 'hangs').exists():
        assert node.running() and time.monotonic() < end, node.output()
        time.sleep(0.01)
    node.process.send_signal(number)
    assert node.process.wait(15.0) == 1
    assert f'ended by {number.name}: waiting for a callback' in node.output()


def test_a_signal_ends_a_node_that_hangs_at_its_start(domain, tmp_path):
    (tmp_path / 'switch').touch()
    imports, patch = READING
    controller = ScriptProcess(
        SCRIPT.format(imports=imports, switch=str(tmp_path / 'switch'),
                      patch=patch.format(act=f'switch.rename(f"{{switch}}ed"); {DEADLOCK}')),
        ['-p', f'robot:={PLANAR_DH}', '-p', f"stack:='{STACK}'"], domain, tmp_path / 'log')
    end = time.monotonic() + DEADLINE
    while not (tmp_path / 'switched').exists():
        assert controller.running() and time.monotonic() < end, controller.output()
        time.sleep(0.01)
    controller.process.send_signal(signal.SIGTERM)
    assert controller.process.wait(DEADLINE) == 1


# Tasks that do not return ---------------------------------------------------------------------


@pytest.mark.parametrize('seed', SEEDS)
def test_the_watchdog_commands_zeros_while_a_task_takes_a_second(replaced, listener, heads,
                                                                 tmp_path, seed):
    controller = replaced(TASK, 'switch.unlink(); time.sleep(1.0)', '-p', 'status_rate:=50.0')
    wait_until(listener, time.time() + np.random.default_rng(seed).uniform(0.0, 0.3))
    (tmp_path / 'switch').touch()
    listener.wait(lambda: not listener.moving(), 'zeros', [controller])
    zeros_at = listener.monitor.commands[-1][0]
    listener.wait(listener.moving, 'motion', [controller])
    moves_at = listener.monitor.commands[-1][0]
    # Not what was computed a second too late, but what is computed afterwards.
    assert moves_at - zeros_at > 0.7
    told = 'no cycle was completed within watchdog_timeout', 'the node stood still for'
    listener.wait(lambda: all(any(text in head for head in heads) for text in told),
                  'the reasons', [controller])


@pytest.mark.parametrize('act', ['time.sleep(3600.0)', 'while True: pass'])
def test_zeros_go_on_while_a_task_never_returns_and_ctrl_c_ends_the_node(replaced, listener,
                                                                         heads, tmp_path, act):
    controller = replaced(TASK, act)
    (tmp_path / 'switch').touch()
    listener.wait(lambda: not listener.moving(), 'zeros', [controller])
    listener.wait_for_more(listener.commands, 10)
    assert not any(velocity.any() for velocity in listener.commands[-10:])
    listener.wait(lambda: heads[-1] == 'no cycle was completed within watchdog_timeout',
                  'the reason', [controller])
    controller.process.send_signal(signal.SIGINT)
    controller.process.wait(DEADLINE)
    listener.wait(lambda: heads and heads[-1] == 'ended by SIGINT', 'the last status')
    listener.catch_up()
    assert not any(velocity.any() for velocity in listener.commands[-10:])


# What is slow beside the loop -----------------------------------------------------------------

def test_commands_go_on_while_a_stack_is_read(replaced, listener, tmp_path):
    # On a busy machine joint states may be late meanwhile, which stops the robot for a reason of
    # its own.
    controller = replaced(READING, 'switch.unlink(); time.sleep(1.5); Path(f"{switch}ed").touch()',
                          '-p', 'state_timeout:=5.0', '-p', 'watchdog_timeout:=5.0')
    reload, = buttons(listener, 'reload', nodes=[controller])
    answer = begin_reading(listener, reload, tmp_path / 'switch', [controller])
    begin = time.time()
    listener.wait((tmp_path / 'switched').exists, 'the end', [controller])
    listener.wait(answer.done, 'the answer', [controller])
    meanwhile = [velocity for sent, velocity in since(listener, begin) if sent < begin + 1.4]
    # 140 on a quiet machine.
    assert len(meanwhile) > 40 and all(velocity.any() for velocity in meanwhile)
    assert answer.result().success


def test_a_stop_does_not_wait_until_a_stack_has_been_read(replaced, listener, tmp_path):
    controller = replaced(READING, 'switch.unlink(); time.sleep(3.0); Path(f"{switch}ed").touch()')
    reload, stop = buttons(listener, 'reload', 'stop', nodes=[controller])
    begin_reading(listener, reload, tmp_path / 'switch', [controller])
    answer = stop.call_async(Trigger.Request())
    listener.wait(answer.done, 'the answer', [controller])
    listener.wait(lambda: not listener.moving(), 'zeros', [controller])
    assert answer.result().success and not (tmp_path / 'switched').exists()


# Watched by another process -------------------------------------------------------------------

@pytest.fixture
def tireless(start, listener):
    """Return a controller and a simulator that a busy machine does not stop for some seconds."""
    nodes = (start('controller_node', '-p', f"stack:='{STACK}'", '-p', 'state_timeout:=5.0',
                   '-p', 'watchdog_timeout:=5.0'),
             start('simulator_node', '-p', 'command_timeout:=10.0'))
    listener.wait(listener.moving, 'motion', nodes)
    return nodes


@pytest.mark.parametrize('seed', SEEDS)
def test_a_killed_controller_is_replaced_by_zeros_of_the_watchdog(start, tireless, listener, heads,
                                                                  seed):
    controller, simulator = tireless
    watchdog = start('watchdog_node', '-p', 'timeout:=1.0', robot=None)
    node = listener.client.node
    listener.wait(lambda: len(node.get_publishers_info_by_topic(
        '/velocity_controller/commands')) == 2, 'the watchdog', [*tireless, watchdog])
    # It leaves a controller alone that is there.
    begin = time.time()
    wait_until(listener, begin + np.random.default_rng(seed).uniform(1.1, 2.0),
               [*tireless, watchdog])
    assert all(velocity.any() for _, velocity in since(listener, begin))
    controller.process.kill()
    listener.wait(lambda: listener.states and not listener.states[-1][1].any(), 'standstill',
                  [simulator, watchdog])
    killed, stopped = [sent for sent, velocity in since(listener, begin) if velocity.any()][-1], \
        listener.monitor.positions[-1][0]
    assert stopped - killed < 5.0
    listener.wait(lambda: 'no command on /velocity_controller/commands for 1 s'
                  in watchdog.output(), 'the warning', [simulator, watchdog])
    # A new one does not take it for somebody who commands the robot.
    nodes = [start('controller_node', '-p', f"stack:='{STACK}'"), simulator, watchdog]
    begin, seen = time.time(), len(heads)
    listener.wait(lambda: any(velocity.any() for _, velocity in since(listener, begin)), 'motion',
                  nodes)
    wait_until(listener, time.time() + 2.0, nodes)
    # On a busy machine joint states may be late at any moment.
    listener.wait(lambda: heads[seen:] and heads[-1] == 'running', 'the status', nodes)
    assert not [head for head in heads[seen:] if re.search('publish.*, too', head)]


def test_a_simulator_that_starts_in_degrees_is_warned_of_and_not_moved(start, listener, heads):
    limits = ['-p', 'limits.joint2.lower:=-2.5', '-p', 'limits.joint2.upper:=2.5']
    simulator = start('simulator_node', '-p', "initial_positions:='{joint2: 45.0}'", *limits)
    controller = start('controller_node', '-p', "stack:='[{stay: {type: posture}}]'",
                       *limits)
    told = 'joint2 is at 45, outside its position limits -2.5 … 2.5: wrong unit or offset?'
    listener.wait(lambda: f'{told}; call ~/start to go on' in heads, 'the reason',
                  [controller, simulator])
    listener.wait_for_more(listener.commands, 20)
    assert not any(velocity.any() for velocity in listener.commands)
    assert f'initial_positions: {told}' in simulator.output()


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_a_watchdog_that_is_killed_or_suspended_stops_the_robot(start, listener, heads, number):
    nodes = [start('controller_node', '-p', f"stack:='{STACK}'", '-p', 'require_watchdog:=true'),
             start('simulator_node')]
    missing = 'no watchdog listens to /velocity_controller/commands'
    listener.wait(lambda: missing in heads, 'the reason', nodes)
    assert not any(velocity.any() for velocity in listener.commands)
    watchdog = start('watchdog_node', robot=None)
    listener.wait(listener.moving, 'motion', [*nodes, watchdog])
    began = len(heads)
    watchdog.process.send_signal(number)
    listener.wait(lambda: missing in heads[began:], 'the reason', nodes)
    listener.wait(lambda: not listener.moving(), 'zeros', nodes)
    if number == signal.SIGSTOP:
        # ROS takes its topics for there: nothing but its silence tells.
        watchdog.process.send_signal(signal.SIGCONT)
        listener.wait(listener.moving, 'motion', [*nodes, watchdog])


def test_a_guard_is_due_once_for_each_time_that_motion_stops():
    guard = CommandTimeout(0.2)
    assert not guard.is_due(0.0)
    guard.note(True, 1.0)
    assert [guard.is_due(1.0 + 0.05 * step) for step in range(8)] == [False] * 5 + [True] + [
        False] * 2
    guard.note(True, 2.0)
    guard.note(False, 2.1)
    assert not any(guard.is_due(2.0 + 0.05 * step) for step in range(20))


def test_a_guard_that_stood_still_itself_listens_first():
    guard = CommandTimeout(0.2)
    guard.note(True, 1.0)
    assert not guard.is_due(1.05) and not guard.is_due(5.0)
    assert not guard.is_due(5.15) and guard.is_due(5.25)
