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

"""The centre of mass of the whole robot (lecture 3.1, equality tasks)."""

from collections.abc import Sequence

import numpy as np
from tp_controller.errors import RobotError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, pose
from tp_controller.model.state import RobotState
from tp_controller.solver.level import Level
from tp_controller.tasks.frame import Axes, parse_axes
from tp_controller.tasks.keys import Gain, Keys, Tolerance
from tp_controller.tasks.position import PointTask
from tp_controller.tasks.sketch import arrow, Dot, Sketch, Triad
from tp_controller.tasks.task import DEFAULT_GAIN, DEFAULT_MODE, DEFAULT_TIMEOUT, Evaluation

AXES = ('x', 'y', 'z')
# Least norm of the Jacobian that is scaled to 1; a smaller one is a rounding error [m/rad].
MIN_JACOBIAN_NORM = 0.01


class CenterOfMass(PointTask):
    """
    Bring the centre of mass of the robot to a point, σ = Σ m_i c_i / Σ m_i.

    All links contribute, including those that do not move. The rows are scaled to norm 1 in the
    neutral posture, because the centre moves little if most of the mass is fixed. The goal is a
    point (3,) [m] in the root.
    """

    type_name = 'center_of_mass'
    keys = {'axes': 'axes of the root that count: some of x, y, z (default: all)'}

    def __init__(self, robot: Robot, name: str, *, axes: Axes | None = None,
                 gain: Gain = DEFAULT_GAIN, tolerance: Tolerance | None = None,
                 timeout: float = DEFAULT_TIMEOUT, mode: str = DEFAULT_MODE) -> None:
        keys = Keys()
        keys.check('type', _check_mass, robot)
        self.axes = keys.check('axes', parse_axes, axes, AXES) or AXES
        self._rows = [AXES.index(axis) for axis in self.axes]
        self.reference = robot.root
        super().__init__(robot, name, ['m'] * len(self.axes), keys, gain=gain,
                         tolerance=tolerance, timeout=timeout, mode=mode)
        keys.raise_faults(name)
        self.row_scale = 1.0 / max(MIN_JACOBIAN_NORM, float(np.linalg.norm(
            robot.state(robot.neutral()).center_of_mass()[1], 2)))

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


def _check_mass(robot: Robot) -> None:
    """Raise `RobotError` if the description gives no link a mass."""
    if not robot.mass > 0.0:
        raise RobotError(f'the description of {robot.name} gives no link a mass')
