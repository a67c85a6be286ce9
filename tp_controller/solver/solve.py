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

Where the result is within the bounds on the velocities it is the answer. Where not, either all
velocities are divided by one factor (lecture 4), or the levels are solved again within the
bounds (`tp_controller.solver.bounded_hierarchy`).
"""

from functools import partial
import math
from numbers import Real

import numpy as np
from tp_controller.solver.bounded_hierarchy import clip, meets, redistribute, within
from tp_controller.solver.errors import SolverError, unknown
from tp_controller.solver.level import check_bounds, check_levels, identity
from tp_controller.solver.min_norm import solve_stacked
from tp_controller.solver.null_space import Damping, frobenius, Projection
from tp_controller.solver.scaling import scale_uniformly
from tp_controller.solver.solution import Solution, Stage

METHODS = ('recursive', 'sequential')
SCALINGS = ('redistribute', 'uniform')
# A singular value of J P below this times ‖J‖ counts as zero. It must not be measured by J P
# itself: of a level that repeats the one above, J P is rounding errors only, and their inverse
# would be a velocity of 1e16.
RANK_TOLERANCE = 1e-9
# λ and ε of levels with bounds, as a share of a row: where the levels above leave so little of it,
# less is asked for, or the joints would race for hardly any gain.
ROW_DAMPING = 0.1


def solve(levels, lower=None, upper=None, weights=None, damping=0.0, scaling='uniform', *,
          singular_region=math.inf, release_region=0.0, regularisation=0.0, period=0.0,
          speed_cap=None, method='recursive', rank_tolerance=RANK_TOLERANCE):
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
        Bounds on the velocity, lower ≤ upper. They may exclude zero.
    weights : array_like (n,), optional
        Cost of moving each joint, all positive: the higher, the less the joint is used
        (lecture 4). Only their ratios matter. The solution minimises Σ w_j q_dot_j².
    damping : float
        λ of the damped inverse s / (s² + λ²), in the units of J; 0 is exact and undamped.
    scaling : str
        What is done where a velocity exceeds its bounds. ``redistribute``: every level is solved
        within them, so that other joints take over, and lower levels give way before higher
        ones. ``uniform``: all velocities are divided by the same factor until the bounds hold
        (lecture 4), which keeps the direction of every task.
    singular_region : float
        Only directions whose singular value s is below this are damped, by
        λ² (1 − (s / singular_region)²), which grows from nothing where they enter it. Infinite:
        all directions are damped by λ², the damped least squares of the lecture.
    release_region : float
        Directions whose singular value is below this are given up to the levels below, smoothly,
        and wholly below a tenth of it. 0: never.
    regularisation : float
        With ``redistribute``: what keeps the answer from jumping from one corner of the bounds
        to another, in the units of J; 0 is exact.
    period : float
        How long the velocity will be held [s]. Damping and regularisation are raised as far as
        that needs, so that the robot does not swing about a singularity; see
        `tp_controller.solver.null_space.Damping`. 0: not at all.
    speed_cap : array_like (n,), optional
        With ``redistribute``: speed up to which the levels below the first may use a joint.
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
        Shapes do not fit together, numbers are not finite, bounds contradict themselves, a
        weight is not positive, or options are unknown or do not go together.

    References
    ----------
    lecture 2.2 (recursion), 4 (scaling, weights); notes (incremental form); slides (50), (51).

    """
    levels = check_levels(levels)
    others = next((given for given in (weights, lower, upper) if given is not None), ())
    n = levels[0].J.shape[1] if levels else len(others)
    if lower is not None or upper is not None:
        lower, upper = check_bounds(lower, upper, n, 'joints')
    if speed_cap is not None:
        if scaling != 'redistribute':
            raise SolverError('speed_cap needs scaling redistribute')
        speed_cap = check_bounds(None, speed_cap, n, 'speed_cap')[1]
        if not (speed_cap >= 0.0).all():
            raise SolverError(f'speed_cap must not be negative, got {speed_cap.tolist()}')
    solver = Solver(n, weights, damping=damping, scaling=scaling, singular_region=singular_region,
                    release_region=release_region, regularisation=regularisation, period=period,
                    method=method, rank_tolerance=rank_tolerance)
    return solver.solve(levels, lower, upper, speed_cap)


class Solver:
    """
    `solve` with everything prepared that is the same in every cycle.

    Parameters
    ----------
    n : int
        Number of joints.
    weights, damping, scaling, singular_region, release_region, regularisation, period, \
method, rank_tolerance
        See `solve`.

    Raises
    ------
    SolverError
        A weight is not positive, a number is negative, or a method or scaling is unknown.

    """

    def __init__(self, n, weights=None, *, damping, scaling, singular_region, release_region,
                 regularisation, period, method, rank_tolerance):
        _check_numbers(damping=damping, singular_region=singular_region,
                       release_region=release_region, regularisation=regularisation,
                       period=period, rank_tolerance=rank_tolerance)
        if method not in METHODS:
            raise SolverError(unknown('method', method, METHODS))
        if scaling not in SCALINGS:
            raise SolverError(unknown('scaling', scaling, SCALINGS))
        if method == 'sequential' and scaling != 'uniform':
            raise SolverError('method sequential goes with scaling uniform only')
        # ζ = W^{-1/2} u turns the weighted problem into an unweighted one in u, projector
        # included. Starting the recursion from Z = W^{-1/2} instead of I does exactly that.
        self._start = identity(n) if weights is None else np.diag(_column_scales(weights, n))
        self._unweighted = weights is None
        # What is released is damped as well, or else only the recursion knows of it.
        releasing = release_region > 0.0 and (damping == 0.0 or release_region > singular_region)
        self._can_stack = self._unweighted and method == 'recursive' and not releasing
        self._recursion = _sequential if method == 'sequential' else _recursive
        self._uniform = scaling == 'uniform'
        self._damping = Damping(damping, singular_region, period)
        self._row_damping = 0.0 if damping == 0.0 or singular_region == 0.0 else ROW_DAMPING
        self._release_region = release_region
        self._regularisation, self._period = regularisation, period
        self._rank_tolerance = rank_tolerance
        self._no_bounds = np.full(n, -np.inf), np.full(n, np.inf)
        # Redistribution needs the recursion; where bounds were in the way they mostly are again.
        self._redistributed = False

    def hold(self, period):
        """Take another period [s] from now on."""
        self._period = period
        self._damping.hold(period)

    def solve(self, levels, lower=None, upper=None, speed_cap=None):
        """
        Return the `Solution` for levels and bounds whose shapes fit together.

        Parameters
        ----------
        levels : list of Level
            The highest priority first.
        lower, upper : ndarray (n,), optional
            Bounds, lower ≤ upper.
        speed_cap : ndarray (n,), optional
            See `solve`.

        Raises
        ------
        SolverError
            The levels hold numbers that are not finite.

        """
        asking = [level for level in levels if level.v is not None]
        rows = () if len(asking) == len(levels) else [
            level for level in levels if level.v is None]
        if rows and self._recursion is _sequential:
            raise SolverError('method sequential knows no levels with bounds')
        velocity = None
        if self._can_stack and not self._redistributed:
            velocity = solve_stacked(asking, len(self._start), self._damping)
            unbounded = partial(self._recur, levels)
        self._redistributed = False
        if velocity is None:
            unbounded = self._recur(levels)
            velocity = unbounded[-1].velocity if unbounded else np.zeros(len(self._start))
        if not math.isfinite(velocity.dot(velocity)):
            raise SolverError('the levels hold numbers that are not finite')
        if lower is None and not rows and speed_cap is None:
            return Solution(velocity, levels, self._start, unbounded)
        bounds = self._no_bounds
        if lower is not None and not self._uniform:
            bounds = lower, upper
        elif lower is not None and rows:
            # Uniform scaling comes afterwards.
            bounds = _enlarged(velocity, lower, upper)
        shared = bounds if speed_cap is None or self._uniform or len(asking) < 2 else (
            clip(-speed_cap, *bounds), clip(speed_cap, *bounds))
        fitting, stages = within(velocity, *shared), None
        if fitting is None or not all(meets(level, fitting) for level in rows):
            self._redistributed = True
            unbounded = unbounded() if callable(unbounded) else unbounded
            fitting, stages = redistribute(levels, unbounded, self._start, bounds, shared,
                                           self._regularisation, self._period, self._row_damping)
        solution = Solution(fitting, levels, self._start, unbounded, stages)
        if self._uniform and lower is not None:
            return self._scaled(solution, lower, upper)
        return solution

    def _scaled(self, solution, lower, upper):
        """Return a solution with all joints slowed alike."""
        scaled, scale, limiting = scale_uniformly(solution.velocity, lower, upper)
        if limiting is None:
            return solution.moved_to(scaled)
        multipliers = np.zeros(len(scaled))
        multipliers[limiting] = 1.0 if scaled[limiting] == upper[limiting] else -1.0
        stages = [Stage(stage.velocity, stage.projection, multipliers, stage.row_multipliers)
                  for stage in solution.stages]
        return Solution(scaled, solution.hierarchy, self._start, solution.unbounded, stages,
                        solution.velocity, scale)

    def _recur(self, levels):
        """Return a `Stage` for each level by the recursion, without bounds."""
        return self._recursion(levels, self._start, self._project)

    def _project(self, level, Z, orthonormal):
        """Return the `Projection` of a level on what Z spans."""
        weighted = level.J if self._unweighted else level.J.dot(self._start)
        return Projection(level, Z, orthonormal and self._unweighted,
                          self._rank_tolerance * frobenius(weighted), self._damping,
                          self._release_region)


def _recursive(levels, start, project):
    """Return a `Stage` for each level; the last one has the velocity that is wanted."""
    zeta = np.zeros(len(start))
    Z, orthonormal = start, True
    stages = []
    for level in levels:
        projection = None
        if level.v is not None:
            projection = project(level, Z, orthonormal)
            zeta = zeta + projection.step(level.v - level.J.dot(zeta))
            Z, orthonormal = projection.remaining, projection.orthonormal
        stages.append(Stage(zeta, projection))
    return stages


def _sequential(levels, start, project):
    """Return what `_recursive` does, by successive projection (slides (50), (51))."""
    zeta = np.zeros(len(start))
    P = identity(len(start))
    cost = np.diagonal(start) ** 2
    stages = []
    for level in levels:
        projection = project(level, start, True)
        zeta = zeta + P.dot(projection.step(level.v))
        P = P.dot(projection.remaining.dot(projection.remaining.T / cost))
        stages.append(Stage(zeta, projection))
    return stages


def _enlarged(velocity, lower, upper):
    """
    Return bounds for what is scaled uniformly afterwards, as far as a velocity has to be anyway.

    Within them the bounds of levels make no joint so fast that all are slowed more for it.
    """
    largest = np.maximum(-lower, upper)
    largest[largest <= 0.0] = np.inf
    largest *= max(1.0, (np.abs(velocity) / largest).max(initial=0.0))
    return -largest, largest


def _check_numbers(**numbers):
    """Raise `SolverError` unless all are finite and not negative; one region may be infinite."""
    for name, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, Real) or not value >= 0.0 \
                or (name != 'singular_region' and math.isinf(value)):
            raise SolverError(f'{name} must be a number that is not negative, not {value!r}')


def _column_scales(weights, n):
    """Return the diagonal of W^{-1/2}, its largest entry 1 so that λ keeps its meaning."""
    try:
        weights = np.asarray(weights, dtype=float)
    except (TypeError, ValueError) as error:
        raise SolverError(f'weights must be {n} positive numbers: {error}') from error
    if weights.shape != (n,) or not (weights > 0.0).all() or not np.isfinite(weights).all():
        raise SolverError(f'weights must be {n} positive numbers, got {weights.tolist()}')
    return np.sqrt(weights.min() / weights)
