# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Plausibility checks of odometry: age, jumps, and the distance travelled."""

import math

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, inverse_pose, rotation_vector
from tp_controller.ros.loop.stamp_age import StampAge
from tp_controller.ros.loop.state_checks import Contradicting, History


class OdometryCheck(Contradicting):
    """
    Checks of odometry, as `JointStateBuffer` checks joint states.

    Localisation may correct itself: a pose may be off by `tolerance` at any time.

    Parameters
    ----------
    robot : Robot
        Robot that the base belongs to.
    late : float
        Age by the stamps from which odometry is dropped [s].
    tolerance : float
        Distance and angle beyond the velocity limits that count as a jump [m and rad].

    Attributes
    ----------
    travel : ndarray (b,)
        Motion of the base so far along the axes of its velocities [m or rad].

    """

    def __init__(self, robot: Robot, late: float, tolerance: float) -> None:
        super().__init__()
        self._robot, self._tolerance = robot, tolerance
        self._age, self._slack = StampAge(late), min(late, 1.0)
        self._history = History(self._slack)
        bases = slice(robot.joint_columns.start)
        limits, units = robot.velocity[bases], np.array(robot.velocity_units[bases])
        # Limits of the norms of linear and angular velocity.
        self._speeds = [math.sqrt(limits[units == unit].dot(limits[units == unit]))
                        for unit in ('m', 'rad')]
        self.travel = np.zeros(bases.stop)
        self._clock = -math.inf
        self._T: Array | None = None
        self._measured = -math.inf

    @property
    def age(self) -> float:
        """Return the age of the last accepted pose by its stamp [s]."""
        return self._age.age

    @property
    def delay(self) -> float:
        """Return the age of the last message by its stamp, even if it was too old [s]."""
        return self._age.delay

    @property
    def is_overtaken(self) -> bool:
        """Return whether the last message is older than one before it."""
        return self._age.overtaken

    def discard(self) -> None:
        """Discard the last pose; the next one is no jump."""
        self._T = None
        self._history.clear()

    def fault(self, stamp: float, clock: float) -> str:
        """
        Return the fault of the stamp of a message, or an empty string.

        Parameters
        ----------
        stamp : float
            Stamp of the message [s]; 0: none.
        clock : float
            Time of receipt on the clock of the robot [s].

        """
        if clock < self._clock:
            # The clock was set back, as that of a simulation.
            self._age = StampAge(self._age.limit)
            self.discard()
        self._clock = clock
        # Stamps cannot be checked with a clock that has not started.
        return self._age.fault(stamp, clock) if clock > 0.0 else ''

    def take(self, T: Array, now: float) -> None:
        """
        Compare a pose with earlier ones, and update the travel.

        Parameters
        ----------
        T : ndarray (4, 4)
            Pose of the base in the message that `fault` has checked.
        now : float
            Time of receipt on the clock of timeouts [s].

        """
        clock = self._clock
        if self._T is not None:
            step = _displacement(self._T, T)
            self._compare(step, clock - self._measured, now)
            self.travel = self.travel + self._robot.base_velocities(step)
        if self._history.positions is not None:
            self._compare(_displacement(self._history.positions, T),
                          clock - float(self._history.measured), now)
        self._T, self._measured = T, clock
        if self._history.is_due(clock):
            self._history.replace(T, clock, clock)

    def _compare(self, displacement: Array, passed: float, now: float) -> None:
        """Detect a displacement (6,) that is larger than the velocity limits allow."""
        for part, speed, unit in zip((displacement[:3], displacement[3:]), self._speeds,
                                     ('m', 'rad')):
            moved = math.sqrt(part.dot(part))
            if moved > speed * (passed + self._slack) + self._tolerance:
                self._contradict(f'odometry jumped by {moved:.2g} {unit} in {passed:.2g} s', now)


def _displacement(before: Array, after: Array) -> Array:
    """Return the displacement (6,) between two poses, in the axes of the first [m, rad]."""
    T = inverse_pose(before).dot(after)
    return np.concatenate((T[:3, 3], rotation_vector(T[:3, :3])))
