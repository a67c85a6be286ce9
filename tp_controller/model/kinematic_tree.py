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

"""How the links of a robot hang together, and which of them may touch."""

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from tp_controller.model.robot import Robot
from tp_controller.model.urdf import mimic_rules, moving_joints, parse, resolve_mimic
from tp_controller.resources import read_source


class Tree:
    """
    Which links of a robot hang together, and which can move against each other.

    Parameters
    ----------
    robot : Robot
        A base that moves is a driven joint between the world and all links.

    """

    def __init__(self, robot: Robot) -> None:
        tree = parse(robot.urdf)
        moving = moving_joints(tree)
        rules = mimic_rules(moving)
        self._above = {_end(joint, 'child'): (joint.get('name', ''), _end(joint, 'parent'))
                       for joint in tree.findall('joint')}
        self._moving = set(moving)
        self._driven = {name for name in moving
                        if resolve_mimic(name, rules)[0] in robot.joint_names}
        if robot.moves:
            # No URDF has a joint without a name.
            self._above[robot.base_frame] = '', robot.root
            self._moving.add('')
            self._driven.add('')

    def adjacent(self, one: str, other: str) -> bool:
        """Say whether no more than one joint that moves lies between two links."""
        return len(self._between(one, other) & self._moving) <= 1

    def separable(self, one: str, other: str) -> bool:
        """Say whether driven joints move two links against each other."""
        return bool(self._between(one, other) & self._driven)

    def _between(self, one: str, other: str) -> set[str]:
        """Return the joints on the path from one link to another."""
        return self._path_up(one) ^ self._path_up(other)

    def _path_up(self, link: str) -> set[str]:
        """Return the joints between a link and the root."""
        joints = set[str]()
        while link in self._above:
            joint, link = self._above[link]
            joints.add(joint)
        return joints


def _end(joint: Element, end: str) -> str:
    """Return the link at an end of a joint, ``parent`` or ``child``."""
    element = joint.find(end)
    return '' if element is None else element.get('link', '')


def srdf_pairs(source: str | Path) -> set[frozenset[str]]:
    """
    Return the pairs of links that an SRDF says need no check.

    Parameters
    ----------
    source : str or pathlib.Path
        SRDF text, a file's path, or ``package://<package>/<path>``.

    Returns
    -------
    set of frozenset of str

    Raises
    ------
    ValueError
        It cannot be read.

    """
    if not isinstance(source, (str, Path)):
        raise ValueError(f'needs text or the name of a file, got {source!r}')
    try:
        tree = ElementTree.fromstring(read_source(source, lambda text: '<' in text).encode())
    except OSError as error:
        raise ValueError(str(error)) from error
    except ElementTree.ParseError as error:
        raise ValueError(f'no XML: {error}') from error
    if tree.tag != 'robot':
        raise ValueError(f'no SRDF: the outermost element is <{tree.tag}>, not <robot>')
    return {frozenset((element.get('link1', ''), element.get('link2', '')))
            for element in tree.findall('disable_collisions')}
