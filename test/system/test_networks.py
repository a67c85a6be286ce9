# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Many robots in one domain, and two machines whose cable is pulled and put back."""

from contextlib import ExitStack
import os
import shutil
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from monitor import Monitor, promise_of
import numpy as np
from processes_harness import DEADLINE, LATE, Listener
import pytest
from robots import planar, PLANAR_DH
from tp_controller.tools.demos.processes import NodeProcess

ROBOTS, RATE, TIMEOUT = 10, 20.0, 2.0
# All nodes of the robots in one process each: ten interpreters would only measure the machine.
CELLS = """
import sys
from rclpy import init
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from tp_controller.ros.controller_node import ControllerNode
from tp_controller.ros.simulator_node import SimulatorNode
init(args=[])
kind, robot, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
rate, timeout = map(float, sys.argv[4:])
executor = SingleThreadedExecutor()
for number in range(count):
    values = {'robot': robot, 'rate': rate}
    if kind == 'controllers':
        goal = '[%.1f, 0, 0]' % (0.1 * number)
        values.update(state_timeout=timeout, watchdog_timeout=timeout,
                      stack='- swing: {type: joint, joints: [joint1, joint2, joint3], gain: 2, '
                      'target: ' + goal + '}')
    else:
        values.update(command_timeout=timeout)
    node = (ControllerNode if kind == 'controllers' else SimulatorNode)(
        namespace=f'robot{number}',
        parameter_overrides=[Parameter(*pair) for pair in
                             ((name, None, value) for name, value in values.items())])
    executor.add_node(node)
    if kind == 'controllers':
        executor.add_node(node.loop_node)
executor.spin()
"""


class Cells(NodeProcess):
    """The controllers, or the simulators, of all robots in one process."""

    def __init__(self, kind, environment, log):
        self.log = log
        with open(log, 'w') as output:
            self.process = subprocess.Popen(
                [sys.executable, '-c', CELLS, kind, str(PLANAR_DH), str(ROBOTS), str(RATE),
                 str(TIMEOUT)],
                env=environment, stdin=subprocess.DEVNULL, stdout=output,
                stderr=subprocess.STDOUT)


def test_ten_robots_in_one_domain_do_not_meddle_with_each_other(domain, listener, tmp_path):
    heads = {}
    robots = [Listener(f'/robot{number}', listener.client) for number in range(ROBOTS)]
    for number, robot in enumerate(robots):
        robot.promise = promise_of(planar(), 1.0 / RATE, TIMEOUT)
        listener.client.node.create_subscription(
            DiagnosticArray, f'/robot{number}/tp_controller/status',
            lambda message, number=number: heads.update({number: message.status[0].message}), 10)
    with ExitStack() as stack:
        nodes = [stack.enter_context(Cells(kind, domain, tmp_path / f'{kind}.log'))
                 for kind in ('simulators', 'controllers')]
        for number, robot in enumerate(robots):
            listener.wait(lambda number=number, robot=robot: robot.states and np.allclose(
                robot.states[-1][0], (0.1 * number, 0.0, 0.0), atol=1e-3),
                f'robot {number} at its own goal', nodes)
        listener.wait(lambda: len(heads) == ROBOTS and set(heads.values()) == {'running'},
                      'all to run', nodes)
    for robot in robots:
        assert robot.commands
        robot.check()


# Two machines ---------------------------------------------------------------------------------

LEFT, RIGHT = '10.213.77.1', '10.213.77.2'


class Cable:
    """Two network namespaces with a cable between them; skips the test without permission."""

    def __init__(self):
        self.names = [f'tp{os.getpid()}{side}' for side in 'ab']

    def __enter__(self):
        """Lay the cable."""
        if shutil.which('ip') is None:
            pytest.skip('needs ip (iproute2)')
        left, right = self.names
        try:
            for name in self.names:
                ip('netns', 'add', name)
            ip('link', 'add', 'veth0', 'netns', left, 'type', 'veth', 'peer', 'name', 'veth0',
               'netns', right)
        except subprocess.CalledProcessError as error:
            self.__exit__()
            pytest.skip(f'network namespaces are not permitted here: {error.stderr.strip()}')
        for name, address in zip(self.names, (LEFT, RIGHT)):
            ip('-n', name, 'address', 'add', f'{address}/24', 'dev', 'veth0')
            ip('-n', name, 'link', 'set', 'lo', 'up')
            ip('-n', name, 'link', 'set', 'veth0', 'up')
        # The kernel tells a change of the link up to a second later, and a node joins only the
        # networks that are up when it starts.
        end = time.monotonic() + DEADLINE
        while not all(map(is_up, self.names)):
            assert time.monotonic() < end, 'the cable does not come up'
            time.sleep(0.02)
        return self

    def __exit__(self, *_):
        """Take everything away."""
        for name in self.names:
            subprocess.run(['ip', 'netns', 'delete', name], capture_output=True, check=False)

    def put(self, plugged):
        """Pull the cable, or put it back."""
        ip('-n', self.names[0], 'link', 'set', 'veth0', 'up' if plugged else 'down')


def ip(*arguments):
    """Run ip; return what it prints."""
    return subprocess.run(['ip', *arguments], check=True, capture_output=True, text=True).stdout


def is_up(name):
    """Return whether the cable works on one side, as nodes there are told."""
    return 'state UP' in ip('-n', name, 'link', 'show', 'veth0')


class Remote(NodeProcess):
    """A node on one of the two machines."""

    def __init__(self, namespace, module, arguments, environment, log):
        self.log = log
        environment = {**environment, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
                       # Both are one machine to it, and memory would be shared.
                       'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}
        with open(log, 'w') as output:
            self.process = subprocess.Popen(
                ['ip', 'netns', 'exec', namespace, sys.executable, *module, *arguments],
                env=environment, stdin=subprocess.DEVNULL, stdout=output,
                stderr=subprocess.STDOUT)


# Prints what the robot is told, and where it is, on the robot's side: when, the number of the
# message, and what is in it.
WITNESS = """
import time
from rclpy import init, spin
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
init(args=[])
node = Node('witness')

def tell(kind, numbers, info):
    print(kind, time.time(), info['publication_sequence_number'], *numbers, flush=True)

node.create_subscription(Float64MultiArray, '/velocity_controller/commands',
                         lambda message, info: tell('command', message.data, info), 1000)
node.create_subscription(JointState, '/joint_states',
                         lambda message, info: tell('state', message.position, info), 1000)
spin(node)
"""
STACK = '[{swing: {type: joint, joints: [joint1, joint2, joint3], target: [60, 40, 20]}}]'


def rows(process, kind):
    """Return (time, number, what was in it) of the messages that a witness has heard."""
    return [(float(sent), int(number), np.array(values, dtype=float))
            for _, sent, number, *values in map(
                str.split, (line for line in process.output().splitlines(keepends=True)
                            if line.startswith(kind) and line.endswith('\n')))]


def moved(process, since=0.0):
    """Return (time, whether the robot has moved) at the states of a witness."""
    found = [row for row in rows(process, 'state') if row[0] > since]
    return [(sent, bool(np.abs(q - before).max() > 1e-9))
            for (_, _, before), (sent, _, q) in zip(found, found[1:])]


def check(process, promise):
    """Check what is promised about every command that a witness has heard."""
    monitor, last = Monitor(), 0
    for sent, number, velocity in rows(process, 'command'):
        monitor.command(sent, velocity, max(number - last, 1))
        last = number
    for sent, _, q in rows(process, 'state'):
        monitor.position(sent, q)
        monitor.heard.append(sent)
    faults = monitor.faults(promise, LATE)
    assert monitor.commands and not faults, '\n'.join(faults)


def wait_for(condition, what, processes, seconds=DEADLINE):
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, what + '\n' + '\n'.join(
            process.output()[-2000:] for process in processes)
        assert all(process.running() for process in processes)
        time.sleep(0.02)


def test_a_cable_that_is_pulled_stops_the_robot_and_put_back_lets_it_go_on(domain, tmp_path):
    with Cable() as cable, ExitStack() as stack:
        left, right = cable.names
        ros = ('--ros-args', '-p', f'robot:={PLANAR_DH}')
        module = ('-m', 'tp_controller.ros.controller_node')
        controller = stack.enter_context(Remote(
            left, module, (*ros, '-p', f"stack:='{STACK}'", '-p', 'status_rate:=50.0'), domain,
            tmp_path / 'controller.log'))
        simulator = stack.enter_context(Remote(
            right, ('-m', 'tp_controller.ros.simulator_node'), ros, domain,
            tmp_path / 'simulator.log'))
        witness = stack.enter_context(Remote(
            right, ('-c', WITNESS), (), domain, tmp_path / 'witness.log'))
        processes = controller, simulator, witness

        def moving(since=0.0):
            return any(moves for _, moves in moved(witness, since))

        wait_for(moving, 'no motion', processes)
        cable.put(False)
        pulled = time.time()
        wait_for(lambda: (found := moved(witness, pulled)) and not found[-1][1],
                 'no standstill', processes)
        # The controller has noticed, too, and nothing arrives any more.
        wait_for(lambda: 'commanding zeros: no joint states' in
                 controller.output().split('running')[-1], 'not noticed', processes)
        assert not [sent for sent, *_ in rows(witness, 'command') if sent > pulled + 1.0]
        cable.put(True)
        back = time.time()
        wait_for(lambda: moving(back), 'no motion afterwards', processes)
        assert 'Traceback' not in controller.output()
        check(witness, promise_of(planar(), 0.01, 0.1))
