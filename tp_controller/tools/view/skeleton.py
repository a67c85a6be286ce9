# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Solid links for robots without shapes: surfaces of revolution along limbs and at joints."""

from collections.abc import Iterable
from xml.etree.ElementTree import Element

import numpy as np
from tp_controller.model.spatial import Array, rotation_from_rpy
from tp_controller.model.urdf import MOVING_TYPES
from tp_controller.tasks.aim import pose_along
from tp_controller.tools.view.meshes import Mesh
from tp_controller.tools.view.parts import Colour, LINK_COLOUR, Part

JOINT_COLOUR: Colour = (52, 74, 99)
# Radius of a link as a share of the length of the robot, and its bounds [m].
THICKNESS, THINNEST, THICKEST = 0.033, 0.008, 0.06
# Factors on that radius at the first and the last link.
TAPER = 1.3, 0.8
# In radii of the link: radius and length of the drum of an axis across the link, of its caps, and
# of the collar of an axis along it; distance of the collar from the joint.
DRUM, CAP, COLLAR, COLLAR_AT = (1.2, 2.5), (0.92, 2.8), (1.1, 0.45), 1.9
# Radius of the rounded edges, in radii.
EDGE = 0.3
# Radius of the tip of a tool, in radii.
TIP_RADIUS = 0.16
# Length of a pointer at the end of a link, and smallest length of a long link, in radii.
POINTER, LONG = 2.2, 5.0
FOOT_HEIGHT, PLATE = 2.6, 0.5  # in radii
# Shorter limbs and offsets are ignored [m].
MIN_LIMB_LENGTH = 1e-6
# Smallest cosine between a link and an axis that is along it.
ALONG_COSINE = 0.9
# Longest travel of a prismatic joint that is drawn [m].
LONGEST_SLIDE = 2.0
SIDES, EDGE_SEGMENTS = 40, 6  # of a full turn, of a rounded edge


def skeleton(tree: Element) -> dict[str, list[Part]]:
    """
    Return {link: parts} of solid links.

    Parameters
    ----------
    tree : xml.etree.ElementTree.Element
        Description of a robot.

    Returns
    -------
    dict
        {link: list of Part}: a limb to each of its joints, and the body of its own joint.

    """
    return _Skeleton(tree).parts


class _Skeleton:
    """Parts of all links of a description, built joint by joint."""

    def __init__(self, tree: Element) -> None:
        joints = tree.findall('joint')
        self._offsets = {_child(joint): vector(joint.find('origin'), 'xyz') for joint in joints}
        self._turns = {_child(joint): rotation_from_rpy(*vector(joint.find('origin'), 'rpy'))
                       for joint in joints}
        self._parents = {_child(joint): _parent(joint) for joint in joints}
        self._moved = {_child(joint) for joint in joints if joint.get('type') in MOVING_TYPES}
        self.parts: dict[str, list[Part]] = {
            link.attrib['name']: [] for link in tree.findall('link')}
        self._follow_chains()
        self._length = max(self._reach.values(), default=0.0)
        self._radius = min(max(THICKNESS * self._length, THINNEST), THICKEST)
        for joint in joints:
            self._add(joint)
        for link in self.parts.keys() - self._parents.keys():
            self._add_foot(link)

    def _follow_chains(self) -> None:
        """Set properties of all links that depend on those above or below them."""
        children: dict[str, list[str]] = {}
        for child, parent in self._parents.items():
            children.setdefault(parent, []).append(child)
        # Length of the chain that ends in a link [m]; links that a joint moves, at any distance.
        self._reach: dict[str, float] = {}
        self._tools = set[str]()
        order = [link for link in self.parts if link not in self._parents]
        for link in order:
            self._reach[link] = 0.0
            if link in self._parents:
                parent = self._parents[link]
                self._reach[link] = self._reach[parent] + float(
                    np.linalg.norm(self._offsets[link]))
                if parent in self._moved or parent in self._tools:
                    self._tools.add(link)
            order += children.get(link, [])
        # Links with a moving one below them, and with one that is elsewhere; positions on each
        # link of the next joints that are not at its origin.
        self._carrying, self._extended = set[str](), set[str]()
        self._next: dict[str, list[Array]] = {link: [] for link in order}
        for link in reversed(order):
            if link not in self._parents:
                continue
            parent, offset = self._parents[link], self._offsets[link]
            far = bool(np.linalg.norm(offset) > MIN_LIMB_LENGTH)
            if link in self._moved or link in self._carrying:
                self._carrying.add(parent)
            if far or link in self._extended:
                self._extended.add(parent)
            self._next[parent] = [*([offset] if far else [
                self._turns[link] @ each for each in self._next[link]]), *self._next[parent]]

    def _add(self, joint: Element) -> None:
        """Add a joint, and the limb that ends at it."""
        parent, child = _parent(joint), _child(joint)
        start, end = self._thickness(parent), self._thickness(child)
        if child in self._moved or child in self._carrying:
            self.parts[parent] += _limb(self._offsets[child], start, end,
                                        self._reach[parent] < MIN_LIMB_LENGTH)
        elif parent in self._moved or parent in self._carrying or parent in self._tools:
            self.parts[parent] += self._tool(child, start)
        if child in self._moved:
            self.parts[child] += self._joint(joint, end)

    def _tool(self, child: str, radius: float) -> list[Part]:
        """Return the parts up to a frame of a tool: a flange, with a pointer at the last frame."""
        offset = self._offsets[child]
        length = float(np.linalg.norm(offset))
        if length < MIN_LIMB_LENGTH:
            return []
        T = pose_along(offset / length, np.zeros(3))
        if child not in self._extended:
            # A long link has a pointer only at its end.
            bare = length - POINTER * radius if length > LONG * radius else 0.0
            return [*_limb((bare / length) * offset, radius, 0.85 * radius), _solid(
                pointer(0.85 * radius, TIP_RADIUS * radius, length - bare),
                pose_along(offset / length, (bare / length) * offset), JOINT_COLOUR)]
        shaft = max(length - 0.5 * radius, MIN_LIMB_LENGTH)
        return [_solid(limb(radius, 0.85 * radius, shaft, 1.0), T)]

    def _joint(self, joint: Element, radius: float) -> list[Part]:
        """Return the body of a joint, on the link that it moves."""
        child = _child(joint)
        axis = vector(joint.find('axis'), 'xyz', '1 0 0')
        axis = axis / np.linalg.norm(axis)
        if joint.get('type') == 'prismatic':
            return _slide(joint, axis, radius)
        back = -self._turns[child].T @ self._offsets[child]
        for offset in (back, *self._next[child]):
            length = float(np.linalg.norm(offset))
            if length > MIN_LIMB_LENGTH and abs(axis @ offset) > ALONG_COSINE * length:
                at = min(COLLAR_AT * radius, 0.5 * length) / length * offset
                return [_solid(drum(COLLAR[0] * radius, COLLAR[1] * radius, 0.1 * radius),
                               pose_along(axis, at), JOINT_COLOUR)]
        T = pose_along(axis, np.zeros(3))
        return [_solid(drum(DRUM[0] * radius, DRUM[1] * radius, EDGE * radius), T),
                _solid(drum(CAP[0] * radius, CAP[1] * radius, 0.1 * radius), T, JOINT_COLOUR)]

    def _add_foot(self, link: str) -> None:
        """Add a foot below a root link whose first limb rises."""
        radius = self._thickness(link)
        if any(offset[2] > max(FOOT_HEIGHT * radius, ALONG_COSINE * np.linalg.norm(offset))
               for offset in self._next[link]):
            self.parts[link].insert(0, _solid(
                foot(1.02 * radius, FOOT_HEIGHT * radius, PLATE * radius), np.eye(4)))

    def _thickness(self, link: str) -> float:
        """Return the radius of a link, which decreases with the distance from the root [m]."""
        share = self._reach[link] / max(self._length, MIN_LIMB_LENGTH)
        return self._radius * (TAPER[0] + (TAPER[1] - TAPER[0]) * share)


def _solid(mesh: Mesh, T: Array, colour: Colour = LINK_COLOUR) -> Part:
    """Return a surface as a part."""
    return Part('mesh', (1.0, 1.0, 1.0), T, colour, mesh=mesh)


def _limb(end: Array, first: float, last: float, flat: bool = False) -> list[Part]:
    """Return a limb from the origin of a link, flat there or not, to a point; radii at both."""
    length = float(np.linalg.norm(end))
    if length < MIN_LIMB_LENGTH:
        return []
    return [_solid(limb(first, last, length, flat=flat), pose_along(end / length, np.zeros(3)))]


def _slide(joint: Element, axis: Array, radius: float) -> list[Part]:
    """Return the body of a prismatic joint: a box, and a rod as long as its travel."""
    T, side = pose_along(axis, np.zeros(3)), 2.0 * DRUM[0] * radius
    limit = joint.find('limit')
    travel = 0.0 if limit is None else float(limit.get('upper', 0.0))
    parts = [Part('box', (side, side, DRUM[1] * radius), T, JOINT_COLOUR)]
    if MIN_LIMB_LENGTH < travel < LONGEST_SLIDE:
        parts += _limb(-travel * T[:3, 2], 0.6 * radius, 0.6 * radius)
    return parts


def _parent(joint: Element) -> str:
    """Return the parent link of a joint."""
    return next(joint.iter('parent')).attrib['link']


def _child(joint: Element) -> str:
    """Return the child link of a joint."""
    return next(joint.iter('child')).attrib['link']


def vector(element: Element | None, key: str, default: str = '0 0 0') -> Array:
    """Return the three numbers of an attribute."""
    found = numbers(default if element is None else element.get(key, default))
    return np.array([*found, 0.0, 0.0, 0.0][:3])


def numbers(text: str) -> list[float]:
    """Return the numbers in a text."""
    return [float(word) for word in text.split()]


def surface(outline: Iterable[tuple[float, float]]) -> Mesh:
    """
    Return the surface that an outline sweeps.

    Parameters
    ----------
    outline : iterable of (float, float)
        Radius and height of its points, from bottom to top [m]; a repeated point makes a sharp
        edge.

    """
    points = np.array(list(outline))
    angles = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    radius, height = points[:, :1], np.repeat(points[:, 1:], SIDES, axis=1)
    vertices = np.stack((radius * np.cos(angles), radius * np.sin(angles), height),
                        axis=-1).reshape(-1, 3)
    lower = np.arange(len(points) - 1)[:, np.newaxis] * SIDES
    one, other = lower + np.arange(SIDES), lower + np.roll(np.arange(SIDES), -1)
    faces = np.concatenate([np.stack((one, other, other + SIDES), axis=-1).reshape(-1, 3),
                            np.stack((one, other + SIDES, one + SIDES), axis=-1).reshape(-1, 3)])
    return Mesh(vertices=vertices, faces=faces, points=vertices)


def drum(radius: float, length: float, edge: float) -> Mesh:
    """Return a cylinder about its centre with rounded edges of a radius [m]."""
    half, quarter = 0.5 * length, np.linspace(0.0, 0.5 * np.pi, EDGE_SEGMENTS)
    upper = [(radius - edge + edge * np.cos(turn), half - edge + edge * np.sin(turn))
             for turn in quarter]
    outline = [(0.0, -half), *((r, -z) for r, z in reversed(upper)), *upper, (0.0, half)]
    return surface(outline)


def limb(start: float, end: float, length: float, waist: float = 0.8,
         flat: bool = False) -> Mesh:
    """
    Return a limb along z, from the origin, with round ends around both points.

    Parameters
    ----------
    start, end : float
        Radii at its ends [m].
    length : float
        Between the ends [m].
    waist : float
        Radius in the middle as a share of that of a straight limb.
    flat : bool
        Begin with a plane, as on the ground.

    """
    shares = np.linspace(0.0, 1.0, 2 * EDGE_SEGMENTS)
    # Zero slope at the ends, for a smooth transition to the round ends.
    bend = 1.0 - (1.0 - waist) * np.sin(np.pi * shares) ** 2
    body = [((start + (end - start) * share) * each, length * share)
            for share, each in zip(shares, bend)]
    quarter = np.linspace(0.0, 0.5 * np.pi, EDGE_SEGMENTS)[:-1]
    below = [(0.0, 0.0)] if flat else [
        (start * np.sin(turn), -start * np.cos(turn)) for turn in quarter]
    above = [(end * np.sin(turn), length + end * np.cos(turn)) for turn in quarter[::-1]]
    return surface([*below, *body, *above])


def foot(radius: float, height: float, plate: float) -> Mesh:
    """Return a foot that stands at the origin: a plate, and a cone that ends at a radius [m]."""
    wide, rim = 2.1 * radius, 0.12 * radius
    quarter = np.linspace(0.0, 1.0, 2 * EDGE_SEGMENTS)
    cone = [(radius + (0.8 * wide - radius) * (1.0 - share) ** 2, plate + (height - plate) * share)
            for share in quarter]
    return surface([(0.0, 0.0), (wide, 0.0), (wide, 0.0), (wide, plate - rim), (wide - rim, plate),
                    (wide - rim, plate), cone[0], cone[0], *cone, (0.0, height)])


def pointer(start: float, end: float, length: float) -> Mesh:
    """Return a tool along z from the origin: a plate, then a cone with a round tip [m]."""
    plate = min(0.35 * start, 0.3 * length)
    quarter = np.linspace(0.0, 0.5 * np.pi, EDGE_SEGMENTS)
    neck = 0.62 * start
    tip = [(end * np.cos(turn), length - end + end * np.sin(turn)) for turn in quarter]
    return surface([(0.0, 0.0), (start, 0.0), (start, 0.0), (start, plate), (start, plate),
                    (neck, plate), (neck, plate), *tip])
