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

"""Scalar functions of the joints that are climbed, as far as the tasks above leave room."""

from abc import abstractmethod

import numpy as np
from tp_controller.errors import GoalError
from tp_controller.solver.level import identity, Level
from tp_controller.tasks.task import DEFAULT_GAIN, DEFAULT_MODE, norm, positive, Task

DEFAULT_SPEED = 0.5


class GradientTask(Task):
    """
    Climb a function h(q): the wanted joint velocity is K ∂h/∂q, projected by the levels above.

    The gradient is wanted as a velocity of all joints, J = I. As a single row J = ∂h/∂q the
    task would ask for a rate of h, and where the levels above leave hardly any way to climb it
    would have the joints race along it.

    A subclass implements `measure`. Its constructor calls this one and then
    `Keys.raise_faults`, as any other task's.

    Parameters
    ----------
    robot, name, keys, gain, tolerance, mode
        See `Task`.
    max_speed : float
        Norm of the wanted velocity at most [rad/s or m/s].

    """

    keys = {
        'gain': 'gain K: joint velocity per slope of the function [1/s]',
        'max_speed': 'norm of the wanted joint velocities at most [rad/s or m/s]',
        'tolerance': 'speed of climbing below which the top counts as reached [rad/s or m/s]',
    }

    def __init__(self, robot, name, keys, *, gain=DEFAULT_GAIN, max_speed=DEFAULT_SPEED,
                 tolerance=None, mode=DEFAULT_MODE):
        # One unit for the norm over all joints.
        super().__init__(robot, name, ['rad'] * robot.n, keys, gain=gain, tolerance=tolerance,
                         mode=mode)
        self.max_speed = keys.check('max_speed', positive, max_speed)

    @abstractmethod
    def measure(self, state):
        """
        Return the function and its gradient at a `RobotState`.

        Returns
        -------
        float
            h
        ndarray (n,)
            ∂h/∂q [1/rad or 1/m].

        """

    def value(self, state):
        """Return h (1,)."""
        return np.array([self.measure(state)[0]])

    def error(self, state):
        """Return the wanted joint velocities (n,) [rad/s or m/s]."""
        wanted = self.gain * self.measure(state)[1]
        speed = norm(wanted)
        return wanted if speed <= self.max_speed else wanted * (self.max_speed / speed)

    def jacobian(self, state):
        """Return the identity (n, n)."""
        return identity(self.robot.n)

    def level(self, state, now):
        """Return the `Level` at a state, and remember the error for the report."""
        self.last_error = self.error(state)
        return Level(identity(self.robot.n), self.last_error, self.mode)

    def start(self, state):
        """There is nothing to hold."""

    def parse_goal(self, goal):
        """Raise `GoalError`: the goal is the top."""
        raise GoalError(f'task {self.name!r} takes no goal: it climbs a function')

    def reported_errors(self, error, residual):
        """Return how fast the function changes, along its gradient; see `Task`."""
        speed = norm(error)
        climbing = float(error.dot(error - residual)) / speed if speed > 0.0 else 0.0
        (_, unit, tolerance), = self.groups
        # Falling, because the tasks above need it, is no rest at the top either.
        return (abs(climbing), f'{unit}/s', tolerance),
