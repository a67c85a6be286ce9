# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of a terminal as the axes of a device."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
import os
import select
import signal
import termios
import tty

import numpy as np
from tp_controller.errors import TpControllerError
from tp_controller.tools.teleop.drive import Drive
from tp_controller.tools.teleop.key_map import FASTER, KeyMap, QUIT, SLOWER, STOP_KEY
from tp_controller.tools.teleop.mapping import DIRECTIONS, Scaling, Source

# Factor of a change of speed, and the largest factor of all changes together.
SPEED_STEP, MOST_SPEED = 1.25, 10.0
# Signals that end a command as Ctrl-C does, so that the terminal is restored.
ENDING = (signal.SIGTERM, signal.SIGHUP)
# Longest input that is read at once [bytes].
LONGEST_INPUT = 64


class Keyboard:
    """
    Keyboard as a device.

    Parameters
    ----------
    key_map : KeyMap

    Attributes
    ----------
    drive : Drive
        Twist that the keys command.

    """

    def __init__(self, key_map: KeyMap) -> None:
        sources = {name: Source(f'axis {index}') for index, name in enumerate(DIRECTIONS)}
        self._first = Scaling(key_map.linear, key_map.angular, 0.0)
        self._keys, self._factor = key_map.keys, 1.0
        self.drive = Drive(sources, Source(''), self._first, key_map.seconds, key_map.ramp,
                           rest_first=False)

    def press(self, key: str, now: float) -> bool:
        """Take a key at a time [s]; return False if it ends the command."""
        if key in self._keys:
            direction, sign = self._keys[key]
            axes = np.zeros(len(DIRECTIONS))
            axes[DIRECTIONS.index(direction)] = sign
            self.drive.take_joy(axes.tolist(), (), now)
        elif key == STOP_KEY:
            self.drive.take_joy([0.0] * len(DIRECTIONS), (), now)
        elif key in (FASTER, SLOWER):
            factor = self._factor * (SPEED_STEP if key == FASTER else 1.0 / SPEED_STEP)
            self._factor = min(factor, MOST_SPEED)
            self.drive.scaling = replace(self._first, linear=self._first.linear * self._factor,
                                         angular=self._first.angular * self._factor)
        return key in self._keys or key != QUIT


@contextmanager
def keys_of(descriptor: int) -> Iterator[None]:
    """
    Read a terminal key by key, without echo, until the block ends; then restore it.

    Raises
    ------
    TpControllerError
        It is not a terminal.

    """
    if not os.isatty(descriptor):
        raise TpControllerError('the keys of a terminal are needed, and standard input is not one')
    settings = termios.tcgetattr(descriptor)
    before = {number: signal.signal(number, signal.default_int_handler) for number in ENDING}
    try:
        tty.setcbreak(descriptor)
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, settings)
        for number, handler in before.items():
            signal.signal(number, handler)


def read_keys(descriptor: int, seconds: float) -> str | None:
    """Return the keys that are pressed within a time [s]; None if the terminal is gone."""
    ready, _, _ = select.select([descriptor], [], [], seconds)
    if not ready:
        return ''
    try:
        found = os.read(descriptor, LONGEST_INPUT)
    except OSError:
        return None
    return found.decode(errors='replace') if found else None
