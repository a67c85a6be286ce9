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

import numpy as np
from scipy.linalg import lapack
from tp_controller.level import identity

# Below this, relative to ‖J‖, the squared condition number costs digits: the recursion is asked.
WELL_CONDITIONED = 1e-2


def solve_stacked(levels, n, damping, singular_region):
    """
    Return the velocity (n,), or None where the recursion is needed.

    Parameters
    ----------
    levels : list of Level
        The highest priority first.
    n : int
        Number of joints.
    damping, singular_region : float
        See `tp_controller.solver.solve`. The answer given is one that no damping touches.

    Returns
    -------
    ndarray (n,) or None

    """
    zeta = None
    if levels and levels[-1].J is identity(n):
        if damping > 0.0 and singular_region > 1.0:
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
    factor, info = lapack.dpotrf(gram)
    if info != 0:
        return None
    # The diagonal blocks of the factor belong to the projected levels, L_ii L_iiᵀ = J̄_i J̄_iᵀ,
    # and those of its inverse to their inverses: no singular value of any J̄_i is below
    # 1 / ‖L⁻¹‖.
    inverse = lapack.dtrtri(factor)[0].ravel('K')
    smallest_squared = WELL_CONDITIONED ** 2 * gram.trace()
    if damping > 0.0:
        smallest_squared = max(smallest_squared, singular_region ** 2)
    if not smallest_squared * inverse.dot(inverse) <= 1.0:
        return None
    if zeta is None:
        return J.T.dot(lapack.dpotrs(factor, v)[0])
    return zeta + J.T.dot(lapack.dpotrs(factor, v - J.dot(zeta))[0])
