# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Motion of the robot: joint ranges, and the state at regular moments."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from tp_controller.model.spatial import Array, pose, rotation_from_quaternion
from tp_controller.tools.recording.mcap import Raw

# Interval of recorded moments [s], and their largest number.
FRAME_SECONDS, MOST_FRAMES = 0.04, 1500
# Share of the interval after which the next moment is recorded, as messages may be early.
EARLY = 0.9
# Bounds of the memory for any recording: largest numbers of joints and of distinct lists of joint
# names, and largest size of all markers [bytes].
MOST_JOINTS, MOST_NAME_LISTS, MOST_MARKER_BYTES = 300, 30, 1 << 26


@dataclass
class Moment:
    """
    Recorded state at one time.

    Attributes
    ----------
    time : float
        [s]
    joints : dict
        {joint: position [rad or m]}
    base : (str, str, ndarray (4, 4)) or None
        Frame, child frame and pose of the odometry.
    markers : Raw or None
        Markers of the tasks, not decoded.

    """

    time: float
    joints: Mapping[str, float]
    base: tuple[str, str, Array] | None
    markers: Raw | None


class Motion:
    """
    Motion of one robot.

    Attributes
    ----------
    moments : list of Moment
        Moments in order of time.
    ranges : dict
        {joint: (smallest, largest) position [rad or m]}

    """

    def __init__(self) -> None:
        self.moments: list[Moment] = []
        self._extremes: dict[tuple[str, ...], tuple[Array, Array]] = {}
        self._joints: dict[str, float] = {}
        self._base: tuple[str, str, Array] | None = None
        self._markers: Raw | None = None
        self._period = FRAME_SECONDS
        self._marker_bytes = 0

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return {joint: (smallest, largest) position [rad or m]}."""
        found: dict[str, tuple[float, float]] = {}
        for names, (low, high) in self._extremes.items():
            for name, least, most in zip(names, low.tolist(), high.tolist()):
                before = found.get(name, (math.inf, -math.inf))
                found[name] = min(before[0], least), max(before[1], most)
        return found

    def add_joints(self, time: float, message: Any) -> None:
        """Process joint states; record a moment if it is due."""
        names, positions = tuple(message.name), message.position
        if len(names) != len(positions) or len(self._joints.keys() | set(names)) > MOST_JOINTS:
            return
        if names not in self._extremes:
            if len(self._extremes) >= MOST_NAME_LISTS:
                return
            self._extremes[names] = positions.copy(), positions.copy()
        low, high = self._extremes[names]
        np.minimum(low, positions, out=low)
        np.maximum(high, positions, out=high)
        if self.moments and time - self.moments[-1].time < EARLY * self._period:
            return
        self._joints.update(zip(names, positions.tolist()))
        if self._markers is not None and (
                not self.moments or self.moments[-1].markers is not self._markers):
            self._marker_bytes += len(self._markers.data)
        self.moments.append(Moment(time, dict(self._joints), self._base, self._markers))
        if len(self.moments) >= 2 * MOST_FRAMES or (
                self._marker_bytes > MOST_MARKER_BYTES and len(self.moments) > 1):
            self._halve_moments()

    def set_base(self, message: Any) -> None:
        """Process the pose of a base."""
        point, turn = message.pose.pose.position, message.pose.pose.orientation
        T = pose(rotation_from_quaternion((turn.x, turn.y, turn.z, turn.w)),
                 (point.x, point.y, point.z))
        self._base = message.header.frame_id, message.child_frame_id, T

    def set_markers(self, raw: Raw) -> None:
        """Set the markers of the tasks for the following moments."""
        self._markers = raw

    def _halve_moments(self) -> None:
        """Drop every second moment, and double the interval."""
        self.moments = self.moments[::2]
        self._period *= 2.0
        self._marker_bytes = sum(len(raw.data) for raw in {
            id(moment.markers): moment.markers for moment in self.moments}.values() if raw)
