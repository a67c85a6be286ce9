# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Device whose axes or twists drive a task of the type twist."""

from collections.abc import Callable, Mapping
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from tp_controller.errors import SettingsError
from tp_controller.ros.adaptive_subscription import AdaptiveSubscription
from tp_controller.tools.teleop.drive import Drive
from tp_controller.tools.teleop.mapping import Array, DIRECTIONS, Scaling, Source
from tp_controller.tools.teleop.messages import twist_message, twist_values

# Passes an input on: its name, and the function that takes it at a time [s].
Take = Callable[[str, Callable[[float], str]], object]


class TwistDevice:
    """
    Device that commands twists.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to.
    values : mapping
        Its parameters.
    sources : mapping
        {parameter: Source} of the axes and buttons.
    take : callable
        Called with each input.

    Attributes
    ----------
    drive : Drive
    out : rclpy.publisher.Publisher

    """

    def __init__(self, node: Node, values: Mapping[str, Any], sources: Mapping[str, Source],
                 take: Take) -> None:
        self._node, self._take = node, take
        directions = {} if values['twist_topic'] else {name: sources[name] for name in DIRECTIONS}
        if not (values['twist_topic'] or any(directions.values())):
            raise SettingsError(['no input: one of the parameters '
                                 f'{", ".join(DIRECTIONS)}, twist_topic or pose_topic is needed'])
        self._frame, self._received_frame = values['frame'], ''
        self.drive = Drive(directions, sources['dead_man'], _scaling(values), values['timeout'],
                           values['ramp'], values['unitless'], values['rest_first'])
        self.out = node.create_publisher(
            TwistStamped, f'/{values["controller"].strip("/")}/{values["task"]}/twist', 10)
        if values['twist_topic']:
            kind = TwistStamped if values['twist_stamped'] else Twist
            AdaptiveSubscription(node, kind, values['twist_topic'], self._on_twist)

    def cycle(self, now: float) -> None:
        """Send the twist of a cycle at a time [s], if there is one."""
        twist = self.drive.command(now)
        if twist is not None:
            self._send(twist)

    def rest(self) -> None:
        """Send zeros."""
        self._send(self.drive.rest())

    def apply(self, values: Mapping[str, Any]) -> None:
        """Apply another scale, deadband or frame."""
        self.drive.scaling, self._frame = _scaling(values), values['frame']

    def _on_twist(self, message: Twist | TwistStamped) -> None:
        """Take a twist of the device."""
        if isinstance(message, TwistStamped):
            self._received_frame, message = message.header.frame_id, message.twist
        self._take('twist', lambda now: self.drive.take_twist(twist_values(message), now))

    def _send(self, twist: Array) -> None:
        """Publish a twist (6,) for the task."""
        message = twist_message(twist, self._frame or self._received_frame)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self.out.publish(message)


def _scaling(values: Mapping[str, Any]) -> Scaling:
    """Return the scaling of the parameters."""
    return Scaling(values['linear_scale'], values['angular_scale'], values['deadband'])
