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
Slow references, written from the definitions and with nothing of the product.

Lexicographic least squares: x minimises ‖J_1 x − v_1‖, among those x minimises ‖J_2 x − v_2‖, and
so on; among what is left it has the smallest norm. The constraints of the upper levels are kept
as the null space of all their rows stacked, not as a recursion of projectors.
"""

import numpy as np
from scipy.linalg import null_space

TOLERANCE = 1e-9


def lexicographic(levels, n, weights=None):
    """
    Return the exact solution (n,).

    Parameters
    ----------
    levels : list of (J, v)
        The highest priority first.
    n : int
        Number of joints.
    weights : array_like (n,), optional
        The norm minimised at the end is Σ w_j x_j².

    """
    x = np.zeros(n)
    rows = np.zeros((0, n))
    for J, v in levels:
        free = null_of(rows)
        x = x + free @ bounded_lstsq(J @ free, v - J @ x, np.linalg.norm(J))
        rows = np.concatenate([rows, J])
    free = null_of(rows)
    W = np.diag(np.ones(n) if weights is None else np.asarray(weights, float))
    return x - free @ np.linalg.solve(free.T @ W @ free, free.T @ W @ x)


def null_of(rows):
    """Return an orthonormal basis (n, k) of the null space."""
    if not rows.size or not np.linalg.norm(rows):
        return np.eye(rows.shape[1])
    return null_space(rows, rcond=TOLERANCE)


def bounded_lstsq(A, b, size):
    """Return the least-squares solution; singular values below TOLERANCE · size are zero."""
    if not A.size or np.linalg.norm(A) <= TOLERANCE * size:
        return np.zeros(A.shape[1])
    largest = np.linalg.norm(A, 2)
    return np.linalg.lstsq(A, b, rcond=TOLERANCE * size / largest)[0]


def residual_norms(levels, x):
    """Return ‖v − J x‖ of every level."""
    return np.array([np.linalg.norm(v - J @ x) for J, v in levels])


def projector(levels, n):
    """Return the orthogonal projector on what the levels leave free (n, n)."""
    rows = np.concatenate([np.zeros((0, n)), *(J for J, _ in levels)])
    free = null_of(rows)
    return free @ free.T


def random_levels(rng, n, rows):
    """Return levels with Gaussian entries, one for each number of rows."""
    return [(rng.standard_normal((m, n)), rng.standard_normal(m)) for m in rows]
