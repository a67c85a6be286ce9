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

"""Subscriptions whose messages are only decoded where they are not too long."""

from collections.abc import Callable

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from tp_controller.ros import Message

# Longest message; in memory it may take up to thirty times as much [bytes].
LONGEST = 1 << 20


def subscribe(node: Node, kind: type, topic: str, callback: Callable[[Message], object],
              qos: QoSProfile | int, longest: int = LONGEST) -> Subscription:
    """
    Subscribe to a topic; messages that are too long or damaged are dropped.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that it belongs to.
    kind : type
        Message type.
    topic : str
        Its name.
    callback : callable
        Called with each message.
    qos : rclpy.qos.QoSProfile or int
        Quality of service, or the depth of the queue.
    longest : int
        Largest size of a message [bytes].

    """
    def take(data: bytes) -> None:
        if len(data) > longest:
            return
        try:
            message = deserialize_message(data, kind)
        except Exception:
            # Each middleware has errors of its own for data that are damaged.
            return
        callback(message)

    return node.create_subscription(kind, topic, take, qos, raw=True)
