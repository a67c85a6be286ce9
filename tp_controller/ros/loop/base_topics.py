# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Topics of a mobile base: odometry in, velocities of the base out."""

from collections.abc import Callable, Iterator, Mapping, Sequence
import math
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from tp_controller.errors import GoalError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, inverse_pose
from tp_controller.ros.loop.numbers_publisher import NumbersPublisher
from tp_controller.ros.loop.odometry_check import OdometryCheck
from tp_controller.ros.loop.state_checks import Dropped, FollowCheck, Following
from tp_controller.tasks.pose import parse_pose

# Largest number of messages taken at once, more than a queue stores: later ones can wait.
MOST_QUEUED = 100
# Time in a queue after which only the newest message is used [s]. On a busy machine (load 5), with
# 2 ms instead 1 to 8 % of the states at 1 kHz, and 2 to 4 % at 2 kHz, get no command; with 10 ms
# at most 0.1 and 0.3 %.
LONGEST_QUEUE_TIME = 10e-3
# As of joint states: lost messages need not be repeated, the next one is newer.
ODOMETRY_QOS = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
# Smallest commanded motion of a base that is checked, relative to the tolerated jump of its
# odometry [1]: a correction by the whole tolerance must not hide that the base follows.
FOLLOW_RATIO = 1.5


class OdometryBuffer:
    """
    Buffer of the latest base pose and its time of receipt.

    Odometry may describe any frame that is fixed to the base. The published base velocities are
    then those of the same frame, as its driver expects.

    Parameters
    ----------
    robot : Robot
        Robot that the base belongs to.

    Attributes
    ----------
    T_root_base : ndarray (4, 4)
        Latest pose of the base.

    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        fixed = ((frame, robot.fixed_to_base(frame)) for frame in robot.frame_names)
        self._carried = {frame: T for frame, T in fixed if T is not None}
        self._child = robot.base_frame
        self.T_root_base = np.eye(4)
        self._received = -np.inf

    def put(self, frame: str, child: str, placement: Sequence[float], now: float) -> str:
        """
        Store the pose of an odometry message.

        Parameters
        ----------
        frame, child : str
            Frame that the placement is expressed in and frame that it describes; empty for the
            root of the robot and its base.
        placement : sequence of float
            x, y, z [m] and a quaternion ``xyzw``.
        now : float
            Time of receipt, or time of the measurement according to the stamp [s].

        Returns
        -------
        str
            Fault for which the message is ignored, or empty.

        """
        child = child or self._robot.base_frame
        if frame and frame != self._robot.root:
            return f'its frame is {frame!r}; valid: {self._robot.root} (parameter world_frame)'
        if child not in self._carried:
            return (f'its child frame is {child!r}; valid are frames fixed to the base: '
                    f'{", ".join(self._carried)}')
        try:
            T_root_child = parse_pose(placement, 'its pose')
        except GoalError as error:
            return str(error)
        self.T_root_base = T_root_child.dot(inverse_pose(self._carried[child]))
        self._child, self._received = child, now
        return ''

    def discard(self) -> None:
        """Mark the stored pose as outdated."""
        self._received = -np.inf

    def missing(self, now: float, timeout: float) -> bool:
        """Return whether no pose was received for `timeout` seconds."""
        return now - self._received > timeout

    def configuration(self, joints: Array) -> Array:
        """Return the configuration of base and driven joints, (nq,)."""
        return self._robot.configuration(joints, self.T_root_base)

    def twist(self, velocity: Array) -> Array:
        """
        Return the twist of the frame that the odometry describes, in its own axes.

        Parameters
        ----------
        velocity : ndarray (n,)
            Velocities of base and joints [m/s, rad/s].

        Returns
        -------
        ndarray (6,)
            Linear, then angular [m/s, rad/s].

        """
        twist = self._robot.base_twist(velocity)
        if self._child == self._robot.base_frame:
            return twist
        T_base_child = self._carried[self._child]
        R_T = T_base_child[:3, :3].T
        linear = twist[:3] + np.cross(twist[3:], T_base_child[:3, 3])
        return np.concatenate((R_T.dot(linear), R_T.dot(twist[3:])))


class MovingBase:
    """
    Odometry subscription and velocity publisher of a mobile base.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to.
    topic : callable
        Returns the full name of a topic.
    robot : Robot
        Robot that the base belongs to.
    qos : rclpy.qos.QoSProfile
        Quality of service offered to subscribers.
    check : OdometryCheck
        Plausibility check of the odometry.
    follow : FollowCheck
        Check that the axes of the base follow their commands.
    stamped : bool
        Publish `TwistStamped`, else `Twist`.

    """

    def __init__(self, node: Node, topic: Callable[[str], str], robot: Robot,
                 qos: QoSProfile, check: OdometryCheck, follow: FollowCheck,
                 stamped: bool) -> None:
        self._node, self._topic = node, topic
        self._columns = slice(robot.joint_columns.start)
        self._check, self._follow = check, follow
        self._buffer = OdometryBuffer(robot)
        # Its frame is left empty: that of the odometry.
        self._commands = NumbersPublisher(node, TwistStamped() if stamped else Twist(), 6,
                                          topic('cmd_vel'), qos,
                                          node.get_clock() if stamped else None)
        self._odometry: Subscription | None = None
        self._dropped = Dropped()

    def listen(self, arrived: Callable[[Odometry], None]) -> None:
        """Subscribe to odometry; `arrived` passes messages on to `put`."""
        self._odometry = self._node.create_subscription(Odometry, self._topic('odom'), arrived,
                                                        ODOMETRY_QOS)

    def configuration(self, joints: Array) -> Array:
        """Return the configuration of base and driven joints, (nq,)."""
        return self._buffer.configuration(joints)

    def stop_reason(self, now: float, timeout: float) -> str:
        """Return the reason for which the base must not move, or an empty string."""
        if not self._buffer.missing(now, timeout):
            return ''
        return f'no odometry{self._dropped.remark(now, timeout)}'

    def publish(self, velocity: Array) -> None:
        """Publish the base components of velocities (n,)."""
        self._commands.publish(self._buffer.twist(velocity))

    @property
    def publishers(self) -> list[NumbersPublisher]:
        """Return the publisher of the velocities of the base."""
        return [self._commands]

    @property
    def contradiction(self) -> str:
        """Return the first jump of the odometry since `forget`, or an empty string."""
        return self._check.contradiction

    def waiting(self) -> Iterator[Odometry]:
        """Yield the queued odometry if the last message was delayed for too long."""
        if self._check.delay > LONGEST_QUEUE_TIME and self._odometry is not None:
            yield from waiting(self._odometry)

    def put(self, message: Odometry, now: float, clock: float) -> str:
        """
        Check odometry and store its pose.

        Parameters
        ----------
        message : nav_msgs.msg.Odometry
            Pose of the base, or of a frame fixed to it.
        now : float
            Time of receipt [s].
        clock : float
            The same on the clock of the robot [s].

        Returns
        -------
        str
            Fault for which the message is ignored, or empty.

        """
        stamp = message.header.stamp
        fault = self._check.fault(stamp.sec + 1e-9 * stamp.nanosec, clock)
        if not fault and self._check.is_overtaken:
            return ''
        fault = fault or self._buffer.put(message.header.frame_id, message.child_frame_id,
                                          placement_of(message), now - self._check.age)
        self._dropped.note(fault, now)
        if not fault:
            self._check.take(self._buffer.T_root_base, now)
        return fault

    def follows(self, velocity: Array, now: float) -> str:
        """Return the fault of an axis that does not follow velocities (n,) now, if any."""
        return self._follow.check(self._check.travel, velocity[self._columns], now)

    @property
    def failing(self) -> str:
        """Return the axis of the last fault of `follows`."""
        return self._follow.joint

    def rest(self) -> None:
        """Restart the check of motion: the next motion begins from rest."""
        self._follow.forget()

    def forget(self) -> None:
        """Clear the recorded jump."""
        self._check.forget()

    def lasting(self, now: float) -> str:
        """Return the jump detected within the last second, if any."""
        return self._check.lasting(now)

    def discard(self) -> None:
        """Discard the odometry received so far, including queued messages."""
        if self._odometry is not None:
            for _ in waiting(self._odometry):
                pass
        self._buffer.discard()
        self._check.discard()

    def close(self) -> None:
        """Destroy the subscription and the publisher."""
        if self._odometry is not None:
            self._node.destroy_subscription(self._odometry)
        self._commands.close()


class FixedBase:
    """Null object in place of `MovingBase` for a fixed base."""

    def listen(self, arrived: Callable[[Odometry], None]) -> None:
        """Do nothing."""

    def configuration(self, joints: Array) -> Array:
        """Return the driven positions: they are the configuration."""
        return joints

    def stop_reason(self, now: float, timeout: float) -> str:
        """Return an empty string: the base never prevents motion."""
        return ''

    def publish(self, velocity: Array) -> None:
        """Do nothing."""

    @property
    def publishers(self) -> list[NumbersPublisher]:
        """Return an empty list."""
        return []

    contradiction = failing = ''

    def waiting(self) -> Iterator[Odometry]:
        """Return an empty iterator."""
        return iter(())

    def put(self, message: Odometry, now: float, clock: float) -> str:
        """Do nothing."""
        return ''

    def follows(self, velocity: Array, now: float) -> str:
        """Return an empty string: every axis follows."""
        return ''

    def rest(self) -> None:
        """Do nothing."""

    def forget(self) -> None:
        """Do nothing."""

    def lasting(self, now: float) -> str:
        """Return an empty string: there is no jump."""
        return ''

    def discard(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def make_base(node: Node, topic: Callable[[str], str], robot: Robot, qos: QoSProfile,
              values: Mapping[str, Any]) -> MovingBase | FixedBase:
    """
    Return the topics of the base of a robot, with the checks of its odometry.

    Parameters
    ----------
    node, topic, robot, qos
        See `MovingBase`.
    values : dict
        Parameters of the controller node.

    """
    if not robot.moves:
        return FixedBase()
    tolerance = values['odometry_jump_tolerance']
    names = robot.velocity_names[:robot.joint_columns.start]
    late = values['state_timeout'] if values['check_stamps'] else math.inf
    follow = FollowCheck(names, np.zeros(len(names), dtype=bool), Following(
        values['follow_window'], distance=max(0.05, FOLLOW_RATIO * tolerance), excess=tolerance))
    return MovingBase(node, topic, robot, qos, OdometryCheck(robot, late, tolerance), follow,
                      values['cmd_vel_stamped'])


def waiting(subscription: Subscription) -> Iterator[Any]:
    """Take and yield the queued messages of a subscription, oldest first."""
    with subscription.handle:
        take, kind = subscription.handle.take_message, subscription.msg_type
        for _ in range(MOST_QUEUED):
            taken = take(kind, subscription.raw)
            if taken is None:
                return
            yield taken[0]


def fill_twist(message: Twist, twist: Array) -> None:
    """Write a twist (6,) to a message."""
    linear, angular = message.linear, message.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = twist.tolist()


def twist_of(message: Twist) -> Array:
    """Return the twist (6,) of a message."""
    linear, angular = message.linear, message.angular
    return np.array((linear.x, linear.y, linear.z, angular.x, angular.y, angular.z))


def placement_of(message: Odometry) -> Sequence[float]:
    """Return the placement (7,) of odometry: x, y, z [m] and a quaternion ``xyzw``."""
    point, turn = message.pose.pose.position, message.pose.pose.orientation
    return point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w


def fill_odometry(message: Odometry, placement: Array, twist: Array) -> None:
    """Write a placement (7,) and a twist (6,) to a message."""
    point, turn = message.pose.pose.position, message.pose.pose.orientation
    point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w = placement.tolist()
    fill_twist(message.twist.twist, twist)
