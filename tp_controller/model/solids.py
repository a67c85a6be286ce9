# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Solids on the frames of a robot: convex shapes in the form of the collision library Coal.

A mesh counts as its convex hull.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
from pathlib import Path
from typing import TypeAlias

import coal
import numpy as np
from tp_controller.model.meshes import binary_stl, convex_hull
from tp_controller.model.shapes import Box, Cylinder, Shape, Sphere
from tp_controller.model.spatial import Array, pose

Geometry: TypeAlias = coal.CollisionGeometry
# Shapes in the compiled core, numbered as in clearance.h: a line is a capsule or a sphere.
OTHER, LINE, PLANE = range(3)
# Shortest line [m]: Coal takes shorter ones for points.
LEAST_LENGTH = 1e-5


@dataclass(eq=False)
class Solid:
    """
    Shape that is fixed to a frame of the robot.

    Attributes
    ----------
    name, frame : str
    pose : ndarray (4, 4)
        T_frame_solid.
    geometry : coal.CollisionGeometry
        A half-space is below the plane z = 0 of `pose`.

    """

    name: str
    frame: str
    pose: Array
    geometry: Geometry

    def __post_init__(self) -> None:
        """Compute the box around the geometry, which counts when Coal compares two of them."""
        self.geometry.computeLocalAABB()

    @cached_property
    def numbers(self) -> list[float]:
        """Return shape, halves of the box around it, and placement of the box on the frame."""
        kind, pose = self.geometry, self.pose
        if isinstance(kind, coal.Halfspace):
            return [PLANE, 0.0, 0.0, 0.0, *pose[:3, :3].ravel(), *pose[:3, 3]]
        low, high = kind.aabb_local.min_, kind.aabb_local.max_
        line = isinstance(kind, coal.Sphere) or (
            isinstance(kind, coal.Capsule) and kind.halfLength > LEAST_LENGTH)
        return [LINE if line else OTHER, *(0.5 * (high - low)), *pose[:3, :3].ravel(),
                *(pose[:3, :3] @ (0.5 * (low + high)) + pose[:3, 3])]


def capsule(name: str, frame: str, start: Array, end: Array, radius: float) -> Solid:
    """Return the `Solid` of all points within a radius of a line from start to end (3,) [m]."""
    along = end - start
    length = math.sqrt(along.dot(along))
    middle = 0.5 * (start + end)
    if length == 0.0:
        return Solid(name, frame, pose(np.eye(3), middle), coal.Sphere(radius))
    # Any orientation will do that has its z axis along the line, in either direction.
    R = np.linalg.qr(np.column_stack([along, np.eye(3)]))[0][:, [1, 2, 0]]
    R[:, 0] *= np.linalg.det(R)
    return Solid(name, frame, pose(R, middle), coal.Capsule(radius, length))


def solid(name: str, frame: str, shape: Shape, T_frame_shape: Array) -> Solid:
    """Return the `Solid` of one of `tp_controller.model.shapes`."""
    return Solid(name, frame, T_frame_shape, _geometry(shape))


def _geometry(shape: Shape) -> Geometry:
    """Return the geometry of a shape in Coal."""
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    if isinstance(shape, Box):
        return coal.Box(*(2.0 * shape.half))
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.half[0], 2.0 * shape.half[1])
    return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)


@lru_cache(maxsize=256)
def mesh_hull(path: Path, changed: int, scale: tuple[float, float, float]) -> Geometry:
    """Return the convex hull of the mesh in a file that changed at a time [ns], cached."""
    points = binary_stl(path)
    if points is None:
        mesh = coal.MeshLoader().load(str(path), np.array(scale))
        mesh.buildConvexHull(True, 'Qt')
        return mesh.convex
    found, faces = convex_hull(points * scale)
    corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in found:
        corners.append(corner)
    for face in faces.tolist():
        triangles.append(coal.Triangle(*face))
    return coal.Convex(corners, triangles)
