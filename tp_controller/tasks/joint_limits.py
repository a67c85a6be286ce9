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

"""Margin to the joint position limits, as a task of the stack."""

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.bounded import BoundedTask, DEFAULT_BOUND_GAIN, DEFAULT_RETURN_SPEED
from tp_controller.tasks.joint import Joints, JointTask
from tp_controller.tasks.keys import Gain, Keys, positive, Tolerance
from tp_controller.tasks.task import Task

# Default of the key `margin` [rad or m].
DEFAULT_MARGIN = 0.05


class JointLimits(JointTask, BoundedTask):
    """
    Keep joints a margin away from their position limits (lecture 3.1, inequality tasks).

    The position limits themselves are enforced with every stack. This task adds a margin,
    which the tasks above it may violate.
    """

    type_name = 'joint_limits'
    feed_forward_type = None
    keys = {'margin': 'least distance to the limits [rad or m]'}
    # An inequality task accepts no joint velocities as feed-forward.
    parse_feed_forward = Task.parse_feed_forward

    def __init__(self, robot: Robot, name: str, *, joints: Joints | None = None,
                 margin: float = DEFAULT_MARGIN, gain: Gain = DEFAULT_BOUND_GAIN,
                 return_speed: float = DEFAULT_RETURN_SPEED,
                 tolerance: Tolerance | None = None) -> None:
        keys = Keys()
        super().__init__(robot, name, keys, joints, lower=-np.inf, upper=np.inf, gain=gain,
                         return_speed=return_speed, tolerance=tolerance)
        self.row_names = self.joints
        lower, upper = robot.lower[self._indices], robot.upper[self._indices]
        self.margin = keys.check('margin', self._margin, margin, upper - lower)
        keys.raise_faults(name)
        self.lower, self.upper = lower + self.margin, upper - self.margin

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return the positions of the joints (rows,) [rad or m] and their rows (rows, n)."""
        return self.positions(state), self.jacobian(state)

    def _margin(self, value: float, ranges: Array) -> float:
        """Return the margin, or raise ValueError if it leaves a joint no range."""
        margin = positive(value)
        narrow = int(ranges.argmin())
        if not 2.0 * margin < ranges[narrow]:
            raise ValueError(f'must be less than half the range of {self.joints[narrow]}, '
                             f'{0.5 * ranges[narrow]:g}, got {margin:g}')
        return margin
