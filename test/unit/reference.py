# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Slow references, written from the definitions and with nothing of the product.

Lexicographic least squares: x minimises ‖J_1 x − v_1‖, among those x minimises ‖J_2 x − v_2‖, and
so on; among what is left it has the smallest norm. The constraints of the upper levels are kept
as the null space of all their rows stacked, not as a recursion of projectors.
"""

import numpy as np
from scipy.linalg import null_space

TOLERANCE = 1e-9


def lexicographic(levels, n, weights=None):
    """
    Return the exact solution (n,).

    Parameters
    ----------
    levels : list of (J, v)
        The highest priority first.
    n : int
        Number of joints.
    weights : array_like (n,), optional
        The norm minimised at the end is Σ w_j x_j².

    """
    x = np.zeros(n)
    rows = np.zeros((0, n))
    for J, v in levels:
        free = null_of(rows)
        x = x + free @ bounded_lstsq(J @ free, v - J @ x, np.linalg.norm(J))
        rows = np.concatenate([rows, J])
    free = null_of(rows)
    W = np.diag(np.ones(n) if weights is None else np.asarray(weights, float))
    return x - free @ np.linalg.solve(free.T @ W @ free, free.T @ W @ x)


def damped_recursion(levels, n, damping, region, first=1.0):
    """
    Return the solution (n,) of a hierarchy whose weak directions are damped.

    A singular value s of what the levels above leave of a level is inverted as
    s / (s² + λ² max(0, 1 − s²/ε²)).

    Parameters
    ----------
    levels : list of (J, v)
        The highest priority first.
    n : int
        Number of joints.
    damping, region : float
        λ and ε.
    first : float
        Share of both that the first level has.

    """
    x, rows, share = np.zeros(n), np.zeros((0, n)), first
    for J, v in levels:
        free = null_of(rows)
        U, s, V_T = np.linalg.svd(J @ free, full_matrices=False)
        moving = s > TOLERANCE * np.linalg.norm(J)
        U, s, V_T = U[:, moving], s[moving], V_T[moving]
        squared = (share * damping) ** 2 * np.maximum(0.0, 1.0 - (s / (share * region)) ** 2)
        x = x + free @ V_T.T @ (s / (s ** 2 + squared) * (U.T @ (v - J @ x)))
        rows, share = np.concatenate([rows, J]), 1.0
    return x


def null_of(rows):
    """Return an orthonormal basis (n, k) of the null space."""
    if not rows.size or not np.linalg.norm(rows):
        return np.eye(rows.shape[1])
    return null_space(rows, rcond=TOLERANCE)


def bounded_lstsq(A, b, size):
    """Return the least-squares solution; singular values below TOLERANCE · size are zero."""
    if not A.size or np.linalg.norm(A) <= TOLERANCE * size:
        return np.zeros(A.shape[1])
    largest = np.linalg.norm(A, 2)
    return np.linalg.lstsq(A, b, rcond=TOLERANCE * size / largest)[0]


def residual_norms(levels, x):
    """Return ‖v − J x‖ of every level."""
    return np.array([np.linalg.norm(v - J @ x) for J, v in levels])


def projector(levels, n):
    """Return the orthogonal projector on what the levels leave free (n, n)."""
    rows = np.concatenate([np.zeros((0, n)), *(J for J, _ in levels)])
    free = null_of(rows)
    return free @ free.T


def random_levels(rng, n, rows):
    """Return levels with Gaussian entries, one for each number of rows."""
    return [(rng.standard_normal((m, n)), rng.standard_normal(m)) for m in rows]


def bounded_lexicographic(levels, n, lower=None, upper=None, weights=None):
    """
    Return the exact solution (n,) of a hierarchy within bounds.

    Every level in turn is minimised over what the levels above it leave: ‖J x − v‖, or for a
    level with bounds the norm of what J x exceeds them by. What J x came to is then kept: as an
    equation, or as bounds widened to contain it. At last Σ w_j x_j² is minimised.

    Parameters
    ----------
    levels : list of (J, v) or (J, lower, upper)
        The highest priority first.
    n : int
        Number of joints.
    lower, upper : array_like (n,), optional
        Bounds on x, which no level can move.
    weights : array_like (n,), optional
        The norm minimised at the end is Σ w_j x_j².

    """
    lower = np.full(n, -np.inf) if lower is None else np.asarray(lower, float)
    upper = np.full(n, np.inf) if upper is None else np.asarray(upper, float)
    x = np.clip(np.zeros(n), lower, upper)
    G, least, most = np.eye(n), lower, upper
    equations = np.zeros((0, n))
    for J, *demand in levels:
        if len(demand) == 1:
            x = constrained_lstsq(J, demand[0], G, least, most, equations, x)
            equations = np.concatenate([equations, J])
            continue
        m = len(J)
        # Slacks w make the rows meet their bounds: lower ≤ J x + w ≤ upper, ‖w‖ least.
        slack = np.clip(J @ x, *demand) - J @ x
        whole = constrained_lstsq(
            np.hstack([np.zeros((m, n)), np.eye(m)]), np.zeros(m),
            np.block([[G, np.zeros((len(G), m))], [J, np.eye(m)]]),
            np.concatenate([least, demand[0]]), np.concatenate([most, demand[1]]),
            np.hstack([equations, np.zeros((len(equations), m))]), np.concatenate([x, slack]))
        x = whole[:n]
        violation = -whole[n:]
        G = np.concatenate([G, J])
        least = np.concatenate([least, demand[0] + np.minimum(violation, 0.0)])
        most = np.concatenate([most, demand[1] + np.maximum(violation, 0.0)])
    root = np.diag(np.ones(n) if weights is None else np.sqrt(weights))
    return constrained_lstsq(root, np.zeros(n), G, least, most, equations, x)


def masked_lexicographic(levels, n, lower=None, upper=None, weights=None):
    """
    Return the exact solution (n,) of a hierarchy within bounds whose levels have masks.

    A level with a mask finds the joints where those above need the least motion. Over the joints
    of its mask alone it is minimised, as in `bounded_lexicographic`; its motion is the shortest
    of those that do that, and counts as its own: at last Σ w_j (x_j − own_j)² is minimised.

    Parameters
    ----------
    levels : list of (mask, J, v) or (mask, J, lower, upper)
        The highest priority first; a mask is (n,) of bool, or None for all joints.
    n, lower, upper, weights
        See `bounded_lexicographic`.

    """
    lower = np.full(n, -np.inf) if lower is None else np.asarray(lower, float)
    upper = np.full(n, np.inf) if upper is None else np.asarray(upper, float)
    x, own = np.clip(np.zeros(n), lower, upper), np.zeros(n)
    G, least, most, equations = np.eye(n), lower, upper, np.zeros((0, n))
    root = np.diag(np.ones(n) if weights is None else np.sqrt(weights))
    begun = False

    def shortened(origin, *more):
        return constrained_lstsq(root, root @ origin, G, least, most,
                                 np.concatenate([equations, *more]), x)

    for mask, J, *demand in levels:
        fixed, origin = np.zeros((0, n)), x
        if mask is not None:
            fixed, x = np.eye(n)[~mask], shortened(own)
            # A first demand begins at rest.
            origin = x if begun or len(demand) == 2 else np.where(mask, own, x)
        m, kept = len(J), np.concatenate([equations, fixed])
        if len(demand) == 1:
            x = constrained_lstsq(J, demand[0], G, least, most, kept, x)
            equations, begun = np.concatenate([equations, J]), True
        else:
            slack = np.clip(J @ x, *demand) - J @ x
            whole = constrained_lstsq(
                np.hstack([np.zeros((m, n)), np.eye(m)]), np.zeros(m),
                np.block([[G, np.zeros((len(G), m))], [J, np.eye(m)]]),
                np.concatenate([least, demand[0]]), np.concatenate([most, demand[1]]),
                np.hstack([kept, np.zeros((len(kept), m))]), np.concatenate([x, slack]))
            x, violation = whole[:n], -whole[n:]
            G = np.concatenate([G, J])
            least = np.concatenate([least, demand[0] + np.minimum(violation, 0.0)])
            most = np.concatenate([most, demand[1] + np.maximum(violation, 0.0)])
        if mask is not None:
            x = shortened(origin, fixed)
            own = own + x - origin
    return shortened(own)


def constrained_lstsq(A, b, G, least, most, equations, x):
    """
    Return an x that minimises ‖A x − b‖ with least ≤ G x ≤ most, and `equations` x unchanged.

    The active-set method from a feasible x on. Each step solves the KKT system of the active rows
    by null space and least squares; the answer is returned only with multipliers that prove it.
    """
    rows = np.concatenate([G, -G])
    bounds = np.concatenate([most, -least])
    rows, bounds = rows[np.isfinite(bounds)], bounds[np.isfinite(bounds)]
    size = np.linalg.norm(A) + 1e-300
    free = null_of(equations)
    active, steps = [], 0
    # Rows of length one in the coordinates that are free; those that cannot change are left out.
    projected = rows @ free
    lengths = np.linalg.norm(projected, axis=1)
    usable = lengths > 1e-10
    while True:
        steps += 1
        assert steps < 5000, 'the reference found no active set'
        left = free
        if active:
            left = free @ null_of(projected[active])
        step = left @ bounded_lstsq(A @ left, b - A @ x, size)
        moved = rows @ step
        share, blocking = 1.0, None
        for row in np.flatnonzero(usable & (moved > 1e-13 * lengths * np.linalg.norm(step))):
            if row not in active:
                reach = max(0.0, (bounds[row] - rows[row] @ x) / moved[row])
                if reach < share - 1e-14:
                    share, blocking = reach, row
        x = x + share * step
        if blocking is not None:
            active.append(int(blocking))
            continue
        gradient = free.T @ (A.T @ (A @ x - b))
        if not active:
            break
        multipliers = np.linalg.lstsq(-projected[active].T, gradient, rcond=None)[0]
        wrong = np.flatnonzero(multipliers < -1e-11 * (1.0 + np.linalg.norm(gradient)))
        if not len(wrong):
            break
        # By the smallest index, not the worst: it cannot cycle.
        active.remove(min(active[index] for index in wrong))
    remaining = gradient if not active else gradient + projected[active].T @ multipliers
    assert np.linalg.norm(remaining) < 1e-8 * size * (1.0 + np.linalg.norm(A @ x - b))
    assert (rows @ x <= bounds + 1e-9 * np.maximum(1.0, np.abs(rows) @ np.abs(x))).all()
    return x
