# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Levels of the hierarchy: the input of the solver, and its validation."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dnrm2
from tp_controller.solver.errors import SolverError, unknown

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MODES = ('least_squares', 'scale')
# Share of the whole that counts as zero: remainders of rows and directions that levels above use,
# or of 1e-17 towards a joint limit, are rounding errors. Exact answers agree with the reference
# to this.
NEGLIGIBLE = 1e-9
# Rounding error of a result, relative to its size.
ROUNDING = 1e-12
# Tolerance of a row on its bound [unit/s].
FEASIBLE = 1e-11
# Largest number in levels; squares of larger ones would overflow.
LARGEST_NUMBER = 1e100
# Largest ratio of two weights; beyond it rounding, not the weights, would decide.
WEIGHT_RATIO = 1e12


@dataclass(slots=True, eq=False)
class Level:
    """
    One level of the hierarchy: J q_dot = v, or lower ≤ J q_dot ≤ upper.

    Attributes
    ----------
    J : ndarray (m, n)
        Task Jacobian.
    v : ndarray (m,) or None
        Desired task velocity; None for a level with bounds.
    mode : str
        Behaviour if a limit prevents v. ``least_squares``: the level comes as near to v as
        possible. ``scale``: it keeps the direction of v, scaled down as little as possible.
    lower, upper : ndarray (m,) or None
        Bounds on the task velocity; infinite if a side is unbounded.
    is_identity : bool
        J is the identity: the level demands a velocity of every joint, in their order.
    joints : ndarray (n,) of bool or None
        Joints that the level may move to meet its demand or bounds; None: all. Its null space,
        in which the levels below move the robot, is that of J, with all joints.
    weights : ndarray (m,) or None
        Weight of each row, positive, where not all rows can be met: Σ w_i residual_i² is least;
        None: all weigh the same.

    """

    J: Array
    # Callers that read the demand or the bounds of a level have checked which of them it has.
    v: Array = None  # type: ignore[assignment]
    mode: str = 'least_squares'
    lower: Array = None  # type: ignore[assignment]
    upper: Array = None  # type: ignore[assignment]

    is_identity: bool = False
    joints: Mask | None = None
    weights: Array | None = None

    @classmethod
    def of_joints(cls, v: Array, mode: str = 'least_squares') -> 'Level':
        """Return a level that demands a velocity v (n,) of every joint."""
        return cls(identity(len(v)), v, mode, is_identity=True)

    def demanded(self, achieved: Array) -> Array:
        """Return v (m,), or the achieved velocity (m,) clamped to the bounds."""
        if self.v is not None:
            return self.v
        return np.minimum(np.maximum(achieved, self.lower), self.upper)

    @property
    def root(self) -> Array:
        """Return the roots of the weights (m,), the smallest of them 1."""
        if self.weights is None:
            return np.ones(len(self.J))
        return np.sqrt(self.weights / self.weights.min(initial=np.inf))

    def meets(self, x: Array) -> bool:
        """Return whether velocities x (n,) satisfy the bounds."""
        return within(self.J.dot(x), self.lower, self.upper, FEASIBLE)


@lru_cache(maxsize=None)
def identity(n: int) -> Array:
    """Return the n×n identity, a cached read-only array."""
    eye = np.eye(n)
    eye.setflags(write=False)
    return eye


def norm(array: Array) -> float:
    """Return the Frobenius norm."""
    # For small arrays BLAS itself is three times as fast as numpy.
    return float(dnrm2(array.ravel('K'))) if array.size else 0.0


def within(values: Array, lower: Array, upper: Array, tolerance: float = 0.0) -> bool:
    """Return whether all values are within their bounds, up to a tolerance."""
    return not (np.count_nonzero(values > upper + tolerance)
                or np.count_nonzero(values < lower - tolerance))


def check_levels(levels: Iterable[Any]) -> list[Level]:
    """
    Return levels as a list of `Level`, with validated shapes and numbers.

    Raises
    ------
    SolverError
        `levels` is not a sequence, shapes do not fit together, numbers are not finite or beyond
        `LARGEST_NUMBER`, bounds contradict themselves, joints are not a mask, weights are not
        positive, or a mode is unknown or cannot be used.

    """
    try:
        levels = list(levels)
    except TypeError as error:
        raise SolverError(f'levels must be a sequence of Level or (J, v), not {levels!r}') \
            from error
    levels = [check_level(level, f'level {number}') for number, level in enumerate(levels, 1)]
    widths = [level.J.shape[1] for level in levels]
    if len(set(widths)) > 1:
        raise SolverError(f'levels disagree on the number of joints: {widths}')
    bounded = None
    for number, level in enumerate(levels, 1):
        if level.v is None:
            bounded = bounded or number
        elif level.mode == 'scale' and bounded:
            raise SolverError(
                f'level {number}: mode scale would stop in front of the bounds of level '
                f'{bounded} above it instead of sliding along them; use least_squares')
    return levels


def check_level(level: Any, name: str) -> Level:
    """Return one validated level with arrays of floats; `SolverError` as in `check_levels`."""
    if isinstance(level, np.ndarray):
        raise SolverError(f'{name}: needs Level or (J, v), got an array of shape {level.shape}; '
                          'a single level, too, is in a sequence: [(J, v)]')
    if not isinstance(level, Level):
        try:
            level = Level(*level)
        except TypeError as error:
            raise SolverError(f'{name}: needs J (m, n) and v (m,): {error}') from error
    if not isinstance(level.mode, str) or level.mode not in MODES:
        raise SolverError(f'{name}: {unknown("mode", str(level.mode), MODES)}')
    J = _array(level.J, 2, f'{name}: J must be (m, n)')
    rows, joints = (J.shape[0],), _mask(level.joints, J.shape[1], name)
    weights = None if level.weights is None else check_weights(
        level.weights, J.shape[0], f'{name}: weights')
    if level.v is not None:
        if level.lower is not None or level.upper is not None:
            raise SolverError(f'{name}: has both a velocity v and bounds; give one of them')
        v = _array(level.v, 1, f'{name}: J must be (m, n) and v (m,)')
        if v.shape != rows:
            raise SolverError(f'{name}: J must be (m, n) and v (m,), '
                              f'got {J.shape} and {v.shape}')
        square = J.shape[0] == J.shape[1]
        checked = Level(J, v, level.mode,
                        is_identity=square and np.array_equal(J, identity(len(J))),
                        joints=joints, weights=weights)
        moderate = _moderate(v)
    else:
        if level.mode != 'least_squares':
            raise SolverError(f'{name}: bounds have no direction that mode scale could keep')
        lower, upper = check_bounds(level.lower, level.upper, J.shape[0], name)
        checked = Level(J, lower=lower, upper=upper, joints=joints, weights=weights)
        moderate = True
    if not (moderate and _moderate(J)):
        raise SolverError(f'{name}: the levels hold numbers that are not finite, or beyond '
                          f'{LARGEST_NUMBER:g}')
    return checked


def check_bounds(lower: Any, upper: Any, size: int, name: str) -> tuple[Array, Array]:
    """
    Return bounds as arrays (size,) with lower ≤ upper; a missing side is infinite.

    Raises
    ------
    SolverError
        Both sides are missing, a shape is wrong, or no number lies between them.

    """
    if lower is None and upper is None:
        raise SolverError(f'{name}: needs v, or a bound')
    lower = np.full(size, -np.inf) if lower is None else _array(
        lower, 1, f'{name}: the lower bound must be ({size},)')
    upper = np.full(size, np.inf) if upper is None else _array(
        upper, 1, f'{name}: the upper bound must be ({size},)')
    if lower.shape != (size,) or upper.shape != (size,):
        raise SolverError(f'{name}: bounds must be {size} numbers each, got shapes '
                          f'{lower.shape} and {upper.shape}')
    if not ((lower <= upper) & (lower < np.inf) & (upper > -np.inf)).all():
        raise SolverError(f'{name}: bounds need lower ≤ upper, got '
                          f'{lower.tolist()} and {upper.tolist()}')
    return lower, upper


def _mask(joints: Any, n: int, name: str) -> Mask | None:
    """Return joints as a mask (n,); None for all of them."""
    if joints is None:
        return None
    mask = np.asarray(joints)
    if mask.dtype != bool or mask.shape != (n,):
        raise SolverError(f'{name}: joints must be {n} of True and False, got {joints!r}')
    return None if mask.all() else mask


def check_weights(weights: Any, n: int, name: str) -> Array:
    """Return weights as an array (n,) of positive numbers, the smallest of them 1."""
    try:
        checked = np.asarray(weights, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise SolverError(f'{name} must be {n} positive numbers: {error}') from error
    if checked.shape != (n,) or not (checked > 0.0).all() or not np.isfinite(checked).all():
        raise SolverError(f'{name} must be {n} positive numbers, got {checked.tolist()}')
    if n and float(checked.max()) / float(checked.min()) > WEIGHT_RATIO:
        raise SolverError(f'{name} must be within a factor of {WEIGHT_RATIO:g}, got '
                          f'{checked.tolist()}')
    return checked / checked.min(initial=np.inf)


def _moderate(array: Array) -> bool:
    """Return whether all numbers are finite and within `LARGEST_NUMBER`."""
    return bool((np.abs(array) <= LARGEST_NUMBER).all())


def _array(values: Any, dimensions: int, what: str) -> Array:
    """Return values as an array of floats."""
    try:
        array = np.asarray(values)
        if np.iscomplexobj(array):
            raise TypeError('complex numbers are not velocities')
        array = array.astype(float, copy=False)
    except (TypeError, ValueError, OverflowError) as error:
        raise SolverError(f'{what}: {error}') from error
    if array.ndim != dimensions:
        raise SolverError(f'{what}, got an array of shape {array.shape}')
    return array
