# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Solid shapes in a scene of the browser, and their bounds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
import math

import numpy as np
from tp_controller.model.spatial import Array, quaternion_from_rotation
from tp_controller.model.state import RobotState
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


def corners(parts: Mapping[str, Sequence[Part]]) -> dict[str, Array]:
    """Return {link: points (k, 3)}: the corners of boxes around its parts, in its axes [m]."""
    return {link: np.concatenate([_corners(part) for part in each])
            for link, each in parts.items() if each}


def outer_points(state: RobotState, own: Mapping[str, Array]) -> Array:
    """
    Return points whose convex hull contains a robot.

    Parameters
    ----------
    state : RobotState
        State of the robot.
    own : mapping
        {link: points (k, 3) in its axes}, as `corners` returns them [m].

    Returns
    -------
    ndarray (k, 3)
        In the root frame [m]; empty for a robot without parts.

    """
    found = [np.zeros((0, 3))]
    for link, points in own.items():
        T = state.pose(link)
        found.append(points @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(found)


def lowest(state: RobotState, parts: Mapping[str, Sequence[Part]]) -> float:
    """Return the height of the lowest point of a robot [m]; infinite if it has no parts."""
    found = math.inf
    for link, each in parts.items():
        for part in each:
            T = state.pose(link) @ part.T
            found = min(found, float(T[2, 3]) - _reach(part, -T[2, :3]))
    return found


def _corners(part: Part) -> Array:
    """Return the corners (8, 3) of a box around a part, in the axes of its link [m]."""
    high, low = ([sign * _reach(part, sign * axis) for axis in np.eye(3)] for sign in (1.0, -1.0))
    return np.array(list(product(*zip(low, high)))) @ part.T[:3, :3].T + part.T[:3, 3]


def _reach(part: Part, d: Array) -> float:
    """Return the largest coordinate of a part along a unit vector (3,) in its own axes [m]."""
    size = np.array(part.size)
    if part.mesh is not None:
        return float((part.mesh.points @ (size * d)).max())
    if part.kind == 'box':
        return float(0.5 * size @ np.abs(d))
    if part.kind == 'sphere':
        return float(np.linalg.norm(size * d))
    # Exact, not of the bounding box: a turned wheel stands on the same ground.
    return float(size[0] * math.hypot(d[0], d[1]) + 0.5 * size[1] * abs(d[2]))
