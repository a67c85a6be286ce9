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
from tp_controller.tools.teleop.mapping import DIRECTIONS, Scaling, Source

# {key: (direction, sign)}
KEYS = {'w': ('x', 1.0), 's': ('x', -1.0), 'a': ('y', 1.0), 'd': ('y', -1.0),
        'r': ('z', 1.0), 'f': ('z', -1.0), 'u': ('rx', 1.0), 'o': ('rx', -1.0),
        'i': ('ry', 1.0), 'k': ('ry', -1.0), 'j': ('rz', 1.0), 'l': ('rz', -1.0)}
STOP_KEY, FASTER, SLOWER, QUIT = ' ', '+', '-', 'q'
HELP = """move   w/s x   a/d y   r/f z      turn   u/o about x   i/k about y   j/l about z
space stop     +/- faster, slower     q or Ctrl-C end     hold a key to go on moving"""
# Time that a key moves [s]: terminals repeat a key every 30 to 40 ms, and do not tell its end.
KEY_SECONDS = 0.15
# Time to full speed [s], so that a short press is a small step.
RAMP_SECONDS = 0.3
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
    linear, angular : float
        Speeds of the keys [m/s, rad/s].

    Attributes
    ----------
    drive : Drive
        Twist that the keys command.

    """

    def __init__(self, linear: float, angular: float) -> None:
        sources = {name: Source(f'axis {index}') for index, name in enumerate(DIRECTIONS)}
        self._first = Scaling(linear, angular, 0.0)
        self._factor = 1.0
        self.drive = Drive(sources, Source(''), self._first, KEY_SECONDS, RAMP_SECONDS,
                           rest_first=False)

    def press(self, key: str, now: float) -> bool:
        """Take a key at a time [s]; return False if it ends the command."""
        if key in KEYS:
            direction, sign = KEYS[key]
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
        return key != QUIT


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
