# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Positions that the joints were commanded to, while the robot moves and while it is stopped."""

import math

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.state_checks import motion

# Distance by which joints may move away from the last positions, beyond the smallest one since the
# stop [rad or m]: twenty times a usual noise of 1 mrad.
MOVED_AWAY = 0.02
# Time without measured positions in which a robot has come to rest, and from which it may be
# anywhere [s].
SIGHT_SECONDS = 0.5


class CommandedPositions:
    """
    Last commanded positions, and whether a robot at rest stays with them.

    A drive with a steady error stays at a constant distance from the positions that it holds; a
    robot that something else moves does not.

    Parameters
    ----------
    endless : ndarray (m,) of bool
        Marks joints that turn without end: their measured positions may wrap.

    Attributes
    ----------
    positions : ndarray (m,) or None
        Last commanded positions [rad or m]; None if the robot may be anywhere.

    """

    def __init__(self, endless: NDArray[np.bool_]) -> None:
        self._endless = endless
        self._turns = bool(endless.any())
        self.positions: Array | None = None
        self._last = np.full(len(endless), math.nan)
        # Smallest distances since the last motion, and the last time of a motion or a distance.
        self._closest = np.full(len(endless), math.inf)
        self._seen = -math.inf

    def ahead(self, measured: Array) -> Array:
        """Return the distances (m,) of the commanded from the measured positions."""
        if self.positions is None:
            return np.zeros(len(measured))
        distance = self.positions - measured
        return motion(distance, self._endless) if self._turns else distance

    def near(self, measured: Array) -> Array:
        """Return the commanded positions (m,), in the turns of the measured ones."""
        if self.positions is None or not self._turns:
            return self.start(measured)
        return np.where(self._endless, measured + self.ahead(measured), self.positions)

    def start(self, measured: Array) -> Array:
        """Return the positions (m,) from which a motion goes on, or begins."""
        if self.positions is not None:
            return self.positions
        # A drive may count the turns that measured positions do not show.
        turned = self._last + motion(measured - self._last, self._endless)
        return np.where(self._endless & np.isfinite(turned), turned, measured)

    def move(self, positions: Array, now: float) -> None:
        """Store the positions (m,) of a command in motion, at a time [s]."""
        self.positions = self._last = positions
        self._closest, self._seen = np.full(len(positions), math.inf), now

    def watch(self, measured: Array, now: float) -> None:
        """Forget the positions if a robot at rest has moved away from them."""
        if self.positions is None:
            return
        distance = np.abs(self.ahead(measured))
        if not self.is_seen(now):
            self._closest = np.where(np.isinf(self._closest), 0.0, self._closest)
        self._seen = now
        self._closest = np.minimum(self._closest, distance)
        if (distance > self._closest + MOVED_AWAY).any():
            self.forget()

    def is_seen(self, now: float) -> bool:
        """Return whether the robot was commanded to move, or was watched, a moment ago."""
        return 0.0 <= now - self._seen <= SIGHT_SECONDS

    def lose_sight(self) -> None:
        """Require that the robot is watched before its positions count again."""
        self._seen = -math.inf

    def forget(self) -> None:
        """Forget the positions: the robot may be anywhere."""
        self.positions = None
