# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""URDF parser: joints, mimic rules, and the model in Pinocchio."""

from collections.abc import Mapping
import copy
import math
from typing import TypeAlias
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pinocchio
from tp_controller.errors import RobotError, unknown
from tp_controller.resources import load_xml

# Supported types of moving joints.
MOVING_TYPES = ('revolute', 'continuous', 'prismatic')
# A URDF cannot express "unlimited"; limits of at least this count as infinite.
UNLIMITED = 1e9
# The largest of example-robot-data, TIAGo with two arms, has 130 links and 101 moving joints.
# Pinocchio's data of a state grow with the third power of the joints: 100 MB for 150.
MOST_LINKS, MOST_MOVING_JOINTS = 1000, 150
# Numbers that the model needs: {element: {attribute: how many}}.
NUMBERS = {'origin': {'xyz': 3, 'rpy': 3}, 'axis': {'xyz': 3}, 'limit': {'lower': 1, 'upper': 1},
           'mass': {'value': 1},
           'inertia': dict.fromkeys(('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'), 1)}
# Name of the joint between the world and a base that moves.
FREE_FLYER = 'free flyer'
# {follower: (leader, multiplier, offset)}
MimicRules: TypeAlias = dict[str, tuple[str, float, float]]


def parse(urdf: str) -> Element:
    """Return the element tree of a URDF text."""
    try:
        tree = load_xml(urdf)
    except ValueError as error:
        raise RobotError(f'robot description: {error}') from error
    if tree.tag != 'robot':
        raise RobotError(f'robot description: the outermost element is <{tree.tag}>, not <robot>')
    if any('xacro' in element.tag for element in tree.iter() if isinstance(element.tag, str)):
        raise RobotError('robot description has xacro macros: run it through xacro first')
    return tree


def moving_joints(tree: Element) -> dict[str, Element]:
    """Return the elements of the joints that move, by name; refuse unsupported types."""
    elements = {}
    for joint in tree.findall('joint'):
        kind = joint.get('type')
        if kind in MOVING_TYPES:
            elements[joint.get('name', '')] = joint
            if len(elements) > MOST_MOVING_JOINTS:
                raise RobotError(f'more than {MOST_MOVING_JOINTS} joints that move: fix those '
                                 'that are not needed')
        elif kind != 'fixed':
            raise RobotError(f'joint {joint.get("name")!r} is of type {kind!r}; '
                             f'valid: fixed, {", ".join(MOVING_TYPES)}')
    return elements


def check_tree(tree: Element) -> None:
    """
    Raise `RobotError` with the cause if links and joints do not form a tree.

    The URDF parser itself only reports that the text is not valid.
    """
    links = _names(tree, 'link')
    _names(tree, 'joint')
    if len(links) > MOST_LINKS:
        raise RobotError(f'robot description: {len(links)} links; at most {MOST_LINKS} are read')
    if not links:
        raise RobotError('robot description: it is empty: there is no link')
    children = set()
    for joint in tree.findall('joint'):
        for end in ('parent', 'child'):
            element = joint.find(end)
            link = None if element is None else element.get('link')
            if link not in links:
                raise RobotError(f'joint {joint.get("name")!r}, {end}: '
                                 f'{unknown("link", link, links)}')
        if link in children:
            raise RobotError(f'link {link!r} is the child of two joints')
        children.add(link)
    roots = [link for link in links if link not in children]
    if len(roots) != 1:
        raise RobotError('robot description: the links must make one tree, with one root; '
                         f'without a parent are: {", ".join(map(str, roots)) or "none"}')


def _names(tree: Element, what: str) -> dict[str, None]:
    """Return the names of the links or joints, in order; refuse missing and repeated names."""
    names: dict[str, None] = {}
    for element in tree.findall(what):
        name = element.get('name')
        if not name or name in names:
            raise RobotError(f'robot description: every {what} needs a name of its own; '
                             f'missing or used twice: {name!r}')
        names[name] = None
    return names


def build_model(tree: Element, moving_base: bool = False) -> pinocchio.Model:
    """
    Return Pinocchio's model of a URDF, with one coordinate for every moving joint.

    A base that moves has a free-flyer joint before them.
    """
    # Drop the shapes, the largest part of a description: the parser blocks all other threads.
    slim = Element('robot', name=tree.get('name') or 'robot')
    for link in tree.findall('link'):
        ElementTree.SubElement(slim, 'link', name=link.get('name', '')).extend(
            link.findall('inertial'))
    slim.extend(copy.deepcopy(tree.findall('joint')))
    _check_numbers(slim)
    for joint in slim.findall('joint'):
        if joint.get('type') not in MOVING_TYPES:
            continue
        limit = joint.find('limit')
        if limit is None:
            limit = ElementTree.SubElement(joint, 'limit')
        # The parser requires both. Limits are read from the description itself.
        limit.set('effort', '0')
        limit.set('velocity', '0')
        if joint.get('type') == 'continuous':
            # Pinocchio would store a continuous joint as cosine and sine, without full turns.
            joint.set('type', 'revolute')
            limit.set('lower', repr(-UNLIMITED))
            limit.set('upper', repr(UNLIMITED))
    before = (pinocchio.JointModelFreeFlyer(), FREE_FLYER) if moving_base else ()
    try:
        return pinocchio.buildModelFromXML(ElementTree.tostring(slim, encoding='unicode'), *before)
    except (ValueError, RuntimeError) as error:
        raise RobotError(f'robot description: {error}') from error


def _check_numbers(slim: Element) -> None:
    """Raise `RobotError` for a faulty number, which the parser does not name or drops."""
    for part in slim:
        for element in part.iter():
            where = f'{part.tag} {part.get("name")!r}, {element.tag}'
            for key, count in NUMBERS.get(element.tag, {}).items():
                text = element.get(key)
                if text is None:
                    continue
                found = _finite(text)
                if len(found) != count:
                    needed = 'a finite number' if count == 1 else f'{count} finite numbers'
                    raise RobotError(f'{where}: {key} needs {needed}, got {text!r}')
                if element.tag == 'axis' and part.get('type') in MOVING_TYPES and not any(found):
                    raise RobotError(f'{where}: an axis needs a direction, not {text!r}')


def _finite(text: str) -> list[float]:
    """Return the numbers in a text; none if one is faulty."""
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        return []
    return found if all(map(math.isfinite, found)) else []


def mimic_rules(elements: Mapping[str, Element]) -> MimicRules:
    """Return {follower: (leader, multiplier, offset)}."""
    rules: MimicRules = {}
    for name, element in elements.items():
        mimic = element.find('mimic')
        if mimic is None:
            continue
        leader = mimic.get('joint', '')
        if leader not in elements:
            raise RobotError(f'joint {name!r} mimics {unknown("joint", leader, elements)}')
        try:
            rules[name] = (leader, float(mimic.get('multiplier', 1.0)),
                           float(mimic.get('offset', 0.0)))
        except ValueError as error:
            raise RobotError(f'joint {name!r}, mimic: {error}') from error
    for name in rules:
        resolve_mimic(name, rules)
    return rules


def resolve_mimic(name: str, rules: MimicRules) -> tuple[str, float, float]:
    """Return (leader, multiplier, offset) of a joint; the joint itself if it has no leader."""
    multiplier, offset = 1.0, 0.0
    leader, seen = name, set[str]()
    while leader in rules:
        if leader in seen:
            raise RobotError(f'joint {name!r} mimics itself, through {", ".join(sorted(seen))}')
        seen.add(leader)
        leader, factor, shift = rules[leader]
        offset += multiplier * shift
        multiplier *= factor
    return leader, multiplier, offset
