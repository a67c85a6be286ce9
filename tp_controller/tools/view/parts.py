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

"""Solid shapes in a scene of the browser."""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from tp_controller.model.spatial import Array, quaternion_from_rotation
from tp_controller.tools.view.meshes import Mesh
import viser

Colour = tuple[int, int, int]
Vector = tuple[float, float, float]
# Order w, x, y, z.
Quaternion = tuple[float, float, float, float]

LINK_COLOUR: Colour = (224, 227, 232)
# Largest distance from the root frame [m].
FARTHEST = 1e6
# Tolerance of the norm of a quaternion.
UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Part:
    """
    Solid fixed to a link.

    Attributes
    ----------
    kind : str
        ``box``, ``sphere``, ``cylinder`` (along z) or ``mesh``.
    size : tuple of float
        Sides; radius; radius and length [m]; for a mesh the scale along each axis.
    T : ndarray (4, 4)
        Pose on the link.
    colour : tuple of int or None
        Red, green and blue up to 255; None if the mesh has its own colour.
    opacity : float
        1 for an opaque solid.
    mesh : Mesh or None

    """

    kind: str
    size: tuple[float, ...]
    T: Array
    colour: Colour | None = LINK_COLOUR
    opacity: float = 1.0
    mesh: Mesh | None = None


def is_pose(wxyz: Quaternion, position: Vector) -> bool:
    """Return whether a quaternion and a position [m] form a pose within range."""
    return (abs(math.hypot(*wxyz) - 1.0) <= UNIT_TOLERANCE
            and all(abs(each) <= FARTHEST for each in position))


def wxyz(R: Array) -> Array:
    """Return a rotation (3, 3) as the quaternion (4,) of viser, w first."""
    return np.roll(quaternion_from_rotation(R), 1)


def place(handle: viser.SceneNodeHandle, T: Array) -> None:
    """Move a node of a scene to a pose (4, 4)."""
    handle.position = T[:3, 3]
    handle.wxyz = wxyz(T[:3, :3])


def add_part(scene: viser.SceneApi, name: str, part: Part) -> viser.SceneNodeHandle:
    """Add a solid to a scene, below the node that its name starts with."""
    handle = ADD[part.kind](scene, name, part)
    place(handle, part.T)
    return handle


def _opacity(part: Part) -> float | None:
    """Return the opacity for viser; None for an opaque part."""
    return part.opacity if part.opacity < 1.0 else None


def _scale(part: Part) -> tuple[float, float, float]:
    """Return the scale along three axes; a single size applies to all."""
    x, y, z = part.size if len(part.size) == 3 else 3 * part.size
    return x, y, z


def _box(scene: viser.SceneApi, name: str, part: Part) -> viser.SceneNodeHandle:
    """Add a box."""
    return scene.add_box(name, part.colour or LINK_COLOUR, np.array(part.size),
                         opacity=_opacity(part), cast_shadow=part.opacity == 1.0)


def _sphere(scene: viser.SceneApi, name: str, part: Part) -> viser.SceneNodeHandle:
    """Add a sphere, or an ellipsoid with three radii."""
    return scene.add_icosphere(name, 1.0, part.colour or LINK_COLOUR,
                               scale=_scale(part),
                               opacity=_opacity(part), cast_shadow=part.opacity == 1.0)


def _cylinder(scene: viser.SceneApi, name: str, part: Part) -> viser.SceneNodeHandle:
    """Add a cylinder."""
    radius, length = part.size
    return scene.add_cylinder(name, radius, length, part.colour or LINK_COLOUR,
                              opacity=_opacity(part), flat_shading=False,
                              cast_shadow=part.opacity == 1.0)


def _mesh(scene: viser.SceneApi, name: str, part: Part) -> viser.SceneNodeHandle:
    """Add a mesh."""
    mesh = part.mesh or Mesh()
    if mesh.vertices is None or mesh.faces is None:
        return scene.add_glb(name, mesh.glb, scale=_scale(part))
    return scene.add_mesh_simple(name, mesh.vertices, mesh.faces, side='double',
                                 color=part.colour or LINK_COLOUR, opacity=_opacity(part),
                                 scale=_scale(part))


ADD: dict[str, Callable[[viser.SceneApi, str, Part], viser.SceneNodeHandle]] = {
    'box': _box, 'sphere': _sphere, 'cylinder': _cylinder, 'mesh': _mesh}
