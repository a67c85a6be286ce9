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

"""
Run the controller node at 1 kHz: how long its cycles take, and how regular they are.

Run as ``python benchmarks/node.py`` (or ``make bench``). The node runs in this process in the same
way as in ``controller_node``, and a simulator with the same rate in another process; joint states
and commands are sent over real topics. In the first run a Panda stays at its pose. In the second
run its joints have 1 % of their speed limits and its goal is half a metre away, so that limits are
active in every cycle.
"""

import argparse
import os
from pathlib import Path
import tempfile
import time

from _robots import load_robot, PANDA_READY
from geometry_msgs.msg import PoseStamped
import numpy as np
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.task import Future
from tp_controller.demos.processes import NodeProcess, own_domain
from tp_controller.model.spatial import quaternion_from_rotation
from tp_controller.nodes.controller_node import ControllerNode
from tp_controller.nodes.runner import make_executor

RATE = 1000.0
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


class WatchedController(ControllerNode):
    """Notes when its cycles begin and how long they take."""

    def __init__(self, context, limits):
        self.begun, self.spent = [], []
        values = {'robot': ROBOT, 'stack': STACK, 'rate': RATE, **limits}
        super().__init__(context=context, parameter_overrides=[
            Parameter(name, value=value) for name, value in values.items()])

    def _cycle(self):
        self.begun.append(time.monotonic_ns())
        before = time.thread_time_ns()
        super()._cycle()
        self.spent.append(time.thread_time_ns() - before)

    @property
    def running(self):
        """Return whether it commands velocities."""
        return not self._stop_reason

    @property
    def velocity(self):
        """Return the last command (n,) [rad/s]."""
        return np.array(self._command.data)


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


def watch(node, executor, seconds):
    """
    Spin a node that runs, and print what its cycles took.

    Returns
    -------
    spent, intervals : ndarray (cycles,)
        Time of the processor in each cycle, and from the beginning of one to the next [µs].
    share : float
        Of one processor, that this process took.

    """
    executor.spin_until_future_complete(Future(executor=executor), WARM_UP_SECONDS)
    node.begun.clear()
    node.spent.clear()
    wall, processor = time.monotonic(), time.process_time()
    executor.spin_until_future_complete(Future(executor=executor), seconds)
    share = (time.process_time() - processor) / (time.monotonic() - wall)
    return np.array(node.spent) / 1e3, np.diff(node.begun) / 1e3, share


def run(limited, seconds, environment, folder):
    """Return what `watch` does, in a run with a simulator of its own."""
    robot = load_robot('Panda')
    slow = {joint: SLOW * speed for joint, speed in zip(robot.joint_names, robot.velocity)}
    limits = {f'limits.{joint}.velocity': speed for joint, speed in slow.items()}
    positions = ', '.join(f'{joint}: {q}' for joint, q in zip(robot.joint_names, PANDA_READY))
    arguments = ['-p', f'robot:={ROBOT}', '-p', f'rate:={RATE}',
                 '-p', f"initial_positions:='{{{positions}}}'"]
    context = Context()
    context.init(args=[])
    node = WatchedController(context, limits if limited else {})
    goals = node.create_publisher(PoseStamped, '~/tool/goal', 1)
    executor = make_executor(context)
    executor.add_node(node)
    try:
        with NodeProcess('simulator_node', arguments, environment, folder / 'simulator.log'):
            end = time.monotonic() + PATIENCE_SECONDS
            while not (node.running and goals.get_subscription_count()):
                assert time.monotonic() < end, 'the nodes did not find each other'
                executor.spin_once(timeout_sec=0.01)
            if limited:
                goals.publish(far_goal(robot))
            measured = watch(node, executor, seconds)
            speeds = np.abs(node.velocity) / [*slow.values()]
            assert (speeds.max() > 1.0 - 1e-9) == limited, speeds
            return measured
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=20.0, help='length of each run')
    options = parser.parse_args()
    print('| | cycles per second | µs per cycle: median | 99 % | longest | '
          'µs from cycle to cycle: median | 99 % | longest | of one processor |')
    print('| --- | --- | --- | --- | --- | --- | --- | --- | --- |')
    with own_domain() as environment, tempfile.TemporaryDirectory() as folder:
        os.environ.update(environment)
        for limited, name in ((False, 'holding a pose'), (True, 'limits active')):
            spent, intervals, share = run(limited, options.seconds, environment, Path(folder))
            cells = [f'{1e6 / intervals.mean():.0f}']
            for times in (spent, intervals):
                cells += [f'{value:.0f}' for value in (*np.percentile(times, [50, 99]),
                                                       times.max())]
            print(f'| {name} | {" | ".join(cells)} | {100.0 * share:.0f} % |')


if __name__ == '__main__':
    main()
