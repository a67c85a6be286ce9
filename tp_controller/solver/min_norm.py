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
The usual case, solved at once: all levels compatible and far from singular.

Where the rows of all levels, stacked, have full rank, every level can be met exactly and the
recursion finds the smallest velocity that does so: ζ = Jᵀ (J Jᵀ)⁻¹ v, one Cholesky
factorisation instead of a singular value decomposition per level. A closing level that asks for
a velocity of every joint, J = I, is met as closely as the others allow by starting from it:
ζ = v_I + Jᵀ (J Jᵀ)⁻¹ (v − J v_I).
"""

import math

import numpy as np
from scipy.linalg.blas import dnrm2
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtri
from tp_controller.solver.level import identity

# Below this, relative to ‖J‖, the squared condition number costs digits: the recursion is asked.
WELL_CONDITIONED = 1e-2


def solve_stacked(levels, n, damping):
    """
    Return the velocity (n,), or None where the recursion is needed.

    Parameters
    ----------
    levels : list of Level
        The highest priority first.
    n : int
        Number of joints.
    damping : tp_controller.solver.null_space.Damping
        The answer given is one that it does not touch.

    Returns
    -------
    ndarray (n,) or None

    """
    zeta = None
    if levels and levels[-1].J is identity(n):
        if not damping.spares(1.0, 0.0):
            return None
        zeta = levels[-1].v
        levels = levels[:-1]
    if not levels:
        return np.zeros(n) if zeta is None else zeta.copy()
    if len(levels) == 1:
        J, v = levels[0].J, levels[0].v
    else:
        if sum(len(level.v) for level in levels) > n:
            return None
        J = np.concatenate([level.J for level in levels])
        v = np.concatenate([level.v for level in levels])
    if not 0 < len(v) <= n:
        return None
    gram = J.dot(J.T)
    factor, info = dpotrf(gram)
    if info != 0:
        return None
    inverse = dtrtri(factor)[0]
    squared_norm = _squared_norm(inverse)
    if not WELL_CONDITIONED ** 2 * _squared_norm(J) * squared_norm <= 1.0:
        return None
    if not _undamped(levels, factor, inverse, squared_norm, v, damping):
        return None
    if zeta is None:
        return J.T.dot(dpotrs(factor, v)[0])
    return zeta + J.T.dot(dpotrs(factor, v - J.dot(zeta))[0])


def _undamped(levels, factor, inverse, squared_norm, v, damping):
    """
    Return whether no singular value of any projected level is in the singular region.

    The diagonal blocks of the Cholesky factor R belong to the projected levels,
    R_iiᵀ R_ii = J̄_i J̄_iᵀ, and those of its inverse are their inverses: the smallest singular
    value s of J̄_i is 1/‖R_ii⁻¹‖. That norm is bounded from above, cheaply by the Frobenius norm
    of the whole inverse, and more closely by 1/s² ≤ ‖R_ii⁻ᵀ R_ii⁻¹‖, level by level. What is
    wanted of a level beyond the levels above is R_iiᵀ z_i with Rᵀ z = v.
    """
    if damping.spares(squared_norm ** -0.5, math.inf):
        return True
    first, z = 0, None
    for level in levels:
        rows = slice(first, first + len(level.v))
        if rows.stop > first:
            if first == 0:
                wish = v[rows]
            else:
                z = inverse.T.dot(v) if z is None else z
                wish = factor[rows, rows].T.dot(z[rows])
            speed = math.sqrt(wish.dot(wish))
            block = inverse[rows, rows]
            if not damping.spares(_squared_norm(block) ** -0.5, speed) \
                    and not damping.spares(_squared_norm(block.dot(block.T)) ** -0.25, speed):
                return False
        first = rows.stop
    return True


def _squared_norm(matrix):
    """Return the square of the Frobenius norm, infinite where it is beyond all numbers."""
    norm = dnrm2(matrix.ravel('K'))
    return norm * norm
