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

"""What the links of a robot look like: its meshes, else its collision shapes, else solid links."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
import math
from xml.etree.ElementTree import Element

import numpy as np
from tp_controller.model.dh import LINK_RADIUS
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, pose, rotation_from_rpy
from tp_controller.model.urdf import MOVING, parse
from tp_controller.tasks.aim import pose_along
from tp_controller.view.borrowed import carriers, lender
from tp_controller.view.meshes import load_mesh, mesh_path
from tp_controller.view.parts import Colour, LINK_COLOUR, Part

JOINT_COLOUR: Colour = (52, 74, 99)
# Radius of a link as a share of the length of the robot, and how large it may be [m].
THICKNESS, THINNEST, THICKEST = 0.033, 0.008, 0.06
# Of the rods beyond the last link, to frames of a tool.
TOOL_SHARE = 0.35
# Sizes of a joint in radii of the links: radius and length.
HUB = 1.3, 2.9
SHORT = 1e-6
# A slide without end is not drawn [m].
LONGEST_SLIDE = 2.0
# Attributes of primitives, in the order of `Part.size`.
SIZES = {'box': ('size',), 'sphere': ('radius',), 'cylinder': ('radius', 'length')}


@dataclass(frozen=True)
class Looks:
    """
    What a robot looks like.

    Attributes
    ----------
    parts : dict
        {link: list of Part}
    remarks : tuple of str
        What of the description cannot be shown, and why.

    """

    parts: Mapping[str, list[Part]]
    remarks: tuple[str, ...] = field(default=())


def looks_of(robot: Robot) -> Looks:
    """
    Return what the links of a robot look like.

    Of each link what its description says is seen if all of it can be read, else what collides.
    Where nothing of this is there, the link is a rod to each of its joints. A description without
    shapes, or one made of a DH table, gives the looks of the same robot of example-robot-data if
    that is installed; else rods and joints throughout.
    """
    tree = parse(robot.urdf)
    if not _is_bare(tree):
        return _described(tree)
    other = lender(robot)
    if other is None:
        return Looks(skeleton(tree))
    lent = _described(parse(other.urdf))
    parts: dict[str, list[Part]] = {}
    for link, (frame, T) in carriers(robot, other, parse(other.urdf)).items():
        parts.setdefault(frame, []).extend(
            replace(part, T=T.dot(part.T)) for part in lent.parts.get(link, ()))
    return Looks(parts, lent.remarks)


def _described(tree: Element) -> Looks:
    """Return what a description says that its links look like."""
    reader, bones = _Reader(tree), skeleton(tree)
    parts: dict[str, list[Part]] = {}
    for link in tree.findall('link'):
        name, shapes = link.attrib['name'], ('visual', 'collision')
        if any(link.find(tag) is not None for tag in shapes):
            parts[name] = next(filter(None, (reader.parts(link, tag) for tag in shapes)),
                               bones.get(name, []))
    return Looks(parts, tuple(reader.remarks))


def skeleton(tree: Element) -> dict[str, list[Part]]:
    """Return {link: parts} of solid links: rods between joints, and the joints."""
    offsets = {_child(joint): _vector(joint.find('origin'), 'xyz')
               for joint in tree.findall('joint')}
    parents = {_child(joint): _parent(joint) for joint in tree.findall('joint')}
    radius = min(max(THICKNESS * max(_length(link, parents, offsets) for link in (
        '', *offsets)), THINNEST), THICKEST)
    parts: dict[str, list[Part]] = {link.attrib['name']: [] for link in tree.findall('link')}
    moved = {_child(joint) for joint in tree.findall('joint') if joint.get('type') in MOVING}
    carrying = {link for each in moved for link in _above(each, parents)}
    for joint in tree.findall('joint'):
        parent, child = _parent(joint), _child(joint)
        tool = parent not in moved and child not in carrying | moved
        parts[parent] += _rod(offsets[child], TOOL_SHARE * radius if tool else radius)
        if child in moved:
            parts[child] += _joint(joint, radius)
    return parts


class _Reader:
    """Reads shapes of links and notes what cannot be read."""

    def __init__(self, tree: Element) -> None:
        self._colours = {material.get('name'): colour for material in tree.findall('material')
                         if (colour := material.find('color')) is not None}
        self.remarks: list[str] = []

    def parts(self, link: Element, tag: str) -> list[Part]:
        """Return the visual or collision shapes of a link; none if one of them cannot be read."""
        parts = []
        for element in link.findall(tag):
            try:
                parts.append(self._part(element))
            except (OSError, ValueError) as error:
                self.remarks.append(f'{link.get("name")}, {tag}: {error}')
                return []
            except ModuleNotFoundError as error:
                self.remarks.append(f'{link.get("name")}, {tag}: {error.name} is missing')
                return []
        return parts

    def _part(self, element: Element) -> Part:
        """Return one shape."""
        shape, origin = element.find('geometry/*'), element.find('origin')
        if shape is None:
            raise ValueError('no shape')
        roll, pitch, yaw = _vector(origin, 'rpy')
        T = pose(rotation_from_rpy(roll, pitch, yaw), _vector(origin, 'xyz'))
        colour, opacity = self._colour(element)
        if shape.tag != 'mesh':
            if shape.tag not in SIZES:
                raise ValueError(f'unknown shape <{shape.tag}>')
            size = tuple(number for key in SIZES[shape.tag]
                         for number in _numbers(shape.get(key, '')))
            return Part(shape.tag, size, T, colour or LINK_COLOUR, opacity)
        mesh = load_mesh(mesh_path(shape.get('filename', '')))
        scale = mesh.unit * _vector(shape, 'scale', '1 1 1')
        return Part('mesh', tuple(scale.tolist()), T,
                    None if mesh.glb else colour or LINK_COLOUR, opacity, mesh)

    def _colour(self, element: Element) -> tuple[Colour | None, float]:
        """Return the colour of a shape, None where nothing is said of it, and its opacity."""
        material = element.find('material')
        if material is None:
            return None, 1.0
        found = material.find('color')
        if found is None:
            found = self._colours.get(material.get('name'))
        if found is None:
            return None, 1.0
        red, green, blue, opacity = (*_numbers(found.get('rgba', '')), 1.0, 1.0, 1.0, 1.0)[:4]
        return (round(255 * red), round(255 * green), round(255 * blue)), opacity


def _is_bare(tree: Element) -> bool:
    """Say whether a description has no shapes but, perhaps, the thin rods of a DH table."""
    shapes = [shape for tag in ('visual', 'collision') for shape in tree.findall(
        f'link/{tag}/geometry/*')]
    return all(shape.tag == 'cylinder' and shape.get('radius') == str(LINK_RADIUS)
               for shape in shapes)


def _rod(end: Array, radius: float) -> list[Part]:
    """Return a rod from the origin of a link to a point, with a round end."""
    length = math.sqrt(end.dot(end))
    if length < SHORT:
        return []
    return [Part('cylinder', (radius, length), pose_along(end / length, 0.5 * end)),
            Part('sphere', (radius,), pose_along(end / length, end))]


def _joint(joint: Element, radius: float) -> list[Part]:
    """Return a joint, on the link that it moves: a drum about its axis; a box if it slides."""
    axis = _vector(joint.find('axis'), 'xyz', '1 0 0')
    T = pose_along(axis / np.linalg.norm(axis), np.zeros(3))
    if joint.get('type') == 'prismatic':
        side = 2.0 * HUB[0] * radius
        limit = joint.find('limit')
        travel = 0.0 if limit is None else float(limit.get('upper', 0.0))
        parts = [Part('box', (side, side, HUB[1] * radius), T, JOINT_COLOUR)]
        if SHORT < travel < LONGEST_SLIDE:
            # What comes out of the link before as the joint moves.
            parts += _rod(-travel * T[:3, 2], 0.6 * radius)
        return parts
    return [Part('cylinder', (HUB[0] * radius, HUB[1] * radius), T, JOINT_COLOUR)]


def _above(link: str, parents: Mapping[str, str]) -> list[str]:
    """Return the links that a link hangs on."""
    found = []
    while link in parents:
        link = parents[link]
        found.append(link)
    return found


def _length(link: str, parents: Mapping[str, str], offsets: Mapping[str, Array]) -> float:
    """Return the length of the chain that ends in a link [m]."""
    length = 0.0
    while link in parents:
        length += float(np.linalg.norm(offsets[link]))
        link = parents[link]
    return length


def _parent(joint: Element) -> str:
    """Return the link that a joint is on."""
    return next(joint.iter('parent')).attrib['link']


def _child(joint: Element) -> str:
    """Return the link that a joint moves."""
    return next(joint.iter('child')).attrib['link']


def _vector(element: Element | None, key: str, default: str = '0 0 0') -> Array:
    """Return the three numbers of an attribute."""
    numbers = _numbers(default if element is None else element.get(key, default))
    return np.array([*numbers, 0.0, 0.0, 0.0][:3])


def _numbers(text: str) -> list[float]:
    """Return the numbers of a text."""
    return [float(word) for word in text.split()]
