# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Publication of velocity commands for joints and base, from any thread."""

from collections.abc import Callable
from threading import Lock

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.base_topics import FixedBase, MovingBase
from tp_controller.ros.loop.clocks import boot_time
from tp_controller.ros.loop.numbers_publisher import NumbersPublisher

TOPIC = 'velocity_controller/commands'
# Timeout for the acknowledgement of the last zeros when the node ends [s].
LAST_ZERO_SECONDS = 0.5
# Number of final zero commands, since a message may get lost.
LAST_ZEROS = 3


class Commands:
    """
    Publisher of the velocities of a cycle, unless the cycle has been interrupted.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the publishers belong to.
    topic : callable
        Returns the full name of a topic.
    robot : Robot
    names : sequence of str
        The driven joints in the order of the commands.
    base : MovingBase or FixedBase
    qos : rclpy.qos.QoSProfile
        Quality of service offered to subscribers.

    Attributes
    ----------
    joints : NumbersPublisher
        Publisher of the joint velocities.
    interruptions : int
        Number of calls of `interrupt`; a cycle reads it when it begins.
    silent : bool
        Nothing is published, not even zeros, because another node commands the robot.

    """

    def __init__(self, node: Node, topic: Callable[[str], str], robot: Robot,
                 names: list[str], base: MovingBase | FixedBase, qos: QoSProfile) -> None:
        self._base = base
        self._order = np.array([robot.joint_index(name) for name in names], dtype=int)
        self._zeros = np.zeros(robot.n)
        self.joints = NumbersPublisher(node, Float64MultiArray(data=[0.0] * len(names)),
                                       len(names), topic(TOPIC), qos)
        self._gate = Lock()
        self.interruptions = 0
        self.silent = False

    @property
    def publishers(self) -> list[NumbersPublisher]:
        """Return the publishers of joints and base."""
        return [self.joints, *self._base.publishers]

    def publish(self, velocity: Array, noted: int, latest: float) -> bool:
        """
        Publish velocities (n,) of a cycle that read `noted` interruptions when it began.

        Returns whether they were published: after an interruption, or the time `latest` [s], they
        are not.
        """
        with self._gate:
            if noted != self.interruptions or boot_time() > latest:
                return False
            self._put(velocity)
            return True

    def zeros(self) -> None:
        """Publish zeros."""
        with self._gate:
            self._put(self._zeros)

    def interrupt(self, times: int = 1) -> None:
        """Publish zeros, and prevent the current cycle from publishing velocities."""
        with self._gate:
            self.interruptions += 1
            for _ in range(times):
                self._put(self._zeros)

    def withdraw(self) -> None:
        """Publish zeros for the last time, and leave the robot to another node."""
        if not self.silent:
            self.interrupt(LAST_ZEROS)
            self.silent = True

    def wait(self) -> None:
        """Wait until the last command is acknowledged, for at most `LAST_ZERO_SECONDS`."""
        for publisher in self.publishers:
            publisher.wait_for_all_acked(Duration(seconds=LAST_ZERO_SECONDS))

    def close(self) -> None:
        """Destroy the publishers."""
        self._base.close()
        self.joints.close()

    def _put(self, velocity: Array) -> None:
        """Publish velocities (n,)."""
        if not self.silent:
            self.joints.publish(velocity[self._order])
            self._base.publish(velocity)
