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

"""What the solver returns."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class LevelSolution:
    """
    How far one level was carried out.

    Attributes
    ----------
    wanted : ndarray (m,)
        Task velocity that was asked for.
    achieved : ndarray (m,)
        J q_dot, with the velocity that was returned.
    residual : ndarray (m,)
        wanted − achieved.
    scale : float
        Factor, in [0, 1], that bounds on the velocity put on this level.
    rank : int
        Directions of the level that the levels above left it.
    smallest_singular_value : float
        m-th singular value of J P, P the projector on what the levels above left free: 0 where
        the level cannot move in some direction at all, small near a singularity.

    """

    wanted: np.ndarray
    achieved: np.ndarray
    scale: float
    rank: int
    smallest_singular_value: float

    @property
    def residual(self):
        """Return wanted − achieved (m,)."""
        return self.wanted - self.achieved


class Solution:
    """
    The answer of the solver.

    Attributes
    ----------
    velocity : ndarray (n,)
        Joint velocities (quasi-velocities where a base is involved).
    scale : float
        Factor in [0, 1] that brought the velocities within their bounds.
    limiting : int or None
        Index of the joint whose bound decided `scale`; None where nothing was scaled.
    levels : tuple of LevelSolution
        Evaluated when it is first asked for.

    """

    def __init__(self, velocity, scale, limiting, levels, ranks, start):
        self.velocity = velocity
        self.scale = scale
        self.limiting = limiting
        self._levels = levels
        self._start = start
        # What the fast path did not need to know is found out when it is asked for.
        self._ranks = ranks

    def singular_values_alone(self, index):
        """Return the singular values of a level as if there were no other, weights included."""
        return np.linalg.svd(self._levels[index].J.dot(self._start), compute_uv=False)

    @cached_property
    def levels(self):
        """Return what was wanted, achieved and possible, level by level."""
        return tuple(
            LevelSolution(level.v, level.J.dot(self.velocity), self.scale, rank, smallest)
            for level, (rank, smallest) in zip(
                self._levels, self._ranks() if callable(self._ranks) else self._ranks))
