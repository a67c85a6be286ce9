# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The teleop node: drives a task of a controller with a gamepad, a 6-DoF mouse or poses."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
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
from tp_controller.tools.teleop.mapping import DIRECTIONS, Source
from tp_controller.tools.teleop.pose_device import PoseDevice
from tp_controller.tools.teleop.twist_device import TwistDevice

NAME = 'tp_teleop'
# Period of the status, and of a warning that repeats [s].
STATUS_PERIOD, WARNING_SECONDS = 0.1, 5.0
# Timeout of the acknowledgement of the last zeros when the node ends [s].
ACKNOWLEDGEMENT_SECONDS = 0.5


class TeleopNode(ClosableNode):
    """Node that turns messages of a device into twists or goals of a task."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        values = declare(self, PARAMETERS)
        sources = _sources(values)
        self._gripper_source = sources['gripper']
        self._gripped: bool | None = None
        self._state = ''
        kind = PoseDevice if values['pose_topic'] else TwistDevice
        self._device: PoseDevice | TwistDevice = kind(self, values, sources, self._take)
        self._connect(values)
        keep_fixed(self)
        accept_numbers(self)
        self.add_post_set_parameters_callback(self._on_parameters)
        warn_unknown(self)
        self.get_logger().info(f'driving {self._device.out.topic_name}')

    def close(self, reason: str) -> None:
        """Stop the task: a courtesy, as nothing does if the node is killed."""
        if self._device.drive.closed(time.monotonic()):
            self._device.rest()
            self._device.out.wait_for_all_acked(Duration(seconds=ACKNOWLEDGEMENT_SECONDS))

    def _connect(self, values: Mapping[str, Any]) -> None:
        """Create publishers, the subscription to axes and buttons, and timers."""
        self._status = self.create_publisher(DiagnosticArray, '~/status', 10)
        self._gripper = self.create_publisher(Bool, '~/gripper', 10) \
            if self._gripper_source else None
        AdaptiveSubscription(self, Joy, values['joy_topic'], self._on_joy)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, callback in ((1.0 / values['rate'], self._cycle),
                                 (STATUS_PERIOD, self._publish_status)):
            self.create_timer(period, callback, clock=steady)

    def _on_joy(self, message: Joy) -> None:
        """Take axes and buttons."""
        self._take('joy', lambda now: self._device.drive.take_joy(
            message.axes, message.buttons, now))
        self._pass_gripper(message)

    def _take(self, stream: str, take: Callable[[float], str]) -> None:
        """Take an input; stop at once where it opens the dead-man switch."""
        drive, now = self._device.drive, time.monotonic()
        moved = drive.closed(now)
        self._warn(stream, take(now))
        if moved and not drive.closed(now):
            self._cycle()

    def _pass_gripper(self, message: Joy) -> None:
        """Publish the state of the gripper button where it has changed."""
        pressed = self._gripper_source.pressed(message.axes, message.buttons)
        if self._gripper is not None and pressed != self._gripped:
            self._gripped = pressed
            self._gripper.publish(Bool(data=pressed))

    def _cycle(self) -> None:
        """Send the command of a cycle, if there is one."""
        self._device.cycle(time.monotonic())
        if self._text() != self._state:
            self._publish_status()

    def _text(self) -> str:
        """Return the state: driving, or the reason for which nothing moves."""
        out = self._device.out
        if not out.get_subscription_count():
            return f'no listener on {out.topic_name}'
        return self._device.drive.reason(time.monotonic()) or 'driving'

    def _publish_status(self) -> None:
        """Publish the state, and log it where it has changed."""
        text = self._text()
        if text != self._state:
            self.get_logger().info(text)
            self._state = text
        name = self.get_fully_qualified_name().strip('/')
        fine = self._device.drive.closed(time.monotonic()) and text == 'driving'
        array = DiagnosticArray(status=[DiagnosticStatus(
            name=name, hardware_id=name, message=text,
            level=DiagnosticStatus.OK if fine else DiagnosticStatus.WARN,
            values=[KeyValue(key='topic', value=self._device.out.topic_name)])])
        array.header.stamp = self.get_clock().now().to_msg()
        self._status.publish(array)

    def _warn(self, stream: str, fault: str) -> None:
        """Log the fault of an input, if there is one."""
        if fault:
            self.get_logger().warning(f'{stream}: {fault}',
                                      throttle_duration_sec=WARNING_SECONDS)

    def _on_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Apply another scale, deadband or frame."""
        self._device.apply({spec.name: self.get_parameter(spec.name).value
                            for spec in PARAMETERS})


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


main = partial(run, TeleopNode, NAME)

if __name__ == '__main__':
    sys.exit(main())
