# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

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
