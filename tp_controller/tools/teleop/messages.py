# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Conversion of twists and poses to and from messages."""

from geometry_msgs.msg import Pose, PoseStamped, Transform, Twist, TwistStamped
from tp_controller.model.spatial import quaternion_from_rotation
from tp_controller.tools.teleop.clutch import Goal
from tp_controller.tools.teleop.mapping import Array

Twist6 = tuple[float, float, float, float, float, float]
Pose7 = tuple[float, float, float, float, float, float, float]


def twist_message(twist: Array, frame: str) -> TwistStamped:
    """Return the message, without a stamp, of a twist (6,) in a frame."""
    message = TwistStamped()
    message.header.frame_id = frame
    linear, angular = message.twist.linear, message.twist.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = twist.tolist()
    return message


def goal_message(goal: Goal) -> PoseStamped:
    """Return the message, without a stamp, of a goal."""
    message = PoseStamped()
    message.header.frame_id = goal.frame
    place, turn = message.pose.position, message.pose.orientation
    place.x, place.y, place.z = goal.T[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = quaternion_from_rotation(goal.T[:3, :3]).tolist()
    return message


def twist_values(twist: Twist) -> Twist6:
    """Return linear and angular velocity."""
    linear, angular = twist.linear, twist.angular
    return linear.x, linear.y, linear.z, angular.x, angular.y, angular.z


def pose_values(pose: Pose | Transform) -> Pose7:
    """Return x, y, z and a quaternion xyzw."""
    transform = isinstance(pose, Transform)
    place, turn = (pose.translation, pose.rotation) if transform \
        else (pose.position, pose.orientation)
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w
