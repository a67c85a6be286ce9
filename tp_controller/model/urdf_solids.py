# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Collision shapes of a URDF.

Pinocchio's buildGeomFromUrdfString makes the same solids of Panda, UR5, Baxter and TIAGo. But it
skips shapes that it cannot read, capsules included, so that a robot would move as if that link
were missing; it accepts negative sizes, and names only the first of several missing meshes.
"""

from collections.abc import Callable, Collection
from pathlib import Path
from xml.etree.ElementTree import Element

import coal
import numpy as np
import pinocchio
from tp_controller.errors import RobotError, unknown
from tp_controller.model.solids import Geometry, mesh_hull, Solid
from tp_controller.model.spatial import Array, pose, rotation_from_rpy
from tp_controller.model.urdf import parse
from tp_controller.resources import find_file

FILE_SCHEME = 'file://'
# Largest mesh file [bytes]. The largest collision mesh of example-robot-data has 3.4 million bytes
# and takes 0.16 s to read.
MOST_MESH_BYTES = 20_000_000


def urdf_solids(urdf: str, links: Collection[str]) -> list[Solid]:
    """
    Return the collision shapes that a URDF gives some links.

    Parameters
    ----------
    urdf : str
        Description of the `Robot`, as text.
    links : collection of str
        Their names.

    Returns
    -------
    list of Solid
        Several on one link are numbered, as in ``hand[2]``.

    Raises
    ------
    RobotError
        Meshes cannot be read, and all of them are named, or a shape is not valid.

    """
    solids, unreadable = [], []
    for link in parse(urdf).findall('link'):
        frame = link.get('name', '')
        elements = link.findall('collision') if frame in links else []
        for number, element in enumerate(elements, 1):
            name = frame + (f'[{number}]' if len(elements) > 1 else '')
            try:
                solids.append(_urdf_solid(name, frame, element))
            except OSError as error:
                unreadable.append(f'{name}: {error}')
    if unreadable:
        raise RobotError('collision meshes cannot be read: ' + '; '.join(unreadable)
                         + '. Give capsules for these links, or name the others in links')
    return solids


def has_solids(urdf: str) -> bool:
    """Return whether a URDF, as text, gives any link a collision shape."""
    return any(link.find('collision') is not None for link in parse(urdf).findall('link'))


def shape_element(shape: pinocchio.GeometryObject) -> Element | None:
    """
    Return the URDF element of the shape of a geometry object of Pinocchio.

    None for planes and half-spaces, which are of the surroundings. An ellipsoid becomes the
    sphere around it. A shape that URDF lacks keeps its name, for `urdf_solids` to refuse.
    """
    solid = shape.geometry
    if isinstance(solid, (coal.Plane, coal.Halfspace)):
        return None
    if shape.meshPath and Path(shape.meshPath).is_absolute():
        return Element('mesh', filename=FILE_SCHEME + shape.meshPath,
                       scale=' '.join(repr(float(each)) for each in shape.meshScale))
    if isinstance(solid, coal.Box):
        return Element('box', size=' '.join(repr(2.0 * float(side)) for side in solid.halfSide))
    if isinstance(solid, coal.Sphere):
        return Element('sphere', radius=repr(float(solid.radius)))
    if isinstance(solid, coal.Ellipsoid):
        return Element('sphere', radius=repr(float(max(solid.radii))))
    if isinstance(solid, (coal.Capsule, coal.Cylinder)):
        return Element(type(solid).__name__.lower(), radius=repr(float(solid.radius)),
                       length=repr(2.0 * float(solid.halfLength)))
    return Element(type(solid).__name__.lower())


def _urdf_solid(name: str, frame: str, element: Element) -> Solid:
    """Return the solid of a <collision> element; OSError if its mesh cannot be read."""
    shape = element.find('geometry/*')
    kind = None if shape is None else shape.tag
    if shape is None or kind not in _URDF_SHAPES:
        raise RobotError(f'{name}: {unknown("collision shape", kind, _URDF_SHAPES)}')
    try:
        origin = element.find('origin')
        xyz, rpy = ('0 0 0', '0 0 0') if origin is None else (
            origin.get('xyz', '0 0 0'), origin.get('rpy', '0 0 0'))
        T = pose(rotation_from_rpy(*_numbers(rpy, 3)), _numbers(xyz, 3))
        return Solid(name, frame, T, _URDF_SHAPES[kind](shape))
    except (TypeError, ValueError) as error:
        raise RobotError(f'{name}: <collision> with a {kind}: {error}') from error


def _numbers(text: str | None, count: int) -> Array:
    """Return the numbers of an attribute (count,)."""
    numbers = np.array(str(text).split(), dtype=float)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ValueError(f'needs {count} numbers, got {text!r}')
    return numbers


def _sizes(text: str | None, count: int = 1) -> list[float]:
    """Return the sizes of an attribute; ValueError unless they are positive."""
    sizes = _numbers(text, count).tolist()
    for size in sizes:
        if not size > 0.0:
            raise ValueError(f'sizes must be positive, got {size:g}')
    return sizes


def _mesh_hull(shape: Element) -> Geometry:
    """Return the convex hull of a mesh; OSError if it cannot be read."""
    scale = _numbers(shape.get('scale', '1 1 1'), 3)
    path = find_file((shape.get('filename') or '').removeprefix(FILE_SCHEME))
    found = path.stat()
    if found.st_size > MOST_MESH_BYTES:
        raise OSError(f'{path} has {found.st_size} bytes; at most {MOST_MESH_BYTES} are read')
    try:
        return mesh_hull(path.resolve(), found.st_mtime_ns, tuple(scale.tolist()))
    except (RuntimeError, ValueError) as error:
        raise OSError(f'{path}: {error}') from error


# The length of a capsule is the distance between its half-spheres.
_URDF_SHAPES: dict[str, Callable[[Element], Geometry]] = {
    'box': lambda shape: coal.Box(*_sizes(shape.get('size'), 3)),
    'sphere': lambda shape: coal.Sphere(*_sizes(shape.get('radius'))),
    'cylinder': lambda shape: coal.Cylinder(*_sizes(shape.get('radius')),
                                            *_sizes(shape.get('length'))),
    'capsule': lambda shape: coal.Capsule(*_sizes(shape.get('radius')),
                                          *_sizes(shape.get('length'))),
    'mesh': _mesh_hull,
}
