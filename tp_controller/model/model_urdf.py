# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
URDF of a Pinocchio model, for robots that are described by anything else.

Every other part of the package reads URDF: limits, shapes, pictures, recordings and the
simulator's ``robot_description``. The forward kinematics are the same to rounding errors.
"""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
import math
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio
from tp_controller.errors import RobotError
from tp_controller.model.spatial import Array, rotation_from_rpy
from tp_controller.model.urdf import MimicRules, UNLIMITED
from tp_controller.model.urdf_solids import shape_element

FREE_FLYER_TYPE = 'JointModelFreeFlyer'
COMPOSITE_TYPE = 'JointModelComposite'
MIMIC_TYPE = 'JointModelMimic'
# Joints of several coordinates that are a chain of simple ones: (suffix, type, axis).
X, Y, Z = np.eye(3)
CHAINS: Mapping[str, Sequence[tuple[str, str, Array]]] = {
    'JointModelPlanar': (('x', 'prismatic', X), ('y', 'prismatic', Y), ('yaw', 'continuous', Z)),
    'JointModelTranslation': tuple((name, 'prismatic', axis)
                                   for name, axis in zip('xyz', (X, Y, Z))),
    'JointModelSphericalZYX': tuple((name, 'revolute', axis) for name, axis in zip(
        ('yaw', 'pitch', 'roll'), (Z, Y, X)))}
VALID_JOINTS = ('revolute, continuous, prismatic, planar, translation, z-y-x, composites of '
                'these, mimic, and a free-flyer that moves the whole robot; replace the joint by '
                'such ones, or fix it')
# Frames that become links; the others are the joints themselves.
LINK_FRAMES = (pinocchio.FrameType.BODY, pinocchio.FrameType.OP_FRAME, pinocchio.FrameType.SENSOR)
# Name of the root link of a model that does not name one.
WORLD = 'world'


class Description(NamedTuple):
    """
    URDF of a robot.

    Attributes
    ----------
    urdf : str
        URDF text.
    floating : str
        Name of the joint that lets the root float, which is left out; empty if there is none.
    remarks : tuple of str
        What could not be read.

    """

    urdf: str
    floating: str = ''
    remarks: tuple[str, ...] = ()

    def remarks_on(self, moves: bool) -> tuple[str, ...]:
        """Return the remarks on a robot, the base of which moves or not."""
        if moves or not self.floating:
            return self.remarks
        return (*self.remarks, f'the root floats in the description, by joint {self.floating}, '
                               'and stands still here: set base to let it move')


class Corrections(NamedTuple):
    """
    Facts that a model lacks, or has wrong.

    Attributes
    ----------
    parts : mapping
        {composite joint: names of its parts}.
    ranges : mapping
        {joint of the URDF: (lower, upper)} [rad or m].
    mimics : mapping
        Further mimic joints: ``{follower: (leader, multiplier, offset)}``.

    """

    parts: Mapping[str, Sequence[str]] = {}
    ranges: Mapping[str, tuple[float, float]] = {}
    mimics: MimicRules = {}


NOTHING = Corrections()


class _Motion(NamedTuple):
    """One simple joint: its URDF type, axis (3,), placement, and indices of its limits."""

    name: str
    kind: str
    axis: Array
    placement: pinocchio.SE3
    row: int | None
    column: int | None


def urdf_from_model(model: pinocchio.Model, shapes: Iterable[pinocchio.GeometryObject] = (),
                    corrections: Corrections = NOTHING) -> Description:
    """
    Return the URDF of a Pinocchio model.

    A first joint of type free-flyer is left out: its child is the root, for `Robot` to move by
    its base. Planar joints, translations and z-y-x joints become chains of simple joints, which
    are named ``<joint>_x``, ``<joint>_yaw`` and so on; parts of composite joints are numbered.

    Parameters
    ----------
    model : pinocchio.Model
        Model of any origin, with or without frames for its bodies.
    shapes : iterable of pinocchio.GeometryObject, optional
        Collision shapes, placed on the joints of the model.
    corrections : Corrections, optional
        Facts that precede those of the model.

    Returns
    -------
    Description

    Raises
    ------
    RobotError
        A joint is of an unsupported type, such as spherical.

    """
    writer = _Writer(model, corrections)
    writer.add_joints()
    writer.add_mimics()
    for frame in model.frames:
        writer.add_frame(frame)
    for shape in shapes:
        writer.add_shape(shape)
    return Description(writer.text(), writer.floating)


class _Writer:
    """
    Writer of the links and joints of a model.

    Attributes
    ----------
    floating : str
        Name of the free-flyer joint that the root was the child of; empty if there is none.

    """

    def __init__(self, model: pinocchio.Model, corrections: Corrections) -> None:
        self._model, self._corrections = model, corrections
        self._tree = Element('robot', name=model.name or 'robot')
        self._links: dict[str, Element] = {}
        self._joints: set[str] = set(model.names)
        # First joint that moves relative to the root, and the link that each joint carries.
        self._first = _root_joint(model)
        self.floating: str = model.names[self._first] if self._first else ''
        self._carried: dict[int, str] = {self._first: self._add_link(self._name_of(self._first))}
        self._add_inertia(self._first)

    def text(self) -> str:
        """Return the URDF."""
        ElementTree.indent(self._tree)
        return ElementTree.tostring(self._tree, encoding='unicode') + '\n'

    def add_joints(self) -> None:
        """Add all joints with the links that they carry; parents come before children."""
        for index in range(self._first + 1, self._model.njoints):
            parent = self._carried[self._model.parents[index]]
            motions = list(self._motions(index))
            for number, motion in enumerate(motions, 1):
                last = number == len(motions)
                child = self._add_link(self._name_of(index) if last else f'{motion.name}_link')
                joint = self._add_joint(motion.name, motion.kind, parent, child, motion.placement)
                ElementTree.SubElement(joint, 'axis', xyz=_numbers(motion.axis))
                self._add_limit(joint, motion)
                parent = child
            self._carried[index] = parent
            self._add_inertia(index)

    def add_mimics(self) -> None:
        """Add the rules of mimic joints, of the model and others."""
        rules = dict(self._corrections.mimics)
        for follower, leader in zip(self._model.mimicking_joints, self._model.mimicked_joints):
            rule = self._model.joints[follower].extract()
            rules[self._model.names[follower]] = (self._model.names[leader], rule.scaling,
                                                  rule.offset)
        joints = {joint.get('name'): joint for joint in self._tree.findall('joint')}
        for name, (leader, multiplier, offset) in rules.items():
            if name in joints and leader in joints:
                ElementTree.SubElement(joints[name], 'mimic', joint=leader,
                                       multiplier=repr(float(multiplier)),
                                       offset=repr(float(offset)))

    def add_frame(self, frame: Any) -> None:
        """Add the link of a frame, unless it has one."""
        if frame.type not in LINK_FRAMES or frame.name in self._links \
                or frame.parentJoint not in self._carried:
            return
        link = self._add_link(frame.name)
        self._add_joint(_unused(f'{link}_fixed', self._joints), 'fixed',
                        self._carried[frame.parentJoint], link, frame.placement)

    def add_shape(self, shape: Any) -> None:
        """Add a collision shape to the link of its joint; ignore what a URDF cannot express."""
        element = shape_element(shape)
        if element is None or shape.parentJoint not in self._carried:
            return
        link, placement = self._carried[shape.parentJoint], shape.placement
        # The index is out of range for shapes of a joint.
        for frame in list(self._model.frames)[shape.parentFrame:shape.parentFrame + 1]:
            if frame.name in self._links and frame.parentJoint == shape.parentJoint:
                link, placement = frame.name, frame.placement.inverse() * placement
        collision = ElementTree.SubElement(self._links[link], 'collision')
        collision.append(_origin(placement))
        ElementTree.SubElement(collision, 'geometry').append(element)

    def _name_of(self, index: int) -> str:
        """Return the name of the link that a joint carries: its body, if it is at the joint."""
        at_joint = [frame.name for frame in self._model.frames
                    if frame.type == pinocchio.FrameType.BODY and frame.parentJoint == index
                    and frame.placement.isIdentity(0.0)]
        if at_joint:
            return at_joint[0]
        return f'{self._model.names[index]}_link' if index else WORLD

    def _motions(self, index: int) -> Iterator[_Motion]:
        """Yield the simple joints that a joint of the model is made of."""
        joint, name = self._model.joints[index], self._model.names[index]
        placement = self._model.jointPlacements[index]
        kind = joint.shortname()
        if kind == COMPOSITE_TYPE:
            joint = joint.extract()
            names = self._corrections.parts.get(name, ())
            for number, (part, at) in enumerate(zip(joint.joints, joint.jointPlacements)):
                yield _simple(names[number] if number < len(names) else f'{name}_{number + 1}',
                              part, placement * at, self._model.nq)
                placement = pinocchio.SE3.Identity()
        elif kind in CHAINS:
            for number, (suffix, type_, axis) in enumerate(CHAINS[kind]):
                yield _Motion(f'{name}_{suffix}', type_, axis, placement, joint.idx_q + number,
                              joint.idx_v + number)
                placement = pinocchio.SE3.Identity()
        else:
            yield _simple(name, joint, placement, self._model.nq)

    def _add_link(self, name: str) -> str:
        """Add a link; return its name, which differs from a name that is used already."""
        name = _unused(name or 'link', self._links)
        self._links[name] = ElementTree.SubElement(self._tree, 'link', name=name)
        return name

    def _add_joint(self, name: str, kind: str, parent: str, child: str,
                   placement: pinocchio.SE3) -> Element:
        """Add a joint, and return its element."""
        self._joints.add(name)
        joint = ElementTree.SubElement(self._tree, 'joint', name=name, type=kind)
        ElementTree.SubElement(joint, 'parent', link=parent)
        ElementTree.SubElement(joint, 'child', link=child)
        joint.append(_origin(placement))
        return joint

    def _add_limit(self, joint: Element, motion: _Motion) -> None:
        """Add the limits of a joint; one that turns without position limits is continuous."""
        model, limit = self._model, {'effort': '0'}
        lower, upper = (-UNLIMITED, UNLIMITED) if motion.row is None else (
            max(float(model.lowerPositionLimit[motion.row]), -UNLIMITED),
            min(float(model.upperPositionLimit[motion.row]), UNLIMITED))
        if motion.name in self._corrections.ranges:
            lower, upper = np.clip(self._corrections.ranges[motion.name], -UNLIMITED, UNLIMITED
                                   ).tolist()
        if motion.kind == 'revolute' and (lower, upper) == (-UNLIMITED, UNLIMITED):
            joint.set('type', 'continuous')
        elif motion.kind != 'continuous':
            limit.update(lower=repr(lower), upper=repr(upper))
        for key, values in (('velocity', model.upperVelocityLimit),
                            ('effort', model.upperEffortLimit)):
            if motion.column is not None and values[motion.column] < UNLIMITED:
                limit[key] = repr(float(values[motion.column]))
        ElementTree.SubElement(joint, 'limit', limit)

    def _add_inertia(self, index: int) -> None:
        """Add the inertia of all bodies that a joint carries to its link."""
        inertia = self._model.inertias[index]
        if not inertia.mass > 0.0:
            return
        element = ElementTree.SubElement(self._links[self._carried[index]], 'inertial')
        ElementTree.SubElement(element, 'origin', xyz=_numbers(inertia.lever))
        ElementTree.SubElement(element, 'mass', value=repr(float(inertia.mass)))
        ElementTree.SubElement(element, 'inertia', {
            f'i{"xyz"[row]}{"xyz"[column]}': repr(float(inertia.inertia[row, column]))
            for row in range(3) for column in range(row, 3)})


def _root_joint(model: pinocchio.Model) -> int:
    """Return the index of a free-flyer joint that moves the whole robot, or 0, the universe."""
    first = [index for index in range(1, model.njoints) if model.parents[index] == 0]
    floating = [index for index in range(1, model.njoints)
                if model.joints[index].shortname() == FREE_FLYER_TYPE]
    if not floating:
        return 0
    if first != floating[:1] or len(floating) > 1:
        raise RobotError(f'joint {model.names[floating[-1]]!r} floats; only the one joint that '
                         'moves the whole robot may (base: floating). Leave the objects around '
                         'it out, or weld them')
    return floating[0]


def _simple(name: str, joint: Any, placement: pinocchio.SE3, nq: int) -> _Motion:
    """Return a joint with one degree of freedom, classified by its motion subspace."""
    kind = joint.shortname()
    S: Array = np.zeros((6, 0))
    if joint.nv == 1 or kind == MIMIC_TYPE:
        data = joint.createData()
        # The subspace of such joints is constant; nq is that of the model.
        joint.calc(data, np.zeros(nq))
        S = np.array(data.S).reshape(6, -1)
    turns = bool(S[3:].any())
    if S.shape[1] != 1 or not S.any() or turns and S[:3].any():
        raise RobotError(
            f'joint {name!r} is of type {kind.removeprefix("JointModel")}; valid: {VALID_JOINTS}')
    axis = S[3:, 0] if turns else S[:3, 0]
    if kind == MIMIC_TYPE:
        # Its subspace is that per motion of the mimicked joint; it has no limits of its own.
        return _Motion(name, 'revolute' if turns else 'prismatic',
                       axis / joint.extract().scaling, placement, None, None)
    if joint.nq == 2:
        # Stored as cosine and sine.
        return _Motion(name, 'continuous', axis, placement, None, joint.idx_v)
    return _Motion(name, 'revolute' if turns else 'prismatic', axis, placement, joint.idx_q,
                   joint.idx_v)


def _origin(placement: pinocchio.SE3) -> Element:
    """Return the URDF element of a placement."""
    return Element('origin', xyz=_numbers(placement.translation),
                   rpy=_numbers(_rpy(placement.rotation)))


def _rpy(R: Array) -> Array:
    """
    Return roll, pitch and yaw (3,) of a rotation (3, 3) [rad].

    Each is read from what the ones before leave: to rounding errors also near a pitch of 90°,
    where roll and yaw are not unique.
    """
    yaw = math.atan2(R[1, 0], R[0, 0])
    R = rotation_from_rpy(0.0, 0.0, -yaw).dot(R)
    pitch = math.atan2(-R[2, 0], R[0, 0])
    R = rotation_from_rpy(0.0, -pitch, 0.0).dot(R)
    return np.array([math.atan2(R[2, 1], R[1, 1]), pitch, yaw])


def _numbers(values: Iterable[float]) -> str:
    """Return numbers as URDF writes them, without loss."""
    return ' '.join(repr(float(value)) for value in values)


def _unused(name: str, used: Container[str]) -> str:
    """Return a name that is not used, with underscores behind it if needed."""
    while name in used:
        name += '_'
    return name
