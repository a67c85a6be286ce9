# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The task-priority solver: levels in, velocities out.

A fast path if all levels can be met (`min_norm`), else one loop over the levels
(`bounded_hierarchy`), and uniform scaling after it if that is selected (`scaling`). The state
between two cycles is an argument and part of the result.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
import math
from typing import Any

import numpy as np
from tp_controller.solver.bounded_hierarchy import BoundedHierarchy
from tp_controller.solver.compiled import Core, core_for, solve_by_core
from tp_controller.solver.damping import Damping
from tp_controller.solver.errors import SolverError, unknown
from tp_controller.solver.level import (
    Array,
    check_bounds,
    check_levels,
    check_weights,
    LARGEST_NUMBER,
    Level,
    NEGLIGIBLE,
    ROUNDING,
)
from tp_controller.solver.min_norm import min_norm
from tp_controller.solver.polytope import Polytope
from tp_controller.solver.scaling import enlarged, scale_uniformly
from tp_controller.solver.solution import Bounds, LevelStep, Memory, Solution

SCALINGS = ('redistribute', 'uniform')


def solve(levels: Iterable[Any], lower: Any = None, upper: Any = None, weights: Any = None,
          damping: float = 0.0, scaling: str = 'uniform', *,
          singular_region: float = math.inf, release_region: float = 0.0,
          regularisation: float = 0.0, period: float = 0.0, speed_cap: Any = None,
          memory: Memory | None = None) -> Solution:
    """
    Return the joint velocities that carry out prioritized tasks.

    Every level is met as well as the levels above it allow, in the least-squares sense. Among the
    remaining solutions the one of minimum norm is returned. An empty list gives no motion.

    Parameters
    ----------
    levels : sequence of Level or (J, v)
        The highest priority first; J (m, n), v (m,). The arrays are kept, not copied, for
        `Solution.levels`. Any units will do, rows of one level weigh as much as they are long;
        but `damping`, `singular_region`, `release_region` and `regularisation` are compared
        with singular values of J. Their usual values are for rows in m or rad per rad or m of a
        joint: convert J and v that are in other units, such as mm.
    lower, upper : array_like (n,), optional
        Bounds on the velocity, lower ≤ upper. They may exclude zero.
    weights : array_like (n,), optional
        Cost of moving each joint, all positive: the higher, the less the joint is used
        (lecture 4). Only their ratios matter. Among the velocities that carry out all levels
        equally well, the solution minimises Σ w_j q_dot_j². Weights do not change the residuals.
    damping : float
        λ of the damped inverse s / (s² + λ²), in the units of J; 0 is exact and undamped. The
        first level has a fifth of it, and of the singular region unless that is infinite.
    scaling : str
        Method if a velocity exceeds its bounds. ``redistribute``: every level is solved within
        them; other joints move instead, and lower levels are limited before higher ones.
        ``uniform``: all velocities are divided by the same factor until the bounds are satisfied
        (lecture 4), which keeps the direction of every task.
    singular_region : float
        Only directions whose singular value s is below this, in the units of J, are damped, by
        λ² (1 − (s / singular_region)²), which grows from zero where they enter it. Infinite:
        all directions are damped by λ², damped least squares (lecture 2.2).
    release_region : float
        Directions whose singular value is below this, in the units of J, are relaxed: left to
        the levels below, smoothly. 0: never.
    regularisation : float
        With bounds: μ, which prevents jumps of the answer from one corner of them to another, in
        the units of J; the first level has a fifth of it. 0 is exact.
    period : float
        Zero-order hold of the velocity [s]. Levels that exert multipliers are damped according
        to the curvature in this time (`tp_controller.solver.damping`). 0: not at all.
    speed_cap : array_like (n,), optional
        With ``redistribute``: speed up to which the levels below the first may use a joint.
    memory : tuple, optional
        `Solution.memory` of the previous cycle, for the same levels; if they have changed, its
        entries for the unchanged first levels.

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
    lecture 2.2, 4; lab, Questions.

    """
    checked = check_levels(levels)
    others = next((given for given in (weights, lower, upper) if given is not None), ())
    n = checked[0].J.shape[1] if checked else np.size(others)
    if lower is not None or upper is not None:
        lower, upper = check_bounds(lower, upper, n, 'joints')
    solver = PrioritySolver(n, Damping(damping, singular_region, release_region, regularisation),
                            weights, scaling)
    if speed_cap is not None:
        if scaling != 'redistribute':
            raise SolverError('speed_cap needs scaling redistribute')
        speed_cap = check_bounds(None, speed_cap, n, 'speed_cap')[1]
        if not (speed_cap >= 0.0).all():
            raise SolverError(f'speed_cap must not be negative, got {speed_cap.tolist()}')
    _check_numbers(period=period)
    _check_numbers(**{f'memory of level {number}': h for number, h in enumerate(memory or (), 1)})
    return solve_cycle(checked, lower, upper, solver, period, speed_cap, memory or ())


@dataclass(frozen=True, eq=False)
class PrioritySolver:
    """
    Solver of this package, with validated options.

    Parameters
    ----------
    n : int
        Number of joints.
    damping : Damping
    weights, scaling
        See `solve`.

    Raises
    ------
    SolverError
        A weight is not positive, a number is negative, or a scaling is unknown.

    """

    n: int
    damping: Damping = Damping()
    weights: Any = None
    scaling: str = 'uniform'

    def __post_init__(self) -> None:
        """Validate all solver."""
        _check_numbers(**asdict(self.damping))
        if self.scaling not in SCALINGS:
            raise SolverError(unknown('scaling', self.scaling, SCALINGS))
        if self.weights is not None:
            object.__setattr__(self, 'weights', check_weights(self.weights, self.n, 'weights'))

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields for a copy; a core cannot be copied."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def solve(self, levels: list[Level], bounds: Bounds, memory: Memory = ()) -> Solution:
        """Return the solution of one cycle; see `Solver`."""
        return solve_cycle(levels, bounds.lower, bounds.upper, self, bounds.hold, bounds.cap,
                           memory)

    @cached_property
    def core(self) -> Core | None:
        """Return the compiled solver for these options; None for the reference."""
        return core_for(self.n, self.damping, self.weights, self.scaling)

    @cached_property
    def undamped(self) -> 'PrioritySolver':
        """Return the solver without damping."""
        return replace(self, damping=replace(self.damping, damping=0.0))


def solve_cycle(levels: list[Level], lower: Array | None, upper: Array | None,
                solver: PrioritySolver, period: float, speed_cap: Array | None = None,
                memory: Memory = ()) -> Solution:
    """
    Return the `Solution` of levels and bounds whose shapes fit together.

    Parameters
    ----------
    levels : list of Level
        The highest priority first.
    lower, upper : ndarray (n,) or None
        Bounds on the velocity, both or none.
    solver : PrioritySolver
        Solver with its options.
    period, speed_cap, memory
        See `solve`.

    Raises
    ------
    SolverError
        The levels hold numbers that are not finite.

    """
    if solver.core is not None:
        found = solve_by_core(solver.core, solver.n, levels, lower, upper, period, speed_cap,
                              memory)
        if found is not None:
            return found
    return solve_by_reference(levels, lower, upper, solver, period, speed_cap, memory)


def solve_by_reference(levels: list[Level], lower: Array | None, upper: Array | None,
                       solver: PrioritySolver, period: float, speed_cap: Array | None = None,
                       memory: Memory = ()) -> Solution:
    """Return the solution of `solve_cycle`, computed in Python."""
    damping = solver.damping
    if lower is None or upper is None:
        lower, upper = np.full(solver.n, -np.inf), np.full(solver.n, np.inf)
    memory = (*memory, *(0.0,) * len(levels))[:len(levels)]
    curved = [damping.curvature(h, period) for h in memory]
    x = _fast(levels, lower, upper, solver, period, speed_cap, curved)
    if x is not None:
        if any(memory):
            memory = tuple(damping.follow(h, 0.0, period) for h in memory)
        return Solution(x, levels, memory)
    if solver.scaling == 'uniform':
        return _uniform(levels, lower, upper, solver, period, memory, curved)
    x, steps = _loop(levels, lower, upper, solver, speed_cap, curved)
    return Solution(x, levels, _remembered(steps, memory, damping, period), steps)


def _fast(levels: list[Level], lower: Array, upper: Array, solver: PrioritySolver,
          period: float, speed_cap: Array | None, curved: list[float]) -> Array | None:
    """Return the velocity (n,) of the fast path; None if damping, bounds or a mask act."""
    if any(level.joints is not None for level in levels):
        return None
    demands = [level for level in levels if level.v is not None]
    bounded = [level for level in levels if level.v is None]
    curved = [c for level, c in zip(levels, curved) if level.v is not None]
    x = min_norm(demands, solver.n, solver.damping, period, curved, solver.weights)
    if x is None or not math.isfinite(x.dot(x)):
        return None
    allowed = Polytope(lower, upper)
    if speed_cap is not None and len(demands) > 1:
        allowed = Polytope(allowed.clip(-speed_cap), allowed.clip(speed_cap))
    x = allowed.fitting(x)
    return x if x is not None and all(level.meets(x) for level in bounded) else None


def _loop(levels: list[Level], lower: Array, upper: Array, solver: PrioritySolver,
          speed_cap: Array | None, curved: list[float]) -> tuple[Array, list[LevelStep]]:
    """Return the velocity (n,), and the step of each level."""
    allowed = Polytope(lower, upper)
    hierarchy = BoundedHierarchy(allowed, solver.damping, solver.weights)
    steps = []
    for level, c in zip(levels, curved):
        if level.v is None:
            steps.append(hierarchy.satisfy(level, c))
            continue
        steps.append(hierarchy.carry_out(level, c))
        if speed_cap is not None:
            allowed.narrow(speed_cap, hierarchy.x)
            speed_cap = None
    hierarchy.finish()
    x = hierarchy.x
    if not math.isfinite(x.dot(x)):
        raise SolverError('the levels hold numbers that are not finite')
    return x, steps


def _uniform(levels: list[Level], lower: Array, upper: Array, solver: PrioritySolver,
             period: float, memory: Memory, curved: list[float]) -> Solution:
    """Return the solution with all joints scaled alike (lecture 4)."""
    least, most = np.full((2, len(lower)), [[-np.inf], [np.inf]])
    enlarging: list[tuple[int, float]] = []
    if any(level.v is None for level in levels):
        # Bounds of levels must not slow the joints more than the demands do.
        demands = [level for level in levels if level.v is not None]
        free, _ = _loop(demands, least, most, solver, None,
                        [c for level, c in zip(levels, curved) if level.v is not None])
        x, share, limiting = scale_uniformly(free, lower, upper)
        least, most = enlarged(share or 1.0, lower, upper)
        enlarging = _end(x, upper, limiting)
    whole, steps = _loop(levels, least, most, solver, None, curved)
    memory = _remembered(steps, memory, solver.damping, period)
    x, slowed, limiting = scale_uniformly(whole, lower, upper)
    return Solution(x, levels, memory, _limited(steps, enlarging, _end(x, upper, limiting)), whole,
                    slowed)


def _end(x: Array, upper: Array, joint: int | None) -> list[tuple[int, float]]:
    """Return a joint and the sign of the bound at which its velocity is; [] for None."""
    return [] if joint is None else [(joint, 1.0 if x[joint] == upper[joint] else -1.0)]


def _limited(steps: list[LevelStep], enlarging: list[tuple[int, float]],
             slowing: list[tuple[int, float]]) -> list[LevelStep]:
    """Return the steps with the multipliers of scaled joints; see `LevelSolution.multipliers`."""
    found = [_half_signs(step) for step in steps]
    ends = slowing
    if any(multipliers.any() for multipliers in found):
        ends = [(joint, 0.5 * sign) for joint, sign in enlarging] + slowing
    for multipliers in found:
        for joint, multiplier in ends:
            multipliers[joint] = multiplier
    return [step if step.multipliers is None and not ends
            else step._replace(multipliers=multipliers)
            for step, multipliers in zip(steps, found)]


def _half_signs(step: LevelStep) -> Array:
    """Return half the signs of the multipliers (n,) of a step; 0 for rounding errors."""
    if step.multipliers is None:
        return np.zeros(len(step.velocity))
    size = np.abs(step.multipliers)
    least = max(NEGLIGIBLE * size.max(initial=0.0), ROUNDING)
    return np.asarray(np.where(size > least, 0.5 * np.sign(step.multipliers), 0.0))


def _remembered(steps: list[LevelStep], memory: Memory, damping: Damping,
                period: float) -> Memory:
    """Return the memory after these steps."""
    return tuple([damping.follow(h, step.bend, period) for step, h in zip(steps, memory)])


def _check_numbers(**numbers: object) -> None:
    """Raise `SolverError` unless all are finite and ≥ 0; the singular region may be infinite."""
    for name, value in numbers.items():
        most = math.inf if name == 'singular_region' else LARGEST_NUMBER
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) \
                or not 0.0 <= _as_float(value) <= most:
            raise SolverError(f'{name} must be a number that is not negative, not {value!r}')


def _as_float(value: Any) -> float:
    """Return a number as a float; NaN if it is beyond the range of floats."""
    try:
        return float(value)
    except OverflowError:
        return math.nan
