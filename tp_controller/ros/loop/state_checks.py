# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Plausibility checks of joint states and odometry: jumps, limits, following.

The checks return faults as text. An implausible message is dropped; the consequence for the robot
is decided in `tp_controller.ros.loop.stop_reasons`.
"""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, wrap_angle

# Time for which a contradiction, or a dropped message, counts as lasting [s].
LASTING_SECONDS = 1.0
# Longest step between two cycles, relative to the window in which a robot has to follow [1]; a
# longer one is a step of the clock. A robot at rest for as long still counts as following.
LARGEST_CLOCK_STEP = 0.5


def motion(change: Array, endless: NDArray[np.bool_]) -> Array:
    """Return changes of positions (…, n) as motion: joints that turn without end may wrap."""
    return np.where(endless, wrap_angle(change), change)


class Dropped:
    """Fault of the last dropped message."""

    def __init__(self) -> None:
        self._fault, self._at = '', -math.inf

    def note(self, fault: str, now: float) -> None:
        """Store the fault of a message at a time [s]; ignore an empty one."""
        if fault:
            self._fault, self._at = fault, now

    def remark(self, now: float, timeout: float) -> str:
        """
        Return the fault in brackets if it is at most `timeout` seconds old, or an empty string.

        It is shown for at least `LASTING_SECONDS`, so that rare messages do not make it flicker.
        """
        recent = now - self._at <= max(timeout, LASTING_SECONDS)
        return f' (ignored: {self._fault})' if recent else ''


class Contradicting:
    """
    Base class of checks that detect contradictory positions.

    Attributes
    ----------
    contradiction : str
        First contradiction since `forget`, or empty.

    """

    def __init__(self) -> None:
        self.contradiction, self._contradicted = '', -math.inf

    def forget(self) -> None:
        """Clear the contradiction."""
        self.contradiction = ''

    def lasting(self, now: float) -> str:
        """Return the contradiction detected within the last second, if any."""
        return self.contradiction if now - self._contradicted < LASTING_SECONDS else ''

    def _contradict(self, what: str, now: float) -> None:
        """Record a contradiction; the first one is reported."""
        self.contradiction, self._contradicted = self.contradiction or what, now


class History:
    """
    Earlier reference positions that reveal slow drift.

    Consecutive messages may each deviate by the whole allowance. Compared with a position that
    is up to `age` seconds old, they may do so only once in that time.

    Parameters
    ----------
    age : float
        Age at which a reference is replaced [s].

    Attributes
    ----------
    due : float
        Time at which the reference is replaced [s].
    positions : ndarray or None
        Positions of the reference; None before the first.
    measured : ndarray or float
        Times of the measurements [s].

    """

    def __init__(self, age: float) -> None:
        self._age, self._since, self.due = age, -math.inf, -math.inf
        self.positions: Array | None = None
        self.measured: Array | float = -math.inf

    def clear(self) -> None:
        """Drop the reference."""
        self.positions, self._since, self.due = None, -math.inf, -math.inf

    def is_due(self, now: float) -> bool:
        """Return whether the reference is missing, or old enough to be replaced."""
        return not self._since <= now < self.due

    def replace(self, positions: Array, measured: Array | float, now: float) -> None:
        """Store a copy of positions as the new reference."""
        self.positions, self.measured = positions.copy(), measured
        self._since, self.due = now, now + self._age


@dataclass(frozen=True)
class Following:
    """
    Thresholds for a robot that does not follow its commands.

    Attributes
    ----------
    window : float
        Time over which motion is compared [s]; 0: never. Motion that is too slow for it is
        compared over `SLOW` times this time.
    lag : float
        Largest delay of a robot that follows [s].
    distance : float
        Commanded motion in that time from which the measured one counts [rad or m].
    share : float
        Smallest share of the commanded motion that counts as following [1].
    excess : float
        Measured motion beyond twice the commanded one that is tolerated [rad or m].

    """

    window: float = 1.0
    lag: float = 0.3
    distance: float = 0.05
    share: float = 0.2
    excess: float = 0.1


class LimitCheck:
    """
    Check of position limits: violated before motion, or passed in motion.

    Parameters
    ----------
    names : tuple of str
        Names of the driven joints.
    lower, upper : ndarray (n,)
        Their position limits [rad or m].
    tolerance : float
        Tolerated distance beyond a limit [rad or m].

    Attributes
    ----------
    tolerance : float
        See above; it may be changed at any time.

    """

    def __init__(self, names: tuple[str, ...], lower: Array, upper: Array,
                 tolerance: float) -> None:
        self._names, self._limits, self.tolerance = names, (lower, upper), tolerance
        self.ignore(np.zeros(len(names), dtype=bool))

    def ignore(self, joints: NDArray[np.bool_]) -> None:
        """Ignore some joints (n,), in place of those before."""
        lower, upper = self._limits
        self._lower, self._upper = (np.where(joints, -np.inf, lower),
                                    np.where(joints, np.inf, upper))
        self._ranges = list(zip(self._lower.tolist(), self._upper.tolist()))
        self.forget()

    def forget(self) -> None:
        """Restart the check: the next positions may be unrelated to the last ones."""
        # A joint that starts outside, within the tolerance, may move back.
        self._inside = np.zeros(len(self._names), dtype=bool)
        self._all_inside = False

    def outside(self, q: Array) -> str:
        """Return the fault of a joint outside its limits by more than the tolerance, if any."""
        beyond = np.maximum(q - self._upper, self._lower - q)
        if not (beyond > self.tolerance).any():
            return ''
        joint = int(np.argmax(beyond))
        return (f'{self._names[joint]} is at {q[joint]:.4g}, outside its position limits '
                f'{self._lower[joint]:.4g} … {self._upper[joint]:.4g}: wrong unit or offset?')

    def passed(self, q: Array) -> str:
        """Return the fault of a joint that was inside and has passed a limit, if any; q (n,)."""
        if self._all_inside and self._is_inside(q.tolist()):
            return ''
        beyond = np.maximum(q - self._upper, self._lower - q)
        gone = self._inside & (beyond > self.tolerance)
        self._inside = (self._inside | (beyond <= 0.0)) & ~gone
        self._all_inside = bool(self._inside.all())
        if not gone.any():
            return ''
        joint = int(np.argmax(gone))
        return f'{self._names[joint]} has passed its position limit, at {q[joint]:.4g}'

    def _is_inside(self, positions: list[float]) -> bool:
        """Return whether all joints are within their limits; faster than numpy for few joints."""
        for position, (lower, upper) in zip(positions, self._ranges):
            if not lower <= position <= upper:
                return False
        return True


class FollowCheck:
    """
    Check that joints, or the axes of a base, follow their commands.

    Parameters
    ----------
    names : tuple of str
        Names of the joints or axes.
    endless : ndarray (n,) of bool
        Marks joints that turn without end.
    following : Following

    Attributes
    ----------
    ignored : ndarray (n,) of bool
        Joints that are not checked.
    joint : str
        Joint of the last fault.
    failed : str
        The same if it alone stood still, while another one followed; else empty.

    """

    # Number of samples in a window, and length of the window for slow motion in windows.
    SAMPLES, SLOW = 20, 5

    def __init__(self, names: tuple[str, ...], endless: NDArray[np.bool_],
                 following: Following) -> None:
        self._names, self._endless, self._following = names, endless, following
        self.ignored = np.zeros(len(names), dtype=bool)
        self._late = 1 + math.ceil(self.SAMPLES * following.lag / (following.window or 1.0))
        self.forget()

    def forget(self) -> None:
        """Restart the check: the next positions may be unrelated to the last ones."""
        most, n = 1 + self.SLOW * self.SAMPLES + self._late, len(self._names)
        # Rows are samples, the last ones valid: motion since the first sample, measured and
        # commanded, and times.
        self._moved, self._demanded = np.zeros((most, n)), np.zeros((most, n))
        self._sampled_at = np.zeros(most)
        self._count, self._last_q = 0, np.zeros(n)
        self.joint = self.failed = ''
        # Commands since the last sample, and the times from which they are in force.
        self._velocities: list[Array] = []
        self._times: list[float] = []
        self._sampled = self._last = -math.inf

    def check(self, q: Array, velocity: Array, now: float) -> str:
        """
        Return the fault of the first joint that does not follow, or an empty string.

        Parameters
        ----------
        q : ndarray (n,)
            Measured positions [rad or m].
        velocity : ndarray (n,)
            Command in force from now on, not modified afterwards [rad/s or m/s].
        now : float
            [s]

        """
        window = self._following.window
        if not window or not len(q):
            return ''
        if self._last > -math.inf and not 0.0 <= now - self._last <= LARGEST_CLOCK_STEP * window:
            # The clock was set: the duration of the last command is unknown.
            self.forget()
        self._velocities.append(velocity)
        self._times.append(now)
        self._last = now
        # Slightly early, since otherwise it may be a whole cycle late.
        if now - self._sampled < 0.9 * window / self.SAMPLES:
            return ''
        self._sampled = now
        self._take_sample(q, now)
        return self._fault()

    def _take_sample(self, q: Array, now: float) -> None:
        """Append the motion until now to the samples."""
        for rows in (self._moved, self._demanded, self._sampled_at):
            rows[:-1] = rows[1:]
        if self._count:
            self._moved[-1] += motion(q - self._last_q, self._endless)
        # All commands but the one that is in force from now on.
        times = np.array(self._times)
        self._demanded[-1] += (times[1:] - times[:-1]) @ np.array(self._velocities[:-1])
        self._sampled_at[-1], self._last_q[:] = now, q
        self._count += 1
        del self._velocities[:-1], self._times[:-1]

    def _fault(self) -> str:
        """Return the fault of the first joint that has not followed in a window that ends now."""
        last = 1 + self._late
        for length in (self.SAMPLES, self.SLOW * self.SAMPLES):
            if self._count < length + last:
                break
            moved = self._moved[-1] - self._moved[-1 - length]
            # Commanded motion in windows of the same length that end earlier: one of them is the
            # motion that a robot with any delay up to `lag` has to follow now.
            demanded = self._demanded[-last:] - self._demanded[-last - length:-length]
            if max(demanded.max(), -demanded.min()) <= self._following.distance \
                    and np.abs(moved).max() <= self._following.excess:
                # Too little motion for any fault.
                continue
            wrong = self._deviating(moved, demanded)
            if wrong.any():
                joint = int(np.argmax(wrong))
                self.joint = self._names[joint]
                passed = self._sampled_at[-1] - self._sampled_at[-1 - length]
                return (f'{self.joint} does not follow: commanded to move by '
                        f'{demanded[-1][joint]:.2g}, moved by {moved[joint]:.2g} '
                        f'in {passed:.2g} s')
        return ''

    def _deviating(self, moved: Array, demanded: Array) -> NDArray[np.bool_]:
        """Return the joints (n,) with motion (n,) unlike all commanded ones (k, n)."""
        following = self._following
        size = np.abs(demanded)
        least = np.where(np.abs(np.sign(demanded).sum(axis=0)) == len(demanded),
                         size.min(axis=0), 0.0)
        along = moved * np.sign(demanded[-1])
        counts = (least > following.distance) & ~self.ignored
        still = counts & (along < following.share * least)
        slack = following.excess + size.max(axis=0)
        away = (moved > demanded.max(axis=0) + slack) | (moved < demanded.min(axis=0) - slack)
        wrong: NDArray[np.bool_] = still | (away & ~self.ignored)
        # A driver fails with all joints, and a joint that moves by itself is not one that failed.
        alone = np.count_nonzero(wrong) == 1 and bool((counts & ~wrong).any())
        stands = still & ~away & (np.abs(along) < following.share * least)
        self.failed = self._names[int(np.argmax(stands))] if alone and stands.any() else ''
        return wrong


def endless_joints(robot: Robot) -> NDArray[np.bool_]:
    """Return the mask (n,) of the driven joints that turn without end."""
    rows = robot.joint_columns
    return np.isinf(robot.upper[rows] - robot.lower[rows]) & np.array(
        [unit == 'rad' for unit in robot.velocity_units[rows]], dtype=bool)
