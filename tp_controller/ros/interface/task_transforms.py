# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Poses of the frames that tasks move."""

from collections.abc import Callable, Collection, Mapping

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from tp_controller.control.sketcher import FramePose
from tp_controller.ros.interface.markers import to_pose
from tp_controller.ros.interface.task_publishers import TaskPublishers
from tp_controller.tasks.frame import FrameTask
from tp_controller.tasks.task import Task

TRANSFORM_TOPIC = 'transform'


class TaskTransforms:
    """
    Publisher of ``~/<task>/transform`` for every task about a frame, with subscribers.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publishers = TaskPublishers(node, TransformStamped, TRANSFORM_TOPIC)

    def follow(self, tasks: Mapping[str, Task]) -> None:
        """Create topics for the tasks about a frame, and destroy those of all others."""
        self._publishers.follow(
            [name for name, task in tasks.items() if isinstance(task, FrameTask)])

    def publish(self, poses: Callable[[Collection[str]], Mapping[str, FramePose]]) -> None:
        """Publish the poses of the tasks whose topics have subscribers."""
        subscribed = self._publishers.subscribed()
        if subscribed:
            stamp = self._node.get_clock().now().to_msg()
            for name, found in poses(subscribed).items():
                message = transform(found)
                message.header.stamp = stamp
                subscribed[name].publish(message)


def transform(found: FramePose) -> TransformStamped:
    """Return the message, without a stamp, of the pose of a frame."""
    message = TransformStamped(child_frame_id=found.frame)
    message.header.frame_id = found.reference
    place = to_pose(found.T)
    shift = message.transform.translation
    shift.x, shift.y, shift.z = place.position.x, place.position.y, place.position.z
    message.transform.rotation = place.orientation
    return message
