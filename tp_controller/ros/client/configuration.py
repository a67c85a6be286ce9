# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Configuration of a robot, assembled from joint states and odometry."""

import sys

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import JointState
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.base_topics import ODOMETRY_QOS, OdometryBuffer, placement_of, twist_of
from tp_controller.ros.loop.joint_state_buffer import JointStateBuffer

# Timeout that every message satisfies, however old [s].
NO_TIMEOUT = sys.float_info.max


class ConfigurationBuffer:
    """
    Latest configuration of a robot, without the age and plausibility checks of the loop.

    Parameters
    ----------
    robot : Robot
        Its driven and passive joints are read from joint states, its base from odometry.

    Attributes
    ----------
    odometry_qos : rclpy.qos.QoSProfile
        Quality of service of the subscription to odometry.

    """

    odometry_qos = ODOMETRY_QOS

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._joints = JointStateBuffer(robot.joint_names, robot.passive_names,
                                        robot.passive_neutral)
        self._odometry = OdometryBuffer(robot) if robot.moves else None

    @property
    def passive(self) -> Array:
        """Return the positions of the passive joints [rad or m]."""
        return self._joints.passive

    def put_joint_state(self, message: JointState, now: float) -> bool:
        """Store the positions of a message received at a time [s]; return False if refused."""
        return not self._joints.put(message.name, message.position, now)

    def put_odometry(self, message: Odometry, now: float) -> None:
        """Store the pose of the base from a message received at a time [s]."""
        if self._odometry is not None:
            self._odometry.put(message.header.frame_id, message.child_frame_id,
                               placement_of(message), now)

    def configuration(self, now: float) -> Array | None:
        """Return q (nq,), or None until every joint and the base are known."""
        joints = self._joints.q
        if not np.isfinite(joints).all():
            return None
        if self._odometry is None:
            return joints.copy()
        if self._odometry.missing(now, NO_TIMEOUT):
            return None
        return self._odometry.configuration(joints)


def base_velocities(robot: Robot, message: Twist) -> Array:
    """Return the base velocities of a robot that a twist commands [m/s, rad/s]."""
    return robot.base_velocities(twist_of(message))
