# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Options of the control cycle, constant until a setting or a velocity limit changes."""

import numpy as np
from tp_controller.control.settings import Settings
from tp_controller.control.velocity_limits import VelocityBounds, VelocityLimits
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array

# Longest time that a command is in force, relative to the mean time between two; at most a period.
HOLD_RATIO = 2.0


class CycleOptions:
    """
    Options of the control cycle that follow from the robot, the settings and its velocity limits.

    Parameters
    ----------
    robot : Robot
    settings : Settings
        Settings that fit the robot.
    velocity : ndarray (n,)
        Velocity limits in force [rad/s or m/s].

    Attributes
    ----------
    robot : Robot
    period, blend : float
        Settings [s].
    delay : int
        Number of pending commands.
    solver : Options
        Options of the solver.
    speed_cap : ndarray (n,) or None
        See `Settings.speed_cap`.

    """

    def __init__(self, robot: Robot, settings: Settings, velocity: Array) -> None:
        self.robot = robot
        self.period, self.blend = settings.period, settings.blend
        self.delay = settings.command_delay
        self.solver = settings.solver_options(robot.n)
        self.speed_cap = settings.speed_cap(robot, velocity)
        self._limits = VelocityLimits(robot, settings.period, settings.braking_gain, velocity)
        # Row of each pending command in the previous cycle; the first row is replaced.
        self._previous_rows = np.maximum(np.arange(self.delay) - 1, 0)

    def bounds(self, positions: Array, velocity: Array, elapsed: float, pending: Array,
               mean: float) -> VelocityBounds:
        """
        Return the bounds on the velocities.

        Parameters
        ----------
        positions : ndarray (n,)
            [rad or m]
        velocity : ndarray (n,)
            Last command [rad/s or m/s].
        elapsed : float
            Time since then [s].
        pending : ndarray (delay, n)
            Commands that the positions do not reflect yet [rad/s or m/s].
        mean : float
            Mean time between two commands [s].

        """
        duration = HOLD_RATIO * mean
        return self._limits.at(positions, velocity, elapsed, pending,
                               duration if duration < self.period else self.period)

    def shifted(self, pending: Array, velocity: Array) -> Array:
        """Return the pending commands (delay, n) after another one, of a velocity (n,)."""
        if not self.delay:
            return pending
        shifted = pending.take(self._previous_rows, 0)
        shifted[0] = velocity
        return shifted
