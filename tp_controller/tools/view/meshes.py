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

"""Mesh files of robot descriptions, as the browser takes them."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
import pinocchio
from tp_controller.model.spatial import Array
from tp_controller.resources import find_file, SCHEME
from tp_controller.ros.signals import uninterrupted

# It takes whatever is raised in it for an error of its own, Ctrl-C too, and goes on.
with uninterrupted():
    import trimesh

FILE_SCHEME = 'file://'
# The largest of example-robot-data has 25 million bytes.
LARGEST_FILE = 64_000_000
# Edges sharper than this stay edges [rad].
SHARP = 0.6
# Packages that are installed beside Pinocchio, as example-robot-data is by pip.
BESIDE = Path(pinocchio.__file__).resolve().parents[4] / 'share'


@dataclass(frozen=True, eq=False)
class Mesh:
    """
    A surface.

    Attributes
    ----------
    unit : float
        Length that the numbers of the file are multiples of [m].
    vertices : ndarray (v, 3) or None
        Corners of triangles, where the file says nothing of colours.
    faces : ndarray (f, 3) of int or None
        The corners of each triangle.
    glb : bytes
        All of it in glTF's binary form where the file has colours; else empty.
    points : ndarray (k, 3)
        All corners, whatever the form.

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
        It is not there, or its package is not installed.

    """
    try:
        return find_file(name.removeprefix(FILE_SCHEME))
    except FileNotFoundError:
        if not name.startswith(SCHEME):
            raise
        path = (BESIDE / name.removeprefix(SCHEME)).resolve()
        if path.is_relative_to(BESIDE) and path.is_file():
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
        It cannot be read.
    ValueError
        It is too large, or nothing that can be shown.
    ModuleNotFoundError
        Its format needs a package that is not installed: ``.dae`` needs pycollada.

    """
    if path.stat().st_size > LARGEST_FILE:
        raise ValueError(f'{path} is larger than {LARGEST_FILE} bytes')
    scene = _read(path)
    unit = _unit(scene)
    for geometry in scene.geometry.values():
        # Some files have three corners of its own for every triangle; edges stay what they are.
        if isinstance(geometry, trimesh.Trimesh):
            geometry.merge_vertices()
    if path.suffix.lower() == '.stl':
        mesh = scene.to_mesh()
        mesh = trimesh.graph.smooth_shade(mesh, angle=SHARP)
        vertices = np.asarray(mesh.vertices)
        return Mesh(unit, vertices, np.asarray(mesh.faces), points=vertices)
    return Mesh(unit, glb=scene.export(file_type='glb'), points=_points(scene))


def _read(path: Path) -> trimesh.Scene:
    """Return what trimesh reads from a file."""
    try:
        scene = trimesh.load_scene(path)
    except (OSError, ModuleNotFoundError):
        raise
    except Exception as error:
        # Whatever a reader of one of many formats stumbles over.
        raise ValueError(f'{path} cannot be read: {error}') from error
    if scene.is_empty:
        raise ValueError(f'{path} has no surface')
    return scene


def _points(scene: trimesh.Scene) -> Array:
    """Return the corners (k, 3) of all surfaces where they are in a scene."""
    placed = (scene.graph[node] for node in scene.graph.nodes_geometry)
    return np.concatenate([trimesh.transform_points(scene.geometry[name].vertices, T)
                           for T, name in placed])


def _unit(scene: trimesh.Scene) -> float:
    """Return the length that the numbers of a file are multiples of [m]; COLLADA says it."""
    for geometry in scene.geometry.values():
        number, _, rest = str(geometry.metadata.get('units', '')).partition(' * ')
        if rest == 'meters':
            return float(number)
    return 1.0
