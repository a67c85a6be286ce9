# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Mesh files of robot descriptions, converted for the browser."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
import pinocchio
from tp_controller.model.spatial import Array
from tp_controller.resources import find_file, SCHEME
from tp_controller.ros.signals import uninterrupted

# Its import treats every exception, including that of Ctrl-C, as a missing dependency.
with uninterrupted():
    import trimesh

FILE_SCHEME = 'file://'
# Largest mesh file [bytes]; that of example-robot-data has 25 million.
MOST_BYTES = 64_000_000
# Angle of an edge from which it is shaded as an edge [rad].
EDGE_ANGLE = 0.6
# Folder of packages installed beside Pinocchio, such as example-robot-data by pip.
SHARE_FOLDER = Path(pinocchio.__file__).resolve().parents[4] / 'share'


@dataclass(frozen=True, eq=False)
class Mesh:
    """
    Triangle mesh.

    Attributes
    ----------
    unit : float
        Unit of the coordinates of the file [m].
    vertices : ndarray (v, 3) or None
        Vertices of the triangles, if the file has no colours.
    faces : ndarray (f, 3) of int or None
        Vertex indices of each triangle.
    glb : bytes
        The mesh in glTF's binary form if the file has colours; else empty.
    points : ndarray (k, 3)
        All vertices, in either form.

    """

    unit: float = 1.0
    vertices: Array | None = None
    faces: NDArray[np.intp] | None = None
    glb: bytes = b''
    points: Array = field(default_factory=lambda: np.zeros((1, 3)))


def mesh_path(name: str) -> Path:
    """
    Return the path of a mesh file.

    Parameters
    ----------
    name : str
        A path, ``file://…`` or ``package://…``.

    Raises
    ------
    FileNotFoundError
        The file is missing, or its package is not installed.

    """
    try:
        return find_file(name.removeprefix(FILE_SCHEME))
    except FileNotFoundError:
        if not name.startswith(SCHEME):
            raise
        path = (SHARE_FOLDER / name.removeprefix(SCHEME)).resolve()
        if path.is_relative_to(SHARE_FOLDER) and path.is_file():
            return path
        raise


@lru_cache(maxsize=256)
@uninterrupted()
def load_mesh(path: Path) -> Mesh:
    """
    Return the content of a mesh file.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is too large, or contains no surface.
    ModuleNotFoundError
        The format needs a package that is not installed: ``.dae`` needs pycollada.

    """
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f'{path} is larger than {MOST_BYTES} bytes')
    scene = _read(path)
    unit = _unit(scene)
    for geometry in scene.geometry.values():
        # Some files repeat the vertices of every triangle; the shading of edges is unaffected.
        if isinstance(geometry, trimesh.Trimesh):
            geometry.merge_vertices()
    if path.suffix.lower() == '.stl':
        mesh = scene.to_mesh()
        mesh = trimesh.graph.smooth_shade(mesh, angle=EDGE_ANGLE)
        vertices = np.asarray(mesh.vertices)
        return Mesh(unit, vertices, np.asarray(mesh.faces), points=vertices)
    return Mesh(unit, glb=scene.export(file_type='glb'), points=_points(scene))


def _read(path: Path) -> trimesh.Scene:
    """Return the trimesh scene of a file."""
    try:
        scene = trimesh.load_scene(path)
    except (OSError, ModuleNotFoundError):
        raise
    except Exception as error:
        # The readers of the many formats raise arbitrary exceptions.
        raise ValueError(f'{path} cannot be read: {error}') from error
    if scene.is_empty:
        raise ValueError(f'{path} has no surface')
    return scene


def _points(scene: trimesh.Scene) -> Array:
    """Return the vertices (k, 3) of all surfaces, at their poses in a scene."""
    placed = (scene.graph[node] for node in scene.graph.nodes_geometry)
    return np.concatenate([trimesh.transform_points(scene.geometry[name].vertices, T)
                           for T, name in placed])


def _unit(scene: trimesh.Scene) -> float:
    """Return the unit of the coordinates of a file [m], which COLLADA specifies."""
    for geometry in scene.geometry.values():
        number, _, rest = str(geometry.metadata.get('units', '')).partition(' * ')
        if rest == 'meters':
            return float(number)
    return 1.0
