# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Run the controller node beside one that only echoes: share of a processor, delay, loss.

Run as ``python benchmarks/node.py`` (or ``make bench``). The nodes run one after the other as
processes of their own, with the executor that they always have. This process is the robot: a Panda
that publishes joint states and follows the commands. After every block of states it pauses until
all have been answered, so it knows which command answers which state. A delay ends when the
middleware has received the command, whenever this process looks at it; it has one thread, so that
nothing of its own is measured. With limits active its joints have 1 % of their speed limits and
its goal is half a metre away.

Shares are of one processor, of the whole process with all its threads. On a machine that does
something else meanwhile, compare with the echo only.
"""

import argparse
from collections import namedtuple
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from _robots import load_robot, PANDA_READY
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tp_controller.model.spatial import quaternion_from_rotation
from tp_controller.ros.loop.outputs import VelocityOutput
from tp_controller.tools.demos.processes import NodeProcess, own_domain
from visualization_msgs.msg import MarkerArray

ROBOT = 'package://tp_controller/config/robots/panda.yaml'
TOOL = 'panda_hand_tcp'
STACK = f"""
- tool: {{type: pose, frame: {TOOL}}}
- posture: {{type: posture, gain: 0.5}}
"""
SLOW, FAR = 0.01, 0.5
# Discovery mostly takes less than 50 ms, now and then 3 s.
PATIENCE_SECONDS = 20.0
# The first cycles are slower, until everything is in the caches of Python and of the processor.
WARM_UP_SECONDS = 1.0
# States in a block, how many commands may wait, and how long the last is waited for: until a
# look, or at most [s]. Of states after a long silence the controller may take the newest only.
BLOCK, DEPTH, LOOK, PAUSE = 100, 200, 0.5e-3, 0.02
# So that no command too many, as a zero where it starts, is taken for the answer to a state [s].
SETTLE = 2e-3
# What somebody may listen to, ten times a second.
HEARD = {'status': DiagnosticArray, 'markers': MarkerArray}
TICKS = os.sysconf('SC_CLK_TCK')

Case = namedtuple('Case', 'name rate hertz limited heard', defaults=[''])
CASES = (
    Case('echo, 1 kHz', None, 1000.0, False),
    Case('timer of 1 kHz, holding a pose', 1000.0, 1000.0, False),
    Case('timer of 1 kHz, limits active', 1000.0, 1000.0, True),
    Case('each state, 1 kHz, holding a pose', 0.0, 1000.0, False),
    Case('each state, 1 kHz, limits active', 0.0, 1000.0, True),
    Case('each state, 1 kHz, limits active, status heard', 0.0, 1000.0, True, 'status'),
    Case('each state, 1 kHz, holding a pose, markers shown', 0.0, 1000.0, False, 'markers'),
    Case('echo, 2 kHz', None, 2000.0, False),
    Case('each state, 2 kHz, holding a pose', 0.0, 2000.0, False),
)


class RobotNode(Node):
    """Publishes joint states at a pace of its own, and takes the commands in between."""

    def __init__(self, robot):
        super().__init__('robot')
        self.q, self.velocity, self.heard = np.array(PANDA_READY), np.zeros(robot.n), None
        self._message = JointState(name=list(robot.joint_names))
        self._states = self.create_publisher(JointState, 'joint_states', 10)
        self._commands = self.create_subscription(
            Float64MultiArray, VelocityOutput.topic, ignore, DEPTH)
        self.goals = self.create_publisher(PoseStamped, '/tp_controller/tool/goal', 1)

    def listen(self, topic):
        """Have the status or the markers made and published from now on."""
        self.heard = self.create_subscription(HEARD[topic], f'/tp_controller/{topic}', ignore, 10)

    def _take(self):
        """Follow the newest command; return when each arrived."""
        arrived = []
        for message, information in taken(self._commands):
            arrived.append(information['received_timestamp'])
            self.velocity = np.array(message.data)
        return arrived

    def block(self, hertz):
        """Publish a block of states; return when each was sent, and when answers arrived [ns]."""
        time.sleep(SETTLE)
        self._take()
        sent, arrived, due = [], [], time.monotonic()
        for _ in range(BLOCK):
            # States that were missed are not made up for.
            due = max(due + 1.0 / hertz, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
            arrived += self._take()
            self.q = self.q + self.velocity / hertz
            self._message.position = self.q.tolist()
            self._message.header.stamp = self.get_clock().now().to_msg()
            sent.append(time.time_ns())
            self._states.publish(self._message)
        end = time.monotonic() + PAUSE
        while len(arrived) < BLOCK and time.monotonic() < end:
            time.sleep(LOOK)
            arrived += self._take()
        return sent, arrived


def ignore(_):
    """Take nothing: messages are taken from the queue."""


def taken(subscription):
    """Take what waits in the queue of a subscription: messages, and what is known of them."""
    with subscription.handle:
        while (message := subscription.handle.take_message(subscription.msg_type, False)):
            yield message


@contextmanager
def process_of(case, robot, environment, folder):
    """Start the node of a case; yield the id of its process."""
    if case.rate is None:
        process = subprocess.Popen([sys.executable, str(Path(__file__).parent / '_echo_node.py')],
                                   env=environment)
        try:
            yield process.pid
        finally:
            process.kill()
            process.wait()
        return
    slow = {f'limits.{joint}.velocity': SLOW * speed
            for joint, speed in zip(robot.joint_names, robot.velocity)} if case.limited else {}
    # In a pause of this robot nothing is to be stopped.
    values = {'robot': ROBOT, 'rate': case.rate, 'state_timeout': 0.2, 'braking_gain': 5.0, **slow}
    path = folder / 'parameters.yaml'
    path.write_text('tp_controller:\n  ros__parameters:\n' + ''.join(
        f'    {name}: {value}\n' for name, value in values.items())
        + '    stack: |\n' + ''.join(f'      {line}\n' for line in STACK.strip().splitlines()))
    with NodeProcess('controller_node', ['--params-file', str(path)], environment,
                     folder / 'controller.log') as node:
        yield node.process.pid


def processor_seconds(pid):
    """Return what a process has taken of the processors [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def far_goal(robot):
    """Return a goal for the tool, off to the side."""
    T = robot.state(PANDA_READY).pose(TOOL)
    goal = PoseStamped()
    goal.header.frame_id = robot.root
    x, y, z = T[:3, 3] + [0.0, FAR, 0.0]
    goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = x, y, z
    orientation = goal.pose.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = quaternion_from_rotation(
        T[:3, :3])
    return goal


def wait_for(node, hertz, condition):
    """Publish states until a condition holds."""
    end = time.monotonic() + PATIENCE_SECONDS
    while not condition():
        assert time.monotonic() < end, 'the nodes did not find each other'
        node.block(hertz)


def measure(case, robot, node, pid, seconds):
    """
    Return what a case takes.

    Returns
    -------
    share : float
        Of a processor.
    answered : float
        Share of the states.
    delays : ndarray
        From a state to its command [s], of blocks without loss.

    """
    wait_for(node, case.hertz, lambda: node.block(case.hertz)[1])
    if case.limited:
        wait_for(node, case.hertz, node.goals.get_subscription_count)
        node.goals.publish(far_goal(robot))
    if case.heard:
        node.listen(case.heard)
        wait_for(node, case.hertz, lambda: list(taken(node.heard)))
    begin = time.monotonic()
    while time.monotonic() < begin + WARM_UP_SECONDS:
        node.block(case.hertz)
    if case.limited:
        assert (np.abs(node.velocity) > 0.999 * SLOW * robot.velocity).any(), node.velocity
    delays, sent, answered, busy = [], 0, 0, 0.0
    before, begin = processor_seconds(pid), time.monotonic()
    while time.monotonic() < begin + seconds:
        times, arrived = node.block(case.hertz)
        sent, answered = sent + BLOCK, answered + len(arrived)
        busy += 1e-9 * (times[-1] - times[0]) + 1.0 / case.hertz
        if len(arrived) == BLOCK:
            delays.extend(1e-9 * np.subtract(arrived, times))
    # Where states set the pace, pauses are no part of what is asked.
    passed = time.monotonic() - begin if case.rate else busy
    return (processor_seconds(pid) - before) / passed, answered / sent, np.array(delays)


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=10.0, help='length of each run')
    options = parser.parse_args()
    robot = load_robot('Panda')
    print('| | of a processor | of the echo | answered | ms from state to command: median | 99 % '
          '| longest |')
    print('| --- | --- | --- | --- | --- | --- | --- |')
    with own_domain() as environment, tempfile.TemporaryDirectory() as folder:
        # As the nodes have it by default; with LOCALHOST, Fast DDS uses shared memory.
        environment.update(ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET',
                           FASTDDS_BUILTIN_TRANSPORTS='UDPv4')
        os.environ.update(environment)
        echo = np.nan
        for case in CASES:
            rclpy.init()
            node = RobotNode(robot)
            with process_of(case, robot, environment, Path(folder)) as pid:
                share, answered, delays = measure(case, robot, node, pid, options.seconds)
            node.destroy_node()
            rclpy.shutdown()
            echo = share if case.rate is None else echo
            cells = [f'{100.0 * share:.0f} %', f'{share / echo:.1f}',
                     '' if case.rate else f'{100.0 * answered:.2f} %']
            # Commands of a timer answer no state in particular.
            cells += [f'{1e3 * value:.2f}' for value in np.percentile(delays, [50, 99, 100])
                      ] if len(delays) and not case.rate else [''] * 3
            print(f'| {case.name} | {" | ".join(cells)} |', flush=True)


if __name__ == '__main__':
    main()
