# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Feasible velocities: bounds on the joints, and rows of levels with bounds."""

import numpy as np
from tp_controller.solver.level import Array, FEASIBLE, identity, norm, ROUNDING, within

EMPTY = np.zeros(0)


class Polytope:
    """
    Polytope of the velocities x with lower ≤ x ≤ upper and row_lower ≤ rows x ≤ row_upper.

    Attributes
    ----------
    lower, upper : ndarray (n,)
        Bounds on the joints.
    rows, row_lower, row_upper : ndarray (r, n), (r,), (r,)
        Rows, normalised to length 1 so that one tolerance fits all.
    lengths : ndarray (r,)
        Lengths of the rows as given.

    """

    def __init__(self, lower: Array, upper: Array) -> None:
        self.lower, self.upper = lower, upper
        self.rows, self.lengths = identity(len(lower))[:0], EMPTY
        self.row_lower = self.row_upper = EMPTY

    def clip(self, x: Array) -> Array:
        """Return x (n,) clamped to the bounds on the joints."""
        return np.minimum(np.maximum(x, self.lower), self.upper)

    def fitting(self, x: Array) -> Array | None:
        """Return x (n,) clamped to its bounds; None if it violates them by more than rounding."""
        clipped = self.clip(x)
        excess = norm(clipped - x)
        if excess and excess > ROUNDING * norm(x):
            return None
        if len(self.rows) and not within(self.rows.dot(clipped), self.row_lower, self.row_upper,
                                         FEASIBLE):
            return None
        return clipped

    def narrow(self, cap: Array, x: Array) -> None:
        """Limit speeds to `cap` (n,), or to the speed of x if that is higher."""
        self.lower = np.minimum(np.maximum(self.lower, -cap), x)
        self.upper = np.maximum(np.minimum(self.upper, cap), x)

    def widen(self, x: Array) -> None:
        """Widen the row bounds to include x (n,), which may exceed them by a tolerance."""
        if len(self.rows):
            values = self.rows.dot(x)
            self.row_lower = np.minimum(self.row_lower, values)
            self.row_upper = np.maximum(self.row_upper, values)

    def add(self, rows: Array, lower: Array, upper: Array, lengths: Array) -> None:
        """Add rows; see the attributes."""
        self.rows = np.concatenate([self.rows, rows])
        self.row_lower = np.concatenate([self.row_lower, lower])
        self.row_upper = np.concatenate([self.row_upper, upper])
        self.lengths = np.concatenate([self.lengths, lengths])

    def along(self, origin: Array, Q: Array) -> tuple[Array, Array, Array]:
        """Return A (n + r, k) and the bounds on A a for which `origin` + Q a is feasible."""
        A, lower, upper = Q, self.lower - origin, self.upper - origin
        if len(self.rows):
            values = self.rows.dot(origin)
            A = np.concatenate([A, self.rows.dot(Q)])
            lower = np.concatenate([lower, self.row_lower - values])
            upper = np.concatenate([upper, self.row_upper - values])
        return A, lower, upper
