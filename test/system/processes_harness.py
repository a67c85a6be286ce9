# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Nodes as processes in a ROS domain of their own, and somebody who listens to them."""

import subprocess
import sys

import numpy as np
import pytest

DEADLINE = 15.0


class Listener:
    """
    Hears the topics of the nodes, in the process of the test.

    Attributes
    ----------
    commands, states : list
        Velocities of all commands, and (position, velocity) of all joint states, so far.

    """

    def __init__(self):
        from rclpy.qos import QoSProfile
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray
        from tp_controller.nodes.client import Client
        self.client = Client()
        self.commands, self.states = [], []
        node = self.client.node
        node.create_subscription(Float64MultiArray, '/velocity_controller/commands',
                                 lambda message: self.commands.append(np.array(message.data)),
                                 QoSProfile(depth=100))
        node.create_subscription(JointState, '/joint_states', lambda message: self.states.append(
            (np.array(message.position), np.array(message.velocity))), QoSProfile(depth=100))

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

    def wait_for_more(self, messages, count=3):
        """Listen until a list has grown."""
        before = len(messages)
        self.wait(lambda: len(messages) >= before + count, f'{count} more messages')


def command_line(environment, *arguments, module='tp_controller.cli.main', seconds=DEADLINE):
    """Run a command to its end; return its exit status, its output and its complaints."""
    done = subprocess.run([sys.executable, '-m', module, *arguments], env=environment,
                          capture_output=True, text=True, timeout=2.0 * seconds, check=False)
    assert 'Traceback' not in done.stderr, done.stderr
    return done.returncode, done.stdout, done.stderr
