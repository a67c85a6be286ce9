# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Conversion of Denavit-Hartenberg tables to URDF.

The robot model is thus always built from a URDF, and a robot with a DH table also has the
``robot_description`` that other ROS tools need.
"""

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
from typing import Any, TypeAlias
from xml.sax.saxutils import quoteattr

from tp_controller.errors import RobotError, unknown
from tp_controller.model.limits import (
    BASE_LIMIT_KEYS,
    LIMIT_KEYS,
    POSITIVE_KEYS,
    UNLIMITED_JOINT,
)
from tp_controller.model.urdf import UNLIMITED
from tp_controller.resources import is_number, load_yaml, read_source

CONVENTIONS = ('standard', 'modified')
JOINT_TYPES = ('revolute', 'continuous', 'prismatic')
TABLE_KEYS = ('name', 'convention', 'root', 'joints', 'frames')
PARAMETERS = ('a', 'alpha', 'd', 'theta')
JOINT_KEYS = ('name', *PARAMETERS, 'type', *LIMIT_KEYS, 'link')
FRAME_KEYS = ('name', 'parent', 'xyz', 'rpy')
LINK_RADIUS = 0.03

# One row of a table, as read from YAML: numbers and names that are not validated yet.
Row: TypeAlias = dict[str, Any]
Table: TypeAlias = Sequence[Row] | Mapping[str, Any] | str | Path
# xyz [m] and rpy [rad].
Triple: TypeAlias = tuple[float, float, float]
Transform: TypeAlias = tuple[Triple, Triple]


def urdf_from_dh(table: Table, convention: str | None = None) -> str:
    """
    Return the URDF of a DH table.

    With ``standard`` (lab exercise 1) the transform of row i is Rz(θ) Tz(d) Tx(a) Rx(α), with
    ``modified`` (Craig's) it is Rx(α) Tx(a) Rz(θ) Tz(d). The joint variable is added to θ for a
    revolute and to d for a prismatic joint.

    Parameters
    ----------
    table : list, dict, str or pathlib.Path
        Rows ``{name, a, alpha, d, theta, type, lower, upper, velocity, acceleration, jerk,
        link}`` with lengths in metres, angles in radians and seconds; only `name` is needed,
        `link` names the frame after the joint (``link1``, ``link2`` …). Or a mapping ``{name,
        convention, root, joints: rows, frames: [{name, parent, xyz, rpy}]}``; or one of these as
        YAML text or file.
    convention : str, optional
        ``standard`` (default) or ``modified``; overrides the one in the table.

    Returns
    -------
    str
        URDF text.

    Raises
    ------
    RobotError
        The table is not valid; the message names the row, the key and the valid values.

    """
    table = _load(table)
    convention = convention or table.get('convention', 'standard')
    if convention not in CONVENTIONS:
        raise RobotError(unknown('DH convention', convention, CONVENTIONS))
    root = table.get('root', 'base_link')
    links, joints = [root], []
    visuals: dict[str, list[Triple]] = {}
    parent = root
    for number, row in enumerate(_rows(table, 'joints', JOINT_KEYS), start=1):
        joint = _joint_row(row, number)
        before, after = _transforms(joint, convention)
        link = joint['link']
        moved = link if after is None else f'{link}_axis'
        joints.append(_moving_joint(joint, parent, moved, before))
        visuals.setdefault(parent, []).append(before[0])
        links.append(moved)
        if after is not None:
            joints.append(_fixed_joint(link, moved, after))
            visuals.setdefault(moved, []).append(after[0])
            links.append(link)
        parent = link
    for row in _rows(table, 'frames', FRAME_KEYS):
        frame = _frame_row(row, links)
        joints.append(_fixed_joint(frame['name'], frame['parent'], (frame['xyz'], frame['rpy'])))
        visuals.setdefault(frame['parent'], []).append(frame['xyz'])
        links.append(frame['name'])
    _check_unique('frame', links)
    _check_unique('joint', [row['name'] for row in table['joints']])
    bodies = [_link(name, visuals.get(name, ())) for name in links]
    name = quoteattr(str(table.get('name', 'robot')))
    return '\n'.join(['<?xml version="1.0"?>', f'<robot name={name}>', *bodies, *joints,
                      '</robot>', ''])


def _load(table: Any) -> dict[str, Any]:
    """Return the table as a mapping with a list of joints."""
    if isinstance(table, (str, Path)):
        try:
            text = read_source(table, lambda text: '\n' in text or '{' in text)
            table = load_yaml(text)
        except OSError as error:
            raise RobotError(f'robot description: {error}') from error
        except ValueError as error:
            raise RobotError(f'DH table: {error}') from error
    if isinstance(table, (list, tuple)):
        table = {'joints': list(table)}
    if not isinstance(table, dict) or not table.get('joints'):
        raise RobotError('a DH table must be a list of joints, or a mapping with the key "joints"')
    for key in table:
        if key not in TABLE_KEYS:
            raise RobotError(f'DH table: {unknown("key", key, TABLE_KEYS)}')
    _check_word(table.get('root', 'base_link'), 'DH table: root')
    return table


def _rows(table: Mapping[str, Any], key: str, valid: Sequence[str]) -> Sequence[Row]:
    """Return the rows under `key`, validated as mappings with valid keys and a name."""
    rows = table.get(key) or []
    if not isinstance(rows, (list, tuple)):
        raise RobotError(f'DH table, {key}: needs a list, not {rows!r}')
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, dict) or not isinstance(row.get('name'), str) \
                or not row['name']:
            raise RobotError(f'DH table, {key}, row {number}: needs a mapping with a name')
        for name in row:
            if name not in valid:
                raise RobotError(f'DH table, {row["name"]}: {unknown("key", name, valid)}')
    return rows


def _joint_row(row: Row, number: int) -> Row:
    """Return a row with defaults filled in and validated numbers."""
    joint = {**dict.fromkeys(PARAMETERS, 0.0), 'type': 'revolute', **UNLIMITED_JOINT,
             'link': f'link{number}', **row}
    if joint['type'] not in JOINT_TYPES:
        raise RobotError(
            f'DH table, {joint["name"]}: {unknown("joint type", joint["type"], JOINT_TYPES)}')
    _check_word(joint['link'], f'DH table, {joint["name"]}: link')
    for key in (*PARAMETERS, *LIMIT_KEYS):
        joint[key] = _number(joint[key], f'DH table, {joint["name"]}: {key}')
        if key in PARAMETERS and not math.isfinite(joint[key]):
            raise RobotError(f'DH table, {joint["name"]}: {key} must be finite')
    if joint['velocity'] < 0.0:
        raise RobotError(f'DH table, {joint["name"]}: velocity must not be negative')
    for key in POSITIVE_KEYS:
        if not joint[key] > 0.0:
            raise RobotError(f'DH table, {joint["name"]}: {key} must be positive')
    return joint


def _frame_row(row: Row, links: Sequence[str]) -> Row:
    """Return an extra frame with defaults filled in and a validated parent."""
    where = f'DH table, frame {row["name"]}'
    frame = {'parent': links[-1], 'xyz': (0.0, 0.0, 0.0), 'rpy': (0.0, 0.0, 0.0), **row}
    if frame['parent'] not in links:
        raise RobotError(f'{where}: {unknown("parent", frame["parent"], links)}')
    for key in ('xyz', 'rpy'):
        if not isinstance(frame[key], (list, tuple)) or len(frame[key]) != 3:
            raise RobotError(f'{where}: {key} needs three numbers')
        frame[key] = tuple(_number(value, f'{where}: {key}') for value in frame[key])
    return frame


def _check_word(value: object, what: str) -> None:
    """Raise `RobotError` unless `value` is a name."""
    if not isinstance(value, str) or not value:
        raise RobotError(f'{what} must be a name, not {value!r}')


def _number(value: object, what: str) -> float:
    """Return `value` as a float; `RobotError` unless it is a number."""
    if not is_number(value):
        raise RobotError(f'{what} must be a number, not {value!r}')
    return float(value)


def _transforms(joint: Row, convention: str) -> tuple[Transform, Transform | None]:
    """Return (xyz, rpy) before the motion of the joint and after it, None for no transform."""
    a, alpha, d, theta = joint['a'], joint['alpha'], joint['d'], joint['theta']
    if convention == 'standard':
        before = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        after = (a * math.cos(theta), a * math.sin(theta), d), (alpha, 0.0, theta)
    else:
        before = (a, 0.0, 0.0), (alpha, 0.0, 0.0)
        after = (0.0, 0.0, d), (0.0, 0.0, theta)
    return before, after if any(after[0]) or any(after[1]) else None


def _check_unique(what: str, names: Sequence[str]) -> None:
    """Raise `RobotError` if a name is used twice."""
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise RobotError(f'DH table: {what} names used twice: {", ".join(sorted(twice))}')


def _triple(values: Triple) -> str:
    """Return three numbers as URDF writes them, without loss."""
    return '"' + ' '.join(repr(float(value)) for value in values) + '"'


def _origin(transform: Transform) -> str:
    """Return a URDF origin element."""
    return f'<origin xyz={_triple(transform[0])} rpy={_triple(transform[1])}/>'


def _moving_joint(joint: Row, parent: str, child: str, before: Transform) -> str:
    """Return the URDF element of a joint that moves about or along z."""
    unlimited = math.isinf(joint['lower']) and math.isinf(joint['upper'])
    turning = 'continuous' if unlimited else 'revolute'
    kind = 'prismatic' if joint['type'] == 'prismatic' else turning
    limits = 'effort="0"' + ''.join(f' {key}="{min(joint[key], UNLIMITED)!r}"'
                                    for key in BASE_LIMIT_KEYS)
    if kind != 'continuous':
        limits += (f' lower="{max(joint["lower"], -UNLIMITED)!r}"'
                   f' upper="{min(joint["upper"], UNLIMITED)!r}"')
    return (f'  <joint name={quoteattr(joint["name"])} type="{kind}">'
            f'<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>'
            f'{_origin(before)}<axis xyz="0 0 1"/><limit {limits}/></joint>')


def _fixed_joint(child: str, parent: str, transform: Transform) -> str:
    """Return the URDF element of a fixed joint."""
    return (f'  <joint name={quoteattr(child + "_fixed")} type="fixed">'
            f'<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>'
            f'{_origin(transform)}</joint>')


def _link(name: str, ends: Sequence[Triple]) -> str:
    """Return the URDF element of a link, drawn as a rod from its origin to each end."""
    rods = ''.join(_rod(end) for end in ends if any(end))
    return f'  <link name={quoteattr(name)}>{rods}</link>'


def _rod(end: Triple) -> str:
    """Return a URDF visual: a cylinder from the origin to `end` (3,) [m]."""
    length = math.hypot(*end)
    pitch = math.atan2(math.hypot(end[0], end[1]), end[2])
    rpy = (0.0, pitch, math.atan2(end[1], end[0]))
    middle = (0.5 * end[0], 0.5 * end[1], 0.5 * end[2])
    return (f'<visual>{_origin((middle, rpy))}<geometry>'
            f'<cylinder radius="{LINK_RADIUS}" length="{length!r}"/></geometry></visual>')
