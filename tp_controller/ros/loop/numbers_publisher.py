# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Publisher of messages of numbers, serialized once."""

from collections import deque
import struct

from rclpy.clock import Clock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from tp_controller.model.spatial import Array
from tp_controller.ros import Message

# Largest number of recent messages that are recognized as own: more than may be in transit.
RECENT_MESSAGES = 50
# Bytes before the stamp of a serialized message: the identifier of its representation.
STAMP_OFFSET = 4
# Bytes of a trajectory point behind its positions: the lengths of three empty lists, and
# `time_from_start`.
BEHIND_POSITIONS = 20
# Seconds and nanoseconds.
STAMP = struct.Struct('<II')
# [ns]
SECOND = 10**9


class NumbersPublisher:
    """
    Publisher of numbers in an otherwise constant message, which may begin with a stamp.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the publisher belongs to.
    message : Message
        A message that ends with `count` doubles, or with a trajectory point of so many positions.
    count : int
        Number of doubles.
    topic : str
        Full name of the topic.
    qos : rclpy.qos.QoSProfile
    clock : rclpy.clock.Clock, optional
        Clock of the stamp, for a message that begins with a header.
    marks : ndarray (count,), optional
        The positions of that point, different from all else in the message.

    Attributes
    ----------
    topic : str
        See above.
    kind : type
        Type of the message.
    type_name : str
        Its name in ROS.

    """

    def __init__(self, node: Node, message: Message, count: int, topic: str,
                 qos: QoSProfile, clock: Clock | None = None, marks: Array | None = None) -> None:
        self._node, self.topic, self.kind, self.count = node, topic, type(message), count
        raw = bytes(serialize_message(message))
        start = len(raw) - 8 * count
        if marks is not None:
            # The middleware reserves more bytes than it fills.
            start = raw.index(marks.tobytes()) if count else start - BEHIND_POSITIONS
            raw = raw[:start + 8 * count + BEHIND_POSITIONS]
        # What is before the numbers, and behind them.
        self._head, self._tail = raw[:start], raw[start + 8 * count:]
        self.type_name = '{}/{}/{}'.format(
            *self.kind.__module__.split('.')[:2], self.kind.__name__)
        self._clock = clock
        self._publisher = node.create_publisher(self.kind, topic, qos)
        self._recent: deque[bytes] = deque(maxlen=RECENT_MESSAGES)

    def publish(self, numbers: Array) -> None:
        """Publish numbers (count,)."""
        if self._clock is not None:
            self._head = self._head[:STAMP_OFFSET] \
                + STAMP.pack(*divmod(self._clock.now().nanoseconds, SECOND)) \
                + self._head[STAMP_OFFSET + STAMP.size:]
        message = self._head + numbers.tobytes() + self._tail
        self._recent.append(message)
        self._publisher.publish(message)

    def set_time_from_start(self, seconds: float) -> None:
        """Set the time of the trajectory point [s] in the messages from now on."""
        self._tail = self._tail[:-8] + STAMP.pack(*divmod(round(seconds * SECOND), SECOND))

    def is_own(self, message: bytes) -> bool:
        """Return whether a serialized message is one of the last published here."""
        return message in self._recent

    def wait_for_all_acked(self, timeout: Duration) -> None:
        """Wait until every subscriber has acknowledged the last message."""
        self._publisher.wait_for_all_acked(timeout)

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)
