# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Declarations of the keys of a task type, as values of attributes of its class."""

from collections.abc import Callable
from dataclasses import dataclass
import inspect
from typing import Any

from tp_controller.model.joint_groups import velocities_of
from tp_controller.tasks.keys import parse_gain, parse_tolerance, parse_weights, positive

# Default of a key that is required.
REQUIRED = inspect.Parameter.empty
# Defaults of the keys `gain` [1/s], `timeout` [s] and `mode`.
DEFAULT_GAIN = 1.0
DEFAULT_TIMEOUT = 0.5
DEFAULT_MODE = 'least_squares'


@dataclass(slots=True)
class Key:
    """
    Declaration of a key; see `yaml_key`.

    Attributes
    ----------
    name : str
        Name in YAML.
    text : str
        Description of one line, without the unit.
    parse : callable or None
        Function of task and value that returns the value in internal form; it raises ValueError,
        `GoalError` or `RobotError` if the value is invalid. None leaves values as they are.
    default : object
        Value of a key that is left out, as in YAML; `REQUIRED` if it may not be.
    unit, valid : str
        Unit and valid numbers, as text.
    acts : bool
        The key has an effect on the level of a cycle.

    """

    name: str
    text: str
    parse: Callable[[Any, Any], Any] | None
    default: Any
    unit: str
    valid: str
    acts: bool

    def __set_name__(self, task_type: type, attribute: str) -> None:
        """Name the key after its attribute, unless it has another name."""
        self.name = self.name or attribute

    @property
    def description(self) -> str:
        """Return the description with the unit."""
        return f'{self.text} [{self.unit}]' if self.unit else self.text


def yaml_key(text: str, parse: Callable[[Any], Any] | None = None, default: Any = REQUIRED, *,
             unit: str = '', parse_for: Callable[[Any, Any], Any] | None = None, name: str = '',
             valid: str = '', acts: bool = True) -> Any:
    """
    Declare a key, as the value of an attribute of a task class.

    Parameters
    ----------
    text : str
        Description of one line, without the unit.
    parse : callable, optional
        Function of a value that returns it in internal form, or raises ValueError, `GoalError` or
        `RobotError`; by default the value stays as it is. Defaults are parsed as well.
    default : object, optional
        Value of a key that is left out; without one the key is required.
    unit : str, optional
        Unit of the value.
    parse_for : callable, optional
        Function of task and value, in place of `parse`, for a key that depends on the robot or on
        keys declared before it.
    name : str, optional
        Name in YAML, if it differs from that of the attribute.
    valid : str, optional
        Valid numbers as text; by default the attribute `range` of `parse`.
    acts : bool, optional
        The key has an effect on the level of a cycle.

    Returns
    -------
    Key
        As Any, since the attribute of a task is the parsed value.

    """
    if parse is not None:
        function = parse

        def parse_for(task: Any, value: Any) -> Any:
            return function(value)
    return Key(name, text, parse_for, default, unit, valid or getattr(parse, 'range', ''), acts)


def gain_key(text: str, default: float = DEFAULT_GAIN) -> Any:
    """Declare the key `gain` [1/s]; see `yaml_key`."""
    return yaml_key(text, default=default, unit='1/s', valid=positive.range,
                    parse_for=lambda task, gain: parse_gain(gain, task.rows or None))


def joints_key(text: str, name: str = '') -> Any:
    """Declare a key for names of joints and groups, None by default; see `yaml_key`."""
    return yaml_key(text, default=None, name=name, parse_for=lambda task, names: None
                    if names is None else velocities_of(names, task.robot.velocity_names,
                                                        task.robot.groups))


def weights_key(text: str) -> Any:
    """Declare the key `weights`, whose attribute is `row_weights`; see `yaml_key`."""
    return yaml_key(text, default=None, name='weights', valid=positive.range,
                    parse_for=lambda task, weights: None if weights is None else
                    parse_weights(weights, task.units, task.weight_names()))


def tolerance_key(text: str, unit: str) -> Any:
    """Declare the key `tolerance`, whose attribute is `groups`; see `yaml_key`."""
    return yaml_key(text, default=None, unit=unit, name='tolerance', valid=positive.range,
                    parse_for=lambda task, value: parse_tolerance(task.units, value), acts=False)
