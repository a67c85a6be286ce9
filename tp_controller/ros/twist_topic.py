# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Topic of twists that other nodes publish with or without a stamp."""

from collections.abc import Callable
from typing import TypeAlias

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from tp_controller.ros.adaptive_subscription import AdaptiveSubscription
from tp_controller.ros.rclpy_internals import RCLError

AnyTwist: TypeAlias = Twist | TwistStamped
# Polling period [s]: ROS does not signal topic discovery.
LOOK_SECONDS = 0.1
TYPES: dict[str, type[AnyTwist]] = {
    'geometry_msgs/msg/TwistStamped': TwistStamped, 'geometry_msgs/msg/Twist': Twist}


class TwistSubscription:
    """
    Subscription to twists of the type that is published, stamped ones at first.

    A node may have only one type on a topic. While stamped ones are published, unstamped ones are
    ignored.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topic belongs to.
    topic : str
    take : callable
        Called with each twist, without its stamp.
    before, after : callable, optional
        Called before the type changes, more than once if need be, and with the new one.
    ignored : str
        End of the names of nodes whose publishers do not decide on the type, besides this one.

    """

    def __init__(self, node: Node, topic: str, take: Callable[[Twist], object],
                 before: Callable[[], object] = lambda: None,
                 after: Callable[[type[AnyTwist]], object] = lambda kind: None,
                 ignored: str = '') -> None:
        self._node, self._topic, self._take = node, topic, take
        self._before, self._after, self._ignored = before, after, ignored
        self._subscribe(self._published() or TwistStamped)
        node.create_timer(LOOK_SECONDS, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _subscribe(self, kind: type[AnyTwist]) -> None:
        """Create the endpoints of a type."""
        self._subscription = AdaptiveSubscription(self._node, kind, self._topic,
                                                  self._on_message)
        self._after(kind)
        self._kind: type[AnyTwist] | None = kind

    def _close(self) -> None:
        """Destroy the endpoints."""
        self._subscription.close()
        self._before()
        self._kind = None

    def _published(self) -> type[AnyTwist] | None:
        """Return the type that other nodes publish, if any."""
        published = {info.topic_type for info
                     in self._node.get_publishers_info_by_topic(self._topic)
                     if info.node_name != self._node.get_name()
                     and not (self._ignored and info.node_name.endswith(self._ignored))}
        return next((kind for name, kind in TYPES.items() if name in published), None)

    def _look(self) -> None:
        """Follow a change of the published type."""
        kind = self._published()
        if kind is None or kind is self._kind:
            return
        if self._kind is not None:
            # Endpoints are destroyed once no thread waits for them any more: by the next look.
            self._close()
            return
        try:
            self._subscribe(kind)
        except RCLError:
            # The middleware refuses a second type of a topic within one process: try again once
            # the other nodes of this one have changed, too.
            self._close()
            return
        self._node.get_logger().info(f'{self._topic} is {kind.__name__}')

    def _on_message(self, message: AnyTwist) -> None:
        """Pass on a twist."""
        self._take(message.twist if isinstance(message, TwistStamped) else message)
