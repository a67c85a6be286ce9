# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The centre of mass of the whole robot."""

from collections.abc import Sequence

import numpy as np
from tp_controller.model.spatial import Array, pose, read_only
from tp_controller.model.state import RobotState
from tp_controller.solver.level import Level
from tp_controller.tasks.frame import parse_axes, spread
from tp_controller.tasks.keys import Keys
from tp_controller.tasks.position import PointTask
from tp_controller.tasks.sketch import arrow, Dot, Sketch, Triad
from tp_controller.tasks.task import Evaluation
from tp_controller.tasks.twin import CENTER_OF_MASS, make_twin, Twin
from tp_controller.tasks.yaml_keys import yaml_key

AXES = ('x', 'y', 'z')
# Least norm of the Jacobian that is scaled to 1; a smaller one is a rounding error [m/rad].
MIN_JACOBIAN_NORM = 0.01


class CenterOfMass(PointTask):
    """
    Bring the centre of mass of the robot to a point.

    It is σ = Σ m_i c_i / Σ m_i of all links, including those that do not move. The rows are scaled
    to norm 1 in the neutral posture, because the centre moves little if most of the mass is fixed.
    The goal is a point (3,) [m] in the root.
    """

    type_name = 'center_of_mass'
    needs = ('masses',)
    sketch_parts = {'frame': True, 'goal': True, 'error': False}

    axes: tuple[str, ...] = yaml_key(
        'axes of the root that count: some of x, y, z (default: all)',
        lambda axes: parse_axes(axes, AXES), None)

    def check_keys(self, keys: Keys) -> None:
        """Set rows and units, of all axes if the key has a fault."""
        super().check_keys(keys)
        self._rows = [AXES.index(axis) for axis in self.axes or AXES]
        self.units = ('m',) * len(self._rows)

    def set_up(self) -> None:
        """Scale the rows to norm 1 in the neutral posture."""
        super().set_up()
        self.reference = self.robot.root
        neutral = self.robot.state(self.robot.neutral())
        self.row_scale = 1.0 / max(MIN_JACOBIAN_NORM, float(np.linalg.norm(
            neutral.center_of_mass()[1], 2)))

    def value(self, state: RobotState) -> Array:
        """Return the centre of mass (3,) in the root [m]."""
        return state.center_of_mass()[0]

    def error(self, state: RobotState) -> Array:
        """Return the vector to the goal along the selected axes (rows,) [m]."""
        return (self.goal - self.value(state))[self._rows]

    def jacobian(self, state: RobotState) -> Array:
        """Return J (rows, n)."""
        return state.center_of_mass()[1][self._rows]

    def make_evaluation(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` at a state, with a scaled level."""
        error = self.error(state)
        level = Level(self.row_scale * self.jacobian(state),
                      self.row_scale * self.velocity(error, now), self.mode)
        return Evaluation(self, level, error)

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        if not isinstance(self.goal, np.ndarray):
            return None
        return make_twin(CENTER_OF_MASS, self._law(), (
            bytes(self._rows), read_only(self.goal), self.row_scale), self.mode)

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return the centre of mass, the goal, and an arrow along the selected axes."""
        place = self.value(state)
        if self.goal is None:
            return [Dot('frame', place)]
        end = place.copy()
        end[self._rows] = self.goal[self._rows]
        return [Dot('frame', place), Triad('goal', pose(np.eye(3), end)),
                *arrow('error', place, end)]

    def in_rows(self, feed_forward: Array) -> Array:
        """Return the selected rows of a twist (6,)."""
        return feed_forward[self._rows]

    def from_rows(self, velocity: Array) -> Array:
        """Return the twist (6,) of selected rows."""
        return spread(velocity, self._rows)
