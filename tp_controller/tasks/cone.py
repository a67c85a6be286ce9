# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Cones that an axis of a frame stays in: field of view and tilt (lecture 3.1)."""

import math
from typing import Any

import numpy as np
from tp_controller.model.spatial import Array, read_only
from tp_controller.model.state import RobotState
from tp_controller.tasks.aim import (
    AimedTask,
    AIMS,
    axis_key,
    parse_axis,
    pose_along,
    turn_between,
)
from tp_controller.tasks.bounded import BoundedTask
from tp_controller.tasks.frame import frame_and_reference, frame_key
from tp_controller.tasks.keys import Keys, Number, optional, positive
from tp_controller.tasks.sketch import Cone, Sketch
from tp_controller.tasks.task import DEFAULT_TIMEOUT, norm
from tp_controller.tasks.twin import CONE, make_twin, Twin
from tp_controller.tasks.yaml_keys import yaml_key

# Angle below which the value is rounded, as a share of the half angle: the gradient of an angle
# has no limit where the axis is aligned.
ROUNDED_SHARE = 0.5
UP = np.array([0.0, 0.0, 1.0])


def half_angle_key(text: str, name: str = '') -> Any:
    """Declare the key of the half angle of a cone; see `yaml_key`."""
    return yaml_key(text, Number(zero=False, below=math.pi, below_text='π'), unit='rad',
                    name=name)


class ConeTask(AimedTask, BoundedTask):
    """
    Base class of tasks that bound the angle between an axis of a frame and a direction.

    The only row is the angle θ, J = nᵀ (J_direction − J_ω) with the axis n of the turn between
    both. Below the share c = ``ROUNDED_SHARE`` of the half angle it is (θ² + c²) / 2c, with the
    same value and slope at c, and without slope where the axis is aligned.
    """

    sketch_parts = {'frame': True, 'goal': True, 'axis': True, 'sight': True, 'cone': True}
    units = ('rad',)

    half_angle: float
    timeout: float = yaml_key('time that a velocity of the goal stays in force', positive,
                              DEFAULT_TIMEOUT, unit='s', acts=False)

    def check_keys(self, keys: Keys) -> None:
        """Bound the angle."""
        super().check_keys(keys)
        self.upper = self.half_angle

    def value(self, state: RobotState) -> Array:
        """Return the angle (1,), rounded near 0 [rad]."""
        return self.observe(state)[0]

    def angle(self, state: RobotState) -> float:
        """Return the angle between axis and direction [rad]."""
        return norm(self._turn(state)[0])

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return the rounded angle (1,) [rad] and its Jacobian (1, n)."""
        turn, J_direction = self._turn(state)
        angle, core = norm(turn), self._core
        J = self._slope(turn).dot(J_direction - state.jacobian(self.frame)[3:])
        return np.array([angle if angle > core else 0.5 * (angle * angle / core + core)]), \
            J[np.newaxis]

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core, for an aim of this package; see `Task`."""
        if not isinstance(self.goal, np.ndarray) or type(self.aim) not in AIMS.values():
            return None
        return make_twin(CONE, self._law(), (
            *frame_and_reference(self.robot, self.frame, self.reference),
            self.goal_type == 'point', read_only(self.goal), self.axis, self._limits()),
            self.mode)

    def own_motion(self, state: RobotState, now: float) -> float | Array:
        """Return the rate of the value due to the motion of the goal, (1,) or 0 [rad/s]."""
        twist = self.feed_forward(now)
        if twist is None:
            return 0.0
        return self._slope(self._turn(state)[0]).dot(self.aim.turning(state, self.goal, twist))

    @property
    def _core(self) -> float:
        """Return the angle below which the value is rounded [rad]."""
        return ROUNDED_SHARE * self.half_angle

    def _turn(self, state: RobotState) -> tuple[Array, Array]:
        """Return the turn (3,) from axis to direction [rad], and J (3, n) of the direction."""
        direction, J_direction = self.aim.sight(state, self.goal)
        return turn_between(self.axis_in_root(state), direction), J_direction

    def _slope(self, turn: Array) -> Array:
        """Return the gradient of the value with respect to a turn (3,)."""
        return turn / max(norm(turn), self._core)


class FieldOfView(ConeTask):
    """
    Keep a point or another frame within a cone about the axis of a camera.

    The goal is the point (3,) [m] in the reference frame; a twist is its velocity.
    """

    type_name = 'field_of_view'
    goal_type = 'point'
    example = {'frame': 'panda_hand_tcp', 'half_angle': 0.4, 'target': [1.0, 0.2, -0.3]}

    towards = 'point'
    frame: str = frame_key('frame of the camera')
    half_angle: float = half_angle_key('angle between the axis and the edge of the view')
    axis: Array = axis_key('axis of the camera: x, -x, y, -y, z, -z or three numbers', 'z')

    def start(self, state: RobotState) -> None:
        """Set a point straight ahead as the default goal."""
        super().start(state)
        if self.goal is None:
            self.goal, self.has_default_goal = self.aim.current(state, self.axis), True

    def cone(self, state: RobotState, direction: Array, length: float) -> Sketch:
        """Return the cone of view."""
        return Cone('cone', pose_along(self.axis_in_root(state), state.position(self.frame)),
                    self.half_angle, length)


class Tilt(ConeTask):
    """
    Keep an axis of a frame within a cone about a direction: a cup upright, a lamp downwards.

    The turn about the axis stays free. The goal is the direction (3,), of any length, in the
    reference frame; a twist is its angular velocity.
    """

    type_name = 'tilt'
    goal_type = 'direction'
    example = {'frame': 'panda_hand_tcp', 'axis': '-z', 'within': 0.3}

    towards = 'direction'
    half_angle: float = half_angle_key('largest angle between axis and direction', name='within')
    axis: Array = axis_key('axis of the frame: x, -x, y, -y, z, -z or three numbers', 'z')
    target: Any = yaml_key(
        'direction at the start: x, -x, y, -y, z, -z or three numbers, in the reference frame '
        '(default: z)', optional(parse_axis), None, name='direction')

    def start(self, state: RobotState) -> None:
        """Set z of the reference as the direction, unless there is a goal."""
        super().start(state)
        if self.goal is None:
            self.goal = UP

    def cone(self, state: RobotState, direction: Array, length: float) -> Sketch:
        """Return the cone that the axis stays in."""
        return Cone('cone', pose_along(direction, state.position(self.frame)), self.half_angle,
                    length)
