# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Fast path for the usual case: compatible levels, far from singularities, without active bounds.

If the stacked rows of all levels have full rank, every level can be met exactly and the recursion
returns the minimum-norm velocity: ζ = Jᵀ (J Jᵀ)⁻¹ v, one Cholesky factorisation instead of a
singular value decomposition per level; with weights ζ = W⁻¹ Jᵀ (J W⁻¹ Jᵀ)⁻¹ v. A closing level
that demands a velocity of every joint, J = I, is met as closely as the others allow by starting
from its demand: ζ = v_I + Jᵀ (J Jᵀ)⁻¹ (v − J v_I).

Sources: lecture 2.2, 4.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtri
from tp_controller.solver.damping import bend, Damping
from tp_controller.solver.level import Array, Level, norm

# Least singular value for the fast path, relative to ‖J‖ [1]. Below it the squared condition
# number costs digits, and the loop is used.
WELL_CONDITIONED = 1e-2
# The same for the weighted rows. Weights cost the levels no digits; Σ w_j x_j² has ten of them.
WELL_WEIGHTED = 1e-3


def min_norm(levels: list[Level], n: int, damping: Damping, period: float,
             curved: Sequence[float], weights: Array | None = None) -> Array | None:
    """
    Return the velocity (n,) of undamped levels with demands; None if the loop is needed.

    `curved` has the c of each level; weights are (n,).
    """
    closing = None
    if levels and levels[-1].is_identity:
        if levels[-1].weights is not None or not damping.spares(1.0, curved[-1]):
            return None
        *levels, last = levels
        closing = last.v
    if not levels:
        return np.zeros(n) if closing is None else closing.copy()
    if not 0 < sum(len(level.v) for level in levels) <= n:
        return None
    J, v = levels[0].J, levels[0].v
    if len(levels) > 1:
        J = np.concatenate([level.J for level in levels])
        v = np.concatenate([level.v for level in levels])
    size = norm(J)
    factor = _factor(J, size, levels, damping, curved)
    if factor is None:
        return None
    if closing is not None:
        return _closed(J, v, factor, closing, bend(size, damping.curvature(1.0, period)))
    if weights is None:
        return J.T.dot(dpotrs(factor, v)[0])
    return _weighted(J, v, factor, weights)


def _closed(J: Array, v: Array, factor: Array, closing: Array, curvature: float) -> Array | None:
    """Return the velocity (n,) nearest to that of a closing level; None if that is damped."""
    z = dpotrs(factor, v - J.dot(closing))[0]
    # z are the multipliers that the closing level exerts; their curvature may damp its step.
    if curvature * norm(z) > 1.0:
        return None
    return closing + J.T.dot(z)


def _weighted(J: Array, v: Array, factor: Array, weights: Array) -> Array | None:
    """Return the velocity (n,) with the smallest Σ w_j x_j²; None near a singularity."""
    root = np.sqrt(weights)
    weighted = J / root
    factors = _factors(weighted, norm(weighted), WELL_WEIGHTED)
    if factors is None:
        return None
    x = weighted.T.dot(dpotrs(factors[0], v)[0]) / root
    # An unweighted correction restores the digits lost to weights of very different size.
    return x + J.T.dot(dpotrs(factor, v - J.dot(x))[0])


def moves_well(J: Array, least: float) -> bool:
    """Return True if a fast test finds that no singular value is below `least`."""
    factors = _factors(J, norm(J))
    return factors is not None and factors[2] * least <= 1.0


def _factors(J: Array, size: float,
             least: float = WELL_CONDITIONED) -> tuple[Array, Array, float] | None:
    """Return R of J Jᵀ = Rᵀ R, R⁻¹, and ‖R⁻¹‖, for ‖J‖ = size; None near a singularity."""
    factor, info = dpotrf(J.dot(J.T))
    if info != 0:
        return None
    inverse = dtrtri(factor)[0]
    largest = norm(inverse)
    return (factor, inverse, largest) if least * size * largest <= 1.0 else None


def _factor(J: Array, size: float, levels: list[Level], damping: Damping,
            curved: Sequence[float]) -> Array | None:
    """Return R of J Jᵀ = Rᵀ R, ‖J‖ = size; None if J is damped, or near a singularity."""
    factors = _factors(J, size)
    if factors is None:
        return None
    factor, inverse, largest = factors
    if damping.spares(1.0 / largest, max(curved)) or _undamped(levels, inverse, damping, curved):
        return factor
    return None


def _undamped(levels: list[Level], inverse: Array, damping: Damping,
              curved: Sequence[float]) -> bool:
    """
    Return whether all singular values of the projected levels are undamped.

    The diagonal blocks of the Cholesky factor R belong to the projected levels,
    R_iiᵀ R_ii = J̄_i J̄_iᵀ, and those of its inverse are their inverses: the smallest singular
    value s of J̄_i is 1/‖R_ii⁻¹‖. That norm is bounded from above: cheaply by the Frobenius norm,
    and more closely by 1/s² ≤ ‖R_ii⁻ᵀ R_ii⁻¹‖.
    """
    begin, kind = 0, damping.first
    for level, c in zip(levels, curved):
        rows = slice(begin, begin + len(level.v))
        begin = rows.stop
        block = inverse[rows, rows]
        if block.size and not kind.spares(1.0 / norm(block), c) \
                and not kind.spares(norm(block.dot(block.T)) ** -0.5, c):
            return False
        kind = damping
    return True
