# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Limits of a robot: those of its URDF, narrowed by mimic joints, or overridden by the user."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from tp_controller.errors import RobotError, unknown
from tp_controller.model.mobile_base import Base, DEFAULT_VELOCITY
from tp_controller.model.spatial import Array, read_only
from tp_controller.model.urdf import MimicRules, resolve_mimic, UNLIMITED
from tp_controller.resources import is_number

# {limit: what follows the unit of a position in its own}. All but the position limits limit an
# absolute value, also of a base, and are infinite by default.
LIMIT_UNITS = {'lower': '', 'upper': '', 'velocity': '/s', 'acceleration': '/s²',
               'jerk': '/s³'}
LIMIT_KEYS = tuple(LIMIT_UNITS)
POSITION_KEYS = ('lower', 'upper')
# A base has no position limits.
BASE_LIMIT_KEYS = LIMIT_KEYS[len(POSITION_KEYS):]
# Limits that must not be zero.
POSITIVE_KEYS = BASE_LIMIT_KEYS[1:]
# A joint with a narrower range than this cannot move; the range is a rounding error [rad or m].
NARROWEST_RANGE = 1e-9
# No joint with limits turns farther than this from zero; larger limits look like degrees [rad].
LARGEST_ANGLE = 4.0 * math.pi * (1.0 + 1e-3)

# {limit: value}, for each of `LIMIT_KEYS`.
Limits: TypeAlias = dict[str, float]
# A joint without limits.
UNLIMITED_JOINT: Limits = {**dict.fromkeys(LIMIT_KEYS, math.inf), 'lower': -math.inf}
# Overrides of a user: {velocity: {limit: value}}, with only the limits that are replaced.
LimitOverrides: TypeAlias = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class LimitArrays:
    """
    Limits of the velocities of a robot, as read-only arrays.

    Attributes
    ----------
    values : dict
        {limit: ndarray (n,)}, for each of `LIMIT_UNITS`; infinite if there are none.
    continuous : ndarray (n,) of bool
        Joints that turn without limits.

    """

    values: dict[str, Array]
    continuous: NDArray[np.bool_]


def limit_arrays(base: Base, driven: Sequence[str], elements: Mapping[str, Element],
                 mimics: MimicRules, overrides: LimitOverrides) -> LimitArrays:
    """
    Return the limits of every velocity: those of the base, then those of the driven joints.

    Parameters
    ----------
    base : Base
        Base, whose velocities come first.
    driven : sequence of str
        The driven joints.
    elements : mapping
        The URDF elements of all moving joints, by name.
    mimics : mapping
        As `tp_controller.model.urdf.mimic_rules` returns them.
    overrides : mapping
        ``{velocity: {limit: value}}``, replaces single limits.

    Raises
    ------
    RobotError
        An override names an unknown velocity or limit, or limits leave no range.

    """
    rows = _velocity_limits(base, driven, elements, mimics, overrides)
    values = {key: read_only(np.array([float(row[key]) for row in rows.values()]))
              for key in LIMIT_KEYS}
    # An override can limit a joint of type continuous.
    continuous = read_only(np.array(
        [name in elements and elements[name].get('type') == 'continuous' for name in rows],
        dtype=bool) & np.isinf(values['lower']) & np.isinf(values['upper']))
    return LimitArrays(values, continuous)


def nearest_to_zero(names: Sequence[str], elements: Mapping[str, Element]) -> Array:
    """Return the position of each joint that is nearest to zero within its limits [rad or m]."""
    ranges = [joint_limits(name, elements[name]) for name in names]
    return np.array([min(max(0.0, row['lower']), row['upper']) for row in ranges])


def as_overrides(limits: object) -> LimitOverrides:
    """Return limits that replace others, or raise `RobotError` if they are no mapping."""
    if limits is None:
        return {}
    if not isinstance(limits, Mapping):
        raise RobotError('limits need a mapping such as {joint1: {velocity: 1.0}}, '
                         f'not {limits!r}')
    return limits


def _velocity_limits(base: Base, driven: Sequence[str], elements: Mapping[str, Element],
                     mimics: MimicRules, overrides: LimitOverrides) -> dict[str, Limits]:
    """Return the limits of every velocity; arguments as for `limit_arrays`."""
    for name, limits in overrides.items():
        _check_override(name, limits, base, driven)
    rows = {name: {**UNLIMITED_JOINT, 'velocity': DEFAULT_VELOCITY} for name in base.names}
    rows.update(_shared_limits(driven, elements, mimics))
    for name, row in rows.items():
        row.update(overrides.get(name, {}))
        _check_row(_label(name, base), row, [
            follower for follower in mimics if resolve_mimic(follower, mimics)[0] == name])
    return rows


def in_degrees(names: Iterable[str], units: Iterable[str], lower: Iterable[float],
               upper: Iterable[float]) -> list[str]:
    """Return the joints with position limits that look like degrees, with their limits."""
    return [f'{name} ({low:g} to {high:g})'
            for name, unit, low, high in zip(names, units, lower, upper)
            if unit == 'rad' and any(LARGEST_ANGLE < abs(end) < math.inf for end in (low, high))]


def velocity_table(names: Sequence[str]) -> str:
    """
    Return YAML in one line that gives velocity limits, for a parameter file or in Python.

    The values are those of a slow joint, for the user to replace.
    """
    rows = ', '.join(f'{name}: {{velocity: {DEFAULT_VELOCITY}}}' for name in names)
    return f'limits: {{{rows}}}'


def without_range(names: Sequence[str], elements: Mapping[str, Element],
                  mimics: MimicRules) -> list[str]:
    """Return the joints that cannot move because their limits, with followers, are equal."""
    rows = _shared_limits(names, elements, mimics)
    return [name for name, row in rows.items()
            if abs(row['upper'] - row['lower']) <= NARROWEST_RANGE]


def _shared_limits(names: Sequence[str], elements: Mapping[str, Element],
                   mimics: MimicRules) -> dict[str, Limits]:
    """Return the limits of joints, narrowed by those of the joints that mimic them."""
    rows = {name: joint_limits(name, elements[name]) for name in names}
    for follower in mimics:
        leader, multiplier, offset = resolve_mimic(follower, mimics)
        if leader in rows:
            _share(rows[leader], joint_limits(follower, elements[follower]), multiplier, offset)
    return rows


def joint_limits(name: str, element: Element) -> Limits:
    """Return the limits of one joint of a URDF; infinite if it has none."""
    limit = element.find('limit')
    attributes = {} if limit is None else limit.attrib
    endless = element.get('type') == 'continuous'
    defaults = UNLIMITED_JOINT if endless else UNLIMITED_JOINT | dict.fromkeys(POSITION_KEYS, 0.0)
    limits = {}
    for key, default in defaults.items():
        given = None if endless and key in POSITION_KEYS else attributes.get(key)
        try:
            value = default if given is None else float(given)
        except ValueError as error:
            raise RobotError(f'joint {name}: {key} limit {given!r} is not a number') from error
        limits[key] = math.copysign(math.inf, value) if abs(value) >= UNLIMITED else value
    return limits


def _share(row: Limits, follower: Limits, multiplier: float, offset: float) -> None:
    """Narrow the limits of a joint by those of a joint that mimics it."""
    if multiplier == 0.0:
        return
    ends = [(follower[key] - offset) / multiplier for key in POSITION_KEYS]
    if multiplier < 0.0:
        ends.reverse()
    row['lower'] = max(row['lower'], ends[0])
    row['upper'] = min(row['upper'], ends[1])
    for key in BASE_LIMIT_KEYS:
        row[key] = min(row[key], follower[key] / abs(multiplier))


def _check_override(name: object, limits: object, base: Base, driven: Sequence[str]) -> None:
    """Raise `RobotError` if limits cannot replace those of a velocity."""
    names = (*base.names, *driven)
    if not isinstance(name, str) or name not in names:
        raise RobotError(unknown('driven joint', name, names))
    what = _label(name, base)
    if not isinstance(limits, dict):
        raise RobotError(f'{what}: limits need a mapping of {", ".join(LIMIT_KEYS)}, '
                         f'not {limits!r}')
    for key, value in limits.items():
        if key not in LIMIT_KEYS:
            raise RobotError(f'{what}: {unknown("limit", key, LIMIT_KEYS)}')
        if not is_number(value):
            raise RobotError(f'{what}: {key} limit must be a number, not {value!r}')
        if name in base.names and key not in BASE_LIMIT_KEYS:
            raise RobotError(f'{what}: a base has no position limits; valid: '
                             f'{", ".join(BASE_LIMIT_KEYS)}')


def _check_row(what: str, row: Limits, followers: Sequence[str]) -> None:
    """Raise `RobotError` if limits leave no range."""
    if not row['upper'] - row['lower'] > NARROWEST_RANGE:
        shared = f' (those of {", ".join(followers)} included)' if followers else ''
        # Add zero, which shows −0.0 as 0.
        raise RobotError(f'{what}: lower limit {row["lower"] + 0.0:g} must be below '
                         f'upper limit {row["upper"] + 0.0:g}{shared}; leave it out of the '
                         'driven ones (joints), or replace its limits (limits)')
    if not row['velocity'] >= 0.0:
        raise RobotError(f'{what}: velocity limit {row["velocity"]} must not be negative')
    for key in POSITIVE_KEYS:
        if not row[key] > 0.0:
            raise RobotError(f'{what}: {key} limit {row[key]} must be positive')


def _label(name: str, base: Base) -> str:
    """Return the name of a velocity for messages."""
    return name if name in base.names else f'joint {name}'
