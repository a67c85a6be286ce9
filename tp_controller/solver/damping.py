# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
All damping of the solver: what keeps levels from moves that the robot cannot follow.

A level moves the robot along the singular directions q_i of what the levels above have left it
(`tp_controller.solver.null_space`). For a singular value s and a demand d its step along one is ::

    a = s d / max(s² + λ² (1 − s²/ε²), c)

The first term is for directions that hardly move the task. λ acts below the singular region ε
only, and grows from nothing where a direction enters it.

The second term is for directions that are curved. In one cycle a level is a plane. In truth it
bends during a zero-order hold of a period T, and so do the levels above that it pushes against.
Newton's method would add that bend to s²: it is the Hessian of the Lagrangian (Nocedal and
Wright, Numerical Optimization, 18.1). Without it, a robot with a goal out of reach reverses in
every cycle. The solver does not have the Hessian, but a bound: J turns by about ‖J‖ for each
radian, and by `TURNING` where its rows are short. For a level that misses w, and that pushes with
the multipliers μ against levels above and ν against rows with bounds, of the length 1, ::

    h = ‖J‖ ‖w‖ + Σ ‖J_l‖ ‖μ_l‖ + ‖ν‖,        c = κ T h

Where every demand is met, h is zero and the recursion exact. Only a push that lasts makes a robot
oscillate: h follows with the time constant `MEMORY`, from cycle to cycle.
"""

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np
from tp_controller.solver.level import Array, norm

# κ: share of the bend that is taken for damping [1]. Goals out of reach shake a robot for ever in
# 43 of 140 runs with 0, in none with 1 (`benchmarks/calm.py`). With commands two cycles late they
# do in 3 of 112 with 2, in none with 4.
CURVATURE = 4.0
# A level turns by this for each radian at least, however short its rows are [unit/rad²]: where
# one row of a tool's position is shortest, at a stretched arm, it turns fastest. A Panda that
# reaches for a height out of reach swings in every cycle at 2.6 rad/s with 0, at 0.2 rad/s above
# a posture with 1, and is calm with 2.
TURNING = 2.0
# The same for a row with bounds. A tool that is to come into a region beyond its reach shakes in
# 245 of 500 cycles with 0.2; with 1 one of 1000 runs of `inequalities.py --types keep_in` gets
# 0.57 mm deep, with 0.5 none deeper than 0.18 mm.
ROW_TURNING = 0.5
# Share of λ, ε and μ that the first level has [1]. That level is to lose little: it misses 1 %
# more than it must in 23 % of fast states with 1, 7 % with 0.5, 2 % with 0.2 (`loss.py`). The
# levels below meet singular values of zero wherever they demand what one above prevents:
# with 0.5 for all, a swap of two levels makes joints jump by 380 rad/s² instead of 4.
FIRST = 0.2
# Time constant with which h follows what a level misses [s]. At the ridge of a manipulability that
# is maximized, joints slip in 41 of 500 cycles with 0.3, in none with 0.1.
MEMORY = 0.1
# h of each level.
Memory = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Damping:
    """
    What damps a level below the first, in the units of J; `first` damps that one.

    Attributes
    ----------
    damping : float
        λ; 0: none at all.
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
        """Return what damps the first level; λ as it is where it acts everywhere."""
        share = 1.0 if self.everywhere else FIRST
        return Damping(share * self.damping, share * self.singular_region, self.release_region,
                       FIRST * self.regularisation)

    @property
    def off(self) -> bool:
        """Say whether λ acts nowhere."""
        return self.damping == 0.0 or self.singular_region == 0.0

    @property
    def everywhere(self) -> bool:
        """Say whether λ acts everywhere."""
        return self.damping > 0.0 and self.singular_region == math.inf

    @cached_property
    def _untouched(self) -> float:
        """Return the singular value above which nothing is damped by λ or relaxed."""
        return max(0.0 if self.off else self.singular_region, self.release_region)

    @cached_property
    def _added(self) -> tuple[float, float]:
        """Return k and λ² for s² + λ² (1 − s²/ε²) = k s² + λ²."""
        if self.off:
            return 1.0, 0.0
        return 1.0 - (self.damping / self.singular_region) ** 2, self.damping ** 2

    def spares(self, s: float, c: float) -> bool:
        """Say whether singular values of at least s are neither damped nor relaxed."""
        return s >= self._untouched and s * s >= c

    def gains(self, s: Array, c: float) -> Array:
        """Return s / max(s² + λ² (1 − s²/ε²), c) for s (k,), the largest first."""
        if not len(s) or self.spares(s[-1], c):
            return 1.0 / s
        k, added = self._added
        # At ε the terms with λ cancel; beyond it their sum is negative.
        return np.array([
            each / max(each * each, k * each * each + added, c) for each in s.tolist()])

    def curvature(self, h: float, period: float) -> float:
        """Return c for a period [s]; 0 where λ acts everywhere."""
        return 0.0 if self.everywhere else CURVATURE * period * h

    def follow(self, h: float, now: float, period: float) -> float:
        """Return the h that the next cycle begins with: this one's, nearer to that of now."""
        if h == now == 0.0:
            return 0.0
        h = now + (h - now) * math.exp(-period / MEMORY)
        # What damps no direction that λ, or else μ, leaves alone is forgotten.
        least = self.singular_region if self.damping else self.regularisation
        c = self.curvature(h, period)
        return h if c > (0.0 if now > 0.0 else least ** 2) else 0.0


def bend(size: float, push: float) -> float:
    """Return the part of h that a level has with ‖J‖ = `size` and ‖multipliers‖ = `push`."""
    return max(size, TURNING) * push


def bend_of_rows(lengths: Array, multipliers: Array) -> float:
    """Return the part of h that rows of length 1 have, with these lengths before."""
    return norm(multipliers * np.maximum(1.0, ROW_TURNING / lengths))
