# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Field of view of a camera (lecture 3.1)."""

import math

import numpy as np
from tp_controller.model.spatial import Array, read_only
from tp_controller.model.state import RobotState
from tp_controller.tasks.aim import AimedTask, axis_key, PointAim, pose_along, turn_between
from tp_controller.tasks.bounded import BoundedTask
from tp_controller.tasks.frame import frame_and_reference, frame_key
from tp_controller.tasks.keys import Keys, Number, positive
from tp_controller.tasks.sketch import Cone, Sketch
from tp_controller.tasks.task import DEFAULT_TIMEOUT
from tp_controller.tasks.twin import FIELD_OF_VIEW, make_twin, Twin
from tp_controller.tasks.yaml_keys import yaml_key

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
    example = {'frame': 'panda_hand_tcp', 'half_angle': 0.4, 'target': [1.0, 0.2, -0.3]}
    sketch_parts = {'frame': True, 'goal': True, 'axis': True, 'sight': True, 'cone': True}
    units = ('rad',)

    towards = 'point'
    frame: str = frame_key('frame of the camera')
    half_angle: float = yaml_key('angle between the axis and the edge of the view',
                                 Number(zero=False, below=math.pi, below_text='π'), unit='rad')
    axis: Array = axis_key('axis of the camera: x, -x, y, -y, z, -z or three numbers', 'z')
    timeout: float = yaml_key('time that a velocity of the point stays in force', positive,
                              DEFAULT_TIMEOUT, unit='s', acts=False)

    def check_keys(self, keys: Keys) -> None:
        """Bound the angle."""
        super().check_keys(keys)
        self.upper = self.half_angle

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

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core, for an aim of this package; see `Task`."""
        if not isinstance(self.goal, np.ndarray) or type(self.aim) is not PointAim:
            return None
        return make_twin(FIELD_OF_VIEW, self._law(), (
            *frame_and_reference(self.robot, self.frame, self.reference), read_only(self.goal),
            self.axis, self._limits()), self.mode)

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
