# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inequality tasks (lecture 3.1): bounds on values, enforced as bounds on their velocities."""

from abc import abstractmethod
from collections.abc import Hashable, Sequence
from copy import copy
from dataclasses import dataclass
import math
from typing import Any, ClassVar, TypeVar

import numpy as np
from tp_controller.errors import GoalError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.compiled import core
from tp_controller.solver.level import Level
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.keys import Keys, positive, UnitRows
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.yaml_keys import gain_key, tolerance_key, yaml_key

# Defaults of the keys `gain` [1/s] and `return_speed` [unit/s].
SomeBoundedTask = TypeVar('SomeBoundedTask', bound='BoundedTask')

DEFAULT_BOUND_GAIN = 10.0
DEFAULT_RETURN_SPEED = 0.2
# Largest joint speed demanded to bring one row back, however short the row [rad/s or m/s].
RETURN_JOINT_SPEED = 0.5
# Constants of the relaxation, the same as in bounded_task.h. A bound is out of reach if the joint
# motion to it along a constant row is longer than `FAR` [rad or m]. A row shorter than `STILL`
# [unit/rad] is then relaxed: the joint speed that it demands falls linearly with its length, down
# to the same speed the other way. A steeper fall overshoots where the length depends on the
# positions, as at a maximum of the manipulability. A row shorter than `LOOSE` [unit/rad] does not
# bound: at half of that length the value may drift away at `DRIFT` [unit/s].
FAR, STILL, LOOSE, DRIFT = 1.0, 2e-2, 1e-3, 1e-2
# Least length of a row in a denominator [unit/rad].
TINY = 1e-12


@dataclass(slots=True, eq=False)
class Observation:
    """
    Values and Jacobian of a bounded task in one cycle.

    Attributes
    ----------
    value : ndarray (m,)
        σ, in the units of the task.
    J : ndarray (m, n)
        ∂σ/∂q.
    names : sequence of str
        Name of each row, for the report; empty if the name of the task is enough.
    keys : sequence or None
        Identifier of each row, for tasks whose rows change from cycle to cycle.

    """

    value: Array
    J: Array
    names: Sequence[str] = ()
    keys: Sequence[Hashable] | None = None


class History:
    """
    Jacobian of a bounded task in the present cycle and in the one before.

    Parameters
    ----------
    robot : Robot
    rows : int
        Number of rows at first.
    width : int
        Number of columns of a row.

    Attributes
    ----------
    numbers : ndarray (1 + nq + 2 m n,)
        Time [s] and configuration of the present cycle, J (m, n) there, and J of the cycle before
        for the same rows; the time is NaN before the first cycle. Twins of the task write here.

    """

    def __init__(self, robot: Robot, rows: int, width: int) -> None:
        self._place, self._n = 1 + robot.nq, width
        self.numbers = np.full(self._place + 2 * rows * width, math.nan)
        self._keys: Sequence[Hashable] | None = None

    def copy(self) -> 'History':
        """Return an independent copy."""
        other = copy(self)
        other.numbers = self.numbers.copy()
        return other

    def forget(self) -> None:
        """Drop the previous cycles, so that the next one is the first."""
        self.numbers[0] = math.nan

    def inherit(self, other: 'History') -> None:
        """Copy the cycles of a task that this one replaces, unless its rows are others."""
        if other._keys is not None or len(other.numbers) == len(self.numbers):
            self._set(other.numbers.copy(), other._keys)

    def note(self, now: float, q: Array, seen: Observation) -> Array:
        """
        Record a cycle; a task may be evaluated twice in one.

        Returns
        -------
        ndarray (m, n)
            J of the cycle before; the present J for rows that are new.

        """
        place = self.numbers[:self._place]
        latest, before = self.numbers[self._place:].reshape(2, -1, self._n)
        if math.isnan(place[0]):
            before = seen.J
        else:
            # The robot may move while the clock stands still.
            is_same = place[0] == now and np.array_equal(place[1:], q)
            before = self._matched(before if is_same else latest, seen)
        self._set(np.concatenate(([now], q, seen.J.ravel(), before.ravel())), seen.keys)
        return before

    def _matched(self, before: Array, seen: Observation) -> Array:
        """Return a J of earlier rows for the present ones (m, n); the present J for new rows."""
        if seen.keys is None or self._keys is None or seen.keys == self._keys:
            return before.copy()
        J, places = seen.J.copy(), {key: row for row, key in enumerate(self._keys)}
        for row, key in enumerate(seen.keys):
            if key in places:
                J[row] = before[places[key]]
        return J

    def _set(self, numbers: Array, keys: Sequence[Hashable] | None) -> None:
        """Set numbers and keys, in the same array while the number of rows is the same."""
        if len(numbers) == len(self.numbers):
            self.numbers[:] = numbers
        else:
            self.numbers = numbers
        self._keys = keys


class BoundedTask(Task):
    """
    Inequality task: a value σ(q) between bounds, unconstrained inside them.

    The speed towards a bound is at most γ times the distance to it, so that the value does not
    cross the bound::

        γ (lower − σ) ≤ J q_dot ≤ γ (upper − σ)

    A value outside returns at the same rate. The demand is limited to `return_speed`, and to a
    joint speed of ``RETURN_JOINT_SPEED``, since the value may be far outside when the task begins.
    A row whose bound is out of reach is relaxed: ‖J‖ < ``STILL``, distance/‖J‖ > ``FAR``;
    otherwise the sign of a tiny number would decide the direction of a joint. The velocity of
    moving bounds is added to both sides.

    The Jacobian changes during a zero-order hold of a period T: the value would cross the bound by
    ½ T² q_dotᵀ ∂²σ/∂q² q_dot. Per period that is ½ ΔJ q_dot, with the change ΔJ of J since the
    last cycle. It is subtracted from the bound.

    A subclass implements `observe`. If its rows change from cycle to cycle, bounds may be
    scalars, and it overrides `observe_rows`, which also returns the names of the rows.

    Parameters
    ----------
    robot, name, units, keys
        See `Task`.
    lower, upper : float or ndarray (rows,), optional
        Bounds of the value; infinite for an absent bound. A type may set them later.
    **given
        Values of keys.

    """

    bounded = True
    # Relative change of a row in one cycle above which it counts as a jump.
    jump: ClassVar[float] = 0.5
    without = ('timeout', 'mode')

    return_speed: float = yaml_key('largest speed at which a value outside is brought back',
                                   positive, DEFAULT_RETURN_SPEED, unit='m/s, rad/s or 1/s')
    gain: Array = gain_key(
        'γ: largest speed towards a bound, per distance to it; at most 1/period',
        DEFAULT_BOUND_GAIN)
    groups: tuple[UnitRows, ...] = tolerance_key(
        'violation that still counts as satisfied: a number, or one for each unit as '
        '{m: …, rad: …}', 'm, rad')

    def __init__(self, robot: Robot, name: str, units: Sequence[str] = (),
                 keys: Keys | None = None, lower: float | Array = -np.inf,
                 upper: float | Array = np.inf, **given: Any) -> None:
        self.lower, self.upper = lower, upper
        super().__init__(robot, name, units, keys, **given)
        self._history = History(robot, self.rows, robot.n)

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
        """Return the observation at a state: value, Jacobian and names of the rows."""
        value, J = self.observe(state)
        return Observation(value, J, self.row_names)

    def own_motion(self, state: RobotState, now: float) -> float | Array:
        """Return the velocity of the value for a robot at rest, (m,) or 0."""
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
        given = (seen.value, seen.J, self._history.note(now, state.q, seen), state.velocity,
                 self.lower, self.upper, self.gain, self.return_speed,
                 self.own_motion(state, now), self.jump)
        error, least, most = (np.empty(len(seen.value)) for _ in range(3))
        if core is None or not core.bound(*given, error, least, most):
            error, least, most = bounds_of(*given)
        return Evaluation(self, Level(seen.J, lower=least, upper=most), error, seen.names)

    def _limits(self) -> tuple[Any, ...]:
        """Return bounds and history as inputs of a twin."""
        lower, upper = (np.asarray(bound, dtype=float) for bound in (self.lower, self.upper))
        return lower, upper, self.return_speed, self.jump, self._history.numbers

    def _distance_back(self, value: Array) -> Array:
        """Return the distance back to the bounds (m,), with its sign; zero inside."""
        return distance_back(value, self.lower, self.upper)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for a copy, which has a history of its own."""
        return {**super().__getstate__(), '_history': self._history.copy()}

    def start(self, state: RobotState) -> None:
        """Do nothing: there is no default goal."""

    def reset(self) -> None:
        """Drop the previous cycles, so that the next one has no history."""
        super().reset()
        self.forget_cycles()

    def forget_cycles(self) -> None:
        """Drop the previous cycles; see `Task`."""
        self._history.forget()

    def at_positions(self: SomeBoundedTask, gain: float = 1.0) -> SomeBoundedTask:
        """Return a copy without a speed at which it returns to its bounds; see `Task`."""
        other = super().at_positions(gain)
        other.return_speed = math.inf
        return other

    def forget_goal(self) -> None:
        """Keep the goal: the pose of a region does not depend on the robot."""

    def inherit_goal(self, other: Task) -> None:
        """Inherit goal and previous cycles of a task that this one replaces."""
        super().inherit_goal(other)
        if self.is_compatible(other):
            self._history.inherit(other._history)

    def parse_goal(self, goal: Any) -> Goal:
        """Raise `GoalError`: an inequality task has no goal, unless its type overrides this."""
        raise GoalError(f'task {self.name!r} takes no goal: it is an inequality task')

    def reported_errors(self, error: Array, residual: Array) -> tuple[tuple[float, str, float],
                                                                      ...]:
        """Return the largest violation of each unit; see `Task`."""
        return tuple((float(np.abs(error[rows]).max(initial=0.0)), unit, tolerance)
                     for rows, unit, tolerance in self.groups)


def bounds_of(value: Array, J: Array, before: Array, velocity: Array, lower: float | Array,
              upper: float | Array, gain: Array, return_speed: float, motion: float | Array,
              jump: float) -> tuple[Array, Array, Array]:
    """
    Return the velocity bounds of the rows of an inequality task; see `BoundedTask`.

    bounded_task.h computes the same in one call.

    Parameters
    ----------
    value, J, before : ndarray (m,), (m, n), (m, n)
        Bounded value, its Jacobian, and the Jacobian of the last cycle.
    velocity : ndarray (n,)
        Joint velocities [rad/s or m/s].
    lower, upper, gain, return_speed, jump
        See `BoundedTask`.
    motion : float or ndarray (m,)
        Velocity of the value for a robot at rest.

    Returns
    -------
    error : ndarray (m,)
        Distance back to the bounds, with its sign.
    least, most : ndarray (m,)
        Bounds of J q_dot.

    """
    error, moved = distance_back(value, lower, upper), np.sqrt((J * J).sum(axis=1))
    back, lost = np.minimum(return_speed, RETURN_JOINT_SPEED * moved), _relaxation(error, moved)
    least = np.minimum(gain * (lower - value), back) - motion - lost
    most = np.maximum(gain * (upper - value), -back) - motion + lost
    change = J - before
    # Ignore rows that jumped, as when the nearest point changes sides.
    change[(change * change).sum(axis=1) > jump ** 2 * (J * J).sum(axis=1)] = 0.0
    curved = 0.5 * change.dot(velocity)
    # Only outward curvature needs a margin; the bounds must not cross each other.
    return error, np.minimum(least - np.minimum(curved, 0.0), most), \
        np.maximum(most - np.maximum(curved, 0.0), least)


def distance_back(value: Array, lower: float | Array, upper: float | Array) -> Array:
    """Return the distance back to the bounds (m,), with its sign; zero inside."""
    return np.minimum(np.maximum(value, lower), upper) - value


def _relaxation(back: Array, moved: Array) -> Array:
    """Return the relaxation of the velocity back to bounds out of reach (m,) [unit/s]."""
    reduced = 2.0 * RETURN_JOINT_SPEED * moved * np.maximum(1.0 - moved / STILL, 0.0)
    loose = DRIFT * np.maximum(LOOSE / np.maximum(moved, TINY) - 1.0, 0.0)
    return out_of_reach(back, moved) * (reduced + loose)


def out_of_reach(back: Array, moved: Array) -> Array:
    """
    Return the degree from 0 to 1 to which bounds are out of reach for their rows (m,).

    Parameters
    ----------
    back, moved : ndarray (m,)
        Distances back to the bounds, and lengths of the rows.

    Returns
    -------
    ndarray (m,)

    """
    travel = np.abs(back) / np.maximum(moved, TINY)
    return np.minimum(np.maximum(travel / FAR - 1.0, 0.0), 1.0)
