# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Measurements of the robot: joint states and odometry, checked and stored."""

from collections.abc import Callable, Mapping
import math
from typing import Any

from nav_msgs.msg import Odometry
import numpy as np
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from tp_controller.errors import in_words
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.log import Log
from tp_controller.ros.loop.base_topics import FixedBase, LONGEST_QUEUE_TIME, MovingBase, waiting
from tp_controller.ros.loop.clocks import RobotClock
from tp_controller.ros.loop.deadlines import state_events, state_qos
from tp_controller.ros.loop.joint_state_buffer import JointStateBuffer
from tp_controller.ros.loop.joint_state_cdr import JointStateReader
from tp_controller.ros.loop.loop_statistics import Figures
from tp_controller.ros.loop.state_checks import endless_joints
from tp_controller.ros.loop.stop_reasons import Stops

# Idle time after which the queue counts as empty [s].
SHORTEST_PAUSE = 1e-4


class Measurements:
    """
    Latest joint states and odometry, the queues they arrive in, and checks of them.

    Contradictory positions stop a robot that has moved until ~/start.

    Parameters
    ----------
    robot : Robot
    base : MovingBase or FixedBase
    values : dict
        Parameters of the controller node.
    stops : Stops
    log : Log
    now : callable
        Returns the time of receipt [s].
    clock : RobotClock

    Attributes
    ----------
    joints : JointStateBuffer
    base : MovingBase or FixedBase
    passive : ndarray (p,) or None
        Positions of the passive joints; None for a robot without such joints [rad or m].
    received : float
        Time of receipt of the last joint state [s].

    """

    def __init__(self, robot: Robot, base: MovingBase | FixedBase, values: Mapping[str, Any],
                 stops: Stops, log: Log, now: Callable[[], float], clock: RobotClock) -> None:
        self.base, self._stops, self._log, self._now, self._clock = base, stops, log, now, clock
        self._timeout, self._deadline = values['state_timeout'], values['state_deadline']
        self.joints = JointStateBuffer(
            robot.joint_names, robot.passive_names, robot.passive_neutral,
            robot.velocity[robot.joint_columns], endless_joints(robot),
            self._timeout if values['check_stamps'] else math.inf, values['jump_tolerance'])
        # A cycle takes less time without them.
        self.passive = self.joints.passive if robot.passive_names else None
        self._reader = JointStateReader()
        self._subscription: Subscription | None = None
        # Last time at which the loop was idle.
        self.received = self._busy_since = now()

    def listen(self, node: Node, topic: Callable[[str], str], figures: Figures,
               on_joint_state: Callable[[bytes], None],
               on_odometry: Callable[[Odometry], None]) -> None:
        """Subscribe; the callbacks pass messages on to the methods `take_…`."""
        self._subscription = node.create_subscription(
            JointState, topic('joint_states'), on_joint_state, state_qos(self._deadline),
            event_callbacks=state_events(self._deadline, figures, self._log), raw=True)
        self.base.listen(on_odometry)

    def close(self, node: Node) -> None:
        """Destroy the subscription to joint states."""
        if self._subscription is not None:
            node.destroy_subscription(self._subscription)

    def discard(self) -> None:
        """Mark the stored positions as outdated."""
        self.joints.discard()
        self.base.discard()

    def drop_queued(self) -> None:
        """Drop the queued joint states; `discard` drops the queued odometry."""
        if self._subscription is not None:
            for _ in waiting(self._subscription):
                pass

    def forget(self) -> None:
        """Clear the contradictions."""
        self.joints.forget()
        self.base.forget()

    def place(self) -> tuple[Array, Array] | None:
        """Return the last received configuration, as `Controller.configuration` does."""
        joints = self.joints.q.copy()
        if not np.isfinite(joints).all():
            return None
        return self.base.configuration(joints), self.joints.passive.copy()

    def missing(self, now: float) -> str:
        """Return the positions that are late, or an empty string if all are known."""
        joints = self.joints
        if joints.whole_valid < now - self._timeout \
                and (missing := joints.missing(now, self._timeout)):
            return f'no joint states of {", ".join(missing)}' \
                   + joints.dropped.remark(now, self._timeout)
        return self.base.stop_reason(now, self._timeout)

    def lasting(self, now: float) -> str:
        """Return the fault for which the robot must not start now, or an empty string."""
        # Without an input the robot would move as soon as the input returns, at any later time.
        return self.joints.lasting(now) or self.base.lasting(now) or self.missing(now)

    def warn_of_passive(self) -> None:
        """Log the passive joints without joint states."""
        unheard = self.joints.unheard()
        if unheard:
            self._log.warning(
                'no joint states of passive joints: until then they count as at zero, or at '
                f'the limit nearest to zero: {", ".join(unheard)}')

    def take_joint_states(self, raw: bytes, now: float, idle_since: float) -> None:
        """Store a joint state, serialized, and all queued ones if they may be old; times in s."""
        self._put(raw, now)
        waited = now - idle_since
        if waited >= SHORTEST_PAUSE:
            self._busy_since = now
        else:
            waited = now - self._busy_since
        # Joint states may have been queued for too long.
        if (waited > LONGEST_QUEUE_TIME or self.joints.delay > LONGEST_QUEUE_TIME) \
                and self._subscription is not None:
            for each in waiting(self._subscription):
                self._put(each, self._now())

    def take_odometry(self, message: Odometry) -> bool:
        """Store odometry, and the queued one if it may be old; return whether one is valid."""
        good = self._put_odometry(message)
        for each in self.base.waiting():
            good = self._put_odometry(each) or good
        return good

    def _put(self, raw: bytes, now: float) -> None:
        """Store the positions of a serialized joint state, or log why it is ignored."""
        self.received = now
        joints = self.joints
        clock = self._clock.time(now) if self._clock.simulated else now
        if joints.put_expected(raw, now, clock):
            if joints.contradiction:
                self._contradict(joints)
            return
        try:
            names, positions, stamp = self._reader.read(raw)
        except Exception as error:  # of rclpy, and not always of the same type
            self._log.warning(f'joint state ignored: {in_words(error)}', 'joint state')
            return
        fault = joints.put(names, positions, now, stamp, clock)
        self._contradict(joints)
        if fault:
            self._log.warning(f'joint state ignored: {fault}', 'joint state')
        else:
            joints.expect(raw, self._reader.mask)

    def _put_odometry(self, message: Odometry) -> bool:
        """Store odometry and return True, or log why it is ignored."""
        now = self._now()
        fault = self.base.put(message, now, self._clock.time(now))
        self._contradict(self.base)
        if fault:
            self._log.warning(f'odometry ignored: {fault}', 'odometry')
        return not fault

    def _contradict(self, source: JointStateBuffer | MovingBase | FixedBase) -> None:
        """Stop until ~/start if positions have jumped while the robot moved."""
        if source.contradiction and self._stops.moved:
            self._stops.latch(source.contradiction)
        elif source.contradiction:
            # A driver may publish zeros before it has read any position, for example.
            source.forget()
