# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Visual model of a robot: its own, or that of an example robot with the same kinematics."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
import os
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from tp_controller.errors import RobotError
from tp_controller.model.dh import LINK_RADIUS
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import pose, rotation_from_rpy
from tp_controller.model.urdf import parse
from tp_controller.tools.view.meshes import load_mesh, mesh_path, SHARE_FOLDER
from tp_controller.tools.view.parts import Colour, FARTHEST, LINK_COLOUR, Part
from tp_controller.tools.view.skeleton import numbers, skeleton, vector

# Environment variable that disables the meshes of example robots, and its value.
MESHES_VARIABLE, OWN = 'TP_CONTROLLER_MESHES', 'own'
# Attributes of primitives, in the order of `Part.size`.
SIZES = {'box': ('size',), 'sphere': ('radius',), 'cylinder': ('radius', 'length')}
# Number of their sizes.
NUMBERS = {'box': 3, 'sphere': 1, 'cylinder': 2}
# Folder in which pip installs the robots of example-robot-data.
ROBOTS = SHARE_FOLDER / 'example-robot-data' / 'robots'
# Largest difference of entries of the poses of a frame that counts as equal [m, rad].
MATCH_TOLERANCE = 1e-4
# Number of random configurations at which two robots are compared.
MATCH_SAMPLES = 3


@dataclass(frozen=True)
class Visuals:
    """
    Visual model of a robot.

    Attributes
    ----------
    parts : dict
        {link: list of Part}
    remarks : tuple of str
        Parts of the description that cannot be shown, with the reasons.

    """

    parts: Mapping[str, list[Part]]
    remarks: tuple[str, ...] = field(default=())


def visuals_of(robot: Robot) -> Visuals:
    """
    Return the visual model of a robot.

    Each link shows its visual geometry if all of it loads, else its collision geometry, else a rod
    to each of its joints. A description without shapes, or one made of a DH table, has the
    geometry of the same robot of example-robot-data if that is installed; else rods and joints
    throughout.
    """
    tree = parse(robot.urdf)
    if not _is_bare(tree):
        return _described(tree)
    other = None if os.environ.get(MESHES_VARIABLE) == OWN else matching_robot(robot)
    if other is None:
        return Visuals(skeleton(tree))
    lent = _described(parse(other.urdf))
    parts: dict[str, list[Part]] = {}
    for link, (frame, T) in attachments(robot, other, parse(other.urdf)).items():
        parts.setdefault(frame, []).extend(
            replace(part, T=T.dot(part.T)) for part in lent.parts.get(link, ()))
    return Visuals(parts, lent.remarks)


def _described(tree: Element) -> Visuals:
    """Return the visual model in a description."""
    reader, bones = _Reader(tree), skeleton(tree)
    parts: dict[str, list[Part]] = {}
    for link in tree.findall('link'):
        name, shapes = link.attrib['name'], ('visual', 'collision')
        if any(link.find(tag) is not None for tag in shapes):
            parts[name] = next(filter(None, (reader.parts(link, tag) for tag in shapes)),
                               bones.get(name, []))
    return Visuals(parts, tuple(reader.remarks))


class _Reader:
    """Reader of the shapes of links, with remarks about unreadable ones."""

    def __init__(self, tree: Element) -> None:
        self._colours = {material.get('name'): colour for material in tree.findall('material')
                         if (colour := material.find('color')) is not None}
        self.remarks: list[str] = []

    def parts(self, link: Element, tag: str) -> list[Part]:
        """Return the visual or collision shapes of a link; empty if one of them cannot be read."""
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
        roll, pitch, yaw = vector(origin, 'rpy')
        T = pose(rotation_from_rpy(roll, pitch, yaw), vector(origin, 'xyz'))
        colour, opacity = self._colour(element)
        if shape.tag != 'mesh':
            if shape.tag not in SIZES:
                raise ValueError(f'unknown shape <{shape.tag}>')
            size = tuple(number for key in SIZES[shape.tag]
                         for number in numbers(shape.get(key, '')))
            if len(size) != NUMBERS[shape.tag]:
                raise ValueError(f'<{shape.tag}> has {len(size)} numbers')
            _check_range((*size, *T.ravel()))
            return Part(shape.tag, size, T, colour or LINK_COLOUR, opacity)
        mesh = load_mesh(mesh_path(shape.get('filename', '')))
        scale = mesh.unit * vector(shape, 'scale', '1 1 1')
        _check_range((*scale, *T.ravel()))
        return Part('mesh', tuple(scale.tolist()), T,
                    None if mesh.glb else colour or LINK_COLOUR, opacity, mesh)

    def _colour(self, element: Element) -> tuple[Colour | None, float]:
        """Return the colour of a shape, None if it is not specified, and its opacity."""
        material = element.find('material')
        if material is None:
            return None, 1.0
        found = material.find('color')
        if found is None:
            found = self._colours.get(material.get('name'))
        if found is None:
            return None, 1.0
        red, green, blue, opacity = np.clip(
            (*numbers(found.get('rgba', '')), 1.0, 1.0, 1.0, 1.0)[:4], 0.0, 1.0).tolist()
        return (round(255 * red), round(255 * green), round(255 * blue)), opacity


def _check_range(values: Iterable[float]) -> None:
    """Raise ValueError unless all numbers are finite and within range."""
    if not all(abs(value) <= FARTHEST for value in values):
        raise ValueError(f'a number is not finite or exceeds {FARTHEST:g}')


def _is_bare(tree: Element) -> bool:
    """Return whether a description has no shapes except the thin rods of a DH table."""
    shapes = [shape for tag in ('visual', 'collision') for shape in tree.findall(
        f'link/{tag}/geometry/*')]
    return all(shape.tag == 'cylinder' and shape.get('radius') == str(LINK_RADIUS)
               for shape in shapes)


def matching_robot(robot: Robot) -> Robot | None:
    """
    Return the example robot with the kinematics of a robot; None if there is none.

    It has the name and all joints of the robot, and the frames of both coincide at random
    configurations. Its base is fixed.
    """
    for path in sorted(ROBOTS.glob(f'*/*/{Path(robot.name).name}.urdf')):
        try:
            found = Robot.from_urdf(path, joints=robot.joint_names)
            own = Robot.from_urdf(robot.urdf, joints=robot.joint_names)
        except RobotError:
            continue
        if _is_same(own, found):
            return found
    return None


def attachments(robot: Robot, other: Robot, tree: Element) -> dict[str, tuple[str, np.ndarray]]:
    """
    Return the attachments of the links of another robot, whose description is a tree.

    Returns
    -------
    dict
        {link: (frame of the robot, pose (4, 4) of the link on it)}; joints missing from the
        robot stay at their neutral position.

    """
    parents: Mapping[str, str] = {
        next(joint.iter('child')).attrib['link']: next(joint.iter('parent')).attrib['link']
        for joint in tree.findall('joint')}
    state = other.state(other.neutral())
    found = {}
    for link in other.frame_names:
        frame: str | None = link
        while frame is not None and frame not in robot.frame_names:
            frame = parents.get(frame)
        if frame is not None:
            found[link] = frame, np.linalg.solve(state.pose(frame), state.pose(link))
    return found


def _is_same(one: Robot, other: Robot) -> bool:
    """Return whether the common frames of two robots coincide."""
    shared = [frame for frame in one.frame_names if frame in other.frame_names]
    if one.base_frame != other.base_frame or len(shared) <= len(one.joint_names):
        return False
    random = np.random.default_rng(0)
    for _ in range(MATCH_SAMPLES):
        q = random.uniform(-1.0, 1.0, one.n)
        states = one.state(q), other.state(q)
        if max(np.abs(states[0].pose(frame) - states[1].pose(frame)).max()
               for frame in shared) > MATCH_TOLERANCE:
            return False
    return True
