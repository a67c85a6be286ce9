# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goal of a tool that follows the poses of a device while a clutch is pressed."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.model.spatial import pose, rotation_from_quaternion, rotation_vector
from tp_controller.tools.teleop.dead_man import DeadManSwitch, TIMEOUT
from tp_controller.tools.teleop.mapping import Array, Source
from tp_controller.tools.teleop.motion import Following, FollowingMotion, Tool

# Names of the streams of a device, and of the poses of the tool.
JOY, SWITCH, POSE, TRANSFORM = 'joy', 'dead_man_topic', 'pose', 'transform'
# Age of the pose of the tool from which it counts as lost [s].
TOOL_SECONDS = 1.0
# Number of final goals at the tool, since a message may get lost, and joints may have to brake.
FINAL_GOALS = 10
WAITING = f'{TIMEOUT}: waiting for the pose of the tool'


class Goal(NamedTuple):
    """Pose T_frame_tool (4, 4) for the tool, in a frame."""

    frame: str
    T: Array


@dataclass(frozen=True)
class Largest:
    """
    Largest distances and angles [m, rad].

    Attributes
    ----------
    step, turn : float
        Between two poses of the device.
    lag, turn_lag : float
        Of the tool from its goal.

    """

    step: float = math.inf
    turn: float = math.inf
    lag: float = math.inf
    turn_lag: float = math.inf


class Clutch:
    """
    Goal of a tool that a device moves.

    A press couples the tool, where it is, to the device, where it is; the device moves the tool
    from there. Opening the clutch, or losing a stream, leaves the tool where it is then.

    Parameters
    ----------
    switch : Source
        Dead-man switch among axes and buttons; without one, a stream of its own brings it.
    following : Following
    largest : Largest
    timeout : float
        Age of the last input of the device from which it counts as lost [s].

    """

    def __init__(self, switch: Source, following: Following, largest: Largest,
                 timeout: float) -> None:
        self._source, self._following, self._largest = switch, following, largest
        self._switch = DeadManSwitch(
            {JOY if switch else SWITCH: timeout, POSE: timeout, TRANSFORM: TOOL_SECONDS})
        # Last T_world_device with its stamp [s], and the last pose of the tool.
        self._device: Array | None = None
        self._stamp = 0.0
        self._tool: Tool | None = None
        self._motion: FollowingMotion | None = None
        self._goals = 0

    @property
    def following(self) -> Following:
        """Return the relation of tool and device."""
        return self._following

    @following.setter
    def following(self, following: Following) -> None:
        """Set another relation, from where both are."""
        self._following = following
        if self._motion is not None and self._device is not None and self._tool is not None:
            self._couple(self._device, self._tool._replace(T=self._motion.goal))

    def take_joy(self, axes: Sequence[float], buttons: Sequence[int], now: float) -> str:
        """Take axes and buttons at a time [s]; see `Drive.take_joy`."""
        if not self._source:
            return ''
        if not np.isfinite(axes).all():
            return 'axes that are not finite'
        self._switch.receive(JOY, now)
        self._press(self._source.pressed(axes, buttons), now)
        missing = self._source.missing(axes)
        return f'{missing} is missing: the device has {len(axes)} axes' if missing else ''

    def take_switch(self, pressed: bool, now: float) -> str:
        """Take the state of the dead-man switch at a time [s]; see `take_pose`."""
        self._switch.receive(SWITCH, now)
        self._press(pressed, now)
        return ''

    def take_pose(self, values: ArrayLike, stamp: float, now: float) -> str:
        """
        Take a pose of the device at a time [s].

        Parameters
        ----------
        values : array_like (7,)
            x, y, z [m] and quaternion xyzw, in the world of the device.
        stamp : float
            Its time [s], by the clock of the device; 0 if unknown.
        now : float
            [s]

        Returns
        -------
        str
            Fault for which the pose is ignored; empty if it is in order.

        """
        found = np.asarray(values, float)
        if not np.isfinite(found).all():
            return 'a pose that is not finite'
        # A clock of the device that was set back counts once the stream is lost.
        if 0.0 < stamp == self._stamp or 0.0 < stamp < self._stamp \
                and self._switch.alive(POSE, now):
            return 'a pose that is not newer than the one before'
        try:
            device = pose(rotation_from_quaternion(found[3:]), found[:3])
        except ValueError as error:
            return str(error)
        before, self._device, self._stamp = self._device, device, stamp
        self._switch.receive(POSE, now)
        if self._switch.closed(now) and before is not None:
            self._open_for(_farther('the device jumped by', before, device,
                                    self._largest.step, self._largest.turn))
        if self._motion is not None and self._switch.closed(now):
            self._motion.follow(device)
        return ''

    def take_tool(self, reference: str, frame: str, values: ArrayLike, now: float) -> str:
        """Take the pose (7,) of the frame of the task in its reference; see `take_pose`."""
        found = np.asarray(values, float)
        try:
            tool = Tool(reference, frame, pose(rotation_from_quaternion(found[3:]), found[:3]))
        except ValueError as error:
            return str(error)
        before, self._tool = self._tool, tool
        self._switch.receive(TRANSFORM, now)
        if not self._switch.closed(now) or self._device is None:
            return ''
        if self._motion is None:
            self._couple(self._device, tool)
        elif before is not None and before[:2] != tool[:2]:
            self._open_for('the task moves another frame')
        else:
            self._open_for(_farther('the tool is behind by', self._motion.goal, tool.T,
                                    self._largest.lag, self._largest.turn_lag))
        return ''

    def command(self, now: float) -> Goal | None:
        """Return the goal to send at a time [s]; None for none."""
        if self._switch.closed(now) and self._motion is not None and self._tool is not None:
            self._goals = FINAL_GOALS
            return Goal(self._tool.reference, self._motion.goal)
        if not self._switch.closed(now):
            self._motion = None
        if not self._goals:
            return None
        self._goals -= 1
        return self.rest()

    def rest(self) -> Goal | None:
        """Return the goal to stay: the tool in its own frame, as it is at the receipt."""
        return None if self._tool is None else Goal(self._tool.frame, np.eye(4))

    def closed(self, now: float) -> bool:
        """Return whether the device moves the tool at a time [s]."""
        return self._switch.closed(now) and self._motion is not None

    def reason(self, now: float) -> str:
        """Return the reason for which nothing moves at a time [s]; empty if the device may."""
        return self._switch.reason(now) or ('' if self._motion is not None else WAITING)

    def _press(self, pressed: bool, now: float) -> None:
        """Take the state of the switch; what moves the tool already ends with a press."""
        closed = self._switch.closed(now)
        self._switch.press(pressed, now)
        if self._switch.closed(now) and not closed:
            self._motion, self._goals = None, FINAL_GOALS

    def _couple(self, device: Array, tool: Tool) -> None:
        """Couple the tool to the device."""
        try:
            self._motion = FollowingMotion(self._following, device, tool)
        except ValueError as error:
            self._open_for(str(error))

    def _open_for(self, reason: str) -> None:
        """Open the clutch for a reason, if there is one."""
        if reason:
            self._switch.open_for(reason)
            self._motion = None


def _farther(what: str, one: Array, other: Array, most: float, most_turn: float) -> str:
    """Return a reason if two poses are farther apart than they may be."""
    distance = float(np.linalg.norm(other[:3, 3] - one[:3, 3]))
    if distance > most:
        return f'{what} {distance:.2f} m'
    angle = float(np.linalg.norm(rotation_vector(one[:3, :3].T.dot(other[:3, :3]))))
    return f'{what} {angle:.2f} rad' if angle > most_turn else ''
