# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""History of a task: its last status, errors, causes and durations."""

from dataclasses import dataclass, field
import math

from tp_controller.ros.client.status import DONE, STOPPED, TaskStatus

# Bounds of the memory for any recording: largest numbers of errors and of causes of a task.
MOST_ERRORS, MOST_CAUSES = 4, 100


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

    def update(self, status: TaskStatus, lasted: float) -> None:
        """Update by a status, the previous one having lasted a time [s]."""
        # The previous status applies to the time since then.
        self.known += lasted
        if self.status in DONE and not self.stopped:
            self.reached += lasted
        self.kind, self.level = status.kind, status.level
        self.stopped = status.status == STOPPED
        # A stop, as at the end of most recordings, must not hide the outcome.
        self.status = self.status or status.status if self.stopped else status.status
        for unit, error in status.errors.items():
            if math.isnan(error) and unit in self.errors:
                continue
            if unit in self.errors or len(self.errors) < MOST_ERRORS:
                self.errors[unit] = error, status.tolerances.get(unit, math.nan)
                if error > self.largest.get(unit, -math.inf):
                    self.largest[unit] = error
        for cause in status.causes:
            if cause in self.causes or len(self.causes) < MOST_CAUSES:
                self.causes[cause] = self.causes.get(cause, 0.0) + lasted
