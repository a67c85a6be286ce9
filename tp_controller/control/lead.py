# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Motion to a goal by a posture: along a straight line of the joints."""

from typing import NamedTuple

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.level import Level
from tp_controller.tasks.task import Evaluation

# Distance of the farthest joint from the posture from which the task goes on by itself [rad or m].
ARRIVED = 0.02


class Lead(NamedTuple):
    """
    Posture that leads a task to its goal.

    The demand is one for all joints, K times the way to the posture, at most as fast as their
    velocity limits allow together: so they move along a straight line, between two points within
    the position limits. The task moves only its own joints.

    Attributes
    ----------
    posture : ndarray (n,)
        Positions of the joints at the goal [rad or m]; NaN for those that stay where they are.

    """

    posture: Array

    def has_arrived(self, state: RobotState) -> bool:
        """Return whether the joints are at the posture."""
        return float(np.abs(self._way(state)).max()) <= ARRIVED

    def demand(self, evaluation: Evaluation, state: RobotState) -> Evaluation:
        """Return the evaluation of a task with the demand of its lead, and its own error."""
        task = evaluation.task
        velocity = float(np.max(task.gain)) * self._way(state)
        # A joint whose limit is zero stays where it is, whatever is demanded.
        limits = task.robot.velocity
        excess = float((np.abs(velocity) / np.where(limits > 0.0, limits, np.inf)).max())
        level = Level.of_joints(velocity / max(excess, 1.0))
        level.joints = task.joint_mask
        return Evaluation(task, level, evaluation.error)

    def _way(self, state: RobotState) -> Array:
        """Return the distances (n,) to the posture."""
        return np.nan_to_num(self.posture - state.positions)
