# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Curvature of the constraints that balance the force of a level (h of `damping`)."""

from collections.abc import Sequence

from tp_controller.solver.damping import bend, bend_of_rows
from tp_controller.solver.level import Array, norm
from tp_controller.solver.null_space import Decomposed
from tp_controller.solver.polytope import Polytope


def bend_against(force: Array, multipliers: Array, allowed: Polytope,
                 above: Sequence[Decomposed], others: Decomposed | None, release_region: float
                 ) -> float:
    """
    Return the part of h from the constraints that balance a force.

    Parameters
    ----------
    force : ndarray (n,)
        Jᵀ w of a level with the residual w; zeros for one with bounds.
    multipliers : ndarray (n + r,) or (0,)
        Multipliers of the joints and rows of the polytope.
    allowed : Polytope
        Bounds on the joints, and rows.
    above : sequence of (Level, Directions)
        Levels above with a demand.
    others : (Level, Directions) or None
        Joints outside the mask of the level; they balance a part without curvature.
    release_region : float
        See `Damping`.

    """
    h = 0.0
    if len(multipliers):
        n = len(force)
        force = force - multipliers[:n]
        if len(multipliers) > n:
            force -= allowed.rows.T.dot(multipliers[n:])
            h = bend_of_rows(allowed.lengths, multipliers[n:])
    if others is not None:
        force = force - _balanced(force, others, 0.0)[1]
    softest = (0.5 * release_region) ** 2
    for each in reversed(above):
        size, part = _balanced(force, each, softest)
        h += bend(each[1].size, size)
        force = force - part
    return h


def _balanced(force: Array, by: Decomposed, softest: float) -> tuple[float, Array]:
    """Return ‖multipliers‖ of a level that balances a force (n,), and its part of that."""
    level, its = by
    mu = force.dot(its.moving) / (its.s + softest / its.s)
    return norm(mu), its.U.dot(mu).dot(level.J)
