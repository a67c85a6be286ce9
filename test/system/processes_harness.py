# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes as processes in a ROS domain of their own, and somebody who listens to them."""

from importlib.util import find_spec
import os
import signal
import subprocess
import sys
import time
import warnings

from monitor import Monitor, promise_of
import numpy as np
import pytest
from robots import CONFIG, planar, PLANAR_DH, REPOSITORY

# Only a test that fails takes as long: a busy machine may be twenty times as slow [s].
DEADLINE = 60.0
# How late messages may be on a machine that has too much to do: a stall that is none yet, and
# the time until this process runs, which does not hear all joint states meanwhile [s].
LATE = 1.0
# From one joint state of the simulator to the next, at least [s].
STATE_PERIOD = 0.005
STACK = '[{swing: {type: joint, joints: [joint1, joint2, joint3], target: [1, 1, 1]}}]'


def hear_ctrl_c():
    """Let a process end by SIGINT, also where these tests run in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Listener:
    """
    Hears the topics of the nodes, in the process of the test.

    Parameters
    ----------
    namespace : str
        Of the nodes.
    client : tp_controller.ros.client.client.Client, optional
        What hears them; one of its own by default.

    Attributes
    ----------
    commands, states : list
        Velocities of all commands, and (position, velocity) of all joint states, so far.
    monitor : Monitor
        The same with the times at which they were sent.
    promise : Promise
        What every command has to keep to; by default that of the planar arm at 100 Hz.

    """

    def __init__(self, namespace='', client=None):
        from rclpy.qos import QoSProfile
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray
        from tp_controller.ros.client.client import Client
        self.client = client or Client()
        self.commands, self.states = [], []
        self.monitor, self._sent = Monitor(), 0
        # How many joint states there were, and when the last one was sent [s].
        self._states_sent, self._since = 0, time.time()
        self.promise = promise_of(planar(), 0.01, 0.1)
        node = self.client.node
        # Nobody takes messages while the test does something else.
        node.create_subscription(Float64MultiArray, f'{namespace}/velocity_controller/commands',
                                 self._on_command, QoSProfile(depth=5000))
        node.create_subscription(JointState, f'{namespace}/joint_states', self._on_state,
                                 QoSProfile(depth=5000))

    def _on_command(self, message, info):
        """Take a command."""
        self.commands.append(np.array(message.data))
        number = info['publication_sequence_number']
        self.monitor.command(1e-9 * info['source_timestamp'], message.data,
                             max(number - self._sent, 1))
        self._sent = number

    def _on_state(self, message, info):
        """Take a joint state."""
        sent, number = 1e-9 * info['source_timestamp'], info['publication_sequence_number']
        self.states.append((np.array(message.position), np.array(message.velocity)))
        self.monitor.position(sent, message.position)
        if number > self._states_sent + 1:
            # Others may have heard what was sent before this side found a simulator that is new,
            # and nobody knows when that was.
            self.monitor.heard.extend(np.arange(self._since, sent, STATE_PERIOD).tolist())
        self._states_sent, self._since = number, sent
        self.monitor.heard.append(sent)

    def expect_another_simulator(self):
        """Count joint states anew: the simulator has ended, and another one starts now."""
        self._states_sent, self._since = 0, time.time()

    def check(self):
        """Check what is promised about every command so far."""
        faults = self.monitor.faults(self.promise, LATE)
        assert not faults, '\n'.join(faults)

    def wait(self, condition, what, nodes=()):
        """Listen until a condition holds."""
        def ready():
            for node in nodes:
                assert node.running(), node.output()
            return condition()

        if not self.client.wait(ready, DEADLINE):
            pytest.fail(f'{what} did not come about within {DEADLINE:g} s: '
                        f'{self.client.stop_reason()}\n'
                        + '\n'.join(node.output() for node in nodes))

    def moving(self):
        """Return whether the latest command moves the robot."""
        return bool(self.commands) and bool(self.commands[-1].any())

    def catch_up(self):
        """Listen until nothing waits any more that was sent before."""
        now = time.time()
        self.wait(lambda: self.monitor.heard and self.monitor.heard[-1] > now, 'a joint state')

    def take_rest(self):
        """Take what waits: joint states among it are older than commands that were taken."""
        before = -1
        while before < len(self.states) + len(self.commands):
            before = len(self.states) + len(self.commands)
            self.client.catch_up()

    def wait_for_more(self, messages, count=3):
        """Listen until a list has grown."""
        before = len(messages)
        self.wait(lambda: len(messages) >= before + count, f'{count} more messages')


# Fixtures ---------------------------------------------------------------------------------------

@pytest.fixture(scope='session')
def environment():
    """Return the environment of a user's shell in which the package can be imported."""
    paths = [str(REPOSITORY), *filter(None, [os.environ.get('PYTHONPATH')])]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(paths)}


@pytest.fixture(scope='module')
def domain(environment):
    """Return the environment of processes that hear each other, soon, and nobody else."""
    if find_spec('rclpy') is None:
        pytest.skip('needs ROS 2')
    with warnings.catch_warnings():
        # The generator of the messages' Python code has a dependency that is behind the times.
        warnings.filterwarnings('ignore', "module 'sre_", DeprecationWarning)
        import rosidl_generator_py  # noqa: F401
    from tp_controller.tools.demos.processes import own_domain
    with own_domain() as given, pytest.MonkeyPatch.context() as patch:
        own = {name: given[name] for name in ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')}
        # What hears the nodes here has the same settings as they.
        own['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(CONFIG / 'fastdds.xml')
        for name, value in own.items():
            patch.setenv(name, value)
        yield {**environment, **own}


@pytest.fixture
def listener(domain):
    """Return a listener in the domain."""
    listener = Listener()
    yield listener
    listener.take_rest()
    listener.client.close()
    listener.check()


@pytest.fixture
def start(domain, tmp_path):
    """Return what starts a node with the planar arm, or another; all are ended at last."""
    from tp_controller.tools.demos.processes import NodeProcess
    nodes = []

    def start(executable, *arguments, robot=PLANAR_DH):
        if robot is not None:
            arguments = ('-p', f'robot:={robot}', *arguments)
        nodes.append(NodeProcess(executable, list(arguments), domain,
                                 tmp_path / f'{executable}{len(nodes)}.log'))
        return nodes[-1]

    yield start
    for node in nodes:
        node.stop()


@pytest.fixture
def cell(start, listener):
    """Return controller and simulator of the planar arm, on its way."""
    nodes = (start('controller_node', '-p', f"stack:='{STACK}'"), start('simulator_node'))
    listener.wait(listener.moving, 'motion', nodes)
    return nodes


# Commands ---------------------------------------------------------------------------------------

def command_line(environment, *arguments, module='tp_controller.tools.cli.main', seconds=DEADLINE):
    """Run a command to its end; return its exit status, its output and its complaints."""
    done = subprocess.run([sys.executable, '-m', module, *arguments], env=environment,
                          capture_output=True, text=True, timeout=2.0 * seconds, check=False)
    assert 'Traceback' not in done.stderr, done.stderr
    return done.returncode, done.stdout, done.stderr
