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

"""Joints that stay near the middle of their ranges, in the null space of the tasks above."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from tp_controller.errors import RobotError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.gradient import GradientTask
from tp_controller.tasks.keys import Keys

# Share of half a range, from its middle, within which the measure is as written; beyond it goes
# on straight, or the gradient would grow without end and the joint swing about its best place.
CURVED = 0.8
# Largest rate at which a joint approaches the middle of its range [1/s]. The curvature of h grows
# as the inverse square of the range: a gripper finger with a range of 2 cm has 20,000/m², and
# would overshoot in every cycle at 100 Hz and gain 0.01.
RATE = 10.0


class JointLimitDistance(GradientTask):
    """
    Maximize the distance of the joints from their limits, h = −Σ 1 / (1 − x²).

    x is the place of a joint in its range, −1 at the lower limit and 1 at the upper one: h is
    the sum of (upper − lower)² / (4 (upper − q) (q − lower)) of the weighted gradient projection
    method (wiki, joint limit avoidance), with its sign turned. Joints without limits do not count.
    The demand K ∂h/∂q of a joint at the distance d from the middle is reduced smoothly to at most
    ``RATE`` d.
    """

    type_name = 'joint_limit_distance'

    def __init__(self, robot: Robot, name: str, **options: Any) -> None:
        keys = Keys()
        self._limited = np.isfinite(robot.upper - robot.lower)
        keys.check('type', _any, self._limited)
        super().__init__(robot, name, keys, **options)
        keys.raise_faults(name)
        lower, upper = robot.lower[self._limited], robot.upper[self._limited]
        self._middle, self._half = 0.5 * (upper + lower), 0.5 * (upper - lower)

    def measure(self, state: RobotState) -> tuple[float, Array]:
        """Return h and its gradient (n,) [1/rad or 1/m]."""
        x, curved, gap = self._places(state)
        slope = -2.0 * curved / (gap * gap)
        gradient = np.zeros(self.robot.n)
        gradient[self._limited] = slope / self._half
        return float(np.sum(slope * (x - curved) - 1.0 / gap)), gradient

    def slowdown(self, state: RobotState) -> Array:
        """Return the factor ≥ 1 (n,) that keeps every joint from approaching faster than RATE."""
        gap = self._places(state)[2]
        factor = np.ones(self.robot.n)
        factor[self._limited] += 2.0 * self.gain / (RATE * (gap * self._half) ** 2)
        return factor

    def _places(self, state: RobotState) -> tuple[Array, Array, Array]:
        """Return x, x within ± CURVED, and 1 − x² of that, of each joint with limits."""
        x = (state.positions[self._limited] - self._middle) / self._half
        curved = np.clip(x, -CURVED, CURVED)
        return x, curved, 1.0 - curved * curved


def _any(limited: NDArray[np.bool_]) -> None:
    """Raise `RobotError` where no joint has limits."""
    if not limited.any():
        raise RobotError('no joint of the robot has position limits')
