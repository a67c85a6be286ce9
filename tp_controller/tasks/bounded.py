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
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from tp_controller.errors import GoalError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.compiled import compiled_module
from tp_controller.solver.level import Level
from tp_controller.tasks.keys import Gain, Keys, positive, Tolerance
from tp_controller.tasks.task import DEFAULT_TIMEOUT, Evaluation, Goal, Task

DEFAULT_BOUND_GAIN = 10.0
DEFAULT_RETURN_SPEED = 0.2
# No joint has to be faster than this to bring one row back, however little it moves the
# value [rad/s or m/s].
RETURN_JOINT_SPEED = 0.5
# A bound is out of reach where all joints together would have to move by more than this, along a
# row that does not change [rad or m]. Then a row that they move by less than `STILL` [unit/rad] is
# relaxed: the joint speed that it demands falls linearly with its length, down to the same speed
# the other way. A steeper fall overshoots where the length depends on the positions, as at a
# maximum of the manipulability. A row below `LOOSE` [unit/rad] bounds nothing: at half of that it
# may get away at `DRIFT` [unit/s].
FAR, STILL, LOOSE, DRIFT = 1.0, 2e-2, 1e-3, 1e-2
TINY = 1e-12
# What is compiled of this file; None where the reference runs, or it was not built.
ROWS = compiled_module('tp_controller.tasks.rows')


@dataclass(slots=True, eq=False)
class Observation:
    """
    What a bounded task sees in one cycle.

    Attributes
    ----------
    value : ndarray (m,)
        σ, in the units of the task.
    J : ndarray (m, n)
        ∂σ/∂q.
    names : sequence of str
        What each row is about, for the report; empty where the name of the task says it all.
    keys : sequence or None
        What tells each row from the others, where the rows change from cycle to cycle.

    """

    value: Array
    J: Array
    names: Sequence[str] = ()
    keys: Sequence[Hashable] | None = None


@dataclass(slots=True, eq=False)
class Moment:
    """When and where a bounded task was evaluated, and what it saw."""

    now: float
    q: Array
    seen: Observation


class BoundedTask(Task):
    """
    An inequality task: a value σ(q) that stays between bounds, and is free in between.

    The value approaches a bound at most as fast as γ times the distance to it, so that the bound
    is not crossed::

        γ (lower − σ) ≤ J q_dot ≤ γ (upper − σ)

    A value outside comes back at the same rate; no more than `return_speed` is demanded, nor so
    much that joints would race: it may be far outside when the task begins. Relax a row whose
    bound is out of reach: ‖J‖ < ``STILL``, distance/‖J‖ > ``FAR``; otherwise the sign of a tiny
    number would decide where a joint may go. Where bounds move, their velocity is added to both
    sides.

    During a zero-order hold of a period T the Jacobian changes: the value would cross the bound by
    ½ T² q_dotᵀ ∂²σ/∂q² q_dot. Per period that is ½ ΔJ q_dot, with the change ΔJ of J since the
    last cycle. It is subtracted from the bound.

    A subclass implements `observe`. Where the rows change from cycle to cycle bounds may be
    scalars, and `observe_rows` is overridden, which also says what each row is about.

    Parameters
    ----------
    robot, name, units, keys
        See `Task`.
    lower, upper : float or ndarray (rows,)
        Bounds of the value, infinite where there is none.
    gain, return_speed, tolerance, timeout
        γ [1/s], speed [unit/s], how far outside still counts as satisfied, and how long a
        velocity of moving bounds stays in force [s].

    """

    bounded = True
    # Share of a row from which on a change of it in one cycle is a jump.
    jump: ClassVar[float] = 0.5
    keys = {
        'gain': 'γ: how fast a bound may be approached, per distance to it; at most 1/period '
                '[1/s]',
        'return_speed': 'largest speed at which a value outside is brought back [m/s, rad/s or '
                        '1/s]',
        'tolerance': 'how far outside still counts as satisfied: a number, or one for each '
                     'unit as {m: …, rad: …} [m, rad]',
    }

    def __init__(self, robot: Robot, name: str, units: Sequence[str], keys: Keys,
                 lower: float | Array, upper: float | Array, *, gain: Gain = DEFAULT_BOUND_GAIN,
                 return_speed: float = DEFAULT_RETURN_SPEED, tolerance: Tolerance | None = None,
                 timeout: float = DEFAULT_TIMEOUT) -> None:
        super().__init__(robot, name, units, keys, gain=gain, tolerance=tolerance,
                         timeout=timeout)
        self.return_speed = keys.check('return_speed', positive, return_speed)
        self.lower, self.upper = lower, upper
        # This cycle, and the one before.
        self._latest: Moment | None = None
        self._before: Moment | None = None

    @abstractmethod
    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """
        Return the value and its Jacobian at a `RobotState`.

        Returns
        -------
        value : ndarray (m,)
            σ, in `units`.
        J : ndarray (m, n)
            ∂σ/∂q.

        """

    def observe_rows(self, state: RobotState) -> Observation:
        """Return what `observe` does, and what the rows are about."""
        value, J = self.observe(state)
        return Observation(value, J, self.row_names)

    def own_motion(self, state: RobotState, now: float) -> float | Array:
        """Return how fast the value changes while the robot stands still, (m,) or 0."""
        return 0.0

    def value(self, state: RobotState) -> Array:
        """Return σ (m,)."""
        return self.observe(state)[0]

    def jacobian(self, state: RobotState) -> Array:
        """Return ∂σ/∂q (m, n)."""
        return self.observe(state)[1]

    def error(self, state: RobotState) -> Array:
        """Return the distance back to the bounds (m,), with its sign; zero inside."""
        return self._distance_back(self.observe(state)[0])

    def make_evaluation(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` at a state."""
        seen = self.observe_rows(state)
        self._remember(Moment(now, state.q, seen))
        given = (seen.value, seen.J, self._rows_before(seen), state.velocity, self.lower,
                 self.upper, self.gain, self.return_speed, self.own_motion(state, now), self.jump)
        error, least, most = (np.empty(len(seen.value)) for _ in range(3))
        if ROWS is None or not ROWS.bound(*given, error, least, most):
            error, least, most = bounds_of(*given)
        return Evaluation(self, Level(seen.J, lower=least, upper=most), error, seen.names)

    def _distance_back(self, value: Array) -> Array:
        """Return the distance back to the bounds (m,), with its sign; zero inside."""
        return distance_back(value, self.lower, self.upper)

    def _rows_before(self, seen: Observation) -> Array:
        """Return J (m, n) as it was in the last cycle; rows that were not there as they are."""
        if self._before is None:
            return seen.J
        before = self._before.seen
        if seen.keys is None or before.keys is None or seen.keys == before.keys:
            return before.J
        J, places = seen.J.copy(), {key: row for row, key in enumerate(before.keys)}
        for row, key in enumerate(seen.keys):
            if key in places:
                J[row] = before.J[places[key]]
        return J

    def _remember(self, moment: Moment) -> None:
        """Keep what was seen for the next cycle; a task may be evaluated twice in one."""
        latest = self._latest
        # The robot may well move while the clock stands still.
        if latest is None or latest.now != moment.now or not np.array_equal(latest.q, moment.q):
            self._before = latest
        self._latest = moment

    def start(self, state: RobotState) -> None:
        """There is no default goal."""

    def reset(self) -> None:
        """Forget the cycles before, so that the next one begins anew."""
        super().reset()
        self._latest = self._before = None

    def forget_goal(self) -> None:
        """Keep the goal: where a region is does not depend on the robot."""

    def inherit_goal(self, other: Task) -> None:
        """Go on with the goal of a task that this one replaces, and with what it knows."""
        super().inherit_goal(other)
        if self.is_compatible(other):
            self._latest, self._before = other._latest, other._before

    def parse_goal(self, goal: Any) -> Goal:
        """Raise `GoalError`: a task with bounds has no goal, unless its type says otherwise."""
        raise GoalError(f'task {self.name!r} takes no goal: it is an inequality task')

    def reported_errors(self, error: Array, residual: Array) -> tuple[tuple[float, str, float],
                                                                      ...]:
        """Return for each unit how far outside the value is; see `Task`."""
        return tuple((float(np.abs(error[rows]).max(initial=0.0)), unit, tolerance)
                     for rows, unit, tolerance in self.groups)


def bounds_of(value: Array, J: Array, before: Array, velocity: Array, lower: float | Array,
              upper: float | Array, gain: Array, return_speed: float, motion: float | Array,
              jump: float) -> tuple[Array, Array, Array]:
    """
    Return what a task with bounds demands of its rows; see `BoundedTask`.

    rows.cpp does the same in one call.

    Parameters
    ----------
    value, J, before : ndarray (m,), (m, n), (m, n)
        What is bounded, its Jacobian, and the same in the last cycle.
    velocity : ndarray (n,)
        Of the joints [rad/s or m/s].
    lower, upper, gain, return_speed, jump
        See `BoundedTask`.
    motion : float or ndarray (m,)
        How fast the value changes while the robot stands still.

    Returns
    -------
    error : ndarray (m,)
        The distance back to the bounds.
    least, most : ndarray (m,)
        Bounds of J q_dot.

    """
    error, moved = distance_back(value, lower, upper), np.sqrt((J * J).sum(axis=1))
    back, lost = np.minimum(return_speed, RETURN_JOINT_SPEED * moved), _drift(error, moved)
    least = np.minimum(gain * (lower - value), back) - motion - lost
    most = np.maximum(gain * (upper - value), -back) - motion + lost
    change = J - before
    # Not where a row has jumped, as where the nearest point changes sides.
    change[(change * change).sum(axis=1) > jump ** 2 * (J * J).sum(axis=1)] = 0.0
    curved = 0.5 * change.dot(velocity)
    # Only what leads outwards needs a margin, as far as there is any.
    return error, np.minimum(least - np.minimum(curved, 0.0), most), \
        np.maximum(most - np.maximum(curved, 0.0), least)


def distance_back(value: Array, lower: float | Array, upper: float | Array) -> Array:
    """Return the distance back to the bounds (m,), with its sign; zero inside."""
    return np.minimum(np.maximum(value, lower), upper) - value


def _drift(back: Array, moved: Array) -> Array:
    """Return by how much the velocity back is reduced where bounds are out of reach (m,)."""
    reduced = 2.0 * RETURN_JOINT_SPEED * moved * np.maximum(1.0 - moved / STILL, 0.0)
    loose = DRIFT * np.maximum(LOOSE / np.maximum(moved, TINY) - 1.0, 0.0)
    return out_of_reach(back, moved) * (reduced + loose)


def out_of_reach(back: Array, moved: Array) -> Array:
    """
    Return from 0 to 1 whether bounds are too far away for their rows.

    Parameters
    ----------
    back, moved : ndarray (m,)
        How far it is back to the bounds, and how long the rows are.

    Returns
    -------
    ndarray (m,)

    """
    travel = np.abs(back) / np.maximum(moved, TINY)
    return np.minimum(np.maximum(travel / FAR - 1.0, 0.0), 1.0)
