# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Device whose poses drive a task of the type pose."""

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Bool
from tp_controller.errors import GoalError, SettingsError
from tp_controller.ros.adaptive_subscription import AdaptiveSubscription
from tp_controller.tasks.keys import finite_vector
from tp_controller.tasks.orientation import valid_rotation
from tp_controller.tools.teleop.clutch import Clutch, Goal, Largest
from tp_controller.tools.teleop.mapping import Source
from tp_controller.tools.teleop.messages import goal_message, pose_values
from tp_controller.tools.teleop.motion import AXES, Following
from tp_controller.tools.teleop.twist_device import Take

TYPES = {kind.__name__: kind for kind in (PoseStamped, Odometry)}


class PoseDevice:
    """
    Device that a tool follows; parameters and attributes are those of `TwistDevice`.

    Attributes
    ----------
    drive : Clutch

    """

    def __init__(self, node: Node, values: Mapping[str, Any], sources: Mapping[str, Source],
                 take: Take) -> None:
        self._node, self._take = node, take
        faults = _faults(values)
        if faults:
            raise SettingsError(faults)
        largest = Largest(*(values[f'pose_largest_{name}']
                            for name in ('step', 'turn', 'lag', 'turn_lag')))
        self.drive = Clutch(sources['dead_man'], _following(values), largest, values['timeout'])
        task = f'/{values["controller"].strip("/")}/{values["task"]}'
        self.out = node.create_publisher(PoseStamped, f'{task}/goal', 10)
        AdaptiveSubscription(node, TransformStamped, f'{task}/transform', self._on_transform)
        AdaptiveSubscription(node, TYPES[values['pose_type']], values['pose_topic'], self._on_pose)
        if values['dead_man_topic']:
            AdaptiveSubscription(node, Bool, values['dead_man_topic'], self._on_switch)

    def cycle(self, now: float) -> None:
        """Send the goal of a cycle at a time [s], if there is one."""
        self._send(self.drive.command(now))

    def rest(self) -> None:
        """Send the goal to stay."""
        self._send(self.drive.rest())

    def apply(self, values: Mapping[str, Any]) -> None:
        """Apply another scale, deadband or frame, without a jump."""
        following = _following(values)
        if following != self.drive.following:
            self.drive.following = following

    def _on_pose(self, message: PoseStamped | Odometry) -> None:
        """Take a pose of the device."""
        pose = message.pose.pose if isinstance(message, Odometry) else message.pose
        stamp = 1e-9 * Time.from_msg(message.header.stamp).nanoseconds
        self._take('pose', lambda now: self.drive.take_pose(pose_values(pose), stamp, now))

    def _on_switch(self, message: Bool) -> None:
        """Take the state of the dead-man switch."""
        self._take('dead_man_topic', lambda now: self.drive.take_switch(message.data, now))

    def _on_transform(self, message: TransformStamped) -> None:
        """Take the pose of the tool."""
        self._take('transform', lambda now: self.drive.take_tool(
            message.header.frame_id, message.child_frame_id, pose_values(message.transform), now))

    def _send(self, goal: Goal | None) -> None:
        """Publish a goal for the task, if there is one."""
        if goal is not None:
            message = goal_message(goal)
            message.header.stamp = self._node.get_clock().now().to_msg()
            self.out.publish(message)


def _faults(values: Mapping[str, Any]) -> list[str]:
    """Return the faults of the parameters."""
    faults = []
    if values['pose_type'] not in TYPES:
        faults.append(f'parameter pose_type: {values["pose_type"]!r} is not '
                      f'{" or ".join(TYPES)}')
    if bool(values['dead_man']) == bool(values['dead_man_topic']):
        faults.append('pose_topic needs one of the parameters dead_man and dead_man_topic')
    if values['pose_forward'] not in ('', *AXES):
        faults.append(f'parameter pose_forward: {values["pose_forward"]!r} is not one of '
                      f'{", ".join(AXES)}')
    try:
        valid_rotation(finite_vector(values['pose_axes'], 4, 'parameter pose_axes'),
                       'parameter pose_axes')
    except GoalError as error:
        faults.append(str(error))
    return faults


def _following(values: Mapping[str, Any]) -> Following:
    """Return the relation of tool and device, by the parameters."""
    return Following(
        values['pose_scale'], values['pose_turn_scale'], values['pose_deadband'],
        values['pose_turn_deadband'], tuple(values['pose_axes']), values['pose_forward'],
        values['frame'])
