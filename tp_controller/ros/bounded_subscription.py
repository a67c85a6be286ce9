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

"""Subscriptions with a bound on the size of messages that are deserialized."""

from collections.abc import Callable

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from tp_controller.ros import Message

# Largest message; deserialized it may take up to thirty times as much memory [bytes].
LARGEST_MESSAGE = 1 << 20


def subscribe(node: Node, kind: type, topic: str, callback: Callable[[Message], object],
              qos: QoSProfile | int, longest: int = LARGEST_MESSAGE) -> Subscription:
    """
    Subscribe to a topic; drop messages that are too large or damaged.

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
            # Each middleware raises its own errors for damaged data.
            return
        callback(message)

    return node.create_subscription(kind, topic, take, qos, raw=True)
