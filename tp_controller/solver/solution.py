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

"""What the solver returns."""

from functools import cached_property

import numpy as np

# A multiplier below this share of the largest one is rounding.
NEGLIGIBLE_MULTIPLIER = 1e-9
SMALLEST_MULTIPLIER = 1e-12
# A velocity below this has no direction.
SMALLEST_SPEED = 1e-12
# Directions are taken for different above this, relatively.
INDEPENDENT = 1e-9
# Up to this share off the wish a direction counts as undamped.
UNDAMPED = 1e-12


class Stage:
    """
    How one level was carried out, before the levels below it.

    Attributes
    ----------
    velocity : ndarray (n,)
        Joint velocities after the level.
    projection : Projection or None
        None for a level with bounds.
    multipliers : ndarray (n,) or None
        Of the bounds on the joints; None where none was in the way.
    row_multipliers : ndarray (r,) or None
        The same for the rows of all levels with bounds down to this one, in order.


    """

    __slots__ = ('velocity', 'projection', 'multipliers', 'row_multipliers')

    def __init__(self, velocity, projection=None, multipliers=None, row_multipliers=None):
        self.velocity, self.projection = velocity, projection
        self.multipliers, self.row_multipliers = multipliers, row_multipliers


class LevelSolution:
    """
    How far one level was carried out, and what stood in the way.

    Everything beyond these attributes is worked out when it is asked for, from what the solver
    knows already.

    Attributes
    ----------
    wanted : ndarray (m,)
        Task velocity that was asked for; of a level with bounds, the one within them that is
        nearest to `achieved`.
    achieved : ndarray (m,)
        J q_dot, with the velocity that was returned.

    """

    def __init__(self, index, solution):
        self._index, self._solution = index, solution
        self._stage = solution.stages[index]
        self._level = level = solution.hierarchy[index]
        self.achieved = level.J.dot(solution.velocity)
        self.wanted = level.v if level.v is not None else np.minimum(
            np.maximum(self.achieved, level.lower), level.upper)

    @property
    def residual(self):
        """Return wanted − achieved (m,)."""
        return self.wanted - self.achieved

    @property
    def velocity(self):
        """Return the joint velocities (n,) after this level, before those below and scaling."""
        return self._stage.velocity

    # What the level can do without bounds

    @property
    def _projection(self):
        """Return the `Projection` of the level where nothing is bounded."""
        return self._solution.unbounded[self._index].projection

    @property
    def rank(self):
        """
        Return how many directions of the level the levels above left it.

        0 for a level with bounds, which takes none away.
        """
        return 0 if self._projection is None else self._projection.rank

    @property
    def smallest_singular_value(self):
        """
        Return the m-th singular value of J P, P the projector on what the levels above left.

        It is 0 where the level cannot move in some direction at all, small near a singularity.
        """
        return 0.0 if self._projection is None else self._projection.smallest

    @property
    def unreachable(self):
        """Return the part of `wanted` (m,) that the level could not have without bounds either."""
        projection = self._projection
        if projection is None:
            return np.zeros(len(self.wanted))
        missing = self._level.v
        if self._index:
            missing = missing - self._level.J.dot(self._solution.stages[self._index - 1].velocity)
        return missing - projection.U.dot(
            projection.s * projection.gains * projection.U.T.dot(missing))

    @property
    def weak_directions(self):
        """Return the singular values (k,) and task directions (m, k) that are damped."""
        projection = self._projection
        if projection is None:
            return np.zeros(0), np.zeros((len(self.wanted), 0))
        damped = projection.s * projection.gains < 1.0 - UNDAMPED
        return projection.s[damped], projection.U[:, damped]

    @property
    def blocked_by(self):
        """
        Return the shares (index,) that the levels above have in what this one cannot do.

        Each level above has taken some motions of the joints away. Shares are those of the
        motion that would take the residual away, Jᵀ residual, squared; what is missing to 1 is
        free, or was damped, or is held by bounds.
        """
        start = np.diagonal(self._solution.start)
        motion = start * self._level.J.T.dot(self.residual)
        size = motion.dot(motion)
        shares = np.zeros(self._index)
        if size > 0.0:
            for index, stage in enumerate(self._solution.unbounded[:self._index]):
                projection = stage.projection
                if projection is not None:
                    taken = projection.directions[:, :projection.rank].T.dot(motion / start)
                    shares[index] = taken.dot(taken) / size
        return shares

    # What bounds stood in its way

    @cached_property
    def scale(self):
        """
        Return the share, in [0, 1], of the velocity it would have that bounds leave the level.

        Along the direction of that velocity; before the levels below.
        """
        if self._solution.slowed < 1.0:
            return self._solution.slowed
        if self._level.v is None or not self._solution.bounded:
            return 1.0
        possible = self._level.v - self.unreachable
        size = possible.dot(possible)
        if size <= SMALLEST_SPEED ** 2:
            return 1.0
        return min(max(float(possible.dot(self._level.J.dot(self.velocity))) / size, 0.0), 1.0)

    @property
    def multipliers(self):
        """
        Return the multipliers of the bounds on the joints (n,), zero where none is in the way.

        Positive for an upper bound, negative for a lower one. Widening the bound by ε lets
        ½ ‖residual‖² of the level, as it was before the levels below, fall by |multiplier| ε.
        With uniform scaling only the joint that decided it has one, ±1.
        """
        found = self._stage.multipliers
        return np.zeros(len(self.velocity)) if found is None else found

    @property
    def limited_by(self):
        """Return the joints whose bounds are in the way, as indices, the strongest first."""
        size = np.abs(self.multipliers)
        least = max(NEGLIGIBLE_MULTIPLIER * size.max(initial=0.0), SMALLEST_MULTIPLIER)
        return [int(joint) for joint in np.argsort(-size, kind='stable') if size[joint] > least]

    @property
    def limited_velocity(self):
        """Return the joint velocities (n,) at which bounds stood in the way of the level."""
        return self._solution.velocity if self._solution.slowed < 1.0 else self.velocity

    @property
    def row_multipliers(self):
        """
        Return {index of a level with bounds: multipliers (m,)} of those in the way of this one.

        Levels above it, or the level itself; signs as for `multipliers`.
        """
        found, first = {}, 0
        if self._stage.row_multipliers is None:
            return found
        for index, level in enumerate(self._solution.hierarchy[:self._index + 1]):
            if level.v is None:
                rows = self._stage.row_multipliers[first:first + len(level.J)]
                if rows.any():
                    found[index] = rows
                first += len(level.J)
        return found

    # What the levels below do to it

    @property
    def disturbance(self):
        """Return what the levels below add to the task velocity (m,)."""
        return self._level.J.dot(self._added())

    @property
    def disturbance_bound(self):
        """
        Return the most that the levels below may add, as a norm; 0 where nothing is released.

        It is the largest singular value of the level on what it left them, below the release
        region, times the speed of the joints that they add.
        """
        projection = self._stage.projection
        if projection is None or not projection.released:
            return 0.0
        sizes = np.linalg.norm(projection.remaining, axis=0)
        left = projection.remaining[:, sizes > 0.0] / sizes[sizes > 0.0]
        basis, s, _ = np.linalg.svd(left, full_matrices=False)
        basis = basis[:, s > INDEPENDENT * s[0]]
        return float(np.linalg.norm(self._level.J.dot(basis), 2)
                     * np.linalg.norm(self._added()))

    def _added(self):
        """Return the joint velocities that the levels below add (n,)."""
        return self._solution.slowed * (self._solution.whole - self.velocity)


class Solution:
    """
    The answer of the solver.

    Attributes
    ----------
    velocity : ndarray (n,)
        Joint velocities (quasi-velocities where a base is involved).
    levels : tuple of LevelSolution
        Evaluated when it is first asked for.
    hierarchy : list of Level
        What was asked for.
    start : ndarray (n, n)
        W^{-1/2}.
    whole, slowed : ndarray (n,), float
        Velocities before uniform scaling, and its factor; `velocity` and 1 without it.

    """

    def __init__(self, velocity, hierarchy, start, unbounded, stages=None, whole=None,
                 slowed=1.0):
        self.velocity = velocity
        self.hierarchy = hierarchy
        self.start = start
        self.whole, self.slowed = velocity if whole is None else whole, slowed
        # A list, or the function that makes it: the fast path does not need to know.
        self._unbounded = unbounded
        self._stages = stages

    def moved_to(self, velocity):
        """Return the same solution with another velocity."""
        return Solution(velocity, self.hierarchy, self.start, self._unbounded, self._stages,
                        self.whole, self.slowed)

    @cached_property
    def unbounded(self):
        """Return the `Stage` of each level in the recursion without bounds."""
        return self._unbounded() if callable(self._unbounded) else self._unbounded

    @property
    def bounded(self):
        """Return whether bounds were in the way."""
        return self._stages is not None

    @property
    def stages(self):
        """Return the `Stage` of each level within the bounds."""
        return self.unbounded if self._stages is None else self._stages

    def singular_values_alone(self, index):
        """Return the singular values of a level as if there were no other, weights included."""
        return np.linalg.svd(self.hierarchy[index].J.dot(self.start), compute_uv=False)

    @property
    def scale(self):
        """Return the smallest share, in [0, 1], that bounds on the joints leave a level."""
        return min((level.scale for level in self.levels), default=1.0)

    @property
    def limiting(self):
        """Return the joint whose bound stands most in the way; None where none does."""
        return next((level.limited_by[0] for level in self.levels if level.limited_by), None)

    @cached_property
    def levels(self):
        """Return what was wanted, achieved and possible, level by level."""
        return tuple(LevelSolution(index, self) for index in range(len(self.hierarchy)))
