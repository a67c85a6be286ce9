# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A harness that runs the nodes of one test in one process, on one thread."""

from collections import defaultdict
import math
import time

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from robots import PLANAR_DH
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from tp_controller.ros.controller_node import ControllerNode
from tp_controller.ros.simulator_node import SimulatorNode

# Only a test that fails takes as long: a busy machine may be twenty times as slow [s].
DEADLINE = 60.0
PERIOD = 0.005
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
JOINTS = ('joint1', 'joint2', 'joint3')
COMMANDS = '/velocity_controller/commands'
# Joints are far from their limits and move from the first cycle on.
MOVING_STACK = '- swing: {type: joint, joints: [joint1, joint2, joint3], target: [1, 0.5, -0.25]}'


class Harness:
    """
    The nodes of a test and a node of its own, on one executor that the test spins.

    Nothing runs while the test does not spin, so nothing changes between two spins.
    """

    def __init__(self, make_executor):
        self.context = Context()
        rclpy.init(context=self.context, args=[])
        self.executor = make_executor(self.context)
        self._nodes = []
        self.node = self.add(Node('tester', context=self.context))

    def close(self):
        """End everything."""
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    # Nodes --------------------------------------------------------------------------------

    def add(self, node):
        """Spin a node, too, and return it."""
        self._nodes.append(node)
        for each in parts(node):
            self.executor.add_node(each)
        return node

    def nodes_of(self, *kinds):
        """Return the nodes of some classes."""
        return [node for node in self._nodes if isinstance(node, kinds)]

    def remove(self, node):
        """End a node."""
        self._nodes.remove(node)
        for each in parts(node):
            self.executor.remove_node(each)
        node.destroy_node()

    def make(self, kind, *, arguments=(), **parameters):
        """Return a new node; parameter names have ``__`` for a dot."""
        overrides = [Parameter(name.replace('__', '.'), value=value)
                     for name, value in parameters.items()]
        return self.add(kind(context=self.context, parameter_overrides=overrides,
                             cli_args=list(arguments) or None))

    def controller(self, **parameters):
        """Return a controller of the planar arm, unless parameters say otherwise."""
        if not {'robot', 'robot_description'} & set(parameters):
            parameters['robot'] = str(PLANAR_DH)
        parameters.setdefault('stack', MOVING_STACK)
        parameters.setdefault('status_rate', 50.0)
        # Without a transition, every command is what the tasks demand.
        parameters.setdefault('blend', 0.0)
        # Arms of the tests are where the tests put them, and go on at once.
        for name, value in (('follow_window', 0.0), ('jump_tolerance', math.inf),
                            ('odometry_jump_tolerance', math.inf), ('settle_time', 0.0),
                            ('exclusive', False)):
            parameters.setdefault(name, value)
        return self.make(ControllerNode, **parameters)

    def simulator(self, **parameters):
        """Return a simulator of the planar arm, unless parameters say otherwise."""
        if not {'robot', 'robot_description'} & set(parameters):
            parameters['robot'] = str(PLANAR_DH)
        return self.make(SimulatorNode, **parameters)

    # Spinning -----------------------------------------------------------------------------

    def spin_until(self, condition, what='the condition', meanwhile=None):
        """Spin until a condition holds; `meanwhile` is called every `PERIOD` seconds."""
        now = time.monotonic()
        end, due = now + DEADLINE, now
        while not condition():
            now = time.monotonic()
            if now > end:
                pytest.fail(f'{what} did not come about within {DEADLINE:g} s', pytrace=True)
            if meanwhile is not None and now >= due:
                meanwhile()
                due = now + PERIOD
            try:
                self.executor.spin_once(timeout_sec=PERIOD)
            except InvalidHandle:
                # As the runner of the nodes does.
                continue

    def spin_until_logged(self, log, text, meanwhile=None):
        """Spin until a text was logged, which nobody waits for in the node; return the log."""
        lines = [log()]

        def logged():
            lines.append(log())
            return text in ''.join(lines)

        self.spin_until(logged, f'{text!r} in the log', meanwhile)
        return ''.join(lines)

    def spin_for_more(self, messages, count=1, meanwhile=None):
        """Spin until a list has grown by so many messages; return the new ones."""
        before = len(messages)
        self.spin_until(lambda: len(messages) >= before + count, f'{count} more messages',
                        meanwhile)
        return messages[before:]

    # Topics, services, parameters ---------------------------------------------------------

    def record(self, kind, topic, qos=50):
        """Return a list that grows by every message of a topic."""
        messages = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def commands(self):
        """Return a list that grows by the velocities of every command."""
        commands = []
        self.node.create_subscription(Float64MultiArray, COMMANDS,
                                      lambda message: commands.append(list(message.data)), 50)
        return commands

    def publisher(self, kind, topic, qos=10, connected=True):
        """Return a publisher, once somebody listens."""
        publisher = self.node.create_publisher(kind, topic, qos)
        if connected:
            self.spin_until(lambda: publisher.get_subscription_count() > 0,
                            f'a subscriber of {topic}')
        return publisher

    def call(self, kind, name, meanwhile=None, **fields):
        """Call a service and return its response; `meanwhile` as in `spin_until`."""
        client = self.node.create_client(kind, name)
        self.spin_until(client.service_is_ready, f'service {name}', meanwhile)
        future = client.call_async(kind.Request(**fields))
        self.spin_until(future.done, f'the answer of {name}', meanwhile)
        self.node.destroy_client(client)
        return future.result()

    def trigger(self, name):
        """Call a service without arguments of the controller."""
        return self.call(Trigger, f'/tp_controller/{name}')

    def start(self, meanwhile):
        """Call ~/start, while `meanwhile` publishes joint states, until they are not late."""
        self.spin_until(lambda: self.call(Trigger, '/tp_controller/start', meanwhile).success,
                        'a start', meanwhile)

    def set_parameters(self, values):
        """Set parameters of the controller, all or none; return why they were refused."""
        parameters = [Parameter(name, value=value).to_parameter_msg()
                      for name, value in values.items()]
        result = self.call(SetParametersAtomically,
                           '/tp_controller/set_parameters_atomically',
                           parameters=parameters).result
        assert result.successful == (not result.reason)
        return result.reason

    def enable(self, task, enabled):
        """Enable or disable a task."""
        return self.call(SetBool, f'/tp_controller/{task}/enable', data=enabled)


def parts(node):
    """Return a node, and the one of its loop if it has one."""
    return [node, *([node.loop_node] if isinstance(node, ControllerNode) else [])]


class Arm:
    """Joint states of an arm at rest, published when the test says so."""

    def __init__(self, harness, q=(0.0, 0.6, 0.3), names=JOINTS, qos=10, connected=True):
        self.names, self.q = list(names), list(q)
        self._publisher = harness.publisher(JointState, '/joint_states', qos, connected)

    def publish(self, stamp=0.0):
        """Publish where the joints are."""
        message = JointState(name=self.names, position=self.q)
        message.header.stamp = Time(nanoseconds=round(1e9 * stamp)).to_msg()
        self._publisher.publish(message)


class Status:
    """The latest status of the controller."""

    def __init__(self, harness, topic='/tp_controller/status'):
        self.messages = harness.record(DiagnosticArray, topic)

    @property
    def head(self):
        """Return what the controller as a whole says."""
        return self.messages[-1].status[0].message if self.messages else ''

    def of_node(self, key):
        """Return the value of a key of the controller as a whole; empty before the first."""
        values = self.messages[-1].status[0].values if self.messages else ()
        return next((value.value for value in values if value.key == key), '')

    def task(self, name):
        """Return {key: value} of a task; every value is empty before the first status."""
        for status in self.messages[-1].status if self.messages else ():
            if status.name.endswith(f': {name}'):
                return defaultdict(str, {value.key: value.value for value in status.values})
        return defaultdict(str)

    def knows(self, name, key):
        """Return if the value of a task is a number, and not the nan of late joint states."""
        return math.isfinite(float(self.task(name)[key] or 'nan'))
