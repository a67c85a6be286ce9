# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscription to reliable and best-effort publishers."""

from collections.abc import Callable
from functools import partial

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from tp_controller.ros import Message

QUEUE_DEPTH = 10


class AdaptiveSubscription:
    """
    Subscription that is compatible with every publisher of a topic.

    A reliable subscription is incompatible with best-effort publishers, and a best-effort one may
    lose messages of any publisher. The subscription is therefore reliable until the first
    best-effort publisher appears, and best-effort from then on.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topic belongs to.
    kind : type
        Message type.
    topic : str
    take : callable
        Called with each message.

    """

    def __init__(self, node: Node, kind: type, topic: str,
                 take: Callable[[Message], object]) -> None:
        self._node, self._kind, self._topic, self._take = node, kind, topic, take
        # The last one is in use. A subscription cannot be destroyed within its own event callback.
        self._open: list[Subscription] = []
        self._subscribe(ReliabilityPolicy.RELIABLE)

    def close(self) -> None:
        """Destroy the subscriptions."""
        while self._open:
            self._node.destroy_subscription(self._open.pop())

    def _subscribe(self, reliability: ReliabilityPolicy) -> None:
        """Create another subscription."""
        self._open.append(self._node.create_subscription(
            self._kind, self._topic, partial(self._on_message, len(self._open)),
            QoSProfile(depth=QUEUE_DEPTH, reliability=reliability),
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._on_incompatible)))

    def _on_incompatible(self, _: object) -> None:
        """Subscribe as best effort, too, once an incompatible publisher appears."""
        if len(self._open) == 1:
            self._subscribe(ReliabilityPolicy.BEST_EFFORT)

    def _on_message(self, index: int, message: Message) -> None:
        """Pass on a message of the subscription in use."""
        if index == len(self._open) - 1:
            self._take(message)
