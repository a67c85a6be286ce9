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
Convex hulls of meshes.

A file is read once. Those in binary STL, as most collision meshes are, are read and wrapped by
numpy and Qhull, which let other threads of Python run; Coal does not, for up to 160 ms.
"""

from functools import lru_cache
from pathlib import Path

import coal
import numpy as np
from scipy.spatial import ConvexHull
from tp_controller.model.spatial import Array

# The largest collision mesh of example-robot-data has 3.4 million bytes, which take Coal 0.16 s.
MOST_BYTES = 20_000_000
STL_HEADER = 84
STL_TRIANGLE = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('rest', '<u2')])


def mesh_hull(path: Path, scale: Array) -> coal.CollisionGeometry:
    """
    Return the convex hull of a mesh.

    Parameters
    ----------
    path : pathlib.Path
        File in a format of Assimp.
    scale : ndarray (3,)
        By which it is multiplied along each axis.

    Raises
    ------
    OSError
        It cannot be read, is too large, or has no volume.

    """
    found = path.stat()
    if found.st_size > MOST_BYTES:
        raise OSError(f'{path} has {found.st_size} bytes; at most {MOST_BYTES} are read')
    try:
        return _hull(path, found.st_size, found.st_mtime_ns, tuple(scale.tolist()))
    except (RuntimeError, ValueError) as error:
        raise OSError(f'{path}: {error}') from error


@lru_cache(maxsize=256)
def _hull(path: Path, size: int, changed: int,
          scale: tuple[float, float, float]) -> coal.CollisionGeometry:
    """Return the hull of a file of a size, as it was when it changed last [ns]."""
    points = _binary_stl(path, size)
    if points is None:
        mesh = coal.MeshLoader().load(str(path), np.array(scale))
        mesh.buildConvexHull(True, 'Qt')
        return mesh.convex
    hull = ConvexHull(points * scale, qhull_options='Qt')
    index = np.zeros(len(points), dtype=int)
    index[hull.vertices] = range(len(hull.vertices))
    corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in hull.points[hull.vertices]:
        corners.append(point)
    for face in index[_outward(hull)].tolist():
        faces.append(coal.Triangle(*face))
    return coal.Convex(corners, faces)


def _binary_stl(path: Path, size: int) -> Array | None:
    """Return the corners (m, 3) of all triangles of a binary STL; None for another file."""
    with open(path, 'rb') as file:
        count = int.from_bytes(file.read(STL_HEADER)[-4:], 'little')
        if path.suffix.lower() != '.stl' or size != STL_HEADER + count * STL_TRIANGLE.itemsize:
            return None
        triangles = np.fromfile(file, STL_TRIANGLE, count)
    return triangles['corners'].reshape(-1, 3).astype(float)


def _outward(hull: ConvexHull) -> Array:
    """Return the corners (f, 3) of the faces, anticlockwise as seen from outside."""
    faces: Array = hull.simplices.copy()
    a, b, c = (hull.points[faces[:, corner]] for corner in range(3))
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces[inward, 1:] = faces[inward, :0:-1]
    return faces
