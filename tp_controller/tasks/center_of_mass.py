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

import numpy as np
from tp_controller.errors import RobotError
from tp_controller.tasks.frame import MovingGoalTask, parse_axes
from tp_controller.tasks.position import PointGoal
from tp_controller.tasks.task import DEFAULT_GAIN, DEFAULT_MODE, DEFAULT_TIMEOUT, Keys

AXES = ('x', 'y', 'z')
# A centre of mass that moves by less than this has no more than rounding to be stretched [m/rad].
LEAST = 0.01


class CenterOfMass(PointGoal, MovingGoalTask):
    """
    Bring the centre of mass of the robot to a point, σ = Σ m_i c_i / Σ m_i.

    All links count, those that stand still included. The more of the weight stands still, the
    less the centre moves; the rows are stretched to length 1 in the neutral posture. The goal is
    a point (3,) [m] in the root.
    """

    type_name = 'center_of_mass'
    keys = {'axes': 'axes of the root that count: some of x, y, z (default: all)'}

    def __init__(self, robot, name, *, axes=None, gain=DEFAULT_GAIN, tolerance=None,
                 timeout=DEFAULT_TIMEOUT, mode=DEFAULT_MODE):
        keys = Keys()
        keys.check('type', _check_mass, robot)
        self.axes = keys.check('axes', parse_axes, axes, AXES) or AXES
        self._rows = [AXES.index(axis) for axis in self.axes]
        self.reference = robot.root
        super().__init__(robot, name, ['m'] * len(self.axes), keys, gain=gain,
                         tolerance=tolerance, timeout=timeout, mode=mode)
        keys.raise_faults(name)
        self.stretch = 1.0 / max(LEAST, np.linalg.norm(
            robot.state(robot.neutral()).center_of_mass()[1], 2))

    def value(self, state):
        """Return the centre of mass (3,) in the root [m]."""
        return state.center_of_mass()[0]

    def error(self, state):
        """Return the way to the goal along the axes that count (rows,) [m]."""
        return (self.goal - self.value(state))[self._rows]

    def jacobian(self, state):
        """Return J (rows, n)."""
        return state.center_of_mass()[1][self._rows]

    def level(self, state, now):
        """Return the `Level` at a state, stretched, and remember the error for the report."""
        level = super().level(state, now)
        level.J, level.v = self.stretch * level.J, self.stretch * level.v
        return level

    def set_feed_forward(self, velocity, now):
        """Take the rows of a twist (6,) that count, until it times out."""
        super().set_feed_forward(velocity[self._rows], now)


def _check_mass(robot):
    """Raise `RobotError` where the description gives no link a mass."""
    if not robot.mass > 0.0:
        raise RobotError(f'the description of {robot.name} gives no link a mass')
