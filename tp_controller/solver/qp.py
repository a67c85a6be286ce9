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
The quadratic program that everything within bounds comes down to: the nearest point.

With the coordinates of a level scaled by the roots of their stiffness, minimising its quadratic
form is looking for the point z of a polytope that is nearest to a given one::

    minimise ½ ‖z − point‖²    subject to    lower ≤ A z ≤ upper

DAQP, a dual active-set method, does that in microseconds. It takes a polytope for empty where
rows of A that all but coincide contradict each other by rounding: joints that can only move
together, each at its limit. Such a program is handed to the non-negative least squares of Lawson
and Hanson (Solving Least Squares Problems, 1974, chapter 23, problem LDP), which is slower and
needs a little room.

Rows shorter than 3e-6 are none to DAQP: what z hardly moves does not hold it up.
"""

from functools import lru_cache

import daqp
import numpy as np
from scipy.optimize import nnls

# How exactly DAQP keeps bounds; the next one where rounding at a corner defeats this.
TOLERANCES = (1e-11, 1e-10, 1e-9, 1e-8)
# What the second method may exceed them by, and what an answer of it must not, per distance.
ROOM = 1e-8
EXCESS = 1e-6


def nearest_point(point, A, lower, upper):
    """
    Return the z (k,) of a polytope that is nearest to a point.

    Parameters
    ----------
    point : ndarray (k,)
        What to come near to.
    A : ndarray (r, k)
        Rows of the polytope.
    lower, upper : ndarray (r,)
        Bounds on A z, infinite where there is none. Some z is within them.

    Returns
    -------
    (z, multipliers) or None
        z (k,) within the bounds to one of `TOLERANCES`, or to about `ROOM` where rows all but
        coincide; multipliers (r,) with z = point − Aᵀ multipliers, positive at upper bounds,
        negative at lower ones, else zero. None where rounding defeats both methods.

    """
    found = nearest_point_if_any(point, A, lower, upper)
    return by_least_squares(point, A, lower, upper) if found is None else found


def nearest_point_if_any(point, A, lower, upper):
    """Return what `nearest_point` does; None where the polytope is empty, or all but empty."""
    identity = _identity(len(point))
    for tolerance in TOLERANCES:
        z, _, flag, information = daqp.solve(identity, -point, A, upper, lower,
                                             primal_tol=tolerance)
        if flag == 1:
            return z, information['lam']
    return None


def by_least_squares(point, A, lower, upper):
    """
    Return what `nearest_point` does, with `ROOM` beyond the bounds; None where it fails.

    For y = z − point the bounds are G y ≥ h. Where u ≥ 0 minimises ‖E u − f‖ with E = [Gᵀ; hᵀ] and
    f = (0, …, 0, 1), the shortest such y is Gᵀ u / (1 − hᵀ u). Lengths are measured in a unit
    that keeps h moderate.
    """
    unit = 1.0 + np.linalg.norm(point)
    values = A.dot(point)
    G = np.concatenate([-A, A])
    h = (np.concatenate([values - upper, lower - values]) - ROOM) / unit
    bounded = np.isfinite(h)
    E = np.concatenate([G.T, h[np.newaxis]])[:, bounded]
    f = np.zeros(len(E))
    f[-1] = 1.0
    if not E.shape[1]:
        return None
    try:
        u, _ = nnls(E, f)
    except RuntimeError:
        return None
    left = 1.0 - E[-1].dot(u)
    if left <= 0.0:
        # No z is within the bounds.
        return None
    both = np.zeros(len(h))
    both[bounded] = unit * u / left
    at_upper, at_lower = np.split(both, 2)
    multipliers = at_upper - at_lower
    z = point - A.T.dot(multipliers)
    # Nobody else would notice that rounding has spoilt the answer.
    values = A.dot(z)
    within = np.maximum(values - upper, lower - values).max() <= EXCESS * unit
    return (z, multipliers) if within else None


@lru_cache(maxsize=None)
def _identity(k):
    """Return the identity as DAQP wants it, in memory that may be written to."""
    return np.eye(k)
