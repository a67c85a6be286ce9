# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Public errors of the package.

::

    TpControllerError
    ├── RobotError      a URDF, DH table, joint, frame or joint position is not usable
    ├── SettingsError   a setting is out of its range (all of them at once)
    ├── TaskError       keys of one task are wrong (all of them at once)
    ├── StackError      the list of tasks has faults (all of them at once, with lines)
    ├── GoalError       a goal is not finite, has the wrong shape or an unknown name
    ├── TimeError       a time is not a finite number
    ├── EvaluationError a task fails in a cycle: it raises an exception, or takes too long
    └── SolverError     the levels handed to ``solve`` do not fit together

Every message names the fault and the valid values.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from tp_controller.solver.errors import SolverError, suggestion, TpControllerError, unknown
from tp_controller.untrusted.calls import foreign, Leaving

__all__ = [
    'EvaluationError', 'Fault', 'GoalError', 'RobotError', 'SettingsError', 'SolverError',
    'StackError', 'TaskError', 'TimeError', 'TpControllerError', 'suggestion', 'unknown']

# Longest fault in a message [characters], and largest number of faults of a stack.
LONGEST_FAULT = 2000
MOST_FAULTS = 30


class RobotError(TpControllerError):
    """Invalid robot description, or invalid name or position of the robot."""


class SettingsError(TpControllerError):
    """Settings out of range; ``faults`` lists them all."""

    def __init__(self, faults: Iterable[str]) -> None:
        self.faults = tuple(faults)
        super().__init__('; '.join(self.faults))


class TaskError(TpControllerError):
    """Wrong keys of one task; ``faults`` is a tuple of (key, message)."""

    def __init__(self, name: str, faults: Iterable[tuple[str, str]]) -> None:
        self.faults = tuple(faults)
        lines = '; '.join(f'{key}: {message}' for key, message in self.faults)
        super().__init__(f'task {name}: {lines}')


class GoalError(TpControllerError):
    """Refusal of a goal; the previous goal stays in force."""


class TimeError(TpControllerError):
    """Refusal of a time; the controller is unchanged."""


class EvaluationError(TpControllerError):
    """Failure of a task in a cycle; ``task`` is its name, ``reason`` the cause."""

    def __init__(self, task: str, reason: str) -> None:
        self.task, self.reason = task, reason
        super().__init__(f'task {task}: {reason}')


@dataclass(frozen=True)
class Fault:
    """
    Fault of a stack.

    Attributes
    ----------
    line : int
        Line in the YAML text, from 1; 0 if there is no text.
    where : str
        Task, or task and key, that the fault is in; empty for the list itself.
    message : str
        Description of the fault, with the valid values.

    """

    line: int
    where: str
    message: str

    def __str__(self) -> str:
        """Return the fault as one line."""
        where = f'{self.where}: ' if self.where else ''
        line = f'line {self.line}: ' if self.line else ''
        text = f'{line}{where}{self.message}'
        # A message that quotes its input may quote a whole file.
        return text if len(text) <= LONGEST_FAULT else f'{text[:LONGEST_FAULT]} …'


class StackError(TpControllerError):
    """Faults of a stack; ``faults`` is a tuple of `Fault`, in order of their lines."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(sorted(faults, key=lambda fault: fault.line))
        shown = [str(fault) for fault in self.faults[:MOST_FAULTS]]
        if len(self.faults) > MOST_FAULTS:
            shown.append(f'and {len(self.faults) - MOST_FAULTS} more')
        super().__init__('; '.join(shown))


def in_words(error: BaseException) -> str:
    """Return the message of an exception, with its type unless it is a `TpControllerError`."""
    if isinstance(error, TpControllerError):
        return str(error)
    if isinstance(error, Leaving) and error.__cause__ is not None:
        error = error.__cause__
    try:
        with foreign:
            text = str(error)
    except Exception:
        # The exception may be foreign code, too.
        text = 'without a message'
    return f'{type(error).__name__}: {text[:LONGEST_FAULT]}' if text else type(error).__name__
