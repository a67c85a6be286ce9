# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Motion of a tool that follows the motion of a device."""

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np
from tp_controller.model.spatial import (
    pose,
    rotation_from_quaternion,
    rotation_from_vector,
    rotation_vector,
)
from tp_controller.tools.teleop.mapping import Array

# Axes of a device, by name.
AXES = {f'{sign}{name}': float(f'{sign}1') * axis
        for name, axis in zip('xyz', np.eye(3)) for sign in ('', '-')}
# Share of a forward axis that has to be level, so that a heading can be measured.
LEVEL = 0.3
# Rotation that is scaled as a whole [rad]: after it a new one begins, far from half a turn, where
# its axis is unknown.
WHOLE_TURN = 0.5 * math.pi


class Tool(NamedTuple):
    """Pose of a tool: T_reference_frame (4, 4), and the names of both frames."""

    reference: str
    frame: str
    T: Array


@dataclass(frozen=True)
class Following:
    """
    Relation of the motion of a tool to that of a device.

    Attributes
    ----------
    linear, angular : float
        Motion of the tool per motion of the device; angle of the tool per angle of the device.
    linear_deadband, angular_deadband : float
        Motion of the device that moves nothing, after every change of direction [m, rad].
    quat_xyzw : tuple of float
        Rotation of vectors of the device's world to the axes along which the tool moves.
    forward : str
        Axis of the device that is forward (x, level) at the press; empty for the rotation alone.
    frame : str
        Frame with these axes: that of the tool, at the press, or its reference (or empty).

    """

    linear: float = 1.0
    angular: float = 1.0
    linear_deadband: float = 0.0
    angular_deadband: float = 0.0
    quat_xyzw: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    forward: str = ''
    frame: str = ''

    def axes(self, device: Array, tool: Tool) -> Array:
        """
        Return R_reference_world, of the world of the device, at a press.

        Parameters
        ----------
        device : ndarray (4, 4)
            T_world_device.
        tool : Tool
            Pose of the tool.

        Raises
        ------
        ValueError
            The forward axis is upright, or the frame is another one.

        """
        if self.frame not in ('', tool.reference, tool.frame):
            raise ValueError(f'frame {self.frame!r} is neither {tool.frame!r}, which the task '
                             f'moves, nor its reference {tool.reference!r}')
        R = rotation_from_quaternion(self.quat_xyzw)
        if self.forward:
            x, y, _ = R.dot(device[:3, :3]).dot(AXES[self.forward])
            if math.hypot(x, y) < LEVEL:
                raise ValueError(f'forward is unknown: {self.forward} of the device is upright')
            R = rotation_from_vector([0.0, 0.0, -math.atan2(y, x)]).dot(R)
        return tool.T[:3, :3].dot(R) if self.frame == tool.frame else R


class FollowingMotion:
    """
    Motion of a tool from a press on.

    Parameters
    ----------
    following : Following
    device : ndarray (4, 4)
        T_world_device at the press.
    tool : Tool
        Pose of the tool at the press.

    Attributes
    ----------
    goal : ndarray (4, 4)
        T_reference_tool to move to.

    Raises
    ------
    ValueError
        See `Following.axes`.

    """

    def __init__(self, following: Following, device: Array, tool: Tool) -> None:
        self._following, self._axes = following, following.axes(device, tool)
        # Pose of the device without the motions within the deadband.
        self._place, self._R = device[:3, 3], device[:3, :3]
        # Places and rotations of device and tool from which motion is measured.
        self._from_place, self._from_R = self._place, self._R
        self._tool_place, self._tool_R = tool.T[:3, 3], tool.T[:3, :3]
        self.goal = tool.T

    def follow(self, device: Array) -> None:
        """Move the goal with the device, to its pose T_world_device."""
        following, axes = self._following, self._axes
        self._place = self._place + beyond(device[:3, 3] - self._place, following.linear_deadband)
        step = rotation_vector(device[:3, :3].dot(self._R.T))
        self._R = rotation_from_vector(beyond(step, following.angular_deadband)).dot(self._R)
        shift = following.linear * axes.dot(self._place - self._from_place)
        turn = rotation_vector(self._R.dot(self._from_R.T))
        R = rotation_from_vector(following.angular * axes.dot(turn)).dot(self._tool_R)
        self.goal = pose(R, self._tool_place + shift)
        if turn.dot(turn) > WHOLE_TURN ** 2:
            self._from_R, self._tool_R = self._R, R


def beyond(vector: Array, deadband: float) -> Array:
    """Return the part of a vector (3,) that is longer than a deadband."""
    length = math.sqrt(vector.dot(vector))
    return vector * (1.0 - deadband / length) if length > deadband else np.zeros(3)
