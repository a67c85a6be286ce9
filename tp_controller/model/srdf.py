# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

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
