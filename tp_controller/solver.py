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

"""
The task-priority algorithm: recursive, with damping, weights and velocity scaling.

The lecture (2.2) solves, from ζ = 0 and P = I, for each level i from the highest priority on::

    J̄ = J_i P
    ζ ← ζ + J̄^# (v_i − J_i ζ)
    P ← P − J̄⁺ J̄

``J̄^#`` may be damped; ``J̄⁺`` in the projector is not, or lower levels would disturb higher ones.
Here P is kept as P = Z Zᵀ, with the orthonormal columns of Z spanning what is left free. That is
the same recursion in fewer coordinates, in which rounding errors do not add up from level to
level::

    J̄ = J_i Z
    ζ ← ζ + Z J̄^# (v_i − J_i ζ)
    Z ← Z N,  N an orthonormal basis of the null space of J̄
"""

import math

import numpy as np
from scipy.linalg import lapack
from tp_controller.errors import SolverError, unknown
from tp_controller.level import identity, Level
from tp_controller.solution import Solution
from tp_controller.stacked import solve_stacked

METHODS = ('recursive', 'sequential')
SCALINGS = ('uniform',)
# A singular value of J P below this times ‖J‖ counts as zero. It must not be measured by J P
# itself: of a level that repeats the one above, J P is rounding errors only, and their inverse
# would be a velocity of 1e16.
RANK_TOLERANCE = 1e-9
# What a velocity exceeds its bound by, relative to the fastest joint, counts as rounding below
# this and is cut off. A joint that stands at its limit has the bound zero, and a residue of 1e-17
# towards the limit would stop the whole robot.
ROUNDING = 1e-9


def solve(levels, lower=None, upper=None, weights=None, damping=0.0, scaling='uniform', *,
          singular_region=math.inf, method='recursive', rank_tolerance=RANK_TOLERANCE):
    """
    Return the joint velocities that carry out prioritized tasks.

    Every level is met as well as the levels above it allow, in the sense of least squares, and
    among what is left the smallest velocity is taken. An empty list gives no motion.

    Parameters
    ----------
    levels : sequence of Level or (J, v)
        The highest priority first; J (m, n), v (m,). The arrays are kept, not copied, for
        `Solution.levels`.
    lower, upper : array_like (n,), optional
        Bounds on the velocity, with lower ≤ 0 ≤ upper; together or not at all.
    weights : array_like (n,), optional
        Cost of moving each joint, all positive: the higher, the less the joint is used
        (lecture 4). Only their ratios matter. The solution minimises Σ w_j q_dot_j².
    damping : float
        λ of the damped inverse s / (s² + λ²), in the units of J; 0 is exact and undamped.
    scaling : str
        ``uniform``: all velocities are divided by the same factor until the bounds hold
        (lecture 4), which keeps the direction of every task.
    singular_region : float
        Only directions whose singular value s is below this are damped, by
        λ² (1 − (s / singular_region)²), which grows from nothing where they enter it. Infinite:
        all directions are damped by λ², the damped least squares of the lecture.
    method : str
        ``recursive``, or ``sequential``: the slides' form (50), (51), for comparison. It keeps
        the first priority, but lower levels are not met even where they could be.
    rank_tolerance : float
        Singular values of J P below this times the Frobenius norm of J count as zero.

    Returns
    -------
    Solution

    Raises
    ------
    SolverError
        Shapes do not fit together, numbers are not finite, bounds exclude zero, a weight is
        not positive, or a method is unknown.

    References
    ----------
    lecture 2.2 (recursion), 4 (scaling, weights); notes (incremental form); slides (50), (51).

    """
    levels = [_check_level(level, index) for index, level in enumerate(levels)]
    n = _check_width(levels, weights if lower is None else lower)
    if lower is not None or upper is not None:
        lower, upper = _check_bounds(lower, upper, n)
    solver = Solver(n, weights, damping, scaling, singular_region, method, rank_tolerance)
    return solver.solve(levels, lower, upper)


class Solver:
    """
    `solve` with everything prepared that is the same in every cycle.

    Parameters
    ----------
    n : int
        Number of joints.
    weights, damping, scaling, singular_region, method, rank_tolerance
        See `solve`.

    Raises
    ------
    SolverError
        A weight is not positive, a number is negative, or a method or scaling is unknown.

    """

    def __init__(self, n, weights, damping, scaling, singular_region, method, rank_tolerance):
        for name, value in (('damping', damping), ('singular_region', singular_region),
                            ('rank_tolerance', rank_tolerance)):
            if isinstance(value, bool) or not isinstance(value, (int, float)) \
                    or not value >= 0.0 or (name != 'singular_region' and math.isinf(value)):
                raise SolverError(f'{name} must be a number that is not negative, not {value!r}')
        if method not in METHODS:
            raise SolverError(unknown('method', method, METHODS))
        if scaling not in SCALINGS:
            raise SolverError(unknown('scaling', scaling, SCALINGS))
        # ζ = W^{-1/2} u turns the weighted problem into an unweighted one in u, projector
        # included. Starting the recursion from Z = W^{-1/2} instead of I does exactly that.
        self._start = identity(n) if weights is None else np.diag(_column_scales(weights, n))
        self._can_stack = weights is None and method == 'recursive'
        self._recursion = _sequential if method == 'sequential' else _recursive
        self._damping, self._singular_region = damping, singular_region
        self._rank_tolerance = rank_tolerance

    def solve(self, levels, lower=None, upper=None):
        """
        Return the `Solution` for levels and bounds whose shapes fit together.

        Parameters
        ----------
        levels : list of Level
            The highest priority first.
        lower, upper : ndarray (n,), optional
            Bounds, lower ≤ 0 ≤ upper.

        Raises
        ------
        SolverError
            The levels hold numbers that are not finite.

        """
        velocity, ranks = None, None
        if self._can_stack:
            velocity = solve_stacked(levels, len(self._start), self._damping,
                                     self._singular_region)
        if velocity is None:
            velocity, ranks = self._recur(levels)
        if not math.isfinite(velocity.dot(velocity)):
            raise SolverError('the levels hold numbers that are not finite')
        scale, limiting = 1.0, None
        if lower is not None:
            velocity, scale, limiting = scale_uniformly(velocity, lower, upper)
        return Solution(velocity, scale, limiting, levels,
                        ranks or (lambda: self._recur(levels)[1]), self._start)

    def _recur(self, levels):
        """Return velocity and ranks by the recursion."""
        return self._recursion(levels, self._start, self._damping, self._singular_region,
                               self._rank_tolerance)


def _recursive(levels, start, damping, singular_region, rank_tolerance):
    """Return the velocity (n,), and rank and smallest singular value of each level."""
    zeta = np.zeros(len(start))
    Z = start
    ranks = []
    for level in levels:
        J_bar = level.J.dot(Z)
        inverse = _Inverse(J_bar, rank_tolerance * _frobenius(level.J.dot(start)))
        zeta = zeta + Z.dot(inverse.damped(level.v - level.J.dot(zeta), damping,
                                           singular_region))
        Z = Z.dot(inverse.null_space)
        ranks.append((inverse.rank, inverse.smallest))
    return zeta, ranks


def _sequential(levels, start, damping, singular_region, rank_tolerance):
    """Return what `_recursive` does, by successive projection (slides (50), (51))."""
    zeta = np.zeros(len(start))
    P = identity(len(start))
    ranks = []
    for level in levels:
        J = level.J.dot(start)
        inverse = _Inverse(J, rank_tolerance * _frobenius(J))
        zeta = zeta + P.dot(inverse.damped(level.v, damping, singular_region))
        P = P.dot(inverse.null_space.dot(inverse.null_space.T))
        ranks.append((inverse.rank, inverse.smallest))
    return start.dot(zeta), ranks


class _Inverse:
    """The singular value decomposition J̄ = U diag(s) Vᵀ, used as an inverse."""

    def __init__(self, J_bar, tolerance):
        rows, columns = J_bar.shape
        if rows == 0 or columns == 0:
            self.rank, self.smallest = 0, 0.0
            self.null_space = identity(columns)
            return
        U, s, V_T, info = lapack.dgesdd(J_bar)
        if info != 0:
            raise SolverError('a level holds numbers that are not finite')
        self.rank = int((s > tolerance).sum())
        self.smallest = float(s[rows - 1]) if rows <= columns else 0.0
        self._s = s[:self.rank]
        self._U = U[:, :self.rank]
        self._V_T = V_T[:self.rank]
        self.null_space = V_T[self.rank:].T

    def damped(self, v, damping, singular_region):
        """Return J̄^# v."""
        if self.rank == 0:
            if not np.isfinite(v).all():
                raise SolverError('a level holds numbers that are not finite')
            return np.zeros(len(self.null_space))
        gains = damped_inverse(self._s, damping, singular_region)
        return self._V_T.T.dot(gains * self._U.T.dot(v))


def damped_inverse(s, damping, singular_region):
    """
    Return the damped inverse of singular values, s / (s² + λ²) with λ only where it is needed.

    Parameters
    ----------
    s : ndarray (k,)
        Positive singular values.
    damping, singular_region : float
        See `solve`.

    Returns
    -------
    ndarray (k,)

    """
    if damping == 0.0 or singular_region == 0.0:
        return 1.0 / s
    needed = np.maximum(1.0 - (s / singular_region) ** 2, 0.0)
    return s / (s * s + damping * damping * needed)


def scale_uniformly(velocity, lower, upper):
    """
    Divide all velocities by the same factor until each is within its bounds (lecture 4).

    The lecture's bounds are symmetric, s = max |ζ_i| / ζ_i,max; here each velocity is compared
    with the bound on its own side.

    Parameters
    ----------
    velocity : ndarray (n,)
        Velocity that may be too fast.
    lower, upper : ndarray (n,)
        Bounds, lower ≤ 0 ≤ upper.

    Returns
    -------
    velocity : ndarray (n,)
        Within the bounds, exactly.
    scale : float
        1/s, in [0, 1].
    limiting : int or None
        Index of the joint that decided it.

    """
    if not (np.count_nonzero(velocity > upper) or np.count_nonzero(velocity < lower)):
        return velocity, 1.0, None
    bound = np.where(velocity > 0.0, upper, lower)
    size = np.abs(velocity)
    too_fast = size - np.abs(bound) > ROUNDING * size.max()
    if not too_fast.any():
        return np.clip(velocity, lower, upper), 1.0, None
    ratios = np.ones(len(velocity))
    np.divide(bound, velocity, out=ratios, where=too_fast)
    limiting = int(ratios.argmin())
    scale = float(ratios[limiting])
    # The products may miss their bounds by one rounding; these two lines take that away and no
    # more.
    scaled = np.clip(scale * velocity, lower, upper)
    scaled[limiting] = bound[limiting]
    return scaled, scale, limiting


def _check_level(level, index):
    """Return a level as `Level`, its shapes checked."""
    if not (isinstance(level, Level) and isinstance(level.J, np.ndarray)
            and isinstance(level.v, np.ndarray)):
        try:
            J, v = (level.J, level.v) if isinstance(level, Level) else level
            level = Level(np.asarray(J, dtype=float), np.asarray(v, dtype=float))
        except (TypeError, ValueError) as error:
            raise SolverError(f'level {index + 1}: needs J (m, n) and v (m,): {error}') from error
    if level.J.ndim != 2 or level.v.shape != (level.J.shape[0],):
        raise SolverError(f'level {index + 1}: J must be (m, n) and v (m,), '
                          f'got {level.J.shape} and {level.v.shape}')
    if not (np.isfinite(level.J).all() and np.isfinite(level.v).all()):
        raise SolverError(f'level {index + 1}: the levels hold numbers that are not finite')
    return level


def _check_width(levels, others):
    """Return n, the number of joints that all levels agree on."""
    n = levels[0].J.shape[1] if levels else 0 if others is None else len(others)
    for level in levels:
        if level.J.shape[1] != n:
            raise SolverError('levels disagree on the number of joints: '
                              f'{[level.J.shape[1] for level in levels]}')
    return n


def _check_bounds(lower, upper, n):
    """Return the bounds as arrays (n,) with lower ≤ 0 ≤ upper."""
    if lower is None or upper is None:
        raise SolverError('bounds need lower and upper together')
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if lower.shape != (n,) or upper.shape != (n,):
        raise SolverError(f'bounds must be {n} numbers each, got shapes {lower.shape} and '
                          f'{upper.shape}')
    if np.count_nonzero(lower <= 0.0) < n or np.count_nonzero(upper >= 0.0) < n:
        raise SolverError('bounds must hold zero, lower ≤ 0 ≤ upper, got '
                          f'{lower.tolist()} and {upper.tolist()}')
    return lower, upper


def _column_scales(weights, n):
    """Return the diagonal of W^{-1/2}, its largest entry 1 so that λ keeps its meaning."""
    weights = np.asarray(weights, dtype=float)
    if weights.shape != (n,) or not (weights > 0.0).all() or not np.isfinite(weights).all():
        raise SolverError(f'weights must be {n} positive numbers, got {weights.tolist()}')
    return np.sqrt(weights.min() / weights)


def _frobenius(J):
    """Return the Frobenius norm."""
    entries = J.ravel('K')
    return math.sqrt(entries.dot(entries))
