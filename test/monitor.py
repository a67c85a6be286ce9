# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""A monitor of a robot: hears every command and every position, and keeps what must not be."""

from dataclasses import dataclass
import math

import numpy as np


@dataclass(frozen=True)
class Promise:
    """
    What is promised about commands.

    Attributes
    ----------
    velocity, acceleration : ndarray (n,)
        Limits [rad/s or m/s, per s]; infinite where there are none.
    lower, upper : ndarray (n,)
        Position limits [rad or m].
    period : float
        Longest time that an acceleration counts for [s].
    timeout : float
        Age of the joint states from which zeros are commanded [s].
    beyond : float
        By how much the true robot may pass a position limit [rad or m].
    lead : float
        Time by which commanded positions may lead, besides their stopping distance [s].

    """

    velocity: np.ndarray
    acceleration: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    period: float
    timeout: float
    beyond: float = 1e-3
    lead: float = 0.2


def promise_of(robot, period, timeout, beyond=1e-3):
    """Return what is promised about the joints of a robot."""
    rows = robot.joint_columns
    return Promise(robot.velocity[rows], robot.acceleration[rows], robot.lower[rows],
                   robot.upper[rows], period, timeout, beyond)


class Monitor:
    """
    Keeps all commands and positions with their times, and finds what breaks a promise.

    Attributes
    ----------
    commands : list of (float, ndarray, int)
        Time [s], velocities, and how many commands were sent since the one before; more than one
        where some were not heard.
    positions : list of (float, ndarray)
        Time [s], and where the robot truly is.
    heard : list of float
        When joint states were sent that may be believed [s].

    """

    def __init__(self):
        self.commands, self.positions, self.heard = [], [], []

    def command(self, time, velocity, sent=1):
        """Take a command."""
        self.commands.append((time, np.array(velocity, dtype=float), sent))

    def position(self, time, q):
        """Take where the robot truly is."""
        self.positions.append((time, np.array(q, dtype=float)))

    def faults(self, promise, late=0.0):
        """
        Return a sentence for each promise that was broken, the first ones.

        Parameters
        ----------
        promise : Promise
            What is promised.
        late : float
            By how much a message may be late on its way [s].

        """
        found = [*self._wrong_numbers(promise), *self._jumps(promise),
                 *self._passed(promise), *self._blind(promise, late)]
        return found[:5]

    def _wrong_numbers(self, promise):
        """Yield commands that are not finite or beyond a velocity limit."""
        for time, velocity, _ in self.commands:
            if len(velocity) != len(promise.velocity):
                yield f'{time:.3f} s: {len(velocity)} velocities'
            elif not np.isfinite(velocity).all():
                yield f'{time:.3f} s: not finite: {velocity}'
            elif (np.abs(velocity) > promise.velocity * (1.0 + 1e-9)).any():
                yield f'{time:.3f} s: beyond the velocity limit: {velocity}'

    def _jumps(self, promise):
        """Yield commands that differ more from the one before than accelerations allow."""
        for (_, before, _), (time, velocity, sent) in zip(self.commands, self.commands[1:]):
            allowed = promise.acceleration * promise.period * sent
            if velocity.any() and (np.abs(velocity - before) > allowed + 1e-9).any():
                yield f'{time:.3f} s: beyond the acceleration limit: {before} to {velocity}'

    def _passed(self, promise):
        """Yield where the robot was beyond a position limit that it had been within."""
        if not self.positions:
            return
        times, q = (np.array(each) for each in zip(*self.positions))
        beyond = np.maximum(q - promise.upper, promise.lower - q)
        inside = np.logical_or.accumulate(beyond <= 0.0)
        for row, joint in np.argwhere(inside & (beyond > promise.beyond))[:1]:
            yield (f'{times[row]:.3f} s: joint {joint} was {beyond[row, joint]:.3g} beyond its '
                   f'limit, {beyond[:, joint].max():.3g} at most')

    def _blind(self, promise, late):
        """Yield commands that move the robot although its joint states are too old."""
        # Before the first one nobody knows what others have heard.
        heard = np.array([math.inf, *self.heard])
        heard[0] = heard[1:].min(initial=math.inf)
        for time, velocity, _ in self.commands:
            age = time - heard[max(np.searchsorted(heard, time, side='right') - 1, 0)]
            if velocity.any() and age > promise.timeout + late:
                yield f'{time:.3f} s: motion {age:.3f} s after the last joint state'


class PositionMonitor(Monitor):
    """
    The same for commanded positions, whose differences are the velocities.

    Stops have to keep the acceleration limits, too.

    Attributes
    ----------
    targets : list of (float, ndarray, ndarray)
        Time [s], commanded positions, and where the robot truly was.

    """

    # Time without a command after which the robot has stopped at the last one [s].
    PAUSE = 0.0301

    def __init__(self):
        super().__init__()
        self.targets = []

    def positions_command(self, time, positions, q):
        """Take commanded positions, and where the robot truly is."""
        before = self.targets[-1] if self.targets else (time, positions, q)
        passed = time - before[0]
        velocity = (positions - before[1]) / passed if passed > 0.0 else 0.0 * positions
        self.targets.append((time, np.array(positions), np.array(q)))
        if passed > 0.0:
            self.command(time, velocity)

    def _wrong_numbers(self, promise):
        """Yield commands that are not finite, too fast, or beyond a position limit or the lead."""
        yield from super()._wrong_numbers(promise)
        stop = promise.velocity ** 2 / (2.0 * promise.acceleration) \
            + 0.05 * promise.velocity + 2.0 * promise.velocity * promise.period
        largest = promise.lead * promise.velocity + 0.02 + stop
        beyond = -np.inf
        for time, positions, q in self.targets:
            before, beyond = beyond, np.maximum(positions - promise.upper,
                                                promise.lower - positions)
            if ((beyond > 1e-9) & (beyond > before + 1e-9)).any():
                yield f'{time:.3f} s: beyond a position limit by {beyond.max():.3g}'
            if (np.abs(positions - q) > largest).any():
                yield f'{time:.3f} s: ahead of the robot by {positions - q}'

    def _jumps(self, promise):
        """Yield changes of the velocity of commanded positions that are too fast."""
        # The last two times between commands; the last one of a stop may be longer.
        usual = 0.0, 0.0
        for (began, before, _), (time, velocity, _) in zip(self.commands, self.commands[1:]):
            passed, longest = time - began, max(self.PAUSE, 3.0 * min(usual))
            usual = usual[1], passed
            allowed = promise.acceleration * passed
            if passed <= longest \
                    and (np.abs(velocity - before) > allowed * (1.0 + 1e-6) + 1e-9).any():
                yield f'{time:.3f} s: beyond the acceleration limit: {before} to {velocity}'

    def _blind(self, promise, late):
        """Yield commands that move the robot without joint states, after the time of a stop."""
        stop = float((promise.velocity / promise.acceleration).max())
        yield from super()._blind(promise, late + stop)
