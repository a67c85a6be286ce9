# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of a node: declaration, and validation with reasons."""

from array import array
from collections.abc import Mapping, Sequence
import math
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from tp_controller.errors import SettingsError, suggestion
from tp_controller.resources import load_yaml
from tp_controller.ros.declarations.spec import (
    EMPTY,
    FIXED,
    LIMITS,
    out_of_range,
    ROBOT,
    Spec,
    TASKS,
    wrong_type,
)
from tp_controller.ros.rclpy_internals import declared_names, initial_parameters

__all__ = [
    'LIMITS', 'ROBOT', 'Spec', 'TASKS', 'accept_numbers', 'as_type', 'declare', 'descriptor',
    'fixed_faults', 'keep_fixed', 'names_in', 'plain', 'warn_unknown']

LISTS = (Parameter.Type.STRING, Parameter.Type.STRING_ARRAY, Parameter.Type.INTEGER_ARRAY)


def descriptor(spec: Spec) -> ParameterDescriptor:
    """Return the descriptor that ROS tools show."""
    unit = f' [{spec.unit}]' if spec.unit else ''
    described = ParameterDescriptor(description=spec.description + unit,
                                    additional_constraints=FIXED if spec.fixed else spec.why)
    if spec.lower == -math.inf and spec.upper == math.inf:
        return described
    if isinstance(spec.default, int):
        described.integer_range = [IntegerRange(from_value=int(spec.lower),
                                                to_value=int(spec.upper))]
    else:
        described.floating_point_range = [FloatingPointRange(from_value=spec.lower,
                                                             to_value=spec.upper)]
    return described


def declare(node: Node, specs: Sequence[Spec]) -> dict[str, Any]:
    """
    Declare parameters and return their values.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that declares them.
    specs : sequence of Spec
        Parameters; those that are declared already are only read.

    Returns
    -------
    dict
        {name: value}

    Raises
    ------
    SettingsError
        All parameters that were given a value of the wrong type or out of range.

    """
    values: dict[str, Any] = {}
    faults: list[str] = []
    initial = initial_parameters(node)
    for spec in specs:
        given = initial.get(spec.name)
        if given is not None:
            kind = Parameter.Type.from_parameter_value(spec.default)
            initial[spec.name] = as_type(given, kind)
        try:
            values[spec.name] = node.declare_parameter(
                spec.name, spec.default, descriptor(spec)).value
        except ParameterAlreadyDeclaredException:
            values[spec.name] = node.get_parameter_or(spec.name).value
        except InvalidParameterTypeException:
            faults.append(wrong_type(spec.name, spec.kind, plain(initial[spec.name].value)))
        except InvalidParameterValueException:
            faults.append(out_of_range(spec.name, spec.lower, spec.upper,
                                       initial[spec.name].value, spec.why))
    if faults:
        raise SettingsError(faults)
    return values


def plain(value: object) -> object:
    """Return a value of a parameter, with arrays as lists."""
    return value.tolist() if isinstance(value, array) else value


def accept_numbers(node: Node) -> None:
    """
    Accept integers and text as numbers for doubles of a node; see `as_type`.

    Values that ROS refuses before any callback are refused with a message that names valid ones.
    """
    def as_declared(parameters: Sequence[Parameter]) -> list[Parameter]:
        return [as_type(parameter, node.get_parameter_or(parameter.name).type_)
                for parameter in parameters]

    set_atomically = node.set_parameters_atomically

    def explained(parameter_list: list[Parameter]) -> SetParametersResult:
        strange = [f'there is no parameter {suggestion(parameter.name, declared_names(node))}'
                   for parameter in parameter_list if not node.has_parameter(parameter.name)]
        if strange:
            return SetParametersResult(successful=False, reason='; '.join(strange))
        result = set_atomically(parameter_list)
        if not result.successful:
            faults = [fault for parameter in as_declared(parameter_list)
                      for fault in _refusals(node, parameter)]
            result.reason = '; '.join(faults) or result.reason
        return result

    node.add_pre_set_parameters_callback(as_declared)
    node.set_parameters_atomically = explained  # type: ignore[method-assign]


def _refusals(node: Node, parameter: Parameter) -> list[str]:
    """Return the faults for which ROS refuses a value of a declared parameter."""
    descriptor = node.describe_parameter(parameter.name)
    kind = Parameter.Type(descriptor.type)
    if parameter.type_ is not kind:
        return [wrong_type(parameter.name, kind.name, plain(parameter.value))]
    for allowed in (*descriptor.floating_point_range, *descriptor.integer_range):
        if isinstance(parameter.value, (int, float)) \
                and not allowed.from_value <= parameter.value <= allowed.to_value:
            return [out_of_range(parameter.name, allowed.from_value, allowed.to_value,
                                 parameter.value, descriptor.additional_constraints)]
    return []


def as_type(parameter: Parameter, kind: Parameter.Type) -> Parameter:
    """
    Return a parameter converted to its declared type, where possible.

    Integers are valid numbers, and ``ros2 param load`` sends ``.inf`` and ``1.0e-05`` as text. The
    empty list, which has no type in ROS, stands for all joints, or equal weights, as the default
    does.
    """
    name, value = parameter.name, parameter.value
    try:
        if name in EMPTY and isinstance(value, (list, array)) and not value:
            return Parameter(name, kind, EMPTY[name])
        if kind is Parameter.Type.DOUBLE and parameter.type_ in (
                Parameter.Type.STRING, Parameter.Type.INTEGER):
            return Parameter(name, kind, float(value))
        if kind is Parameter.Type.DOUBLE_ARRAY and parameter.type_ in LISTS:
            # ROS parses lists with inf as text arrays, and lists with 1e-05 as text.
            numbers = load_yaml(value) if isinstance(value, str) else value
            return Parameter(name, kind, list(map(float, numbers)))
    except (ValueError, TypeError):
        pass  # ROS refuses it for its type
    return parameter


def fixed_faults(node: Node, given: Mapping[str, object]) -> list[str]:
    """Return the faults of new values: fixed parameters must keep their values."""
    return [f'parameter {name} is {node.get_parameter(name).value!r}, {FIXED}'
            for name, value in given.items()
            if node.has_parameter(name) and not _equal(node.get_parameter(name).value, value)
            and (node.describe_parameter(name).additional_constraints == FIXED
                 or name == 'use_sim_time')]


def _equal(one: object, other: object) -> bool:
    """Return whether two values are equal; ``ros2 param load`` changes white space in text."""
    if isinstance(one, str) and isinstance(other, str):
        return one.split() == other.split()
    return one == other


def keep_fixed(node: Node) -> None:
    """Refuse changes of the fixed parameters of a node from now on."""
    def check(parameters: Sequence[Parameter]) -> SetParametersResult:
        faults = fixed_faults(node, {parameter.name: parameter.value for parameter in parameters})
        return SetParametersResult(successful=not faults, reason='; '.join(faults))

    node.add_on_set_parameters_callback(check)


def names_in(value: Sequence[str]) -> list[str] | None:
    """Return the names in a parameter, or None where an empty name stands for all."""
    return None if list(value) == [''] else list(value)


def warn_unknown(node: Node) -> None:
    """Warn of values for parameters that do not exist: ROS ignores them silently."""
    # Limits and task parameters are checked once the robot and its stack exist.
    names = [name for name in initial_parameters(node) if not node.has_parameter(name)
             and not name.startswith((LIMITS, TASKS, 'qos_overrides.'))]
    if names:
        known = sorted(node.get_parameters_by_prefix(''))
        node.get_logger().warning('unknown parameters, ignored: ' + ', '.join(
            suggestion(name, known) for name in sorted(names)))
