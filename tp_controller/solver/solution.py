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

"""Solution of the solver, with the results of its levels."""

from functools import cached_property
from typing import Protocol
from warnings import warn

import numpy as np
from tp_controller.solver.bounded_hierarchy import BoundedHierarchy, LevelStep
from tp_controller.solver.damping import Damping, Memory
from tp_controller.solver.level import Array, Level, NEGLIGIBLE, ROUNDING
from tp_controller.solver.polytope import Polytope


class LevelSolution:
    """
    Result of one level: velocity, residual, limits and disturbance.

    Every value is computed on access, from the results of the solver.

    """

    def __init__(self, index: int, solution: 'Solution') -> None:
        self._index, self._solution, self._level = index, solution, solution.hierarchy[index]

    @cached_property
    def _step(self) -> LevelStep:
        """Return the step of the level."""
        return self._solution.step(self._index)

    @cached_property
    def achieved(self) -> Array:
        """Return J q_dot (m,) at the velocity of the solution."""
        return self._level.J.dot(self._solution.velocity)

    @property
    def demand(self) -> Array:
        """Return the demanded velocity (m,), or `achieved` clamped to the bounds."""
        return self._level.demanded(self.achieved)

    @property
    def wanted(self) -> Array:
        """Return `demand` (m,): the former name, deprecated."""
        warn('LevelSolution.wanted is called demand', DeprecationWarning, stacklevel=2)
        return self.demand

    @property
    def residual(self) -> Array:
        """Return demand − achieved (m,)."""
        return self.demand - self.achieved

    @property
    def velocity(self) -> Array:
        """Return the joint velocities (n,) after this level, before those below and scaling."""
        return self._step.velocity

    # Velocity without bounds

    @property
    def rank(self) -> int:
        """
        Return the rank of the level in the null space of the levels above.

        0 for a level with bounds, which does not reduce the null space.
        """
        return 0 if self._step.directions is None else self._step.directions.rank

    @property
    def smallest_singular_value(self) -> float:
        """
        Return the m-th singular value of J P, P the null-space projector of the levels above.

        It is 0 if the level cannot move in some direction at all, small near a singularity.
        """
        return 0.0 if self._step.directions is None else self._step.directions.smallest

    @property
    def unreachable(self) -> Array:
        """Return the part of `demand` (m,) that is unreachable even without bounds."""
        if self._step.directions is None:
            return np.zeros(len(self.demand))
        missing = self.demand
        if any(level.v is not None for level in self._solution.hierarchy[:self._index]):
            missing = missing - self._level.J.dot(self._solution.step(self._index - 1).velocity)
        U = self._step.directions.U
        return missing - U.dot(self._step.followed * U.T.dot(missing))

    # Limits of the level

    @cached_property
    def scale(self) -> float:
        """
        Return the share, in [0, 1], that bounds leave of the velocity without them.

        It is measured along the direction of that velocity, before the levels below.
        """
        if self._solution.slowed < 1.0:
            return self._solution.slowed
        if self._level.v is None or not self._solution.bounded:
            return 1.0
        possible = self._level.v - self.unreachable
        size = possible.dot(possible)
        if size <= ROUNDING ** 2:
            return 1.0
        share = float(possible.dot(self._level.J.dot(self.velocity))) / size
        return 1.0 if share > 1.0 - NEGLIGIBLE else max(share, 0.0)

    @property
    def multipliers(self) -> Array:
        """
        Return the multipliers of the bounds on the joints (n,), zero where none is active.

        Positive for an upper bound, negative for a lower one. Widening the bound by ε reduces
        ½ ‖residual‖² of the level, before the levels below, by abs(multiplier) ε. With uniform
        scaling only the limiting joint has a multiplier, ±1.
        """
        found = self._step.multipliers
        return np.zeros(len(self.velocity)) if found is None else found

    @cached_property
    def limited_by(self) -> list[int]:
        """Return the indices of the joints whose bounds limit the level, the strongest first."""
        if self._step.multipliers is None:
            return []
        size = list(map(abs, self._step.multipliers.tolist()))
        least = max(NEGLIGIBLE * max(size, default=0.0), ROUNDING)
        return sorted((joint for joint, each in enumerate(size) if each > least),
                      key=lambda joint: -size[joint])

    @property
    def limited_velocity(self) -> Array:
        """Return the joint velocities (n,) at which bounds limited the level."""
        return self._solution.velocity if self._solution.slowed < 1.0 else self.velocity

    @property
    def row_multipliers(self) -> dict[int, Array]:
        """
        Return the multipliers (m,) of the levels with bounds that limit this one, by index.

        They are levels above it, or the level itself; signs as for `multipliers`.
        """
        found: dict[int, Array] = {}
        first = 0
        if self._step.row_multipliers is None:
            return found
        for index, level in enumerate(self._solution.hierarchy[:self._index + 1]):
            if level.v is None:
                rows = self._step.row_multipliers[first:first + len(level.J)]
                if np.abs(rows).max(initial=0.0) > ROUNDING:
                    found[index] = rows
                first += len(level.J)
        return found

    # Disturbance by the levels below

    @property
    def disturbance(self) -> Array:
        """Return the task velocity (m,) that the levels below add."""
        return self._level.J.dot(self._added())

    @property
    def disturbance_bound(self) -> float:
        """
        Return an upper bound of the norm of the disturbance; 0 without relaxed directions.

        It is the largest singular value of the level in the null space left to them, below
        `release_region`, times the norm of the joint velocities that they add.
        """
        if self._step.relaxed is None:
            return 0.0
        sizes = np.linalg.norm(self._step.relaxed, axis=0)
        left = self._step.relaxed[:, sizes > 0.0] / sizes[sizes > 0.0]
        basis, s, _ = np.linalg.svd(left, full_matrices=False)
        basis = basis[:, s > NEGLIGIBLE * s[0]]
        return float(np.linalg.norm(self._level.J.dot(basis), 2)
                     * np.linalg.norm(self._added()))

    def _added(self) -> Array:
        """Return the joint velocities that the levels below add (n,)."""
        return self._solution.slowed * (self._solution.whole - self.velocity)


class Steps(Protocol):
    """Steps of the levels, recorded by the compiled core."""

    def step(self, index: int) -> LevelStep:
        """Return the step of a level."""

    def bends(self) -> list[float]:
        """Return `LevelStep.bend` of each level."""


class Solution:
    """
    Solution of the levels in one cycle.

    Attributes
    ----------
    velocity : ndarray (n,)
        Joint velocities (quasi-velocities where a base is involved).
    memory : tuple of float
        State for the next cycle: h of each level (`tp_controller.solver.damping`).
    hierarchy : list of Level
        Levels that were solved.
    whole, slowed : ndarray (n,), float
        Velocities before uniform scaling, and its factor; `velocity` and 1 without it.

    """

    def __init__(self, velocity: Array, hierarchy: list[Level], memory: Memory,
                 steps: list[LevelStep] | Steps | None = None, whole: Array | None = None,
                 slowed: float = 1.0) -> None:
        self.velocity, self.hierarchy, self.memory = velocity, hierarchy, memory
        self.whole, self.slowed = velocity if whole is None else whole, slowed
        self._steps = steps

    def moved_to(self, velocity: Array) -> 'Solution':
        """Return the same solution with another velocity."""
        return Solution(velocity, self.hierarchy, self.memory, self._steps, self.whole,
                        self.slowed)

    def step(self, index: int) -> LevelStep:
        """Return the step of a level."""
        if self._steps is None or isinstance(self._steps, list):
            return self.steps[index]
        return self._steps.step(index)

    @cached_property
    def steps(self) -> list[LevelStep]:
        """Return the steps of all levels."""
        if isinstance(self._steps, list):
            return self._steps
        if self._steps is not None:
            return [self._steps.step(index) for index in range(len(self.hierarchy))]
        # No direction was damped, and no bound active.
        infinite = np.full(len(self.velocity), np.inf)
        recursion = BoundedHierarchy(Polytope(-infinite, infinite), Damping())
        return [LevelStep(recursion.x) if level.v is None else recursion.carry_out(level, 0.0)
                for level in self.hierarchy]

    @property
    def bends(self) -> list[float]:
        """Return h of this cycle alone (`tp_controller.solver.damping`), of each level."""
        if self._steps is None or isinstance(self._steps, list):
            return [step.bend for step in self.steps]
        return self._steps.bends()

    @property
    def bounded(self) -> bool:
        """Return whether bounds were active."""
        return self._steps is not None and any(
            step.multipliers is not None for step in self.steps)

    def singular_values_alone(self, index: int) -> Array:
        """Return the singular values of a level on its own."""
        return np.asarray(np.linalg.svd(self.hierarchy[index].J, compute_uv=False), float)

    @property
    def scale(self) -> float:
        """Return the smallest share, in [0, 1], that bounds leave a level."""
        return min((level.scale for level in self.levels), default=1.0)

    @property
    def limiting(self) -> int | None:
        """Return the index of the joint whose bound limits most; None if no bound limits."""
        if not self.bounded:
            return None
        return next((level.limited_by[0] for level in self.levels if level.limited_by), None)

    @cached_property
    def levels(self) -> tuple[LevelSolution, ...]:
        """Return the results of all levels."""
        return tuple(LevelSolution(index, self) for index in range(len(self.hierarchy)))
