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

"""A level, seen by what the levels above left free."""

import math

import numpy as np
from scipy.linalg import lapack
from tp_controller.solver.errors import SolverError
from tp_controller.solver.level import identity

# Fully released below this share of the release region.
RELEASED = 0.1
# κ: how many periods a wish may take at least to lead out of a singularity, per unit of s.
REACTION = 4.0
# The most that λ² and ε² are raised by.
LARGEST_GROWTH = 36.0
# A level below that moves by 1 along a released direction has s of this where half is released.
HALF_RELEASED = 0.1
TINY = 1e-9


class Projection:
    """
    The singular value decomposition of a projected level, J Z = U diag(s) Vᵀ.

    Attributes
    ----------
    level : Level
    tolerance : float
        Singular values up to this count as zero.
    rank : int
        Singular values that are not zero.
    smallest : float
        m-th singular value, 0 where there are fewer.
    U : ndarray (m, rank)
        Directions of the task that can move.
    s : ndarray (rank,)
        Their singular values, the largest first.
    gains : ndarray (rank,)
        Their damped inverses, as the last `aim` used them.
    directions : ndarray (n, k)
        Z V: the motions of the joints that belong to `U`, then those that do not move the task.
    remaining : ndarray (n, k')
        What is left free for the levels below: the motions that do not move the task, and, as
        far as they are released, those along nearly singular directions.
    orthonormal : bool
        Whether the columns of `remaining` are.
    released : float
        Largest singular value that is at least partly released, 0 where none is.

    """

    __slots__ = ('level', 'tolerance', 'rank', 'smallest', 'U', 's', 'gains', 'directions',
                 'remaining', 'orthonormal', '_damping',
                 'released')

    def __init__(self, level, Z, orthonormal, tolerance, damping, release_region):
        self.level, self.tolerance = level, tolerance
        self.orthonormal = orthonormal
        self._damping = damping
        self.released = 0.0
        eye = identity(len(Z))
        whole, start = level.J is eye, Z is eye
        J_bar = Z if whole else level.J if start else level.J.dot(Z)
        rows, columns = J_bar.shape
        if rows == 0 or columns == 0:
            self._nothing(Z, rows)
            return
        if whole and orthonormal:
            U, s, V_T = Z, np.ones(columns), identity(columns)
        else:
            U, s, V_T = _decompose(J_bar)
        self.rank = rank = len(s) if s[-1] > tolerance else int(np.count_nonzero(s > tolerance))
        self.smallest = float(s[rows - 1]) if rows <= columns else 0.0
        self.s = s = s[:rank]
        self.U = U[:, :rank]
        self.directions = Z if whole and orthonormal else V_T.T if start else Z.dot(V_T.T)
        self.remaining = self.directions[:, rank:]
        if rank and s[-1] < release_region:
            self._release(release_region)

    def _nothing(self, Z, rows):
        """Describe a level without rows, or one that was left nothing."""
        self.rank, self.smallest = 0, 0.0
        self.U, self.s, self.gains = np.zeros((rows, 0)), np.zeros(0), np.zeros(0)
        self.directions = self.remaining = Z

    def _release(self, region):
        """Give weak directions up to the levels below, smoothly from `region` on downwards."""
        weak = int(np.count_nonzero(self.s >= region))
        share = (self.s[weak:] / region - RELEASED) / (1.0 - RELEASED)
        kept = np.clip(share, 0.0, 1.0)
        kept = kept * kept * (3.0 - 2.0 * kept)
        # For a level below this is a factor of its s, and damping gives the share to it that
        # belongs to s: so it is that share that has to grow smoothly, and be whole in the end.
        given = np.minimum(HALF_RELEASED * np.sqrt((1.0 - kept) / np.maximum(kept, TINY)), 1.0)
        self.orthonormal, self.released = False, float(self.s[weak])
        self.remaining = np.hstack([self.directions[:, weak:self.rank] * given, self.remaining])

    def step(self, residual):
        """Return the motion (n,) that takes a residual (m,) away, J̄^# residual."""
        return self.directions[:, :self.rank].dot(self.aim(residual))

    def aim(self, residual):
        """Return `step` in coordinates of the first `directions` (rank,)."""
        wish = self.U.T.dot(residual)
        self.gains = self._damping.inverse(self.s, wish)
        return self.gains * wish


class Damping:
    """
    The damped inverse s / (s² + λ²) of singular values, with λ only where it is needed.

    Only directions with s < ε are damped, by λ² (1 − (s / ε)²), which grows from nothing where
    they enter the region. On its way out of a singularity s grows at the rate |v| / λ² for the
    wanted velocity v of the direction. A velocity that is held for a period T would overshoot
    where that is too fast, and swing from one side of the singularity to the other: there λ² is
    raised to κ T |v|, and ε with it.

    Parameters
    ----------
    damping, singular_region, period : float
        λ, ε and T; see `tp_controller.solver.solve.solve`.

    """

    def __init__(self, damping, singular_region, period):
        self._none = damping == 0.0 or singular_region == 0.0
        self._squared, self._region = damping * damping, singular_region
        # Without a region this is the damped least squares of the lecture, and stays it.
        self._plain = self._none or singular_region == math.inf
        self.hold(period)

    def hold(self, period):
        """Take another period [s] from now on."""
        self._pace = 0.0 if self._plain else REACTION * period / self._squared
        # From here on no direction is damped, whatever is wanted of it.
        self._safe = self._region * (1.0 if self._pace == 0.0 else LARGEST_GROWTH ** 0.5)

    def spares(self, s, wish):
        """Say whether singular values of at least `s` are undamped for wishes up to `wish`."""
        if self._none or s >= self._safe:
            return True
        if s < self._region or wish == math.inf:
            return False
        return s * s >= self._region ** 2 * min(max(self._pace * wish, 1.0), LARGEST_GROWTH)

    def inverse(self, s, wish):
        """
        Return the damped inverses.

        Parameters
        ----------
        s, wish : ndarray (k,)
            Positive singular values, the smallest last, and the velocities that are wanted of
            their directions.

        Returns
        -------
        ndarray (k,)

        """
        if not len(s) or self.spares(s[-1], math.sqrt(wish.dot(wish))):
            return 1.0 / s
        growth = np.minimum(np.maximum(self._pace * np.abs(wish), 1.0), LARGEST_GROWTH)
        squares = s * s
        needed = np.maximum(growth - squares / self._region ** 2, 0.0)
        return s / (squares + self._squared * needed)


def _decompose(J_bar):
    """Return U, s and Vᵀ; U at least as wide as s is long."""
    if J_bar.shape[1] == 1:
        size = frobenius(J_bar)
        U, s, V_T = J_bar / (size or 1.0), np.array([size]), identity(1)
        failed = not math.isfinite(size)
    else:
        U, s, V_T, failed = lapack.dgesdd(J_bar)
    if failed:
        raise SolverError('the levels hold numbers that are not finite')
    return U, s, V_T


def frobenius(J):
    """Return the Frobenius norm."""
    entries = J.ravel('K')
    return math.sqrt(entries.dot(entries))
