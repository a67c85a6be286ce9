# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Lookup of frames outside the robot, and broadcast of its base, with tf2 if installed."""

from typing import Any

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.time import Time
from tp_controller.errors import GoalError, SettingsError
from tp_controller.model.spatial import pose, rotation_from_quaternion
from tp_controller.tasks.keys import finite_vector

# Time stamp that requests the latest transform.
LATEST = Time()


class TfFrames:
    """
    Lookup of the poses of foreign frames; subscribes to tf at the first lookup.

    Parameters
    ----------
    node : rclpy.node.Node
    root : str
        Root frame of the robot.

    """

    def __init__(self, node: Node, root: str) -> None:
        self._node, self._root = node, root
        # Buffer of tf2_ros, which may be missing.
        self._buffer: Any = None

    def pose(self, frame: str) -> NDArray[np.float64]:
        """
        Return T_root_frame (4, 4), the latest known.

        Raises
        ------
        GoalError
            tf2 is not installed, or does not know the frame (yet).

        """
        try:
            import tf2_ros
        except ImportError as error:
            raise GoalError(f'frame {frame!r} is not on the robot, and tf2_ros is not installed: '
                            f'use a frame of the robot or its root {self._root!r}') from error
        hint = ''
        if self._buffer is None:
            self._buffer = tf2_ros.Buffer(node=self._node)
            self._listener = tf2_ros.TransformListener(self._buffer, self._node)
            hint = ' (listening to tf only from now on: send the goal again)'
        try:
            transform = self._buffer.lookup_transform(self._root, frame, LATEST).transform
            turn, shift = transform.rotation, transform.translation
            R = rotation_from_quaternion(np.array([turn.x, turn.y, turn.z, turn.w]))
            origin = finite_vector((shift.x, shift.y, shift.z), 3, 'its origin')
        except (tf2_ros.TransformException, ValueError, GoalError) as error:
            raise GoalError(f'frame {frame!r}: {error}{hint}') from error
        return pose(R, origin)


class TfBroadcast:
    """
    Publisher of odometry as tf, for viewers of a robot with a mobile base.

    Parameters
    ----------
    node : rclpy.node.Node

    Raises
    ------
    SettingsError
        tf2 is not installed.

    """

    def __init__(self, node: Node) -> None:
        try:
            import tf2_ros
        except ImportError as error:
            raise SettingsError(['parameter publish_tf needs tf2_ros, which is not '
                                 'installed']) from error
        self._broadcaster = tf2_ros.TransformBroadcaster(node)

    def send(self, odometry: Odometry) -> None:
        """Publish the pose of a message."""
        place = odometry.pose.pose
        transform = TransformStamped(header=odometry.header,
                                     child_frame_id=odometry.child_frame_id)
        shift = transform.transform.translation
        shift.x, shift.y, shift.z = place.position.x, place.position.y, place.position.z
        transform.transform.rotation = place.orientation
        self._broadcaster.sendTransform(transform)
