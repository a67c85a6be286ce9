# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The teleop node: drives a task of a controller with a gamepad, a 6-DoF mouse or twists."""

from collections.abc import Mapping, Sequence
from functools import partial
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Twist, TwistStamped
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool
from tp_controller.errors import SettingsError
from tp_controller.ros.adaptive_subscription import AdaptiveSubscription
from tp_controller.ros.parameters import accept_numbers, declare, keep_fixed, warn_unknown
from tp_controller.ros.runner import ClosableNode, run
from tp_controller.tools.teleop.declarations import PARAMETERS
from tp_controller.tools.teleop.drive import Drive
from tp_controller.tools.teleop.mapping import Array, DIRECTIONS, Scaling, Source
from tp_controller.tools.teleop.messages import twist_message

NAME = 'tp_teleop'
# Period of the status, and of a warning that repeats [s].
STATUS_PERIOD, WARNING_SECONDS = 0.1, 5.0
# Timeout of the acknowledgement of the last zeros when the node ends [s].
ACKNOWLEDGEMENT_SECONDS = 0.5


class TeleopNode(ClosableNode):
    """Node that turns messages of a device into twists of a task."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        values = declare(self, PARAMETERS)
        sources = _sources(values)
        self._gripper_source = sources['gripper']
        self._gripped: bool | None = None
        self._frame, self._received_frame = values['frame'], ''
        self._state = ''
        directions = {} if values['twist_topic'] else {name: sources[name] for name in DIRECTIONS}
        if not (values['twist_topic'] or any(directions.values())):
            raise SettingsError(['no input: one of the parameters '
                                 f'{", ".join(DIRECTIONS)} or twist_topic is needed'])
        self._drive = Drive(directions, sources['dead_man'], _scaling(values), values['timeout'],
                            values['ramp'], values['unitless'], values['rest_first'])
        self._connect(values)
        keep_fixed(self)
        accept_numbers(self)
        self.add_post_set_parameters_callback(self._on_parameters)
        warn_unknown(self)
        self.get_logger().info(f'driving {self._out.topic_name}')

    def close(self, reason: str) -> None:
        """Send zeros, a courtesy: the task times out by itself."""
        if self._drive.closed(time.monotonic()):
            self._send(np.zeros(6))
            self._out.wait_for_all_acked(Duration(seconds=ACKNOWLEDGEMENT_SECONDS))

    def _connect(self, values: Mapping[str, Any]) -> None:
        """Create publishers, subscriptions and timers."""
        self._out = self.create_publisher(
            TwistStamped, f'/{values["controller"].strip("/")}/{values["task"]}/twist', 10)
        self._status = self.create_publisher(DiagnosticArray, '~/status', 10)
        self._gripper = self.create_publisher(Bool, '~/gripper', 10) \
            if self._gripper_source else None
        AdaptiveSubscription(self, Joy, values['joy_topic'], self._on_joy)
        if values['twist_topic']:
            kind = TwistStamped if values['twist_stamped'] else Twist
            AdaptiveSubscription(self, kind, values['twist_topic'], self._on_twist)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, callback in ((1.0 / values['rate'], self._cycle),
                                 (STATUS_PERIOD, self._publish_status)):
            self.create_timer(period, callback, clock=steady)

    def _on_joy(self, message: Joy) -> None:
        """Take axes and buttons; send zeros at once where they open the dead-man switch."""
        now = time.monotonic()
        moved = self._drive.closed(now)
        self._warn('joy', self._drive.take_joy(message.axes, message.buttons, now))
        self._pass_gripper(message)
        if moved and not self._drive.closed(now):
            self._cycle()

    def _on_twist(self, message: Twist | TwistStamped) -> None:
        """Take a twist of the device."""
        now = time.monotonic()
        moved = self._drive.closed(now)
        if isinstance(message, TwistStamped):
            self._received_frame, message = message.header.frame_id, message.twist
        linear, angular = message.linear, message.angular
        self._warn('twist', self._drive.take_twist(
            (linear.x, linear.y, linear.z, angular.x, angular.y, angular.z), now))
        if moved and not self._drive.closed(now):
            self._cycle()

    def _pass_gripper(self, message: Joy) -> None:
        """Publish the state of the gripper button where it has changed."""
        pressed = self._gripper_source.pressed(message.axes, message.buttons)
        if self._gripper is not None and pressed != self._gripped:
            self._gripped = pressed
            self._gripper.publish(Bool(data=pressed))

    def _cycle(self) -> None:
        """Send the twist of a cycle, if there is one."""
        twist = self._drive.command(time.monotonic())
        if twist is not None:
            self._send(twist)
        if self._text() != self._state:
            self._publish_status()

    def _send(self, twist: Array) -> None:
        """Publish a twist (6,) for the task."""
        message = twist_message(twist, self._frame or self._received_frame)
        message.header.stamp = self.get_clock().now().to_msg()
        self._out.publish(message)

    def _text(self) -> str:
        """Return the state: driving, or the reason for which nothing moves."""
        if not self._out.get_subscription_count():
            return f'no listener on {self._out.topic_name}'
        return self._drive.reason(time.monotonic()) or 'driving'

    def _publish_status(self) -> None:
        """Publish the state, and log it where it has changed."""
        text = self._text()
        if text != self._state:
            self.get_logger().info(text)
            self._state = text
        name = self.get_fully_qualified_name().strip('/')
        fine = self._drive.closed(time.monotonic()) and text == 'driving'
        array = DiagnosticArray(status=[DiagnosticStatus(
            name=name, hardware_id=name, message=text,
            level=DiagnosticStatus.OK if fine else DiagnosticStatus.WARN,
            values=[KeyValue(key='topic', value=self._out.topic_name)])])
        array.header.stamp = self.get_clock().now().to_msg()
        self._status.publish(array)

    def _warn(self, stream: str, fault: str) -> None:
        """Log the fault of an input, if there is one."""
        if fault:
            self.get_logger().warning(f'{stream}: {fault}',
                                      throttle_duration_sec=WARNING_SECONDS)

    def _on_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Apply another scale, deadband or frame."""
        names = ('linear_scale', 'angular_scale', 'deadband', 'frame')
        values = {name: self.get_parameter(name).value for name in names}
        self._drive.scaling, self._frame = _scaling(values), values['frame']


def _sources(values: Mapping[str, Any]) -> dict[str, Source]:
    """Return {parameter: Source}; raise `SettingsError` with all faults."""
    found: dict[str, Source] = {}
    faults = []
    for name in (*DIRECTIONS, 'dead_man', 'gripper'):
        try:
            found[name] = Source(values[name])
        except ValueError as error:
            faults.append(f'parameter {name}: {error}')
    if faults:
        raise SettingsError(faults)
    return found


def _scaling(values: Mapping[str, Any]) -> Scaling:
    """Return the scaling of the parameters."""
    return Scaling(values['linear_scale'], values['angular_scale'], values['deadband'])


main = partial(run, TeleopNode, NAME)

if __name__ == '__main__':
    sys.exit(main())
