# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Meshes in binary STL, the usual format of collision meshes, and convex hulls.

numpy reads the meshes and Qhull computes the hulls; both let other threads of Python run. The
collision library blocks them for up to 160 ms.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from tp_controller.model.spatial import Array

# Size of the header, with the number of triangles [bytes], and layout of a triangle.
HEADER_BYTES = 84
TRIANGLE = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('rest', '<u2')])


def binary_stl(path: Path) -> Array | None:
    """Return the corners (m, 3) of all triangles of a binary STL; None for any other file."""
    with open(path, 'rb') as file:
        count = int.from_bytes(file.read(HEADER_BYTES)[-4:], 'little')
        size = HEADER_BYTES + count * TRIANGLE.itemsize
        if path.suffix.lower() != '.stl' or path.stat().st_size != size:
            return None
        triangles = np.fromfile(file, TRIANGLE, count)
    return triangles['corners'].reshape(-1, 3).astype(float)


def convex_hull(points: Array) -> tuple[Array, NDArray[np.intp]]:
    """
    Return the convex hull of points.

    Parameters
    ----------
    points : ndarray (m, 3)
        Any order; repetitions are allowed.

    Returns
    -------
    corners : ndarray (c, 3)
        Points on the hull.
    faces : ndarray (f, 3) of int
        Indices of the corners of triangles, anticlockwise as seen from outside.

    Raises
    ------
    RuntimeError, ValueError
        The points are in one plane, or not finite.

    """
    hull = ConvexHull(points, qhull_options='Qt')
    index = np.zeros(len(points), dtype=int)
    index[hull.vertices] = range(len(hull.vertices))
    corners, faces = points[hull.vertices], index[hull.simplices]
    a, b, c = (corners[faces[:, corner]] for corner in range(3))
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces[inward] = faces[inward, ::-1]
    return corners, faces
