# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Publishers of one topic for each task."""

from collections.abc import Collection, Mapping

from rclpy.node import Node
from rclpy.publisher import Publisher

QUEUE_DEPTH = 10


class TaskPublishers:
    """
    Publishers of the same topic for several tasks.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to, below ``~/<task>/``.
    kind : type
        Message type.
    topic : str
        Last part of the topic, after the name of the task.

    """

    def __init__(self, node: Node, kind: type, topic: str) -> None:
        self._node, self._kind, self._topic = node, kind, topic
        self._publishers: dict[str, Publisher] = {}

    def follow(self, names: Collection[str]) -> None:
        """Create topics for some tasks, and destroy those of all others."""
        for name in set(self._publishers) - set(names):
            self._node.destroy_publisher(self._publishers.pop(name))
        for name in names:
            if name not in self._publishers:
                self._publishers[name] = self._node.create_publisher(
                    self._kind, f'~/{name}/{self._topic}', QUEUE_DEPTH)

    def subscribed(self) -> Mapping[str, Publisher]:
        """Return {task: publisher} of the topics with subscribers."""
        return {name: publisher for name, publisher in self._publishers.items()
                if publisher.get_subscription_count()}
