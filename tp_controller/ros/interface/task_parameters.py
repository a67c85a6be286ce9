# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Gains and tolerances of the tasks of a stack as parameters."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.parameter import Parameter
from tp_controller.control.controller import Controller
from tp_controller.control.gains import (
    check_gain,
    check_tolerance,
    gain_limit,
    set_gain,
    set_tolerance,
)
from tp_controller.errors import SettingsError
from tp_controller.ros.declarations.spec import Spec, TASKS, wrong_type
from tp_controller.ros.log import Log
from tp_controller.ros.parameters import as_type, declare, plain
from tp_controller.ros.rclpy_internals import initial_parameters
from tp_controller.tasks.keys import MAX_NUMBER
from tp_controller.tasks.stack import Stack
from tp_controller.tasks.task import Task
from tp_controller.untrusted.calls import foreign


@dataclass(frozen=True)
class TaskParameter:
    """Parameter for the gain of a task, or, with a unit, for its tolerance."""

    spec: Spec
    task: str
    unit: str = ''


class TaskParameters:
    """
    Parameters ``tasks.<task>.gain`` and ``tasks.<task>.tolerance`` of every task of a stack.

    Their initial values are those of the stack; values that the node was started with override
    those of every stack. A gain is one number or has one for each row, as in the stack. A task
    with several units has a tolerance for each, such as ``tasks.<task>.tolerance.rad``.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that declares them.
    controller : Controller
        Controller that the values are passed to.
    log : Log

    """

    def __init__(self, node: Node, controller: Controller, log: Log) -> None:
        self._node, self._controller, self._log = node, controller, log
        self._started_with: dict[str, Parameter] = {
            name: parameter for name, parameter in initial_parameters(node).items()
            if name.startswith(TASKS)}
        self._declared: dict[str, TaskParameter] = {}

    def start_with(self, stack: Stack) -> None:
        """
        Set the tasks of a stack to the values that the node was started with.

        Raises
        ------
        SettingsError
            All values that the tasks refuse.

        """
        faults: list[str] = []
        for name, entry in _entries(stack).items():
            given = self._started_with.get(name)
            if given is None:
                continue
            kind = Parameter.Type.from_parameter_value(entry.spec.default)
            given = as_type(given, kind)
            if given.type_ is not kind:
                faults.append(wrong_type(name, kind.name, plain(given.value)))
                continue
            task = stack.tasks[entry.task]
            try:
                if entry.unit:
                    set_tolerance(task, {entry.unit: given.value})
                else:
                    set_gain(task, _plain(given.value), self._controller.settings.period)
            except SettingsError as error:
                faults += [f'parameter {name}: {fault}' for fault in error.faults]
        if faults:
            raise SettingsError(faults)

    def follow_stack(self) -> None:
        """Declare the parameters of the current stack only; unchanged ones stay."""
        entries = _entries(self._controller.stack, self._controller.settings.period)
        self._undeclare(name for name in self._declared if not self._stays(name, entries))
        self._declared = entries
        declare(self._node, [entry.spec for entry in entries.values()])
        strange = sorted(set(self._started_with) - set(self._declared))
        if strange:
            self._log.warning('Ignoring parameters that no task of the stack has: '
                              f'{", ".join(strange)}')

    def check(self, given: Mapping[str, Any]) -> None:
        """Raise `SettingsError` if some of {parameter: value} are refused."""
        for entry, value in self._select(given):
            task = self._controller.stack.tasks[entry.task]
            if entry.unit:
                check_tolerance(task, {entry.unit: value})
            else:
                check_gain(task, _plain(value), self._controller.settings.period)

    def apply(self, given: Mapping[str, Any]) -> None:
        """Apply {parameter: value} that were checked."""
        for entry, value in self._select(given):
            if entry.unit:
                self._controller.set_tolerance(entry.task, {entry.unit: value})
            else:
                self._controller.set_gain(entry.task, _plain(value))
                self.warn(entry.task)

    def warn(self, task: str) -> None:
        """Log the gain warning of a task, if any."""
        warning = self._controller.gain_warning(task)
        if warning:
            self._log.warning(f'task {task}: {warning}')

    def close(self) -> None:
        """Undeclare all parameters."""
        self._undeclare(self._declared)
        self._declared = {}

    def _undeclare(self, names: Iterable[str]) -> None:
        """Undeclare some parameters."""
        for name in names:
            # A parameter whose declaration was refused does not exist.
            if self._node.has_parameter(name):
                self._node.undeclare_parameter(name)

    def _stays(self, name: str, entries: Mapping[str, TaskParameter]) -> bool:
        """Return whether a parameter equals its new declaration."""
        if name not in entries or not self._node.has_parameter(name):
            return False
        before, after = self._declared[name].spec, entries[name].spec
        return replace(before, default=after.default) == after \
            and _plain(self._node.get_parameter(name).value) == after.default

    def _select(self, given: Mapping[str, Any]) -> Iterator[tuple[TaskParameter, Any]]:
        """Yield the entries of {parameter: value} that belong to a task."""
        for name, value in given.items():
            if name in self._declared:
                yield self._declared[name], value


def _entries(stack: Stack, period: float = math.inf) -> dict[str, TaskParameter]:
    """Return {name: TaskParameter} with the values of the tasks, in cycles of a period [s]."""
    with foreign:
        return {entry.spec.name: entry for task in stack.tasks.values()
                for entry in _entries_of(task, period)}


def _entries_of(task: Task, period: float) -> Iterator[TaskParameter]:
    """Yield the parameters of a task, for cycles of a period [s]."""
    prefix, described = f'{TASKS}{task.name}', task.described_keys()
    if 'gain' in described:
        largest, why = gain_limit(task, period)
        yield TaskParameter(Spec(f'{prefix}.gain', np.asarray(task.gain, float).tolist(),
                                 described['gain'], lower=0.0, upper=min(MAX_NUMBER, largest),
                                 why=f'at most {why}' if why else ''), task.name)
    if 'tolerance' in described:
        # The rest describes the YAML syntax for several units.
        description = described['tolerance'].partition(':')[0]
        for _, unit, tolerance in task.groups:
            ending = f'.{unit}' if len(task.groups) > 1 else ''
            yield TaskParameter(
                Spec(f'{prefix}.tolerance{ending}', float(tolerance), description,
                     '' if unit == '1' else unit, 0.0, MAX_NUMBER), task.name, unit)


def _plain(value: Any) -> float | list[float]:
    """Return a number, or a list from any array of ROS."""
    return value if isinstance(value, float) else list(value)
