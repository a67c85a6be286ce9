# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Numeric reports of the tasks, for plotting."""

from collections.abc import Callable, Collection, Iterable
import math

from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from tp_controller.control.task_report import TaskReport
from tp_controller.ros.interface.task_publishers import TaskPublishers

NUMBERS_TOPIC = 'numbers'
# Separator of the names of the numbers.
SEPARATOR = ', '


class TaskNumbers:
    """
    Publisher of ``~/<task>/numbers`` for every task of a stack with subscribers.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publishers = TaskPublishers(node, Float64MultiArray, NUMBERS_TOPIC)

    def follow(self, names: Collection[str]) -> None:
        """Create topics for some tasks, and destroy those of all others."""
        self._publishers.follow(names)

    def publish(self, reports: Callable[[], Iterable[TaskReport]]) -> None:
        """Publish the reports of the tasks whose topics have subscribers."""
        subscribed = self._publishers.subscribed()
        if subscribed:
            stamp = 1e-9 * self._node.get_clock().now().nanoseconds
            for report in reports():
                if report.name in subscribed:
                    subscribed[report.name].publish(numbers(report, stamp))


def numbers(report: TaskReport, stamp: float) -> Float64MultiArray:
    """
    Return the report of a task as numbers in a constant layout.

    The label of its one dimension contains the names of all numbers. Unknown numbers, while the
    task is disabled or the robot is stopped, are NaN. No message of common_interfaces has a header
    and named numbers, so the time [s] is the last number.
    """
    named: dict[str, float] = {}
    for error, unit, tolerance in report.errors:
        named[f'error [{unit}]'], named[f'tolerance [{unit}]'] = error, tolerance
    known = report.carried_out
    named['wanted speed'] = report.demanded_speed if known else math.nan
    named['achieved speed'] = report.achieved_speed if known else math.nan
    named['stamp [s]'] = stamp
    message = Float64MultiArray(data=list(named.values()))
    message.layout.dim = [MultiArrayDimension(label=SEPARATOR.join(named), size=len(named),
                                              stride=len(named))]
    return message
