# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Sequential form, slides (50) and (51): for comparison only (docs/sequential.md)."""

import numpy as np
from tp_controller.solver.level import Array, Level
from tp_controller.solver.null_space import decompose
from tp_controller.solver.scaling import scale_uniformly
from tp_controller.solver.solution import Bounds, Memory, Solution


def sequential(levels: list[Level], n: int) -> Array:
    """
    Return the joint velocities (n,) of successive projection.

    Each level is inverted on its own, and projected onto the null spaces of the levels above it,
    each on its own: ζ ← ζ + P J⁺ v, P ← P (I − J⁺ J). The first priority is kept. Lower levels
    are not met even if they could be, for two reasons: the velocities that the levels above cause
    are not subtracted, and a product of projectors is a projector only if they commute.

    Parameters
    ----------
    levels : list of Level
        With demands, the highest priority first.
    n : int
        Number of joints.

    References
    ----------
    slides (11)–(51).

    """
    zeta, P = np.zeros(n), np.eye(n)
    for level in levels:
        alone = decompose(level)
        step = alone.U.T.dot(level.v) / alone.s
        zeta = zeta + P.dot(alone.Q[:, :alone.rank].dot(step))
        free = alone.Q[:, alone.rank:]
        P = P.dot(free.dot(free.T))
    return zeta


class SequentialSolver:
    """
    Solver of the sequential form with uniform scaling, for `Controller(…, solver=…)`.

    Parameters
    ----------
    n : int
        Number of joints.

    """

    def __init__(self, n: int) -> None:
        self._n = n

    def solve(self, levels: list[Level], bounds: Bounds, memory: Memory = ()) -> Solution:
        """Return the solution of levels with demands."""
        whole = sequential(levels, self._n)
        return Solution(scale_uniformly(whole, bounds.lower, bounds.upper)[0], levels)

    @property
    def undamped(self) -> 'SequentialSolver':
        """Return the solver itself: it has no damping."""
        return self
