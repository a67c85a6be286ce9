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

"""Inequality tasks: values that stay between bounds, as bounds on their velocity."""

from abc import abstractmethod

import numpy as np
from tp_controller.errors import GoalError
from tp_controller.solver.level import Level
from tp_controller.tasks.task import DEFAULT_TIMEOUT, positive, Task

DEFAULT_BOUND_GAIN = 10.0
DEFAULT_RETURN_SPEED = 0.2
# No joint has to be faster than this on the way back of one row, however little it moves the
# value [rad/s or m/s].
RETURN_JOINT_SPEED = 0.5
# Slower yet for a row that joints move by less than this [unit/rad or unit/m].
WEAK = 0.05
# A bound is out of reach where all joints together would have to move by more than this, along a
# row that does not change [rad or m]. Then a row that they move by less than `STILL` is let go,
# smoothly: at half of that it may get away at `DRIFT` [unit/rad, unit/s].
FAR, STILL, DRIFT = 1.0, 2e-2, 1e-2
TINY = 1e-12


class BoundedTask(Task):
    """
    A value σ(q) that stays between bounds, and that the task leaves alone in between.

    The velocity of the value may lead to a bound only as fast as γ times the distance to it, so
    that the bound is approached but not crossed::

        γ (lower − σ) ≤ J q_dot ≤ γ (upper − σ)

    A value that is outside comes back, at the same rate but never faster than `return_speed`, nor
    so fast that joints would race: it may be far outside when the task begins. A row that hardly
    moves and whose bound is out of reach, as of a link that turns about its own axis, is let go,
    or the sign of next to nothing would decide where a joint may go. Where the bounds themselves
    move, their velocity is added to both sides.

    A command is held for a period T, in which J changes, and the curvature of the way leads beyond
    the bound by ½ T² q_dotᵀ ∂²σ/∂q² q_dot. Half of what J has changed by since the last cycle,
    times the velocity since then, is that per period, and it is kept free.

    A subclass implements `observe`. Where the rows change from cycle to cycle bounds may be
    scalars, and `observe` sets `row_keys`, which says what each row is about.

    Parameters
    ----------
    robot, name, units, keys
        See `Task`.
    lower, upper : float or ndarray (rows,)
        Bounds of the value, infinite where there is none.
    gain, return_speed, tolerance, timeout
        γ [1/s], speed [unit/s], how far outside still counts as kept, and how long a velocity
        of moving bounds is believed [s].

    """

    bounded = True
    row_keys = None
    # Share of a row from which on a change of it in one cycle is a jump.
    jump = 0.5
    keys = {
        'gain': 'γ: how fast a bound may be approached, per distance to it; at most 1/period '
                '[1/s]',
        'return_speed': 'the most that is asked for on the way back from outside [m/s, rad/s or '
                        '1/s]',
        'tolerance': 'how far outside still counts as kept: a number, or one for each unit as '
                     '{m: …, rad: …} [m, rad]',
    }

    def __init__(self, robot, name, units, keys, lower, upper, *, gain=DEFAULT_BOUND_GAIN,
                 return_speed=DEFAULT_RETURN_SPEED, tolerance=None, timeout=DEFAULT_TIMEOUT):
        super().__init__(robot, name, units, keys, gain=gain, tolerance=tolerance,
                         timeout=timeout)
        self.return_speed = keys.check('return_speed', positive, return_speed)
        self.lower, self.upper = lower, upper
        # Time of a cycle, its Jacobian, and what its rows were about; this one and the one before.
        self._latest = self._before = None

    @abstractmethod
    def observe(self, state):
        """
        Return the value and its Jacobian at a `RobotState`.

        Returns
        -------
        value : ndarray (m,)
            σ, in `units`.
        J : ndarray (m, n)
            ∂σ/∂q.

        """

    def own_motion(self, state, now):
        """Return how fast the value changes while the robot stands still, (m,) or 0."""
        return 0.0

    def value(self, state):
        """Return σ (m,)."""
        return self.observe(state)[0]

    def jacobian(self, state):
        """Return ∂σ/∂q (m, n)."""
        return self.observe(state)[1]

    def error(self, state):
        """Return the way back to between the bounds (m,); zero inside."""
        return self._way_back(self.observe(state)[0])

    def level(self, state, now):
        """Return the `Level` at a state, and remember the error for the report."""
        value, J = self.observe(state)
        self.last_error = self._way_back(value)
        self._remember(J, now)
        moved = np.sqrt((J * J).sum(axis=1))
        motion, curved = self.own_motion(state, now), self._curved(J, state.velocity)
        back = np.minimum(self.return_speed,
                          RETURN_JOINT_SPEED * moved * np.minimum(moved / WEAK, 1.0))
        lost = out_of_reach(self.last_error, moved) * DRIFT * np.maximum(
            STILL / np.maximum(moved, TINY) - 1.0, 0.0)
        lower = np.minimum(self.gain * (self.lower - value), back) - lost - motion
        upper = np.maximum(self.gain * (self.upper - value), -back) + lost - motion
        # Only what leads outwards needs room, as far as there is any.
        return Level(J, lower=np.minimum(lower - np.minimum(curved, 0.0), upper),
                     upper=np.maximum(upper - np.maximum(curved, 0.0), lower))

    def _way_back(self, value):
        """Return the way back to between the bounds (m,)."""
        return np.minimum(np.maximum(value, self.lower), self.upper) - value

    def _curved(self, J, velocity):
        """Return the speed (m,) that the curvature of the way adds until the next cycle."""
        if self._before is None:
            return np.zeros(len(J))
        _, J_before, keys_before = self._before
        if self.row_keys == keys_before:
            return 0.5 * self.change(J, J_before).dot(velocity)
        known = [key in keys_before for key in self.row_keys]
        rows = [keys_before.index(key) for key in self.row_keys if key in keys_before]
        curved = np.zeros(len(J))
        curved[known] = 0.5 * self.change(J[known], J_before[rows]).dot(velocity)
        return curved

    def change(self, J, J_before):
        """
        Return by how much rows (k, n) of the Jacobian have turned since the last cycle.

        Not at all where they have jumped, as where the nearest point changes sides.
        """
        change = J - J_before
        change[(change * change).sum(axis=1) > self.jump ** 2 * (J * J).sum(axis=1)] = 0.0
        return change

    def _remember(self, J, now):
        """Keep a Jacobian for the next cycle; a level may be made twice in one."""
        if self._latest is None or self._latest[0] != now:
            self._before = self._latest
        self._latest = now, J, self.row_keys

    def start(self, state):
        """There is nothing to hold."""

    def release(self):
        """Forget the cycles before, so that the next one begins anew."""
        super().release()
        self._latest = self._before = None

    def take_over(self, other):
        """Go on with the goal of a task that this one replaces, and with what it knows."""
        super().take_over(other)
        if self.means_the_same(other):
            self._latest, self._before = other._latest, other._before

    def parse_goal(self, goal):
        """Raise `GoalError`: a task with bounds has no goal, unless its type says otherwise."""
        raise GoalError(f'task {self.name!r} takes no goal: it keeps bounds')

    def reported_errors(self, error, residual):
        """Return for each unit how far outside the value is; see `Task`."""
        return tuple((float(np.abs(error[rows]).max(initial=0.0)), unit, tolerance)
                     for rows, unit, tolerance in self.groups)


def out_of_reach(way_back, moved):
    """
    Return from 0 to 1 whether bounds are too far away for their rows.

    Parameters
    ----------
    way_back, moved : ndarray (m,)
        How far it is back to the bounds, and how long the rows are.

    Returns
    -------
    ndarray (m,)

    """
    travel = np.abs(way_back) / np.maximum(moved, TINY)
    return np.minimum(np.maximum(travel / FAR - 1.0, 0.0), 1.0)
