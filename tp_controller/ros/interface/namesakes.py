# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Detection of other nodes of the same name."""

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from tp_controller.ros.log import Log

# Polling period of the node graph [s].
GRAPH_POLL_SECONDS = 0.5


class Namesakes:
    """
    Warnings of other nodes that have the name of a node.

    Parameters
    ----------
    node : rclpy.node.Node
    log : Log

    """

    def __init__(self, node: Node, log: Log) -> None:
        self._node, self._log, self._count = node, log, 0
        node.create_timer(GRAPH_POLL_SECONDS, self._look,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _look(self) -> None:
        """Count the nodes of the same name; log another one."""
        own = self._node.get_name(), self._node.get_namespace()
        count = self._node.get_node_names_and_namespaces().count(own) - 1
        if count > self._count:
            self._log.warning(f'another node has the name {self._node.get_fully_qualified_name()}')
        self._count = count
