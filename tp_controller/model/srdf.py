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

"""Disabled collision pairs of an SRDF."""

from pathlib import Path

from tp_controller.resources import load_xml, MOST_XML_CHARACTERS, read_source

# Pinocchio's removeCollisionPairsFromXML removes the same pairs (Panda, UR5, Baxter). But its
# error for a file that is no SRDF is "No such node (robot)", and for broken XML "expected >".


def srdf_pairs(source: str | Path) -> set[frozenset[str]]:
    """
    Return the pairs of links whose collisions an SRDF disables.

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
        The SRDF cannot be read.

    """
    try:
        tree = load_xml(read_source(source, lambda text: '<' in text, MOST_XML_CHARACTERS))
    except OSError as error:
        raise ValueError(str(error)) from error
    if tree.tag != 'robot':
        raise ValueError(f'not an SRDF: the outermost element is <{tree.tag}>, not <robot>')
    return {frozenset((element.get('link1', ''), element.get('link2', '')))
            for element in tree.findall('disable_collisions')}
