# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Base class of tasks that demand a velocity, without a value."""

from typing import Any

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.task import norm, Task


class VelocityTask(Task):
    """Task whose goal is a velocity; its reported error is desired minus achieved velocity."""

    has_position = False

    def value(self, state: RobotState) -> Array:
        """Return zeros (rows,), the default goal."""
        return np.zeros(self.rows)

    def error(self, state: RobotState) -> Array:
        """Return zeros (rows,), since there is no value."""
        return np.zeros(self.rows)

    def parse_goal(self, goal: Any) -> Array:
        """Return a velocity in internal form, or raise `GoalError`."""
        return self.parse_feed_forward(goal)

    def goal_in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Rotate a velocity from the axes of another frame to those of the reference."""
        return self.feed_forward_in_reference(goal, T_reference_frame[:3, :3])

    def set_goal(self, goal: Array, now: float) -> None:
        """Set a velocity, until it times out."""
        super().set_goal(goal, now)
        self.set_feed_forward(goal, now)

    def reported_errors(self, error: Array, residual: Array) -> tuple[tuple[float, str, float],
                                                                      ...]:
        """Return desired minus achieved velocity for each unit; see `Task`."""
        return tuple((norm(residual[rows]), f'{unit}/s', tolerance)
                     for rows, unit, tolerance in self.groups)
