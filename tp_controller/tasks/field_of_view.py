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

"""Field of view of a camera (lecture 3.1, inequality tasks)."""

import math

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.aim import AimedTask, Axis, pose_along, turn_between
from tp_controller.tasks.bounded import BoundedTask, DEFAULT_BOUND_GAIN, DEFAULT_RETURN_SPEED
from tp_controller.tasks.keys import Gain, Keys, positive, Tolerance
from tp_controller.tasks.sketch import Cone, Sketch
from tp_controller.tasks.task import DEFAULT_TIMEOUT

# Angle below which the direction out of the view is undefined [rad].
MIN_ANGLE = 1e-9


class FieldOfView(AimedTask, BoundedTask):
    """
    Keep a point, or the origin of another frame, within a cone about the axis of a camera.

    The only row is the angle between the axis and the direction to the point.

    The goal is the point (3,) [m] in the reference frame; a twist is its velocity.
    """

    type_name = 'field_of_view'
    goal_type = 'point'
    keys = {
        'frame': 'frame of the camera',
        'axis': 'axis of the camera: x, -x, y, -y, z, -z or three numbers',
        'half_angle': 'angle between the axis and the edge of the view [rad]',
        'timeout': 'time that a velocity of the point stays in force [s]',
    }

    def __init__(self, robot: Robot, name: str, *, frame: str, half_angle: float,
                 axis: Axis = 'z', target: ArrayLike | None = None, reference: str | None = None,
                 gain: Gain = DEFAULT_BOUND_GAIN, return_speed: float = DEFAULT_RETURN_SPEED,
                 tolerance: Tolerance | None = None, timeout: float = DEFAULT_TIMEOUT) -> None:
        keys = Keys()
        half_angle = keys.check('half_angle', _half_angle, half_angle)
        super().__init__(
            robot, name, ['rad'], keys, frame=frame, axis=axis, towards='point', target=target,
            reference=reference, lower=-np.inf, upper=half_angle, gain=gain,
            return_speed=return_speed, tolerance=tolerance, timeout=timeout)
        keys.raise_faults(name)

    def start(self, state: RobotState) -> None:
        """Set a point straight ahead as the default goal."""
        super().start(state)
        if self.goal is None:
            self.goal, self.has_default_goal = self.aim.current(state, self.axis), True

    def value(self, state: RobotState) -> Array:
        """Return the angle (1,) [rad]."""
        return self.observe(state)[0]

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return the angle (1,) [rad] and its Jacobian (1, n)."""
        angle, normal, J_direction = self._angle_and_axis(state)
        J = normal.dot(J_direction - state.jacobian(self.frame)[3:])
        return np.array([angle]), J[np.newaxis]

    def own_motion(self, state: RobotState, now: float) -> float | Array:
        """Return the rate of the angle due to the motion of the point, (1,) or 0 [rad/s]."""
        twist = self.feed_forward(now)
        if twist is None:
            return 0.0
        _, normal, _ = self._angle_and_axis(state)
        return normal.dot(self.aim.turning(state, self.goal, twist))

    def cone(self, state: RobotState, direction: Array, length: float) -> Sketch:
        """Return the cone of view."""
        return Cone('cone', pose_along(self.axis_in_root(state), state.position(self.frame)),
                    float(self.upper), length)

    def _angle_and_axis(self, state: RobotState) -> tuple[float, Array, Array]:
        """Return the angle, its axis (3,) in the root, and J (3, n) of the direction."""
        direction, J_direction = self.aim.sight(state, self.goal)
        turn = turn_between(self.axis_in_root(state), direction)
        angle = math.sqrt(turn.dot(turn))
        return angle, turn / angle if angle > MIN_ANGLE else np.zeros(3), J_direction


def _half_angle(value: float) -> float:
    """Return an angle between 0 and π, or raise ValueError."""
    angle = positive(value)
    if angle >= math.pi:
        raise ValueError(f'must be less than π, got {angle:g}')
    return angle
