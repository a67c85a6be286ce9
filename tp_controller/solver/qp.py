# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Quadratic programs of levels with active bounds.

A level moves by Q a. Its program, for stiffnesses k_i ≥ 0 and a target a°, is ::

    minimise    Σ k_i (a_i − a°_i)²    subject to    lower ≤ A a ≤ upper

Directions with k = 0 cost nothing. The answer may then lie in a corner of the bounds, and jump to
another corner in the next cycle. Therefore no stiffness is below μ². The added stiffness pulls
towards the step clamped to the bounds. That is mostly the nearest feasible velocity: the answer
is hardly biased, and it does not jump when a bound becomes active. For an exact answer the
program is solved again from there, with decreasing μ: the proximal point algorithm
(Rockafellar, 1976). Directions softer than the last μ still lag behind: `refined` finishes them.

In coordinates scaled by √k a program is a projection onto a polytope (`active_set`). The polytope
appears empty if nearly parallel rows of A contradict each other by rounding: joints that can only
move together, each at its limit. A looser tolerance distinguishes such a polytope from an empty
one.
"""

import numpy as np
from tp_controller.solver.active_set import ActiveSet
from tp_controller.solver.level import (
    Array,
    FEASIBLE,
    Level,
    NEGLIGIBLE,
    norm,
    ROUNDING,
)
from tp_controller.solver.null_space import decompose

# Tolerances on bounds; the next one is used if rounding prevents a solution. In a million cycles
# (`closed_loops.py`) three programs stay unsolved: their levels add nothing in that cycle. A
# larger last tolerance lets levels disturb those above by as much.
TOLERANCES = (FEASIBLE, 1e-9, 1e-7, 1e-6)
# μ² for an exact answer, as shares of the largest stiffness, one after the other; `refined` does
# the rest. If the sequence begins with 1e-6, two programs of 1,500 fast states (`loss.py`) stay
# unsolved. A longer one only takes time: with 1e-2, 1e-4, 1e-6, 1e-8 and 1e-8 twice as much.
EXACT = np.array([1e-2, 1e-6])

Answer = tuple[Array, Array]


def regularised(stiffness: Array, target: Array, A: Array, lower: Array, upper: Array,
                least: float, start: Array) -> Answer | None:
    """
    Return the a (k,) that minimises Σ stiffness_i (a_i − target_i)² within bounds on A a.

    Multipliers (r,) are the second value: positive at upper bounds, negative at lower ones, else
    zero. `least` is μ², 0 is exact; the added stiffness first pulls towards `start`, which is best
    near the answer. Return None if rounding prevents a solution.
    """
    exact = least == 0.0
    softest = EXACT * (stiffness[stiffness.argmax()] or 1.0) if exact else (least,)
    answer = None
    for least in softest:
        stiff = np.maximum(stiffness, least)
        share = stiffness / stiff
        found = nearest(stiff, start + share * (target - start), A, lower, upper)
        if found is not None:
            # The nearest answer if rounding prevents a solution of the next program.
            answer, start = found, found[0]
        if not np.count_nonzero(share < 1.0):
            return answer
    if exact and answer is not None:
        answer = refined(stiffness, target, A, lower, upper, answer)
    return answer


def refined(stiffness: Array, target: Array, A: Array, lower: Array, upper: Array,
            answer: Answer) -> Answer:
    """
    Return the exact minimum of `regularised` from an answer near it.

    The primal active-set method (Nocedal and Wright, Numerical Optimization, 16.5): minimise on
    the face of the bounds that have a multiplier, stop at the first other bound and add it, or
    drop the bound with the most negative multiplier. Between soft and stiff directions its size
    is a poor criterion: each of these bounds is dropped once, until one reduces the minimum.
    """
    a, multipliers = answer
    lengths = np.sqrt((A * A).sum(axis=1))
    lengths[lengths <= NEGLIGIBLE] = 1.0
    rows, sides = A / lengths[:, np.newaxis], np.sign(multipliers)
    lower, upper, root = lower / lengths, upper / lengths, np.sqrt(stiffness)
    least, tried = np.inf, np.zeros(len(A), dtype=bool)
    for _ in range(10 * sum(A.shape)):
        active = np.flatnonzero(sides)
        face = decompose(Level(rows[active]))
        step = _step(face.Q[:, face.rank:], root, root * (target - a))
        share, row, side = _first_bound(rows, lower, upper, a, step, sides)
        a = a + share * step
        if share < 1.0:
            sides[row] = side
            continue
        missed = root * (target - a)
        found = sides[active] * face.U.dot((root * missed).dot(face.moving) / face.s)
        multipliers = np.zeros(len(A))
        multipliers[active] = sides[active] * np.maximum(found, 0.0) / lengths[active]
        answer = a, multipliers
        if norm(missed) < (1.0 - ROUNDING) * least:
            least, tried[:] = norm(missed), False
        found[tried[active]] = 0.0
        if found.min(initial=0.0) == 0.0:
            break
        row = active[found.argmin()]
        sides[row], tried[row] = 0.0, True
    return answer


def _step(Z: Array, root: Array, missed: Array) -> Array:
    """Return the shortest Z y that minimises ‖missed − diag(root) Z y‖."""
    # The transpose is wide: the core, too, first shortens it by reflections.
    free = decompose(Level(Z.T * root))
    rank = int(np.count_nonzero(free.s > NEGLIGIBLE * norm(root)))
    shares = missed.dot(free.Q[:, :rank]) / free.s[:rank]
    return Z.dot(free.U[:, :rank].dot(shares))


def _first_bound(rows: Array, lower: Array, upper: Array, a: Array, step: Array,
                 sides: Array) -> tuple[float, int, float]:
    """Return the share of a step up to the first inactive bound, its row and side."""
    values, gained = rows.dot(a), rows.dot(step)
    moving = (sides == 0.0) & (np.abs(gained) > ROUNDING * norm(step))
    distance = np.where(gained > 0.0, upper - values, lower - values)
    shares = np.divide(distance, gained, out=np.ones(len(rows)), where=moving)
    row = int(shares.argmin())
    return min(max(float(shares[row]), 0.0), 1.0), row, float(np.sign(gained[row]))


def nearest(stiffness: Array, centre: Array, A: Array, lower: Array,
            upper: Array) -> Answer | None:
    """Return the answer of `regularised` for positive stiffnesses."""
    # Relative to its largest stiffness, a program is independent of the units of the rows.
    unit = stiffness[stiffness.argmax()]
    root = np.sqrt(stiffness / unit)
    found = nearest_point(root * centre, np.divide(A, root, order='C'), lower, upper)
    return None if found is None else (found[0] / root, unit * found[1])


def nearest_point(point: Array, A: Array, lower: Array, upper: Array) -> Answer | None:
    """
    Return the z (k,) of the polytope lower ≤ A z ≤ upper that is nearest to a point (k,).

    Multipliers (r,) are the second value, z = point − Aᵀ multipliers. Return None if no z
    satisfies the bounds to one of `TOLERANCES`, or rounding prevents a solution.
    """
    polytope = ActiveSet(point, A, lower, upper)
    for tolerance in TOLERANCES:
        found = polytope.solve(tolerance)
        if found is not None:
            return found
    return None
