# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Outputs for the driven joints: velocities, or positions integrated from them."""

from collections.abc import Callable, Mapping, Sequence
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray
from tp_controller.errors import SettingsError, unknown
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.declarations.controller import OUTPUTS
from tp_controller.ros.loop.commanded_positions import CommandedPositions
from tp_controller.ros.loop.integration import Integration, Stop
from tp_controller.ros.loop.numbers_publisher import NumbersPublisher
from tp_controller.ros.loop.state_checks import endless_joints
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

# Shortest `time_from_start` [s]: two cycles of a controller manager at its default of 100 Hz. In
# less time than one, joint_trajectory_controller steps to the point at once.
SHORTEST_WAY = 0.02
# Time without a command after which a robot has stopped at the last positions by itself [s], or
# three periods.
LONGEST_SILENCE = 0.03


class Moment(NamedTuple):
    """
    State of the robot in a cycle.

    Attributes
    ----------
    now : float
        Time on the clock of the robot [s].
    measured : ndarray (m,)
        Measured positions of the driven joints [rad or m].
    share : float
        Share of a command that the joints carry out [1].

    """

    now: float
    measured: Array
    share: float = 1.0


class VelocityOutput:
    """
    Velocities of the driven joints; zeros stop them.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the publisher belongs to.
    topic : callable
        Returns the full name of a topic.
    robot : Robot
    names : sequence of str
        The driven joints in the order of the commands.
    qos : rclpy.qos.QoSProfile
        Quality of service offered to subscribers.
    values : dict
        Parameters of the controller node.

    Attributes
    ----------
    publisher : NumbersPublisher
    velocity : ndarray (m,)
        Velocities in force, in the order of the robot [rad/s or m/s].
    share : float
        Share of these velocities that the joints carry out [1].
    ahead : ndarray (m,) or None
        Distances of the commanded from the measured positions [rad or m]; None if no positions
        are commanded.
    largest_lead : ndarray (m,)
        Largest of these distances [rad or m].

    """

    topic: ClassVar[str] = 'velocity_controller/commands'
    # Silence holds the robot.
    holds: ClassVar[bool] = False

    def __init__(self, node: Node, topic: Callable[[str], str], robot: Robot,
                 names: Sequence[str], qos: QoSProfile, values: Mapping[str, Any]) -> None:
        # None, mostly: the order of the robot.
        self._order: NDArray[np.intp] | None = None
        if tuple(names) != robot.joint_names:
            self._order = np.array([robot.joint_names.index(name) for name in names], np.intp)
        self._zeros = np.zeros(len(names))
        self.velocity, self.share = self._zeros, 1.0
        self.ahead: Array | None = None
        self.largest_lead = np.full(len(names), math.inf)
        self.publisher = self._make_publisher(node, names, topic(self.topic), qos)

    @property
    def stopped(self) -> str:
        """Return a description of the commands of a robot that is stopped."""
        return 'zeros'

    @property
    def at_rest(self) -> bool:
        """Return whether the robot is commanded to rest once it is stopped."""
        return True

    @property
    def lead(self) -> float:
        """Return the largest share of `largest_lead` that is in use; NaN without positions."""
        ahead = self.ahead
        return math.nan if ahead is None or not len(ahead) \
            else float((np.abs(ahead) / self.largest_lead).max())

    def positions(self, measured: Array, now: float) -> Array:
        """
        Return the positions that the next command starts from, (m,) [rad or m].

        Parameters
        ----------
        measured, now
            See `Moment`.

        """
        return measured

    def command(self, velocity: Array, moment: Moment) -> None:
        """Publish a command for velocities (m,) of the driven joints [rad/s or m/s]."""
        self.velocity, self.share = velocity, moment.share
        self._publish(velocity)

    def stop(self, now: float, measured: Array | None) -> None:
        """
        Publish a command that stops the robot, or keeps it at rest.

        Parameters
        ----------
        now : float
            See `Moment`.
        measured : ndarray (m,) or None
            Measured positions [rad or m]; None if they are not known.

        """
        self.velocity = self._zeros
        self.publisher.publish(self._zeros)

    def resume(self) -> None:
        """Begin anew after a time without commands, in which the robot may have been moved."""

    def forget(self) -> None:
        """Leave the robot to another node: the next motion starts where it is."""

    def _publish(self, numbers: Array) -> None:
        """Publish numbers (m,) of the driven joints, in the order of the robot."""
        self.publisher.publish(numbers if self._order is None else numbers[self._order])

    def _make_publisher(self, node: Node, names: Sequence[str], topic: str,
                        qos: QoSProfile) -> NumbersPublisher:
        """Return the publisher of numbers for the joints of these names."""
        return NumbersPublisher(node, Float64MultiArray(data=[0.0] * len(names)), len(names),
                                topic, qos)


class PositionOutput(VelocityOutput):
    """
    Positions of the driven joints, integrated from velocities; a stop holds the last ones.

    If measured positions move away from the commanded ones while the robot is stopped, it is moved
    by something else: nothing is published then, and the next motion starts from the measured
    positions. Nor is it while measured positions are not known for longer.

    The parameters are those of `VelocityOutput`.
    """

    topic, holds = 'position_controller/commands', True

    def __init__(self, node: Node, topic: Callable[[str], str], robot: Robot,
                 names: Sequence[str], qos: QoSProfile, values: Mapping[str, Any]) -> None:
        super().__init__(node, topic, robot, names, qos, values)
        self._integration, self._values = Integration.of(robot, values), values
        self.largest_lead = self._integration.largest_lead
        self._commanded = CommandedPositions(endless_joints(robot))
        # Time of the last command or stop, and time between the last two commands [s].
        self._at, self._interval = -math.inf, 0.0
        # Limits of the present stop; None in motion.
        self._stop: Stop | None = None

    @property
    def stopped(self) -> str:
        """Return a description of the commands of a robot that is stopped."""
        return 'no positions' if self._commanded.positions is None else 'the last positions'

    @property
    def at_rest(self) -> bool:
        """Return whether the commanded positions stand still."""
        return not self.velocity.any()

    def positions(self, measured: Array, now: float) -> Array:
        """Return the positions that the next command starts from, (m,) [rad or m]."""
        if self._stop is not None and self.at_rest:
            self._commanded.watch(measured, now)
        return self._commanded.near(measured)

    def command(self, velocity: Array, moment: Moment) -> None:
        """Publish the positions that velocities (m,) lead to since the last command."""
        now, measured, share = moment
        commanded, integration = self._commanded, self._integration
        if self._stop is not None and self.at_rest:
            integration.begin()
        self._interval = integration.interval(now - self._at)
        self.ahead = ahead = commanded.ahead(measured)
        self.velocity, moved = integration.advance(
            share * velocity, self.velocity, commanded.start(measured), ahead, self._interval)
        commanded.move(moved, now)
        self._at, self._stop = now, None
        self._put()

    def stop(self, now: float, measured: Array | None) -> None:
        """Publish the positions of joints that brake, or that are commanded."""
        elapsed, commanded, integration = now - self._at, self._commanded, self._integration
        self._at, self.ahead = now, None
        if commanded.positions is None:
            self.velocity = self._zeros
            return
        if self._stop is None:
            self._stop = integration.stop(self.velocity, self._values['stop_deceleration'])
        if self.at_rest:
            if measured is not None:
                commanded.watch(measured, now)
        elif elapsed > max(3.0 * self._interval, LONGEST_SILENCE):
            self.velocity = self._zeros
        else:
            interval = integration.interval(elapsed)
            self.velocity, moved = integration.brake(
                self.velocity, commanded.positions, self._stop, interval)
            commanded.move(moved, now)
        if commanded.is_seen(now):
            self._put()

    def resume(self) -> None:
        """Begin anew after a time without commands, in which the robot may have been moved."""
        self._commanded.lose_sight()

    def forget(self) -> None:
        """Leave the robot to another node: the next motion starts where it is."""
        self.velocity, self.ahead = self._zeros, None
        self._integration.begin()
        self._commanded.forget()

    def _put(self) -> None:
        """Publish the commanded positions, if there are any."""
        if self._commanded.positions is not None:
            self._publish(self._commanded.positions)


class TrajectoryOutput(PositionOutput):
    """
    The same positions as trajectories of one point, to be reached when the next one is due.

    The stamp is zero: the trajectory starts when it arrives, and replaces the one before.
    """

    topic = 'joint_trajectory_controller/joint_trajectory'

    def _make_publisher(self, node: Node, names: Sequence[str], topic: str,
                        qos: QoSProfile) -> NumbersPublisher:
        """Return the publisher of numbers for the joints of these names."""
        marks = np.pi * np.arange(1.0, len(names) + 1.0)
        message = JointTrajectory(joint_names=list(names),
                                  points=[JointTrajectoryPoint(positions=marks)])
        return NumbersPublisher(node, message, len(names), topic, qos, marks=marks)

    def _put(self) -> None:
        """Publish the commanded positions, if there are any."""
        if self._commanded.positions is not None:
            self.publisher.set_time_from_start(max(self._interval, SHORTEST_WAY))
            self._publish(self._commanded.positions)


TYPES: Mapping[str, type[VelocityOutput]] = dict(zip(OUTPUTS, (
    VelocityOutput, PositionOutput, TrajectoryOutput)))


def output_type(name: str) -> type[VelocityOutput]:
    """Return the class of an output; raise `SettingsError` if there is none of this name."""
    if name not in TYPES:
        raise SettingsError([unknown('output', name, OUTPUTS)])
    return TYPES[name]
