# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Damping of the solver, which prevents motions that the robot cannot follow.

A level moves the robot along the singular directions q_i of its projected Jacobian
(`tp_controller.solver.null_space`). For a singular value s and a demand d its step along one is ::

    a = s d / max(s² + λ² (1 − s²/ε²), c)

The first term damps directions that hardly move the task. λ acts below the singular region ε
only, and grows from zero where a direction enters it.

The second term damps directions with curvature. The solver linearises a level in each cycle. Its
true constraint curves during a zero-order hold of a period T, and so do those of the levels above
on which it exerts multipliers. Newton's method would add this curvature to s²: it is the Hessian
of the Lagrangian (Nocedal and Wright, Numerical Optimization, 18.1). Without it, a robot with a
goal out of reach reverses in every cycle. The solver does not have the Hessian, but a bound: J
changes by about ‖J‖ per radian, and by `TURNING` if its rows are short. For a level with the
residual w, and the multipliers μ of levels above and ν of rows with bounds, of the length 1, ::

    h = ‖J‖ ‖w‖ + Σ ‖J_l‖ ‖μ_l‖ + ‖ν‖,        c = κ T h

If every demand is met, h is zero and the recursion exact. Only lasting multipliers make a robot
oscillate: h is low-pass filtered with the time constant `MEMORY`, from cycle to cycle.

Sources: lecture 2.2, 4; lab exercise 2; wiki, Pseudoinverse Calculation and Singularity Damping.
"""

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np
from tp_controller.solver.level import Array, norm

# κ: factor of the curvature in the damping [1]. Robots with goals out of reach oscillate for ever
# in 43 of 140 runs with 0, in 0 with 1 (`benchmarks/calm.py`). With commands two cycles late they
# oscillate in 3 of 112 runs with 2, in 0 with 4.
CURVATURE = 4.0
# Minimum change of J per radian, also for short rows [unit/rad²]: at a stretched arm, where one
# row of a tool's position is shortest, it turns fastest. A Panda that reaches for a height out of
# reach oscillates in every cycle at 2.6 rad/s with 0, at 0.2 rad/s above a posture with 1, and
# not at all with 2.
TURNING = 2.0
# The same for a row with bounds. A tool that is to enter a region beyond its reach oscillates in
# 245 of 500 cycles with 0.2; with 1 the tool gets 0.57 mm outside in one of 1000 runs of
# `inequalities.py --types keep_in`, with 0.5 at most 0.18 mm in all.
ROW_TURNING = 0.5
# Share of λ, ε and μ that the first level uses [1]. Its loss should be small: its residual is 1 %
# larger than necessary in 23 % of fast states with 1, 7 % with 0.5, 2 % with 0.2 (`loss.py`). The
# levels below have singular values of zero wherever a level above prevents their demand: with 0.5
# for all levels, swapping two of them makes joints jump by 380 rad/s² instead of 4.
FIRST = 0.2
# Time constant of h [s]. At the ridge of a manipulability that is maximized, joints jump in 41 of
# 500 cycles with 0.3, in 0 with 0.1.
MEMORY = 0.1


@dataclass(frozen=True, eq=False)
class Damping:
    """
    Damping of the levels below the first, in the units of J; `first` is that of the first.

    Attributes
    ----------
    damping : float
        λ; 0: undamped.
    singular_region : float
        ε; infinite: λ acts everywhere, damped least squares (lecture 2.2), and c nowhere.
    release_region : float
        See `tp_controller.solver.null_space.remaining`.
    regularisation : float
        μ, see `tp_controller.solver.qp.regularised`.

    """

    damping: float = 0.0
    singular_region: float = math.inf
    release_region: float = 0.0
    regularisation: float = 0.0

    @cached_property
    def first(self) -> 'Damping':
        """Return the damping of the first level, with the full λ if that acts everywhere."""
        share = 1.0 if self.everywhere else FIRST
        return Damping(share * self.damping, share * self.singular_region, self.release_region,
                       FIRST * self.regularisation)

    @property
    def off(self) -> bool:
        """Return whether λ damps no direction."""
        return self.damping == 0.0 or self.singular_region == 0.0

    @property
    def everywhere(self) -> bool:
        """Return whether λ damps all directions."""
        return self.damping > 0.0 and self.singular_region == math.inf

    @cached_property
    def _undamped_above(self) -> float:
        """Return the singular value above which λ damps no direction and none is relaxed."""
        return max(0.0 if self.off else self.singular_region, self.release_region)

    @cached_property
    def _added(self) -> tuple[float, float]:
        """Return k and λ² for s² + λ² (1 − s²/ε²) = k s² + λ²."""
        if self.off:
            return 1.0, 0.0
        return 1.0 - (self.damping / self.singular_region) ** 2, self.damping ** 2

    def spares(self, s: float, c: float) -> bool:
        """Return whether singular values of at least s are neither damped nor relaxed."""
        return s >= self._undamped_above and s * s >= c

    def gains(self, s: Array, c: float) -> Array:
        """Return s / max(s² + λ² (1 − s²/ε²), c) for s (k,), the largest first."""
        if not len(s) or self.spares(s[-1], c):
            return 1.0 / s
        k, added = self._added
        # At ε the terms with λ cancel; beyond it their sum is negative.
        return np.array([
            each / max(each * each, k * each * each + added, c) for each in s.tolist()])

    def curvature(self, h: float, period: float) -> float:
        """Return c for a period [s]; 0 if λ damps all directions."""
        return 0.0 if self.everywhere else CURVATURE * period * h

    def follow(self, h: float, now: float, period: float) -> float:
        """Return h for the next cycle: low-pass filtered towards its value `now`."""
        if h == now == 0.0:
            return 0.0
        h = now + (h - now) * math.exp(-period / MEMORY)
        # Drop h if it damps no direction that λ, or else μ, leaves undamped.
        least = self.singular_region if self.damping else self.regularisation
        c = self.curvature(h, period)
        return h if c > (0.0 if now > 0.0 else least ** 2) else 0.0


def bend(size: float, push: float) -> float:
    """Return the part of h of a level with ‖J‖ = `size` and ‖multipliers‖ = `push`."""
    return max(size, TURNING) * push


def bend_of_rows(lengths: Array, multipliers: Array) -> float:
    """Return the part of h of rows of length 1, normalised from rows of these lengths."""
    return norm(multipliers * np.maximum(1.0, ROW_TURNING / lengths))
