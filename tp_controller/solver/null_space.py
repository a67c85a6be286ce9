# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Null-space recursion of lecture 2.2: directions and null space of each level.

From ζ = 0 and P = I, it computes for each level i, the highest priority first::

    J̄ = J_i P,    ζ ← ζ + J̄^# (v_i − J_i ζ),    P ← P − J̄⁺ J̄

Here P = Z Zᵀ, where the orthonormal columns of Z span the null space. That is the same recursion
in fewer coordinates, without accumulation of rounding errors::

    J_i Z = U diag(s) Vᵀ,    ζ ← ζ + Z V diag(s)⁻¹ Uᵀ (v_i − J_i ζ),    Z ← Z V_null

Sources: lecture 1.1, 1.2, 2.1, 2.2; lab exercise 1 [1], exercise 2 [7];
wiki [2]–[7], [16]–[19], [29], [30]; slides (2), (6), (13), (34); notes [1]–[3], [5], [7],
Properties.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.linalg import lapack
from tp_controller.solver.errors import SolverError
from tp_controller.solver.level import Array, identity, Level, Mask, NEGLIGIBLE, norm


class Directions(NamedTuple):
    """
    Singular value decomposition J Z = U diag(s) Vᵀ, truncated to its numerical rank.

    Attributes
    ----------
    U : ndarray (m, rank)
        Directions of the task that can move.
    s : ndarray (rank,)
        Their singular values, the largest first.
    Q : ndarray (n, k)
        Z V: the motions of the joints that belong to `U`, then those of the null space.
    size : float
        ‖J‖, Frobenius norm.

    """

    U: Array
    s: Array
    Q: Array
    size: float

    @property
    def rank(self) -> int:
        """Return the number of directions that can move."""
        return len(self.s)

    @property
    def moving(self) -> Array:
        """Return the motions that belong to `U` (n, rank)."""
        return self.Q[:, :len(self.s)]

    @property
    def free(self) -> Array:
        """Return the motions of the null space (n, k − rank)."""
        return self.Q[:, len(self.s):]

    @property
    def smallest(self) -> float:
        """Return the m-th singular value; 0 if there are fewer."""
        return float(self.s[-1]) if 0 < len(self.s) == len(self.U) else 0.0


# A level and its directions.
Decomposed: TypeAlias = tuple[Level, Directions]


def decompose(level: Level, Z: Array | None = None, orthonormal: bool = True) -> Directions:
    """Return the `Directions` of a level in the span of Z (n, k); None: of all motions."""
    size = norm(level.J)
    if Z is None:
        J_bar = level.J
    else:
        J_bar = Z if level.is_identity else level.J.dot(Z)
    rows, columns = J_bar.shape
    if rows == 0 or columns == 0:
        return Directions(np.zeros((rows, 0)), np.zeros(0), identity(columns) if Z is None else Z,
                          size)
    if level.is_identity and orthonormal:
        return Directions(J_bar, np.ones(columns), J_bar, size)
    U, s, V = singular_values(J_bar)
    # Relative to ‖J‖, not to ‖J Z‖: for a level that repeats the one above, J Z has only rounding
    # errors, and their inverse would be a velocity of 1e16.
    least = NEGLIGIBLE * size
    rank = len(s) if s[-1] > least else int(np.count_nonzero(s > least))
    if Z is not None:
        # Stored like V, column by column.
        V = Z if columns == 1 else V.T.dot(Z.T).T
    return Directions(U[:, :rank], s[:rank], V, size)


def projection(level: Level, directions: Directions) -> Array:
    """
    Return the P (m, rank) with which Pᵀ w are the coordinates in U of a demand w (m,).

    U P ᵀ w is the part of w that can move: the orthogonal projection, P = U; or with weights the
    one that is nearest in their norm, which differs where some rows cannot be met.
    """
    U = directions.U
    if level.weights is None or U.shape[1] == len(U) or not U.size:
        return U
    root = level.root
    P, s, R = singular_values(root[:, np.newaxis] * U)
    rank = len(s)
    return root[:, np.newaxis] * (P[:, :rank] / s).dot(R[:, :rank].T)


def weighted(level: Level, directions: Directions) -> tuple[Array, Array]:
    """Return the R (rank, rank) and θ of the decomposition √W U diag(s) = P diag(θ) Rᵀ."""
    _, s, R = singular_values(level.root[:, np.newaxis] * directions.U * directions.s)
    return R[:, :len(s)], s


def excluded(joints: Mask, Z: Array) -> Decomposed:
    """
    Return the joints outside a mask (n,) as a level, and its `Directions` in the span of Z (n, k).

    Its null space are the motions of the joints of the mask alone.
    """
    level = Level(identity(len(joints))[~joints])
    return level, decompose(level, Z)


def remaining(directions: Directions, region: float = 0.0, damping: float = 0.0) -> Array:
    """
    Return a basis of the null space that a level leaves (n, k').

    Its last columns are the motions that do not move the level, orthonormal. Before them are the
    directions with a singular value below `region`, relaxed smoothly. If the level keeps the
    share k of a direction, its column is shortened to λ √((1 − k) / k), at most 1, with
    λ = `damping`: a level below that is damped by λ alone follows it by 1 − k.
    """
    s, Q, rank, free = directions.s, directions.Q, directions.rank, directions.free
    if not rank or s[-1] >= region:
        return free
    weak = int(np.count_nonzero(s >= region))
    share = s[weak:] / region
    kept = share * share * (3.0 - 2.0 * share)
    given = np.minimum(damping * np.sqrt((1.0 - kept) / np.maximum(kept, NEGLIGIBLE)), 1.0)
    return np.hstack([Q[:, weak:rank] * given, free])


def null_space(levels: list[Level], n: int) -> Array:
    """Return an orthonormal basis (n, k) of the null space of all levels."""
    Z = identity(n)
    for level in levels:
        Z = remaining(decompose(level, Z))
    return Z


def singular_values(J_bar: Array) -> tuple[Array, Array, Array]:
    """Return U, s and V; U has at least as many columns as s has entries."""
    if J_bar.shape[1] == 1:
        size = norm(J_bar)
        U_T, s, V = J_bar.T / (size or 1.0), np.array([size]), identity(1)
        failed = not math.isfinite(size)
    else:
        # The transpose of a matrix that is stored row by row needs no copy.
        V, s, U_T, failed = lapack.dgesdd(J_bar.T)
    if failed:
        raise SolverError('the levels hold numbers that are not finite')
    return U_T.T, s, V
