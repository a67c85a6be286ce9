# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Projection onto a polytope by the dual active-set method of Goldfarb and Idnani (1983).

Starting from the point p itself, the row that is violated most, measured in rows of length 1,
becomes active; a row whose multiplier reaches zero on the way is dropped. With the active normals
N = Q R and the new normal n ::

    N e + r = n,   r ⊥ N        z ← z − t r,   λ ← λ − t e

t is the smaller of the full step, violation / ‖r‖², and the step at which a multiplier is zero. If
r is zero and no multiplier falls, the polytope is empty. At the end z and λ are computed once more
from the active rows alone, z = Q y + (1 − Q Qᵀ) p with Rᵀ y = b, against rounding.
"""

import math

import numpy as np
from scipy.linalg.lapack import dtrtrs
from tp_controller.solver.level import Array, norm, ROUNDING

# A normal of length 1 depends linearly on the active ones if the squared length of its component
# orthogonal to them is below this.
DEPENDENT = 1e-15
# Rounding error of a satisfied bound, relative to the size of the point.
LAST_DIGIT = 1e-15


class ActiveSet:
    """
    Projection of a point onto lower ≤ A z ≤ upper: the nearest z (k,).

    Parameters
    ----------
    point : ndarray (k,)
    A, lower, upper : ndarray (r, k), (r,), (r,)

    """

    def __init__(self, point: Array, A: Array, lower: Array, upper: Array) -> None:
        self._point = point
        square = np.einsum('ij,ij->i', A, A)
        # Rows of negligible length are zeroed: z cannot change whether they are satisfied.
        negligible = square < ROUNDING ** 2
        square[negligible] = 1.0
        # Normalise the rows to length 1.
        self._scale = 1.0 / np.sqrt(square)
        self._rows = A * np.where(negligible, 0.0, self._scale)[:, np.newaxis]
        if A.shape[1] == 1:
            # Exactly: where z is at several bounds, the first of them acts, whatever the rounding.
            self._rows = np.sign(self._rows)
        self._lower, self._upper = self._scale * lower, self._scale * upper
        # Tolerances refer to the rows as given, reduced in proportion if both bounds are below 1.
        reach = np.maximum(np.abs(lower), np.abs(upper))
        self._slack = self._scale * np.where(reach > 0.0, np.minimum(reach, 1.0), 1.0)

    def solve(self, tolerance: float) -> tuple[Array, Array] | None:
        """
        Return z (k,) and multipliers (r,): positive at upper bounds, negative at lower ones.

        Return None if no z satisfies the bounds within a tolerance, or rounding prevents a result.
        """
        r, k = self._rows.shape
        most = min(r, k)
        self._Q, self._R = np.zeros((k, most)), np.zeros((most, most))
        # Active rows, the signs of their bounds, and their multipliers.
        self._active: list[int] = []
        self._sides, self._u = np.zeros(most), np.zeros(most)
        self._start()
        self._iterations_left, settled = 10 * (r + k) + 20, False
        while self._iterations_left > 0:
            self._iterations_left -= 1
            beyond, is_upper = self._violations()
            beyond[beyond <= np.maximum(tolerance * self._slack, self._rounding)] = 0.0
            row = int(beyond.argmax()) if r else 0
            if r and beyond[row] > 0.0:
                settled = False
                if not self._enter(row, 1.0 if is_upper[row] else -1.0, float(beyond[row])):
                    return None
            elif settled or not self._active:
                return self._answer()
            else:
                self._settle()
                settled = True
        return None

    def _violations(self) -> tuple[Array, Array]:
        """Return the violations (r,) of the bounds, 0 if active, and the mask of upper bounds."""
        values = self._rows.dot(self._z)
        over, under = values - self._upper, self._lower - values
        beyond = np.maximum(over, under)
        beyond[self._active] = 0.0
        return beyond, over > 0.0

    def _answer(self) -> tuple[Array, Array] | None:
        """Return z and the multipliers of the rows as given; None if z is not finite."""
        if not math.isfinite(self._z.dot(self._z)):
            return None
        count, multipliers = len(self._active), np.zeros(len(self._rows))
        multipliers[self._active] = self._sides[:count] * np.maximum(self._u[:count], 0.0)
        return self._z, self._scale * multipliers

    def _start(self) -> None:
        """Reset z to the point that is projected."""
        self._z, self._rounding = self._point, LAST_DIGIT * (1.0 + norm(self._point))

    def _enter(self, row: int, side: float, violation: float) -> bool:
        """Activate a bound; return whether that is possible."""
        normal, gained = side * self._rows[row], 0.0
        while self._iterations_left > 0:
            self._iterations_left -= 1
            count = len(self._active)
            u = self._u[:count]
            # normal = Q R e + rest
            d, rest = self._split(normal)
            e = self._solve_triangular(d)
            square = float(rest.dot(rest))
            # Step length at which the first multiplier becomes zero.
            t, leaving = min(((max(each, 0.0) / slope, index) for index, (each, slope)
                              in enumerate(zip(u.tolist(), e.tolist())) if slope > 0.0),
                             default=(math.inf, -1))
            free = count < len(self._u) and square > DEPENDENT
            if leaving < 0 and not free:
                return False
            whole = free and violation <= t * square
            t = violation / square if whole else t
            if free:
                self._z = self._z - t * rest
                violation -= t * square
            u -= t * e
            gained += t
            if whole:
                self._append(row, side, gained, d, rest, math.sqrt(square))
                return True
            self._drop(leaving)
        return False

    def _split(self, w: Array) -> tuple[Array, Array]:
        """Return the coordinates of w (k,) in Q, and its component orthogonal to Q."""
        Q = self._Q[:, :len(self._active)]
        along = w.dot(Q)
        rest = w - Q.dot(along)
        # Orthogonalise twice: one pass leaves rounding errors along Q.
        more = rest.dot(Q)
        return along + more, rest - Q.dot(more)

    def _solve_triangular(self, b: Array, transposed: bool = False) -> Array:
        """Return R⁻¹ b, or R⁻ᵀ b."""
        count = len(b)
        return dtrtrs(self._R[:count, :count], b, trans=int(transposed))[0] if count else b

    def _append(self, row: int, side: float, multiplier: float, d: Array, rest: Array,
                length: float) -> None:
        """Append a bound to the active ones."""
        count = len(self._active)
        self._R[:count, count], self._R[count, count] = d, length
        self._Q[:, count] = rest / length
        self._sides[count], self._u[count] = side, multiplier
        self._active.append(row)

    def _drop(self, leaving: int) -> None:
        """Remove a bound from the active ones."""
        count = len(self._active)
        del self._active[leaving]
        for each in (self._sides, self._u):
            each[leaving:count - 1] = each[leaving + 1:count]
        # Each column after the removed one has one entry below the diagonal: factor R again.
        turn, R = np.linalg.qr(np.delete(self._R[:count, :count], leaving, axis=1))
        self._R[:count - 1, :count - 1] = R
        self._Q[:, :count - 1] = self._Q[:, :count].dot(turn)

    def _settle(self) -> None:
        """
        Recompute z and the multipliers from the active bounds, without accumulated rounding.

        z = Q y + rest, with Rᵀ y = b, and the rest is the component of the point orthogonal to Q.
        Bounds whose recomputed multipliers are negative are dropped.
        """
        while self._active:
            count = len(self._active)
            rows, sides = self._active, self._sides[:count]
            b = np.where(sides > 0.0, self._upper[rows], -self._lower[rows])
            y = self._solve_triangular(b, transposed=True)
            along, rest = self._split(self._point)
            self._z = self._Q[:, :count].dot(y)
            if count < len(self._point):
                self._z += rest
            self._u[:count] = self._solve_triangular(along - y)
            least = int(self._u[:count].argmin())
            if not self._u[least] < -ROUNDING:
                self._rounding = LAST_DIGIT * (1.0 + norm(self._z))
                return
            self._drop(least)
        self._start()
