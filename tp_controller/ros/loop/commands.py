# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Publication of commands for joints and base, from any thread."""

from collections.abc import Callable, Mapping
from threading import Lock
import time
from typing import Any

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.base_topics import FixedBase, MovingBase
from tp_controller.ros.loop.clocks import boot_time
from tp_controller.ros.loop.numbers_publisher import NumbersPublisher
from tp_controller.ros.loop.outputs import Moment, output_type
from tp_controller.ros.loop.ramped_stop import LONGEST_RAMP

# Timeout for the acknowledgement of the last zeros when the node ends [s].
LAST_ZERO_SECONDS = 0.5
# Number of final zero commands, since a message may get lost.
LAST_ZEROS = 3
# Time between two commands of a stop that no cycle continues [s].
STOP_PERIOD = 0.01


class Commands:
    """
    Publisher of the velocities of a cycle, unless the cycle has been interrupted.

    Where positions are published, "zeros" are those of a robot that brakes and then stays.

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
    values : dict
        Parameters of the controller node.
    clock : callable
        Returns the time on the clock of the robot [s].

    Attributes
    ----------
    output : VelocityOutput
        Output for the driven joints.
    interruptions : int
        Number of calls of `interrupt`; a cycle reads it when it begins.
    silent : bool
        Nothing is published, not even zeros, because another node commands the robot.

    """

    def __init__(self, node: Node, topic: Callable[[str], str], robot: Robot,
                 names: list[str], base: MovingBase | FixedBase, qos: QoSProfile,
                 values: Mapping[str, Any], clock: Callable[[], float]) -> None:
        self._base, self._clock = base, clock
        # Columns of the driven joints; None where there are no others.
        self._columns = robot.joint_columns if robot.joint_columns.start else None
        self._zeros = np.zeros(robot.n)
        self.output = output_type(values['output'])(node, topic, robot, names, qos, values)
        self._gate = Lock()
        self.interruptions = 0
        self.silent = False

    @property
    def stopped(self) -> str:
        """Return a description of the commands of a robot that is stopped."""
        return 'nothing' if self.silent else self.output.stopped

    @property
    def publishers(self) -> list[NumbersPublisher]:
        """Return the publishers of joints and base."""
        return [self.output.publisher, *self._base.publishers]

    @property
    def watched(self) -> list[NumbersPublisher]:
        """Return the publishers whose silence does not stop the robot: a watchdog has to."""
        return self.publishers[1:] if self.output.holds else self.publishers

    def publish(self, velocity: Array, noted: int, latest: float, moment: Moment) -> bool:
        """
        Publish velocities (n,) of a cycle that read `noted` interruptions when it began.

        Returns whether they were published: after an interruption, or the time `latest` [s], they
        are not.
        """
        with self._gate:
            if noted != self.interruptions or boot_time() > latest:
                return False
            if not self.silent:
                self.output.command(velocity if self._columns is None
                                    else velocity[self._columns], moment)
                self._base.publish(velocity)
            return True

    def zeros(self, measured: Array | None = None) -> None:
        """Publish zeros; `measured` positions (m,) of the driven joints, if they are known."""
        with self._gate:
            self._put_zeros(measured)

    def interrupt(self, times: int = 1) -> None:
        """Publish zeros, and prevent the current cycle from publishing velocities."""
        with self._gate:
            self.interruptions += 1
            for _ in range(times):
                self._put_zeros(None)

    def withdraw(self) -> None:
        """Publish zeros for the last time, and leave the robot to another node."""
        if self.silent:
            return
        if self.output.holds:
            # Positions of two nodes in turns would make the robot jump; without any it stays.
            with self._gate:
                self.interruptions += 1
                for _ in range(LAST_ZEROS):
                    self._base.publish(self._zeros)
        else:
            self.interrupt(LAST_ZEROS)
        self.silent = True
        self.output.forget()

    def come_to_rest(self) -> None:
        """Publish zeros until the robot is commanded to rest, for at most `LONGEST_RAMP`."""
        for _ in range(round(LONGEST_RAMP / STOP_PERIOD)):
            if self.output.at_rest:
                return
            time.sleep(STOP_PERIOD)
            self.zeros()

    def wait(self) -> None:
        """Come to rest, and wait until the last command is acknowledged (`LAST_ZERO_SECONDS`)."""
        self.come_to_rest()
        for publisher in self.publishers:
            publisher.wait_for_all_acked(Duration(seconds=LAST_ZERO_SECONDS))

    def close(self) -> None:
        """Destroy the publishers."""
        self.come_to_rest()
        self._base.close()
        self.output.publisher.close()

    def _put_zeros(self, measured: Array | None) -> None:
        """Publish zeros."""
        if not self.silent:
            self.output.stop(self._clock(), measured)
            self._base.publish(self._zeros)
