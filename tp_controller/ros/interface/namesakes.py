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
