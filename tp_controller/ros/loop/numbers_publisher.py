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

"""Publisher of messages that end with numbers, serialized once."""

from collections import deque

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from tp_controller.model.spatial import Array
from tp_controller.ros import Message

# Largest number of recent messages that are recognized as own: more than may be in transit.
RECENT_MESSAGES = 50


class NumbersPublisher:
    """
    Publisher of numbers at the end of an otherwise constant message.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the publisher belongs to.
    message : Message
        A message that ends with `count` doubles.
    count : int
        Number of doubles.
    topic : str
        Full name of the topic.
    qos : rclpy.qos.QoSProfile

    Attributes
    ----------
    topic : str
        See above.
    kind : type
        Type of the message.

    """

    def __init__(self, node: Node, message: Message, count: int, topic: str,
                 qos: QoSProfile) -> None:
        self._node, self.topic, self.kind, self.count = node, topic, type(message), count
        self._message = bytearray(serialize_message(message))
        self._view = np.frombuffer(self._message, dtype='<f8',
                                   offset=len(self._message) - 8 * count)
        self._publisher = node.create_publisher(self.kind, topic, qos)
        self._recent: deque[bytes] = deque(maxlen=RECENT_MESSAGES)

    def publish(self, numbers: Array) -> None:
        """Publish numbers (count,)."""
        self._view[:] = numbers
        message = bytes(self._message)
        self._recent.append(message)
        self._publisher.publish(message)

    def is_own(self, message: bytes) -> bool:
        """Return whether a serialized message is one of the last published here."""
        return message in self._recent

    def wait_for_all_acked(self, timeout: Duration) -> None:
        """Wait until every subscriber has acknowledged the last message."""
        self._publisher.wait_for_all_acked(timeout)

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)
