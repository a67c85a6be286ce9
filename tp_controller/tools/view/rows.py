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

"""Status of a controller as displayed rows, one per task."""

from dataclasses import dataclass
import math

from tp_controller.ros.client.status import ControllerStatus, TaskStatus

# Displayed units, with their conversion factors.
SHOWN = {'m': ('mm', 1e3), 'rad': ('°', math.degrees(1.0)), 'm/s': ('mm/s', 1e3),
         'rad/s': ('°/s', math.degrees(1.0))}
# Desired speed of a task up to which it is at rest, in its own unit.
REST_SPEED = 1e-6
DISABLED = 'disabled'
# Status of all tasks while zeros are commanded.
STOPPED = 'stopped'


@dataclass(frozen=True)
class Row:
    """
    Displayed state of a task.

    Attributes
    ----------
    name, kind, level : str
        Name and type of the task; level ``1``, ``2`` …, or ``disabled``.
    status : str
        ``reached``, ``moving``, ``limited`` …
    errors : tuple of (str, float)
        Unit and value of each error.
    share : float
        Achieved share of the desired speed; not a number at rest.
    reason, hint : str
        Cause of a limit, and possible remedy.
    accepted, refused : int
        Number of accepted and refused goals.
    refusal, warning : str
        Reason of the last refusal, and probable mistake in the last accepted goal.

    """

    name: str
    kind: str
    level: str
    status: str
    errors: tuple[tuple[str, float], ...]
    share: float
    reason: str
    hint: str
    accepted: int
    refused: int
    refusal: str
    warning: str

    @property
    def enabled(self) -> bool:
        """Return whether the task is in the stack."""
        return self.level != DISABLED

    def error_text(self) -> str:
        """Return the errors as text, in suitable units."""
        return ', '.join(quantity(unit, value) for unit, value in self.errors)


def rows_of(status: ControllerStatus) -> list[Row]:
    """Return a row for each task of a status, in order of priority."""
    return [_row(task) for task in status.tasks.values()]


def _row(task: TaskStatus) -> Row:
    """Return the row of a task."""
    wanted = task.wanted_speed
    share = min(max(task.achieved_speed / wanted, 0.0), 1.0) if wanted > REST_SPEED else math.nan
    return Row(task.name, task.kind, task.level, task.status, tuple(task.errors.items()), share,
               task.reason, task.hint, task.accepted, task.refused, task.refusal,
               '; '.join(task.warnings))


def quantity(unit: str, value: float) -> str:
    """Return a value as text with its unit, converted to a suitable one."""
    if math.isnan(value):
        return '-'
    shown, factor = SHOWN.get(unit, (unit, 1.0))
    text = f'{factor * value:.1f}' if unit in SHOWN else f'{value:.4g}'
    return text if unit == '1' else f'{text}{"" if shown.startswith("°") else " "}{shown}'
