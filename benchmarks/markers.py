# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Time the markers of the demos: sketches of the tasks, messages, and publishing them.

Run as ``python benchmarks/markers.py``. Each robot has carried its stack out for half a second
from its neutral posture. All of it happens beside the loop, `status_rate` times a second.
"""

import argparse
from collections.abc import Callable
import os
import time

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from tp_controller import Controller
from tp_controller.control.sketcher import Sketcher
from tp_controller.ros.interface.markers import Markers
from tp_controller.tools.demos.scenarios import Demo, DEMOS
from visualization_msgs.msg import MarkerArray

CYCLES, PERIOD = 50, 0.01


def started(demo: Demo) -> Controller:
    """Return the controller of a demo after some cycles."""
    robot, controller = demo.robot, Controller(demo.robot, demo.stack)
    q = robot.configuration(robot.positions(robot.neutral())[robot.joint_columns])
    for cycle in range(CYCLES):
        command = controller.update(q, PERIOD * cycle)
        q = robot.integrate(q, command.velocity, PERIOD)
    return controller


def milliseconds(call: Callable[[], object], times: int) -> str:
    """Return the median and the 99th percentile of what a call takes."""
    taken = []
    for _ in range(times):
        began = time.perf_counter()
        call()
        taken.append(1e3 * (time.perf_counter() - began))
    median, most = np.percentile(taken, [50, 99])
    return f'{median:.2f} ({most:.2f})'


def refuse(task: str, reason: str) -> None:
    """Raise: every task of a demo can be drawn."""
    raise AssertionError(f'{task}: {reason}')


def row(name: str, demo: Demo, node: Node, publisher: Publisher, times: int) -> str:
    """Return the row of a demo."""
    controller, root = started(demo), demo.robot.root
    sketcher, markers = Sketcher(demo.robot, refuse), Markers(0.1, refuse)
    stamp, sketches = node.get_clock().now().to_msg(), sketcher.sketch(controller)
    message = markers.message(stamp, root, sketches)
    cells = [name, str(len(controller.stack.tasks)), str(len(message.markers)),
             str(len(serialize_message(message))),
             *(milliseconds(call, times) for call in (
                 lambda: sketcher.sketch(controller),
                 lambda: markers.message(stamp, root, sketches),
                 lambda: publisher.publish(message)))]
    return f'| {" | ".join(cells)} |'


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--times', type=int, default=1000, help='repetitions')
    options = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    rclpy.init()
    node = Node('markers')
    publisher = node.create_publisher(MarkerArray, 'markers', 10)
    # Without a subscriber nothing would be sent.
    node.create_subscription(MarkerArray, 'markers', lambda message: None, 10)
    print('| demo | tasks | markers | bytes | sketches [ms] | messages [ms] | publishing [ms] |')
    print('| --- | --- | --- | --- | --- | --- | --- |')
    for name, demo in DEMOS.items():
        print(row(name, demo, node, publisher, options.times), flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
