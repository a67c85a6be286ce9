# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""URDF that stands alone: meshes that are found without its file, and simple joints only."""

from collections.abc import Iterator, Mapping
import copy
from pathlib import Path
import re
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape, unescape

from tp_controller.errors import RobotError
from tp_controller.model.model_urdf import Description
from tp_controller.model.urdf import parse, UNLIMITED
from tp_controller.resources import find_file, package_share, SCHEME

# Files that elements of a URDF name, such as meshes and textures.
FILE_NAME = re.compile(r'(\bfilename\s*=\s*)(["\'])([^<>\n]*?)\2')
# Schemes that name a folder that is searched; the second is Gazebo's.
SCHEMES = (SCHEME, 'model://')
FILE_SCHEME = 'file://'
QUOTES = {'&quot;': '"', '&apos;': "'"}
MARKS = {mark: name for name, mark in QUOTES.items()}
# Joint types that are rewritten.
PLANAR, FLOATING = 'planar', 'floating'
REWRITTEN = re.compile(rf'\btype\s*=\s*["\'](?:{PLANAR}|{FLOATING})["\']')
# Joints that a planar one is made of: (suffix, type, axis).
PLANAR_PARTS = (('x', 'prismatic', '1 0 0'), ('y', 'prismatic', '0 1 0'),
                ('yaw', 'continuous', '0 0 1'))


def with_located_meshes(urdf: str, path: Path, packages: Mapping[str, Path]) -> str:
    """
    Return a URDF that names its meshes so that they are found without its own path.

    Relative names, and packages that are only found in `packages` or in folders above the file,
    become ``file://<absolute path>``. All others stay, also those that do not exist: many parts
    need no meshes.

    Parameters
    ----------
    urdf : str
        URDF text.
    path : pathlib.Path
        Its file.
    packages : mapping
        ``{package: folder}``, before those that are searched.

    """
    found: dict[str, str] = {}

    def located(match: re.Match[str]) -> str:
        before, quote, name = match.groups()
        if name not in found:
            found[name] = _location(unescape(name, QUOTES), path, packages)
        return f'{before}{quote}{escape(found[name], MARKS)}{quote}' \
            if found[name] else match.group()

    return FILE_NAME.sub(located, urdf)


def with_simple_joints(urdf: str) -> Description:
    """
    Return a URDF without joints of type planar and floating.

    A planar joint becomes ``<joint>_x``, ``<joint>_y`` and ``<joint>_yaw``, in the x-y plane of
    its frame as in Pinocchio and MoveIt, whatever its axis. A floating joint is left out if it
    moves the whole robot: its child is the root then.

    Raises
    ------
    RobotError
        The URDF is not valid, or another joint floats.

    """
    if not REWRITTEN.search(urdf):
        return Description(urdf)
    tree = parse(urdf)
    floating = _drop_floating(tree)
    for joint in tree.findall('joint'):
        if joint.get('type') == PLANAR:
            place = list(tree).index(joint)
            tree[place:place + 1] = list(_planar_parts(joint))
    return Description(ElementTree.tostring(tree, encoding='unicode'), floating)


def _location(name: str, path: Path, packages: Mapping[str, Path]) -> str:
    """Return the absolute name of a file that a URDF names; empty if its name can stay."""
    scheme = next((scheme for scheme in SCHEMES if name.startswith(scheme)), '')
    if not scheme:
        file = path.resolve().parent / name
        return '' if '://' in name or Path(name).is_absolute() or not file.is_file() \
            else f'{FILE_SCHEME}{file.resolve()}'
    package, _, rest = name[len(scheme):].partition('/')
    try:
        if package in packages:
            return f'{FILE_SCHEME}{packages[package] / rest}'
        if scheme == SCHEME and _is_installed(package):
            return ''
        return f'{FILE_SCHEME}{find_file(f"{SCHEME}{package}/{rest}", path)}'
    except (OSError, ValueError):
        return ''


def _is_installed(package: str) -> bool:
    """Return whether a package is found without a file that names it."""
    try:
        package_share(package)
    except (OSError, ValueError):
        return False
    return True


def _drop_floating(tree: Element) -> str:
    """Remove the floating joint that moves the whole robot, with its parent; return its name."""
    floating = [joint for joint in tree.findall('joint') if joint.get('type') == FLOATING]
    if not floating:
        return ''
    joint, *others = floating
    parent = _link(joint, 'parent')
    beside = [other for other in tree.findall('joint')
              if other is not joint and parent in (_link(other, 'parent'), _link(other, 'child'))]
    if others or beside:
        raise RobotError(f'joint {(others or floating)[0].get("name")!r} is of type floating; '
                         'only the one joint below the root may float, and moves the whole robot '
                         '(base: floating). Fix the others')
    tree.remove(joint)
    for link in tree.findall('link'):
        if link.get('name') == parent:
            tree.remove(link)
    return joint.get('name', '')


def _planar_parts(joint: Element) -> Iterator[Element]:
    """Yield the joints, and the links between them, that a planar joint is made of."""
    name, parent = joint.get('name', ''), _link(joint, 'parent')
    for suffix, kind, axis in PLANAR_PARTS:
        part = Element('joint', name=f'{name}_{suffix}', type=kind)
        child = _link(joint, 'child') if suffix == PLANAR_PARTS[-1][0] else f'{name}_{suffix}_link'
        ElementTree.SubElement(part, 'parent', link=parent)
        ElementTree.SubElement(part, 'child', link=child)
        if suffix == PLANAR_PARTS[0][0]:
            part.extend(copy.deepcopy(joint.findall('origin')))
        ElementTree.SubElement(part, 'axis', xyz=axis)
        given = joint.find('limit')
        limit = {} if given is None else {key: value for key, value in given.attrib.items()
                                          if key not in ('lower', 'upper')}
        if kind == 'prismatic':
            limit.update(lower=repr(-UNLIMITED), upper=repr(UNLIMITED))
        ElementTree.SubElement(part, 'limit', limit)
        yield part
        if suffix != PLANAR_PARTS[-1][0]:
            yield Element('link', name=child)
        parent = child


def _link(joint: Element, end: str) -> str:
    """Return the link at one end of a joint; empty if it is not named."""
    element = joint.find(end)
    return '' if element is None else element.get('link', '')
