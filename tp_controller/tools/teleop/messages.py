# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Conversion of twists to messages."""

from geometry_msgs.msg import TwistStamped
from tp_controller.tools.teleop.mapping import Array


def twist_message(twist: Array, frame: str) -> TwistStamped:
    """Return the message, without a stamp, of a twist (6,) in a frame."""
    message = TwistStamped()
    message.header.frame_id = frame
    linear, angular = message.twist.linear, message.twist.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = twist.tolist()
    return message
