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

"""History of a task: its last status, errors, causes and durations."""

from collections.abc import Mapping
from dataclasses import dataclass, field
import math
import re

from tp_controller.untrusted import errors_of, number

# Status of all tasks while the robot is stopped.
STOPPED = 'stopped'
# Bounds of the memory for any recording: largest numbers of errors and of causes of a task.
MOST_ERRORS, MOST_CAUSES = 4, 100
# Numbers in a reason, which change continuously.
NUMBER = re.compile(r' by [-+.\de]+ (m|rad)\b')


@dataclass
class TaskHistory:
    """
    History of a task.

    Attributes
    ----------
    name, kind, level : str
        Name, type and level in the last status.
    status : str
        Last status before a stop; ``stopped`` if there is no other.
    stopped : bool
        Whether the robot was stopped at the end.
    errors : dict
        {unit: (last known error, tolerance)}
    largest : dict
        {unit: largest error}
    causes : dict
        {cause: time for which it limited the task [s]}
    reached, known : float
        Time for which the task was reached or satisfied, and time with a known status [s].

    """

    name: str
    kind: str = ''
    level: str = ''
    status: str = ''
    stopped: bool = False
    errors: dict[str, tuple[float, float]] = field(default_factory=dict)
    largest: dict[str, float] = field(default_factory=dict)
    causes: dict[str, float] = field(default_factory=dict)
    reached: float = 0.0
    known: float = 0.0

    def update(self, values: Mapping[str, str], lasted: float) -> None:
        """Update by the values of a status, the previous one having lasted a time [s]."""
        # The previous status applies to the time since then.
        self.known += lasted
        if self.status in ('reached', 'satisfied') and not self.stopped:
            self.reached += lasted
        self.kind, self.level = values.get('type', ''), values.get('level', '')
        status = values.get('status', '')
        self.stopped = status == STOPPED
        # A stop, as at the end of most recordings, must not hide the outcome.
        self.status = self.status or status if self.stopped else status
        for unit, error in errors_of(values).items():
            if math.isnan(error) and unit in self.errors:
                continue
            if unit in self.errors or len(self.errors) < MOST_ERRORS:
                self.errors[unit] = error, number(values.get(f'tolerance [{unit}]', ''))
                if error > self.largest.get(unit, -math.inf):
                    self.largest[unit] = error
        for cause in filter(None, values.get('reason', '').split('; ')):
            brief = brief_cause(cause)
            if brief in self.causes or len(self.causes) < MOST_CAUSES:
                self.causes[brief] = self.causes.get(brief, 0.0) + lasted


def brief_cause(cause: str) -> str:
    """Return a cause without numbers, with a list of combined causes reduced to its first."""
    cause = NUMBER.sub('', cause)
    first, comma, _ = cause.partition(', ')
    return f'{first} and others together' if comma and cause.endswith(' together') else cause
