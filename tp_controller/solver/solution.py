# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Contract of a solver: what it gets, and what it returns.

A `Solver` gets levels and `Bounds`, and returns a `Solution`. Whatever a report asks of a solution
is here; it follows from one `LevelStep` for each level, whose fields a solver may leave out.
"""

from functools import cached_property
from typing import NamedTuple, Protocol, TypeAlias
from warnings import warn

import numpy as np
from tp_controller.solver.level import Array, identity, Level, NEGLIGIBLE, norm, ROUNDING
from tp_controller.solver.min_norm import moves_well
from tp_controller.solver.null_space import decompose, Directions, excluded, projection

# State of a solver between two cycles: one number for each level, 0 where nothing is remembered.
Memory: TypeAlias = tuple[float, ...]


class Bounds:
    """
    Bounds on the velocity of one cycle.

    Attributes
    ----------
    lower, upper : ndarray (n,)
        Least and largest velocities, lower ≤ upper; they may exclude zero.
    cap : ndarray (n,) or None
        Speed up to which the levels below the first may use a joint.
    hold : float
        Duration for which the velocity is in force [s]; 0: no matter how long.

    """

    def __init__(self, lower: Array, upper: Array, cap: Array | None = None,
                 hold: float = 0.0) -> None:
        self.lower, self.upper, self.cap, self.hold = lower, upper, cap, hold


class LevelStep(NamedTuple):
    """
    Result of one level, before the levels below it.

    Attributes
    ----------
    velocity : ndarray (n,)
        Joint velocities after the level.
    directions : Directions or None
        None for a level with bounds; if a solver leaves it out, it is computed from the levels.
    followed : ndarray (rank,)
        Share of the demand that damping leaves in each direction; empty: all of it.
    relaxed : ndarray (n, k) or None
        Basis of the null space left to the levels below; None without relaxed directions.
    multipliers, row_multipliers : ndarray (n,), (r,), or None
        Multipliers of the joint bounds, and of the rows of all levels with bounds down to this
        one; None if no bound was active.
    bend : float
        Part of the memory of the level that follows from this cycle alone; in this package h, see
        `damping`.
    origin : ndarray (n,) or None
        Velocities at which the step of the level begins; None: those after the level above.

    """

    velocity: Array
    directions: Directions | None = None
    followed: Array = np.zeros(0)
    relaxed: Array | None = None
    multipliers: Array | None = None
    row_multipliers: Array | None = None
    bend: float = 0.0
    origin: Array | None = None


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
    def _directions(self) -> Directions | None:
        """Return the directions of the level; None for one with bounds."""
        if self._level.v is None or self._step.directions is not None:
            return self._step.directions
        return self._solution.free_steps[self._index].directions

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
        Return the rank of the level in the null space of the levels above, with its joints.

        0 for a level with bounds, which does not reduce the null space.
        """
        return 0 if self._directions is None else self._directions.rank

    @property
    def smallest_singular_value(self) -> float:
        """
        Return the m-th singular value of J P, P the projector on what the level may move.

        It is 0 if the level cannot move in some direction at all, small near a singularity.
        """
        return 0.0 if self._directions is None else self._directions.smallest

    @property
    def unreachable(self) -> Array:
        """Return the part of `demand` (m,) that is unreachable even without bounds."""
        if self._directions is None:
            return np.zeros(len(self.demand))
        missing, origin = self.demand, self._step.origin
        if origin is None and any(
                level.v is not None for level in self._solution.hierarchy[:self._index]):
            origin = self._solution.step(self._index - 1).velocity
        if origin is not None:
            missing = missing - self._level.J.dot(origin)
        U, followed = self._directions.U, self._step.followed
        along = missing.dot(projection(self._level, self._directions))
        return missing - U.dot(followed * along if len(followed) else along)

    @property
    def singular_values_alone(self) -> Array:
        """Return the singular values of the level by itself, the largest first."""
        return np.asarray(np.linalg.svd(self._level.J, compute_uv=False), float)

    @property
    def rank_alone(self) -> int:
        """Return the rank of the level by itself."""
        return int(np.count_nonzero(self.singular_values_alone > NEGLIGIBLE * norm(self._level.J)))

    @property
    def is_damped(self) -> bool:
        """Return whether damping or relaxed directions may be why the level has a residual."""
        step = self._step
        # Bounds of levels that cannot be satisfied are damped, too.
        return self.is_relaxed \
            or self._level.v is None and step.multipliers is not None \
            or min(step.followed.tolist(), default=1.0) < 1.0 - NEGLIGIBLE

    @property
    def is_relaxed(self) -> bool:
        """Return whether directions of the level are left to the levels below."""
        return self._step.relaxed is not None

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
        scaling they are signs: ±1 for the limiting joint, and ±½ for limits that act on levels
        with bounds before the scaling.
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
        return self._level.J.dot(self.added)

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
                     * np.linalg.norm(self.added))

    @property
    def added(self) -> Array:
        """Return the joint velocities that the levels below add (n,)."""
        return self._solution.slowed * (self._solution.whole - self.velocity)


class Steps(Protocol):
    """Steps of the levels that are read on access."""

    def step(self, index: int) -> LevelStep:
        """Return the step of a level."""

    def bends(self) -> list[float]:
        """Return `LevelStep.bend` of each level."""


class Solution:
    """
    Solution of the levels in one cycle.

    Parameters
    ----------
    velocity, hierarchy, memory, whole, slowed
        See the attributes.
    steps : list of LevelStep or Steps, optional
        Steps of the levels; by default those without damping, and without active bounds.

    Attributes
    ----------
    velocity : ndarray (n,)
        Joint velocities (quasi-velocities where a base is involved).
    memory : tuple of float
        State for the next cycle, one number for each level.
    hierarchy : list of Level
        Levels that were solved.
    whole, slowed : ndarray (n,), float
        Velocities before uniform scaling, and its factor; `velocity` and 1 without it.

    """

    def __init__(self, velocity: Array, hierarchy: list[Level], memory: Memory = (),
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
        return self.free_steps

    @cached_property
    def free_steps(self) -> list[LevelStep]:
        """Return the steps of all levels without damping and bounds; see `null_space`."""
        x, Z, found = np.zeros(len(self.velocity)), None, []
        for level in self.hierarchy:
            if level.v is None:
                found.append(LevelStep(x))
                continue
            whole = its = decompose(level, Z)
            if level.joints is not None:
                every = identity(len(x)) if Z is None else Z
                its = decompose(level, excluded(level.joints, every)[1].free)
            missing = level.v if Z is None else level.v - level.J.dot(x)
            gains = 1.0 / its.s
            x = x + its.moving.dot(gains * missing.dot(projection(level, its)))
            Z = whole.free
            found.append(LevelStep(x, its, its.s * gains))
        return found

    def directions_alone(self, level: Level, least: float) -> Directions | None:
        """Return the directions of a level by itself; None if its singular values ≥ `least`."""
        if self.hierarchy and self.hierarchy[0] is level and level.joints is None:
            # The solver may have them: nothing is above the first level.
            its = self.step(0).directions
            if its is not None:
                return its
        return None if moves_well(level.J, least) else decompose(level)

    @property
    def bends(self) -> list[float]:
        """Return the part of `memory` that follows from this cycle alone."""
        if self._steps is None or isinstance(self._steps, list):
            return [step.bend for step in self.steps]
        return self._steps.bends()

    @property
    def bounded(self) -> bool:
        """Return whether bounds were active."""
        return self._steps is not None and any(
            step.multipliers is not None for step in self.steps)

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


class Solver(Protocol):
    """Solver of prioritized levels; its options are constant over the cycles."""

    def solve(self, levels: list[Level], bounds: Bounds, memory: Memory = ()) -> Solution:
        """
        Return the solution of one cycle.

        Parameters
        ----------
        levels : list of Level
            The highest priority first.
        bounds : Bounds
            Bounds of this cycle.
        memory : tuple of float
            `Solution.memory` of the previous cycle, for the same levels; empty at first.

        Raises
        ------
        SolverError
            The levels have no finite solution.

        """

    @property
    def undamped(self) -> 'Solver':
        """Return the solver without damping; itself if it has none."""
