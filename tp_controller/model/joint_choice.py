# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Choice of the driven joints among the moving joints of a robot."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from tp_controller.errors import RobotError, unknown
from tp_controller.model.limits import LimitOverrides, without_range
from tp_controller.model.mobile_base import Base
from tp_controller.model.urdf import MimicRules


class JointChoice(NamedTuple):
    """
    Driven and passive joints of a robot.

    Attributes
    ----------
    driven : tuple of str
        Joints that are commanded, in the order of all arrays.
    passive : tuple of str
        Joints that could be driven, but are not.

    """

    driven: tuple[str, ...]
    passive: tuple[str, ...]


def choose_joints(names: Sequence[str], elements: Mapping[str, Element], mimics: MimicRules,
                  base: Base, joints: Sequence[str] | None,
                  limits: LimitOverrides) -> JointChoice:
    """
    Return the driven and passive joints of a robot.

    Parameters
    ----------
    names : sequence of str
        Joints of the model; those without an element do not move.
    elements : mapping
        The URDF elements of all moving joints, by name.
    mimics : mapping
        As `tp_controller.model.urdf.mimic_rules` returns them.
    base : Base
        Base of the robot, whose names no joint may have.
    joints : sequence of str or None
        Driven joints in the desired order; None for all that can be driven.
    limits : mapping
        ``{velocity: {limit: value}}``; a joint without a range can be driven if it is here.

    Raises
    ------
    RobotError
        Joints cannot be driven, or there is none to drive.

    """
    moving = [name for name in names if name in elements]
    drivable = [name for name in moving if name not in mimics]
    if joints is None:
        still = [name for name in without_range(drivable, elements, mimics)
                 if name not in limits]
        driven = [name for name in drivable if name not in still]
    else:
        still, driven = [], _listed(joints)
    _check_driven(driven, drivable, mimics, still, base)
    taken = {*base.names, *base.coordinate_names}.intersection(moving)
    if taken:
        raise RobotError('joints must not be named like a velocity of the base: '
                         f'{", ".join(sorted(taken))}')
    return JointChoice(tuple(driven), tuple(name for name in drivable if name not in driven))


def _check_driven(driven: Sequence[str], drivable: Sequence[str], mimics: MimicRules,
                  still: Sequence[str], base: Base) -> None:
    """Raise `RobotError` if joints cannot be driven."""
    for name in driven:
        if isinstance(name, str) and name in mimics:
            raise RobotError(f'joint {name!r} mimics {mimics[name][0]!r}: drive that one')
        if not isinstance(name, str) or name not in drivable:
            raise RobotError(unknown('joint', name, drivable))
    if len(set(driven)) < len(driven):
        raise RobotError(f'driven joints named twice: {driven}')
    if not driven and not base.moves:
        ranges = f'; their limits leave no range: {", ".join(still)}; give others (limits)' \
            if still else '; if it moves as a whole, set base'
        raise RobotError(f'the robot has no joint to drive{ranges}')


def _listed(joints: object) -> list[str]:
    """Return the names of joints as a list; `_check_driven` validates them."""
    if isinstance(joints, str) or not isinstance(joints, (Sequence, np.ndarray)):
        raise RobotError(f'joints must be a list of names, not {joints!r}')
    return list(joints)
