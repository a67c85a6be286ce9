# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
The errors a user can meet.

::

    TpControllerError
    ├── RobotError      a URDF, DH table, joint, frame or joint position is not usable
    ├── SettingsError   a setting is out of its range (all of them at once)
    ├── TaskError       keys of one task are wrong (all of them at once)
    ├── StackError      the list of tasks has faults (all of them at once, with lines)
    ├── GoalError       a goal is not finite, has the wrong shape or names nothing
    ├── TimeError       a time is not a finite number
    ├── EvaluationError a task fails in a cycle: it raises an exception, or takes too long
    └── SolverError     the levels handed to ``solve`` do not fit together

Every message names what is wrong and says what is valid.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from tp_controller.foreign import foreign, Leaving
from tp_controller.solver.errors import SolverError, suggestion, TpControllerError, unknown

__all__ = [
    'EvaluationError', 'Fault', 'GoalError', 'RobotError', 'SettingsError', 'SolverError',
    'StackError', 'TaskError', 'TimeError', 'TpControllerError', 'suggestion', 'unknown']

# What a message shows: characters of a fault, and faults of a stack.
LONGEST = 2000
MOST_SHOWN = 30


class RobotError(TpControllerError):
    """A robot description, or a name or position of the robot, is not valid."""


class SettingsError(TpControllerError):
    """One or more settings are out of range; ``faults`` lists them all."""

    def __init__(self, faults: Iterable[str]) -> None:
        self.faults = tuple(faults)
        super().__init__('; '.join(self.faults))


class TaskError(TpControllerError):
    """Keys of one task are wrong; ``faults`` is a tuple of (key, message)."""

    def __init__(self, name: str, faults: Iterable[tuple[str, str]]) -> None:
        self.faults = tuple(faults)
        lines = '; '.join(f'{key}: {message}' for key, message in self.faults)
        super().__init__(f'task {name}: {lines}')


class GoalError(TpControllerError):
    """A goal was refused; the goal in force before stays in force."""


class TimeError(TpControllerError):
    """A time was refused; the controller is as it was before."""


class EvaluationError(TpControllerError):
    """A task failed in a cycle; ``task`` is its name, and ``reason`` says why."""

    def __init__(self, task: str, reason: str) -> None:
        self.task, self.reason = task, reason
        super().__init__(f'task {task}: {reason}')


@dataclass(frozen=True)
class Fault:
    """
    One fault of a stack.

    Attributes
    ----------
    line : int
        Line in the YAML text, from 1; 0 where there is no text.
    where : str
        Task, or task and key, that the fault is in; empty for the list itself.
    message : str
        What is wrong and what is valid.

    """

    line: int
    where: str
    message: str

    def __str__(self) -> str:
        """Return the fault as one line."""
        where = f'{self.where}: ' if self.where else ''
        line = f'line {self.line}: ' if self.line else ''
        text = f'{line}{where}{self.message}'
        # A message that quotes what was written may quote a whole file.
        return text if len(text) <= LONGEST else f'{text[:LONGEST]} …'


class StackError(TpControllerError):
    """A stack has faults; ``faults`` is a tuple of `Fault`, in order of their lines."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(sorted(faults, key=lambda fault: fault.line))
        shown = [str(fault) for fault in self.faults[:MOST_SHOWN]]
        if len(self.faults) > MOST_SHOWN:
            shown.append(f'and {len(self.faults) - MOST_SHOWN} more')
        super().__init__('; '.join(shown))


def in_words(error: BaseException) -> str:
    """Return what an exception says, with its type where it is not one of ours."""
    if isinstance(error, TpControllerError):
        return str(error)
    if isinstance(error, Leaving) and error.__cause__ is not None:
        error = error.__cause__
    try:
        with foreign:
            text = str(error)
    except Exception:
        # An exception may be anybody's code, too.
        text = 'without a message'
    return f'{type(error).__name__}: {text[:LONGEST]}' if text else type(error).__name__
