# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""The watchdog node: publishes zeros when the commands of a moving robot stop arriving."""

from array import array
from functools import partial
import math
import sys
import time
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock, ClockType
from std_msgs.msg import Float64MultiArray, Header, String
from tp_controller.errors import SettingsError, unknown
from tp_controller.model.mobile_base import BASES
from tp_controller.ros.adaptive_subscription import AdaptiveSubscription
from tp_controller.ros.declarations.spec import Spec
from tp_controller.ros.loop.base_topics import twist_of
from tp_controller.ros.loop.commands import LAST_ZEROS
from tp_controller.ros.loop.other_publishers import HEARTBEAT, HEARTBEAT_SECONDS, WATCHDOG
from tp_controller.ros.loop.outputs import VelocityOutput
from tp_controller.ros.parameters import (
    accept_numbers,
    declare,
    keep_fixed,
    warn_unknown,
)
from tp_controller.ros.runner import ClosableNode, run
from tp_controller.ros.twist_topic import AnyTwist, TwistSubscription

NAME, TOPIC = f'tp_{WATCHDOG}', VelocityOutput.topic
PARAMETERS = (
    Spec('timeout', 0.2, 'time without a command, after one that moves the robot, after which '
         'zeros are commanded', 's', 0.01, 10.0, True),
    Spec('base', 'fixed', f'how the base moves ({", ".join(BASES)}): unless it is fixed, '
         'cmd_vel is watched over, too', fixed=True),
)


class CommandTimeout:
    """
    Timeout of the commands that move a robot.

    Parameters
    ----------
    timeout : float
        [s]

    """

    def __init__(self, timeout: float) -> None:
        self._timeout, self._received, self._checked = timeout, math.inf, math.inf

    def note(self, moves: bool, now: float) -> None:
        """Record a command received at a time [s]."""
        self._received = now if moves else math.inf

    def is_due(self, now: float) -> bool:
        """Return whether zeros are due: once each time that commands stop during motion."""
        if now - self._checked > self._timeout:
            # This node itself stood still: messages may be waiting in its queues.
            self._received = max(self._received, now)
        self._checked = now
        due = now - self._received > self._timeout
        if due:
            self._received = math.inf
        return due


class WatchdogNode(ClosableNode):
    """Node that receives commands, and publishes zeros on the same topics when they stop."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        values = declare(self, PARAMETERS)
        if values['base'] not in BASES:
            raise SettingsError([unknown('base', values['base'], BASES)])
        self._timeout = values['timeout']
        self._watched = {topic: CommandTimeout(values['timeout']) for topic in (TOPIC, 'cmd_vel')}
        # In the size of the last command.
        self._joint_zeros = Float64MultiArray()
        self._out = {TOPIC: self.create_publisher(Float64MultiArray, TOPIC, 10)}
        AdaptiveSubscription(self, Float64MultiArray, TOPIC, self._on_command)
        if values['base'] != 'fixed':
            TwistSubscription(self, 'cmd_vel', self._on_base_command, self._close_base,
                              self._open_base, WATCHDOG)
        # Their names follow the remapped topics.
        self._pulses = [self.create_publisher(String, publisher.topic_name + HEARTBEAT, 10)
                        for publisher in self._out.values()]
        self._name = String(data=self.get_fully_qualified_name())
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, callback in ((values['timeout'] / 4.0, self._on_timer),
                                 (HEARTBEAT_SECONDS, self._publish_heartbeat)):
            self.create_timer(period, callback, clock=steady)
        keep_fixed(self)
        accept_numbers(self)
        warn_unknown(self)

    def close(self, reason: str) -> None:
        """Do nothing: the controller goes on."""

    def _on_command(self, message: Float64MultiArray) -> None:
        """Record a command for the joints."""
        self._joint_zeros = Float64MultiArray(data=array('d', bytes(8 * len(message.data))))
        self._watched[TOPIC].note(any(message.data), time.monotonic())

    def _on_base_command(self, message: Twist) -> None:
        """Record a command for the base."""
        self._watched['cmd_vel'].note(bool(twist_of(message).any()), time.monotonic())

    def _open_base(self, kind: type[AnyTwist]) -> None:
        """Create the publisher of zeros for the base."""
        self._out['cmd_vel'] = self.create_publisher(kind, 'cmd_vel', 10)

    def _close_base(self) -> None:
        """Destroy the publisher of zeros for the base."""
        if 'cmd_vel' in self._out:
            self.destroy_publisher(self._out.pop('cmd_vel'))

    def _zeros(self, kind: Any) -> Float64MultiArray | AnyTwist:
        """Return zeros of the type of a command."""
        if kind is Float64MultiArray:
            return self._joint_zeros
        if kind is Twist:
            return Twist()
        # Receivers may ignore old stamps.
        return TwistStamped(header=Header(stamp=self.get_clock().now().to_msg()))

    def _publish_heartbeat(self) -> None:
        """Publish the heartbeat, by which controllers detect this node."""
        for publisher in self._pulses:
            publisher.publish(self._name)

    def _on_timer(self) -> None:
        """Publish zeros on the topics where they are due."""
        for topic, publisher in self._out.items():
            if self._watched[topic].is_due(time.monotonic()):
                for _ in range(LAST_ZEROS):
                    publisher.publish(self._zeros(publisher.msg_type))
                self.get_logger().warning(f'no command on {publisher.topic_name} for '
                                          f'{self._timeout:g} s; publishing zeros')


main = partial(run, WatchdogNode, NAME)

if __name__ == '__main__':
    sys.exit(main())
