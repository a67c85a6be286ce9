# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
MJCF, the format of MuJoCo, read by Pinocchio's parser and turned into URDF.

Pinocchio's parser reads one file and the first body of the world, misplaces joints whose position
is that of a class, takes ranges of slides for degrees, shifts ranges by `ref`, drops the names of
several joints of one body, and knows no equalities of joints. The tree is changed before, and
the model after, so that kinematics and ranges are those of MuJoCo.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import math
from pathlib import Path
import tempfile
from typing import TypeAlias
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pinocchio
from tp_controller.errors import LONGEST_FAULT, RobotError, unknown
from tp_controller.model.model_urdf import Corrections, Description, urdf_from_model, WORLD
from tp_controller.model.urdf import MimicRules
from tp_controller.resources import load_xml, MOST_XML_CHARACTERS, read_source

MJCF_ROOT = 'mujoco'
# Elements whose attributes may be those of a class, and the name of the outermost class.
WITH_CLASSES, MAIN_CLASS = ('joint', 'geom', 'site', 'mesh'), 'main'
# Parts without an effect on kinematics and shapes, some of which stop the parser.
UNUSED_SECTIONS = ('keyframe', 'actuator', 'sensor', 'contact', 'equality', 'tendon', 'custom',
                   'visual', 'statistic', 'extension')
# {class: {element: attributes}}
Classes: TypeAlias = dict[str, dict[str, dict[str, str]]]
# Elements that make bodies, and that the parser would leave out silently.
UNREAD_ELEMENTS = ('frame', 'replicate', 'attach', 'composite', 'flexcomp')
# Largest number of files that a model includes.
MOST_INCLUDES = 100
# Prefix of a joint that stands for several of one body, before the name of the first.
SEVERAL_JOINTS = 'Composite_'
# Exceptions of the parser.
PARSER_FAILURES = (ValueError, RuntimeError, IndexError)


def urdf_from_mjcf(text: str, path: Path | None = None) -> Description:
    """
    Return the URDF of a robot in MJCF.

    A free joint of the only body of the world is left out, so that `Robot` can move it by its
    base. Linear equalities of two joints become mimic joints, sites become links.

    Parameters
    ----------
    text : str
        MJCF text.
    path : pathlib.Path, optional
        Its file, relative to which included files and meshes are searched.

    Returns
    -------
    Description

    Raises
    ------
    RobotError
        The text is not valid, or a joint is of an unsupported type, such as a ball joint.

    """
    where = str(path or 'MJCF')
    folder = path.resolve().parent if path else None
    try:
        tree = _Merger(folder).merged(text)
    except (OSError, ValueError) as error:
        raise RobotError(f'{where}: {error}') from error
    for name in UNREAD_ELEMENTS:
        if tree.find(f'worldbody//{name}') is not None:
            raise RobotError(f'{where}: <{name}> is not read. Let MuJoCo write the model without '
                             'it (mujoco.mj_saveLastXML), or take a URDF of the robot')
    rules, left_out = _mimic_rules(tree)
    corrections, remarks = Corrections(mimics=rules), _drop_objects(tree, where)
    if left_out:
        remarks = (*remarks, f'{where}: without the equalities that do not make a joint mimic '
                             f'another; those joints move by themselves: {", ".join(left_out)}')
    for name in UNUSED_SECTIONS:
        for element in tree.findall(name):
            tree.remove(element)
    try:
        _resolve_classes(tree)
        corrections = corrections._replace(parts=_name_joints(tree), ranges=_ranges(tree))
    except (RobotError, ValueError) as error:
        raise RobotError(f'{where}: {error}') from error
    _join_bodies(tree)
    return _converted(tree, where, corrections, remarks)


def _converted(tree: Element, where: str, corrections: Corrections,
               remarks: tuple[str, ...]) -> Description:
    """Return the URDF of a changed tree."""
    text = ElementTree.tostring(tree, encoding='unicode')
    try:
        model = _parsed(text)
    except PARSER_FAILURES as error:
        raise RobotError(f'{where}: {_message(error)}; let MuJoCo write the model as one file '
                         '(mujoco.mj_saveLastXML), or take a URDF of the robot') from error
    model.name = tree.get('model') or 'robot'
    try:
        shapes = _shapes(text, model)
    except PARSER_FAILURES as error:
        shapes = []
        remarks = (*remarks, f'{where}: without collision shapes, which cannot be read: '
                             f'{_message(error)}')
    return urdf_from_model(model, shapes, corrections)._replace(remarks=remarks)


def _parsed(text: str) -> pinocchio.Model:
    """Return Pinocchio's model of a text."""
    with _file(text) as name:
        return pinocchio.buildModelFromMJCF(name)


def _shapes(text: str, model: pinocchio.Model) -> list[pinocchio.GeometryObject]:
    """Return the collision shapes of a text, on the joints of its model."""
    with _file(text) as name:
        return list(pinocchio.buildGeomFromMJCF(
            model, name, pinocchio.GeometryType.COLLISION).geometryObjects)


@contextmanager
def _file(text: str) -> Iterator[str]:
    """Yield the name of a temporary file with a text: the parser reads files only."""
    with tempfile.NamedTemporaryFile('wb', suffix='.xml') as file:
        file.write(text.encode())
        file.flush()
        yield file.name


class _Merger:
    """
    Reader of a model with the files that it includes.

    Parameters
    ----------
    folder : pathlib.Path or None
        Folder of the model, which all paths in it are relative to; None for a text.

    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._files = self._characters = 0

    def merged(self, text: str) -> Element:
        """Return the tree of a text with one element for each section, and absolute paths."""
        tree = Element(MJCF_ROOT)
        self._append(tree, self._included(text))
        compiler = tree.find('compiler')
        if compiler is None:
            compiler = ElementTree.SubElement(tree, 'compiler')
        if self._folder is not None:
            given = compiler.get('meshdir', compiler.get('assetdir', ''))
            compiler.set('meshdir', str(self._folder / given))
        return tree

    def _included(self, text: str) -> Element:
        """Return the tree of a text, in which the content of files replaces their includes."""
        self._characters += len(text)
        if self._characters > MOST_XML_CHARACTERS:
            raise ValueError(f'more than {MOST_XML_CHARACTERS} characters with what it includes')
        tree = load_xml(text)
        for parent in list(tree.iter()):
            for place, element in reversed(list(enumerate(parent))):
                if element.tag == 'include':
                    parent[place:place + 1] = list(self._included(
                        self._text(element.get('file', ''))))
        return tree

    def _text(self, name: str) -> str:
        """Return the text of an included file."""
        self._files += 1
        if self._files > MOST_INCLUDES:
            raise ValueError(f'more than {MOST_INCLUDES} includes, of which {name} is one: files '
                             'may not include each other in a circle')
        if self._folder is None:
            raise ValueError(f'a text cannot include the file {name}: give the name of the model')
        return read_source(self._folder / name, lambda text: False, MOST_XML_CHARACTERS)

    @staticmethod
    def _append(tree: Element, other: Element) -> None:
        """Append the sections of another model; sections of the same name become one."""
        tree.attrib.update(other.attrib)
        for section in other:
            found = tree.find(section.tag) if isinstance(section.tag, str) else None
            if found is None:
                tree.append(section)
            else:
                found.attrib.update(section.attrib)
                found.extend(section)


def _drop_objects(tree: Element, where: str) -> tuple[str, ...]:
    """Remove rigid bodies that float beside a robot with joints; return a remark on them."""
    bodies = [(world, body) for world in tree.findall('worldbody')
              for body in world.findall('body')]
    objects = [(world, body) for world, body in bodies
               if (len(body.findall('joint')), len(list(body.iter('joint')))) in ((0, 0), (1, 1))
               and (body.find('freejoint') is not None or _is_free(body.find('joint')))]
    if not objects or len(objects) == len(bodies):
        return ()
    for world, body in objects:
        world.remove(body)
    names = ', '.join(body.get('name', '?') for _, body in objects)
    return (f'{where}: without the objects that float: {names}',)


def _is_free(joint: Element | None) -> bool:
    """Return whether a joint is of type free."""
    return joint is not None and joint.get('type') == 'free'


def _resolve_classes(tree: Element) -> None:
    """Give elements the attributes of their classes, and remove all classes."""
    classes: Classes = {MAIN_CLASS: {}}
    for default in tree.findall('default'):
        _read_class(default, {}, classes)
        tree.remove(default)
    for section in (*tree.findall('asset'), *tree.findall('worldbody')):
        _resolve(section, MAIN_CLASS, classes)
    for element in tree.iter():
        element.attrib.pop('class', None)


def _read_class(default: Element, inherited: Mapping[str, dict[str, str]],
                classes: Classes) -> None:
    """Add a class, and those inside it, to the classes."""
    own = {tag: {**inherited.get(tag, {}), **_attributes(default.find(tag))}
           for tag in WITH_CLASSES}
    classes[default.get('class', MAIN_CLASS)] = own
    for nested in default.findall('default'):
        _read_class(nested, own, classes)


def _resolve(parent: Element, name: str, classes: Classes) -> None:
    """Give the elements of a body, the class of which has a name, the attributes of classes."""
    name = parent.attrib.pop('childclass', name)
    for element in parent:
        tag = str(element.tag)
        if tag == 'body':
            _resolve(element, name, classes)
        elif tag in WITH_CLASSES:
            own = element.get('class', name)
            if own not in classes:
                raise RobotError(unknown('class', own, classes))
            element.attrib.update({**classes[own].get(tag, {}), **element.attrib})


def _attributes(element: Element | None) -> dict[str, str]:
    """Return the attributes of an element, if there is one, without its class."""
    return {} if element is None else {
        key: value for key, value in element.attrib.items() if key != 'class'}


def _join_bodies(tree: Element) -> None:
    """Put several bodies of the world into one that is fixed: the parser reads only one."""
    for world in tree.findall('worldbody'):
        bodies = world.findall('body')
        if len(bodies) > 1:
            for body in bodies:
                world.remove(body)
            ElementTree.SubElement(world, 'body', name=WORLD).extend(bodies)


def _mimic_rules(tree: Element) -> tuple[MimicRules, list[str]]:
    """
    Return the linear equalities of two joints, and the names of all other equalities in force.

    Returns
    -------
    dict
        {follower: (leader, multiplier, offset)}.
    list of str

    """
    rules: MimicRules = {}
    left_out: list[str] = []
    for each in tree.iterfind('equality/*'):
        if each.tag == 'default' or each.get('active') == 'false':
            continue
        follower, leader = each.get('joint1'), each.get('joint2')
        try:
            offset, multiplier, *rest = map(float, each.get('polycoef', '0 1 0 0 0').split())
        except ValueError:
            rest = [math.nan]
        if each.tag == 'joint' and follower and leader and not any(rest):
            rules[follower] = leader, multiplier, offset
        else:
            left_out.append(f'{each.tag} {each.get("name") or follower or each.get("body1", "")}'
                            .rstrip())
    return rules, left_out


def _name_joints(tree: Element) -> dict[str, list[str]]:
    """
    Name all joints.

    Returns
    -------
    dict
        {joint of the parser: names of the joints of one body that it stands for}.

    """
    parts = {}
    for body in tree.iterfind('worldbody//body'):
        joints = body.findall('joint')
        for number, joint in enumerate(joints, 1):
            if not joint.get('name'):
                joint.set('name', f'{body.get("name", "body")}_joint{number}')
        if len(joints) > 1:
            names = [joint.get('name', '') for joint in joints]
            parts[SEVERAL_JOINTS + names[0]] = names
    return parts


def _ranges(tree: Element) -> dict[str, tuple[float, float]]:
    """Return {joint: (lower, upper)} of all joints [rad or m], infinite without a limit."""
    compiler = tree.find('compiler')
    given = {} if compiler is None else compiler.attrib
    degree = 1.0 if given.get('angle') == 'radian' else math.radians(1.0)
    inferred = given.get('autolimits') != 'false'
    found = {}
    for joint in tree.iterfind('worldbody//joint'):
        limited = joint.get('limited', 'auto')
        ends = [float(end) for end in joint.get('range', '').split()]
        if limited == 'true' or limited == 'auto' and inferred and any(ends):
            if len(ends) != 2:
                raise ValueError(f'joint {joint.get("name")!r}: range needs two numbers')
            unit = 1.0 if joint.get('type') == 'slide' else degree
            found[joint.get('name', '')] = unit * ends[0], unit * ends[1]
        else:
            found[joint.get('name', '')] = -math.inf, math.inf
    return found


def _message(error: Exception) -> str:
    """Return the message of an exception of the parser in one line, without places in it."""
    text = str(error).partition('message:')[2] or str(error)
    if isinstance(error, IndexError):
        return 'a class, mesh or material that it names is not defined'
    return ' '.join(text.split())[:LONGEST_FAULT]
