# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Twist that a device commands, cycle by cycle."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.tools.teleop.dead_man import DeadManSwitch, DEFLECTION, SWITCH
from tp_controller.tools.teleop.mapping import Array, DIRECTIONS, Scaling, Source

# Names of the streams of a device.
JOY, TWIST = 'joy', 'twist'
# Number of final zeros, since a message may get lost.
FINAL_ZEROS = 3


class Drive:
    """
    Twist of a device.

    Parameters
    ----------
    sources : mapping
        {direction of `DIRECTIONS`: Source} of the deflections; without one, a stream of twists
        brings them.
    dead_man : Source
        Dead-man switch; without one, a deflection beyond the deadband counts as pressed.
    scaling : Scaling
    timeout, ramp : float
        See `DeadManSwitch` [s].
    unitless : bool
        Twists of the stream are deflections, not velocities.
    rest_first : bool
        See `open_first` of `DeadManSwitch`.

    Attributes
    ----------
    scaling : Scaling
        May be replaced at any time.

    """

    def __init__(self, sources: Mapping[str, Source], dead_man: Source, scaling: Scaling,
                 timeout: float, ramp: float, unitless: bool = True,
                 rest_first: bool = True) -> None:
        self._sources = [sources.get(name, Source('')) for name in DIRECTIONS]
        self._joy_drives = any(self._sources)
        self._dead_man, self.scaling, self._unitless = dead_man, scaling, unitless
        streams = [JOY] * bool(self._joy_drives or dead_man) + [TWIST] * (not self._joy_drives)
        self._switch = DeadManSwitch(dict.fromkeys(streams, timeout), ramp, rest_first,
                                     SWITCH if dead_man else DEFLECTION)
        self._deflection = np.zeros(6)
        self._zeros = 0

    def take_joy(self, axes: Sequence[float], buttons: Sequence[int], now: float) -> str:
        """
        Take the axes and buttons of a device at a time [s].

        Returns
        -------
        str
            Fault for which they are ignored, or a warning; empty if they are in order.

        """
        if not np.isfinite(axes).all():
            return 'axes that are not finite'
        self._switch.receive(JOY, now)
        if self._joy_drives:
            self._deflection = np.array([source.value(axes, buttons) for source in self._sources])
        if self._dead_man:
            self._switch.press(self._dead_man.pressed(axes, buttons), now)
        elif self._joy_drives:
            self._press_by_deflection(now)
        missing = next(filter(None, (source.missing(axes)
                                     for source in (*self._sources, self._dead_man))), '')
        return f'{missing} is missing: the device has {len(axes)} axes' if missing else ''

    def take_twist(self, twist: ArrayLike, now: float) -> str:
        """Take a twist (6,) of the stream at a time [s]; see `take_joy`."""
        if not np.isfinite(twist).all():
            return 'a twist that is not finite'
        self._switch.receive(TWIST, now)
        self._deflection = np.asarray(twist, float)
        if not self._dead_man:
            self._press_by_deflection(now)
        return ''

    def command(self, now: float) -> Array | None:
        """Return the twist (6,) [m/s, rad/s] to send at a time [s]; None for none."""
        if self._switch.closed(now):
            self._zeros = FINAL_ZEROS
            return self._switch.share(now) * self._twist()
        if not self._zeros:
            return None
        self._zeros -= 1
        return self.rest()

    def rest(self) -> Array:
        """Return the twist (6,) to stay."""
        return np.zeros(6)

    def closed(self, now: float) -> bool:
        """Return whether the device moves the robot at a time [s]."""
        return self._switch.closed(now)

    def reason(self, now: float) -> str:
        """Return the reason for which nothing moves at a time [s]; empty if the device may."""
        return self._switch.reason(now)

    def _twist(self) -> Array:
        """Return the twist of the last input at full share."""
        scaled = self._unitless or self._joy_drives
        return self.scaling.twist(self._deflection) if scaled else self._deflection

    def _press_by_deflection(self, now: float) -> None:
        """Take a deflection beyond the deadband for a pressed switch."""
        self._switch.press(bool(self._twist().any()), now)
