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
Solid shapes on the frames of a robot, and how far they are apart.

Distances come from Coal, the collision library of Pinocchio; nothing else here knows it. All
shapes are convex: a mesh counts as its convex hull.
"""

from dataclasses import dataclass
import math

import coal
import numpy as np
from tp_controller.errors import RobotError, unknown
from tp_controller.model.shapes import Box, Cylinder, HalfSpace, Sphere
from tp_controller.model.spatial import cross, pose, rotation_from_rpy, skews
from tp_controller.model.urdf import parse
from tp_controller.resources import find_file

FILE_SCHEME = 'file://'
# How exact distances are [m]. With 1e-6 apart, as Coal has it, normals at a cylinder are wrong by
# up to 0.03; overlapping, its iteration finds no end for some cylinders below 1e-6.
EXACT_APART, EXACT_OVERLAPPING = 1e-9, 1e-6
# Angle of the tilted copies of a solid [rad]: more than a robot mostly turns in a cycle, little
# enough for less than a millimetre at 0.1 m from the middle.
TILT = 0.0075
TILTS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


@dataclass(eq=False)
class Solid:
    """
    A shape that is fixed to a frame of the robot.

    Attributes
    ----------
    name, frame : str
    pose : ndarray (4, 4)
        T_frame_solid.
    geometry : coal.CollisionGeometry
    reach : float
        Radius of a sphere around the origin of `pose` that holds the shape; infinite for a
        half-space, which is below the plane z = 0 of `pose` [m].

    """

    name: str
    frame: str
    pose: np.ndarray
    geometry: coal.CollisionGeometry
    reach: float


def capsule(name, frame, start, end, radius):
    """Return the `Solid` of all points within a radius of a line from start to end (3,) [m]."""
    along = end - start
    length = math.sqrt(along.dot(along))
    middle = 0.5 * (start + end)
    if length == 0.0:
        return Solid(name, frame, pose(np.eye(3), middle), coal.Sphere(radius), radius)
    # Any attitude will do that has its z axis along the line, whichever way.
    R = np.linalg.qr(np.column_stack([along, np.eye(3)]))[0][:, [1, 2, 0]]
    R[:, 0] *= np.linalg.det(R)
    return Solid(name, frame, pose(R, middle), coal.Capsule(radius, length),
                 radius + 0.5 * length)


def solid(name, frame, shape, T_frame_shape):
    """Return the `Solid` of one of `tp_controller.model.shapes`."""
    geometry, reach = _GEOMETRIES[type(shape)](shape)
    return Solid(name, frame, T_frame_shape, geometry, reach)


_GEOMETRIES = {
    Sphere: lambda shape: (coal.Sphere(shape.radius), shape.radius),
    Box: lambda shape: (coal.Box(*(2.0 * shape.half)), math.hypot(*shape.half)),
    Cylinder: lambda shape: (coal.Cylinder(shape.half[0], 2.0 * shape.half[1]),
                             math.hypot(*shape.half)),
    HalfSpace: lambda shape: (coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), math.inf),
}


# The collision shapes of a URDF -----------------------------------------------------------


def urdf_solids(urdf, links):
    """
    Return the collision shapes that a URDF gives some links.

    Parameters
    ----------
    urdf : str
        Text that a `Robot` was made of.
    links : collection of str
        Their names.

    Returns
    -------
    list of Solid
        Several on one link are numbered, as in ``hand[2]``.

    Raises
    ------
    RobotError
        Meshes that cannot be read, all of them, or a shape that is none.

    """
    solids, unreadable = [], []
    for link in parse(urdf).findall('link'):
        if link.get('name') not in links:
            continue
        elements = link.findall('collision')
        for number, element in enumerate(elements, 1):
            name = link.get('name') + (f'[{number}]' if len(elements) > 1 else '')
            try:
                solids.append(_urdf_solid(name, link.get('name'), element))
            except OSError as error:
                unreadable.append(f'{name}: {error}')
    if unreadable:
        raise RobotError('collision meshes cannot be read: ' + '; '.join(unreadable)
                         + '. Give capsules for these links, or name the others in links')
    return solids


def _urdf_solid(name, link, element):
    """Return the solid of a <collision> element; OSError where its mesh cannot be read."""
    geometry = element.find('geometry')
    shape = next(iter(geometry), None) if geometry is not None else None
    kind = None if shape is None else shape.tag
    if kind not in _URDF_SHAPES:
        raise RobotError(f'{name}: {unknown("collision shape", kind, _URDF_SHAPES)}')
    try:
        origin = element.find('origin')
        xyz, rpy = ('0 0 0', '0 0 0') if origin is None else (
            origin.get('xyz', '0 0 0'), origin.get('rpy', '0 0 0'))
        T = pose(rotation_from_rpy(*_numbers(rpy, 3)), _numbers(xyz, 3))
        geometry, reach, centre = _URDF_SHAPES[kind](shape)
    except (TypeError, ValueError) as error:
        raise RobotError(f'{name}: <collision> with a {kind}: {error}') from error
    # The origin of a solid is the centre of a sphere around it.
    return Solid(name, link, T.dot(pose(np.eye(3), centre)), geometry, reach)


def _numbers(text, count):
    """Return the numbers of an attribute (count,)."""
    numbers = np.array(str(text).split(), dtype=float)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ValueError(f'needs {count} numbers, got {text!r}')
    return numbers


def _sizes(shape, *names):
    """Return attributes that are sizes, as positive floats."""
    sizes = [_numbers(shape.get(name), 1)[0] for name in names]
    return [_positive(size) for size in sizes]


def _positive(size):
    """Return a size, or raise ValueError unless it is positive."""
    if not size > 0.0:
        raise ValueError(f'sizes must be positive, got {size:g}')
    return float(size)


def _urdf_box(shape):
    """Return a box, how far it reaches, and its centre."""
    sizes = [_positive(size) for size in _numbers(shape.get('size'), 3)]
    return coal.Box(*sizes), 0.5 * math.hypot(*sizes), np.zeros(3)


def _urdf_sphere(shape):
    """Return a sphere, how far it reaches, and its centre."""
    radius, = _sizes(shape, 'radius')
    return coal.Sphere(radius), radius, np.zeros(3)


def _urdf_cylinder(shape):
    """Return a cylinder, how far it reaches, and its centre."""
    radius, length = _sizes(shape, 'radius', 'length')
    return coal.Cylinder(radius, length), math.hypot(radius, 0.5 * length), np.zeros(3)


def _urdf_capsule(shape):
    """Return a capsule, its length that between the half-spheres; how far it reaches, centre."""
    radius, length = _sizes(shape, 'radius', 'length')
    return coal.Capsule(radius, length), radius + 0.5 * length, np.zeros(3)


def _urdf_mesh(shape):
    """Return the convex hull of a mesh, how far it reaches, and its centre; or OSError."""
    name = shape.get('filename') or ''
    scale = _numbers(shape.get('scale', '1 1 1'), 3)
    path = find_file(name.removeprefix(FILE_SCHEME))
    try:
        mesh = coal.MeshLoader().load(str(path), scale)
        points = np.array(mesh.vertices())
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        moved = coal.BVHModelOBBRSS()
        moved.beginModel(0, len(points))
        moved.addVertices(points - centre)
        moved.endModel()
        moved.buildConvexHull(True, 'Qt')
    except (RuntimeError, ValueError) as error:
        raise OSError(f'{path}: {error}') from error
    return moved.convex, float(np.sqrt(((points - centre) ** 2).sum(axis=1).max())), centre


_URDF_SHAPES = {'box': _urdf_box, 'sphere': _urdf_sphere, 'cylinder': _urdf_cylinder,
                'capsule': _urdf_capsule, 'mesh': _urdf_mesh}


# Distances --------------------------------------------------------------------------------


@dataclass
class Nearness:
    """
    Where pairs of solids are closest.

    Attributes
    ----------
    pairs : list of int
        Which pairs of the `Clearance`.
    tilts : list of int
        0 for the solids as they are, 1 to 4 for copies of one that are tilted.
    distances : ndarray (m,)
        Negative where they overlap: how far they must be moved apart [m].
    normals : ndarray (m, 3)
        From the second towards the first: along it the distance grows.
    points : ndarray (m, 3)
        In the middle between the nearest points [m].

    """

    pairs: list
    tilts: list
    distances: np.ndarray
    normals: np.ndarray
    points: np.ndarray


class Clearance:
    """
    Distances between pairs of solids, worked out only where they can be small.

    Where flat sides or parallel edges face each other, the nearest points jump from one end to
    the other as the solids rock, and a robot that is pushed there would rattle. So very near
    pairs are measured four more times, one of the solids tilted a little to either side about
    two axes: whatever end comes nearer is watched all the time.

    Parameters
    ----------
    solids : list of Solid
    pairs : list of (int, int)
        Of their indices; only the second may be a half-space.

    Attributes
    ----------
    pairs : list of (int, int)
    frames : list of str
        That the solids are fixed to.
    first, second : ndarray (p,) of int
        Index in `frames` for each pair.

    """

    def __init__(self, solids, pairs):
        self._solids, self.pairs = solids, pairs
        self.frames = list(dict.fromkeys(solid.frame for solid in solids))
        self._frame = np.array([self.frames.index(solid.frame) for solid in solids], dtype=int)
        self._poses = np.array([solid.pose for solid in solids]).reshape(-1, 4, 4)
        self._one, self._other = np.array(pairs, dtype=int).reshape(-1, 2).T
        self.first, self.second = self._frame[self._one], self._frame[self._other]
        reach = np.array([solid.reach for solid in solids])
        self._planes = np.flatnonzero(np.isinf(reach)[self._other])
        self._pivot = np.where(reach[self._one] <= reach[self._other], self._one, self._other)
        self._reach = reach
        # Each pair twice: the box around the one and the sphere around the other, and reversed.
        self._from = np.tile(np.arange(len(pairs)), 2)
        self._boxes = np.concatenate([self._one, self._other])
        boxes = np.array([_rounded_box(solid.geometry) for solid in solids]).reshape(-1, 4)
        self._half = boxes[self._boxes, :3]
        self._margin = boxes[self._boxes, 3] + reach[np.concatenate([self._other, self._one])]
        # What has no flat sides nor edges need not be tilted.
        self._round = [any(isinstance(solids[index].geometry, coal.Sphere) for index in pair)
                       for pair in pairs]
        self._functions = {}
        self._request = coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._request.gjk_tolerance = EXACT_APART
        self._request.epa_tolerance = EXACT_OVERLAPPING

    def nearest(self, poses, within, close=-math.inf):
        """
        Return where pairs are closest, of those that are less than `within` apart.

        Parameters
        ----------
        poses : ndarray (f, 4, 4)
            Of `frames`, in the root.
        within, close : float
            Pairs nearer than `close` are measured with tilted copies, too [m].

        Returns
        -------
        Nearness
            In the root.

        """
        T = poses[self._frame] @ self._poses
        R, origins, placed = T[:, :3, :3], T[:, :3, 3], {}
        pairs, found, flat = [], [], []
        for pair in self._candidates(T, within):
            one, other = self.pairs[pair]
            if one not in placed:
                placed[one] = coal.Transform3s(R[one], origins[one])
            if other not in placed:
                placed[other] = coal.Transform3s(R[other], origins[other])
            where = self._measure(pair, 0, placed[one], placed[other])
            distance = where.min_distance
            if distance < within:
                if distance < close and not self._round[pair]:
                    flat.append(len(pairs))
                pairs.append(pair)
                found.append(_read(where))
        tilts = [0] * len(pairs)
        if flat:
            near = [pairs[index] for index in flat]
            tilted = self._tilted(T, near, np.array([found[index][0] for index in flat]))
            for pair, copies in zip(near, tilted):
                other = placed[self.pairs[pair][1]]
                for tilt, copy in enumerate(copies, 1):
                    pairs.append(pair)
                    tilts.append(tilt)
                    found.append(_read(self._measure(
                        pair, tilt, coal.Transform3s(copy[:, :3], copy[:, 3]), other)))
        # Coal's normals go from the first to the second, whatever the sign of the distance.
        normals, ends, other_ends = np.array(found).reshape(-1, 3, 3).transpose(1, 0, 2)
        distances = ((other_ends - ends) * normals).sum(axis=1)
        if not math.isfinite(distances.sum()):
            self._guess(T, pairs, distances, normals, ends, other_ends)
        return Nearness(pairs, tilts, distances, -normals, 0.5 * (ends + other_ends))

    def _guess(self, T, pairs, distances, normals, ends, other_ends):
        """Take those whose distance Coal did not find to touch, away from each other's middle."""
        for row in np.flatnonzero(~np.isfinite(distances)):
            one, other = (T[index] for index in self.pairs[pairs[row]])
            way = -other[:3, 2] if math.isinf(self._reach[self._other[pairs[row]]]) else \
                other[:3, 3] - one[:3, 3]
            distances[row], normals[row] = 0.0, way / (math.sqrt(way.dot(way)) or 1.0)
            ends[row] = other_ends[row] = one[:3, 3]

    def _candidates(self, T, within):
        """Return the pairs that may be less than `within` apart, by spheres and boxes."""
        origins = T[:, :3, 3]
        between = origins[self._other] - origins[self._one]
        # The sphere around each solid of a pair, seen from the box around the other.
        seen = between[self._from][:, np.newaxis] @ T[self._boxes, :3, :3]
        beyond = np.maximum(np.abs(seen[:, 0]) - self._half, 0.0)
        gaps = np.sqrt((beyond * beyond).sum(axis=1)) - self._margin
        gaps = np.maximum(*gaps.reshape(2, -1))
        if len(self._planes):
            planes = self._planes
            gaps[planes] = -(between[planes] * T[self._other[planes], :3, 2]).sum(axis=1) \
                - self._reach[self._one[planes]]
        return np.flatnonzero(gaps < within).tolist()

    def _measure(self, pair, tilt, one, other):
        """Return Coal's result for a pair, or for one of its tilted copies."""
        # What Coal returns are windows into the result: each measurement needs its own.
        if (pair, tilt) not in self._functions:
            first, second = (self._solids[index].geometry for index in self.pairs[pair])
            self._functions[pair, tilt] = (coal.DistanceResult(),
                                           coal.ComputeDistance(first, second))
        result, function = self._functions[pair, tilt]
        result.clear()
        function(one, other, self._request, result)
        return result

    def _tilted(self, T, pairs, normals):
        """Return the poses (k, 4, 3, 4) of the first of pairs, tilted across the normals."""
        one = T[self._one[pairs]]
        # The axes go with those of the solid: sides and edges come to lie across them.
        least = np.abs(one[:, :3, :3].transpose(0, 2, 1) @ normals[:, :, np.newaxis])[
            :, :, 0].argmin(axis=1)
        u = cross(normals, one[np.arange(len(pairs)), :3, least])
        u /= np.sqrt((u * u).sum(axis=1))[:, np.newaxis]
        turns = TILT * TILTS.dot(np.stack([u, cross(normals, u)], axis=1)).transpose(1, 0, 2)
        K = skews(turns)
        R = np.eye(3) + K + 0.5 * (K @ K)
        # About the middle of the smaller one: its ends move less.
        pivot = T[self._pivot[pairs], :3, 3, np.newaxis]
        arms = one[:, :3].copy()
        arms[:, :, 3:] -= pivot
        tilted = R @ arms[:, np.newaxis]
        tilted[..., 3:] += pivot[:, np.newaxis]
        return tilted


def _rounded_box(geometry):
    """Return half the sides of a box, and by how much it must grow to hold a shape (4,)."""
    if isinstance(geometry, coal.Sphere):
        return 0.0, 0.0, 0.0, geometry.radius
    if isinstance(geometry, coal.Capsule):
        return 0.0, 0.0, geometry.halfLength, geometry.radius
    if isinstance(geometry, coal.Cylinder):
        return geometry.radius, geometry.radius, geometry.halfLength, 0.0
    if isinstance(geometry, coal.Box):
        return *geometry.halfSide, 0.0
    if isinstance(geometry, coal.Halfspace):
        return 0.0, 0.0, 0.0, 0.0
    return *np.abs(geometry.points()).max(axis=0), 0.0


def _read(result):
    """Return the normal and the nearest points of Coal's result."""
    return result.normal, result.getNearestPoint1(), result.getNearestPoint2()
