# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Groups of joints, which tasks name together."""

from collections.abc import Collection, Mapping, Sequence
from typing import TypeAlias

from tp_controller.errors import RobotError, unknown
from tp_controller.resources import load_yaml

Groups: TypeAlias = Mapping[str, str | Sequence[str]] | str
# Name of the group of the velocities of a moving base.
BASE = 'base'


def joint_groups(groups: object, velocity_names: Sequence[str], base: Sequence[str]
                 ) -> dict[str, tuple[str, ...]]:
    """
    Return {name: names of velocities} of groups, after that of a moving base.

    Parameters
    ----------
    groups : mapping or str
        {name: names of velocities or of groups before it}, or that as YAML.
    velocity_names, base : sequence of str
        Names of all velocities, and of those of the base.

    Raises
    ------
    RobotError
        A name is taken or unknown, or a group is empty.

    """
    if isinstance(groups, str):
        try:
            groups = load_yaml(groups)
        except ValueError as error:
            raise RobotError(f'groups: {error}') from error
    if not isinstance(groups, Mapping):
        raise RobotError('groups need a mapping such as {arm: [joint1, joint2]}, '
                         f'not {groups!r}')
    found: dict[str, tuple[str, ...]] = {BASE: tuple(base)} if base else {}
    for name, members in groups.items():
        if not isinstance(name, str) or name == BASE or name in velocity_names:
            raise RobotError(f'a group needs a name that is neither {BASE} nor that of a joint, '
                             f'not {name!r}')
        try:
            found[name] = velocities_of(members, velocity_names, found)
        except RobotError as error:
            raise RobotError(f'group {name}: {error}') from error
    return found


def check_velocities(names: Collection[str], velocity_names: Sequence[str]) -> None:
    """Raise `RobotError` unless names are a list, and all are velocities, not groups of them."""
    # An iterator would be used up by the check.
    if isinstance(names, str) or not isinstance(names, Collection):
        raise RobotError(f'joints must be a list of names, not {names!r}')
    for name in names:
        if name not in velocity_names:
            raise RobotError(unknown('driven joint', name, velocity_names))


def velocities_of(names: object, velocity_names: Sequence[str],
                  groups: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """
    Return the names of velocities of one name or several, in their order, each once.

    Parameters
    ----------
    names : str or sequence of str
        Names of velocities or of groups.
    velocity_names, groups
        See `Robot`.

    Raises
    ------
    RobotError
        A name is unknown, or there is none.

    """
    listed = [names] if isinstance(names, str) else names
    if not isinstance(listed, (list, tuple)) or not listed:
        raise RobotError(f'needs a joint, a group or a list of them, got {names!r}')
    found: dict[str, None] = {}
    for name in listed:
        if not isinstance(name, str) or name not in velocity_names and name not in groups:
            raise RobotError(unknown('joint or group', name, [*groups, *velocity_names]))
        found.update(dict.fromkeys(groups.get(name, (name,))))
    return tuple(found)
