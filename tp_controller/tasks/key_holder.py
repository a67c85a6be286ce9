# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of a task: fields of its class, each declared once, and their values."""

from collections.abc import Mapping, Sequence, Set
import inspect
from typing import Any, ClassVar, TypeVar

import numpy as np
from tp_controller.errors import TaskError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Mask
from tp_controller.tasks.goal_holder import GoalHolder
from tp_controller.tasks.joint_mask import joint_mask
from tp_controller.tasks.keys import (
    Gain,
    Keys,
    parse_gain,
    parse_kinds,
    parse_mode,
    parse_tolerance,
    positive,
    Tolerance,
    UnitRows,
)
from tp_controller.tasks.needs import lacks
from tp_controller.tasks.yaml_keys import (
    DEFAULT_MODE,
    DEFAULT_TIMEOUT,
    gain_key,
    joints_key,
    Key,
    REQUIRED,
    tolerance_key,
    weights_key,
    yaml_key,
)

SomeHolder = TypeVar('SomeHolder', bound='KeyHolder')


class _KeySignature:
    """Signature of a task class with its keys as keyword-only arguments."""

    def __get__(self, task: object, task_type: type['KeyHolder']) -> inspect.Signature:
        """Return the signature of a class."""
        ordered = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD)
                   for name in ('robot', 'name')]
        ordered += [inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=default)
                    for key, default in task_type.accepted_keys().items()]
        return inspect.Signature(ordered)


class KeyHolder(GoalHolder):
    """
    Holder of the keys of a task, and base class of `Task`.

    A key is an attribute of the class that `yaml_key` declares; on a task the attribute is the
    value in internal form. Those below are common to all types. A type that overrides one declares
    it again.

    Attributes
    ----------
    needs : tuple of str
        Properties that the robot must have, of `tp_controller.tasks.needs.NEEDS`.
    without : tuple of str
        Keys of the base classes that the type does not accept; they keep their defaults.
    example : mapping
        Keys of one task of the type on the Panda of this package, as in YAML.
    keys : dict
        {keyword: description} of a type whose own constructor has keyword-only arguments.
    units : tuple of str
        Unit of each row of the error: ``'m'``, ``'rad'``, or ``'1'`` for a ratio.
    rows : int
        Number of rows.
    groups : tuple of UnitRows
        Rows and tolerance of each unit.
    used_joints, excluded_joints : tuple of str or None
        Joints that the task may move, and those that it must not, as velocities of the robot; a
        type whose `used_joints` is None has no such key.
    joint_mask : ndarray (n,) of bool or None
        Velocities that both leave the task; None for all.
    row_weights : ndarray () or (rows,), or None
        Weights of the rows; None if all weigh the same.

    """

    needs: ClassVar[tuple[str, ...]] = ()
    without: ClassVar[tuple[str, ...]] = ()
    example: ClassVar[Mapping[str, Any]] = {}
    keys: ClassVar[dict[str, str]] = {}
    __signature__ = _KeySignature()

    gain: Array = gain_key('gain K, one number or one for each row')
    groups: tuple[UnitRows, ...] = tolerance_key(
        'error below which the goal counts as reached: a number, or one for each unit as '
        '{m: …, rad: …}', 'm, rad')
    timeout: float = yaml_key('time that a feed-forward velocity stays in force', positive,
                              DEFAULT_TIMEOUT, unit='s', acts=False)
    accept: tuple[str, ...] = yaml_key(
        'kinds of findings of `tp_controller check` that are meant to be so', parse_kinds, (),
        acts=False)
    mode: str = yaml_key(
        'behaviour at a limit: least_squares comes as near to the desired velocity as possible, '
        'scale keeps its direction and scales it down', parse_mode, DEFAULT_MODE)

    used_joints: tuple[str, ...] | None = joints_key(
        'joints and groups that the task may move (default: all)', name='joints')
    excluded_joints: tuple[str, ...] | None = joints_key(
        'joints and groups that the task must not move, such as base')
    row_weights: Array | None = weights_key(
        'weight of the rows where not all can be met: a number, one for each row, or one for each '
        'unit as {m: …, rad: …}')

    type_name: ClassVar[str] = ''
    joint_mask: Mask | None = None
    units: tuple[str, ...] = ()
    rows: int
    _fields: ClassVar[dict[str, Key]] = {}
    _omitted: ClassVar[set[str]] = set()
    _given_keys: dict[str, object]

    def __init_subclass__(cls, **options: Any) -> None:
        """Collect the declared keys."""
        super().__init_subclass__(**options)
        cls._fields, cls._omitted = _declared(cls), _left_out(cls)

    def __new__(cls: type[SomeHolder], *arguments: object, **keys: object) -> SomeHolder:
        """Return a task of any type that stores its keys as they were given."""
        task = super().__new__(cls)
        task._given_keys = keys
        return task

    def __init__(self, robot: Robot, name: str, units: Sequence[str] = (),
                 keys: Keys | None = None, **given: Any) -> None:
        """
        Set the attributes of all keys.

        Parameters
        ----------
        robot : Robot
            Robot of the task.
        name : str
            Name of the task.
        units : sequence of str, optional
            Unit of each row, unless the type sets `units` itself.
        keys : Keys, optional
            Collector whose faults the caller raises; by default they are raised here.
        **given
            Values of keys.

        Raises
        ------
        TaskError
            The robot lacks a property that the type needs, or keys have faults.
        TypeError
            A key is unknown.

        """
        super().__init__(name)
        self.robot = robot
        self.units = tuple(units) or self.units
        for key in given.keys() - {key.name for key in self._fields.values()} | \
                given.keys() & self._omitted:
            raise TypeError(f'{type(self).__name__} got an unexpected keyword argument {key!r}')
        lacking = lacks(self.type_name, self.needs, robot, given)
        if lacking:
            raise TaskError(name, lacking)
        own = Keys() if keys is None else keys
        self._parse(own, self._fields.keys() - set(COMMON), given)
        self.check_keys(own)
        # The number of rows is unknown if keys are faulty.
        self.rows = 0 if own.faults else len(self.units)
        self._parse(own, set(COMMON), given)
        self.joint_mask = own.check('excluded_joints' if self.excluded_joints else 'joints',
                                    joint_mask, robot, self.used_joints, self.excluded_joints)
        self.rows = len(self.units)
        if keys is None:
            own.raise_faults(name)
        if not own.faults:
            self.set_up()

    def _parse(self, keys: Keys, attributes: Set[str], given: Mapping[str, Any]) -> None:
        """Set some attributes to the values of their keys; None for one with a fault."""
        for attribute, key in self._fields.items():
            if attribute not in attributes:
                continue
            value = given.get(key.name, key.default)
            if value is REQUIRED:
                keys.faults.append((key.name, f'is needed: {key.description}'))
                value = None
            elif key.parse is not None:
                value = keys.check(key.name, key.parse, self, value)
            setattr(self, attribute, value)

    def check_keys(self, keys: Keys) -> None:
        """
        Check keys against each other, and set `units` if they depend on keys.

        Called after the keys of the type itself are parsed, and before the common ones. An
        attribute is None if its key has a fault. A type may override this.

        Parameters
        ----------
        keys : Keys
            Collector of faults.

        """

    def set_up(self) -> None:
        """Prepare a task whose keys are valid, or raise `TaskError`; a type may override this."""

    def weight_names(self) -> dict[str, list[int]]:
        """Return {name: indices of its rows} for the key `weights`; a type may override this."""
        return {unit: [row for row, its in enumerate(self.units) if its == unit]
                for unit in self.units}

    @classmethod
    def accepted_keys(cls) -> dict[str, Any]:
        """Return {key: default} of the keys; `inspect.Parameter.empty` marks a required one."""
        accepted, complete = _constructor_keys(cls)
        if complete:
            for name, key in cls._accepted().items():
                # A key that is optional for the base may be required by a subclass.
                accepted.setdefault(name, key.default)
        return accepted

    @classmethod
    def described_keys(cls) -> dict[str, str]:
        """Return {key: description} of the accepted keys, in the order of `accepted_keys`."""
        described = {name: key.description for name, key in cls._accepted().items()}
        for base in reversed(cls.__mro__):
            described.update(vars(base).get('keys', {}))
        return {key: described.get(key, '') for key in cls.accepted_keys()}

    @classmethod
    def key_ranges(cls) -> dict[str, str]:
        """Return {key: valid numbers as text} of the accepted keys; empty for other values."""
        declared = cls._accepted()
        return {name: declared[name].valid if name in declared else ''
                for name in cls.accepted_keys()}

    @classmethod
    def _accepted(cls) -> dict[str, Key]:
        """Return {name: Key} of the declared keys that the type accepts."""
        return {key.name: key for key in cls._fields.values() if key.name not in cls._omitted}

    def set_gain(self, gain: Gain) -> None:
        """Set the gain, in the form of the key `gain`, or raise ValueError."""
        self.gain = parse_gain(gain, self.rows)
        # In the form of YAML, for `is_equivalent`.
        self._given_keys = {**self._given_keys, 'gain': np.asarray(self.gain).tolist()}

    def parse_tolerance(self, tolerance: Tolerance) -> tuple[UnitRows, ...]:
        """Return `groups` with new tolerances of some or all units, or raise ValueError."""
        given = tolerance if isinstance(tolerance, Mapping) else \
            dict.fromkeys(self.units, tolerance)
        before = {unit: value for _, unit, value in self.groups}
        found = {unit: value for _, unit, value in parse_tolerance(
            self.units, {**before, **given})}
        # The rows of groups may differ from the units, as for obstacles.
        return tuple(group._replace(tolerance=found[group.unit]) for group in self.groups)

    def set_tolerance(self, tolerance: Tolerance) -> None:
        """Set tolerances, in the form of `parse_tolerance`."""
        self.groups = self.parse_tolerance(tolerance)

    def _acting_keys(self) -> dict[str, object]:
        """Return {key: value as given} of the keys with an effect on the level."""
        idle = {key.name for key in self._fields.values() if not key.acts}
        keys = {**self.accepted_keys(), **self._given_keys}
        return {key: value for key, value in keys.items() if key not in idle}


# Attributes of the keys that are common to all types, and come last.
COMMON = tuple(attribute for attribute, value in vars(KeyHolder).items() if isinstance(value, Key))


def _declared(task_type: type[KeyHolder]) -> dict[str, Key]:
    """Return {attribute: Key} of a class: required keys first, the common ones last."""
    declared: dict[str, Key | None] = {}
    for base in task_type.__mro__:
        for attribute, value in vars(base).items():
            # A type without a key of its base classes sets the attribute to None.
            if value is None or isinstance(value, Key):
                declared.setdefault(attribute, value)
    keys = {attribute: value for attribute, value in declared.items() if value is not None}
    return dict(sorted(keys.items(), key=lambda item: (
        COMMON.index(item[0]) if item[0] in COMMON else -1, item[1].default is not REQUIRED)))


def _left_out(task_type: type[KeyHolder]) -> set[str]:
    """Return the names of the declared keys that a class does not accept."""
    out: set[str] = set()
    for base in reversed(task_type.__mro__):
        out -= {value.name for value in vars(base).values() if isinstance(value, Key)}
        out |= set(vars(base).get('without', ()))
    return out


def _constructor_keys(task_type: type[KeyHolder]) -> tuple[dict[str, Any], bool]:
    """
    Return {key: default} of the keyword-only arguments of the constructors of a type.

    Also return whether the constructors pass other keys on to that of `Task`.
    """
    accepted: dict[str, Any] = {}
    for base in task_type.__mro__:
        if '__init__' not in vars(base):
            continue
        parameters = inspect.signature(vars(base)['__init__']).parameters.values()
        for parameter in parameters:
            if parameter.kind is inspect.Parameter.KEYWORD_ONLY:
                accepted.setdefault(parameter.name, parameter.default)
        # Only a constructor with ** passes keys on to the next one.
        if not any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters):
            return accepted, False
        if base is KeyHolder:
            break
    return accepted, True
