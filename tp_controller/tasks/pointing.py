# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks that point an axis of a frame, with a free turn about it or kept upright."""

from collections.abc import Sequence
import math
from typing import Any

import numpy as np
from tp_controller.errors import unknown
from tp_controller.model.spatial import Array, read_only, skew
from tp_controller.model.state import RobotState
from tp_controller.solver.level import Level
from tp_controller.tasks.aim import (
    across,
    AimedTask,
    AIMS,
    Axis,
    axis_key,
    parse_axis,
    turn_between,
)
from tp_controller.tasks.frame import frame_and_reference, frame_key
from tp_controller.tasks.keys import Keys
from tp_controller.tasks.orientation import TurningTask
from tp_controller.tasks.sketch import arc, RAY_LENGTH, Sketch
from tp_controller.tasks.task import Evaluation
from tp_controller.tasks.twin import AXIS, make_twin, Twin
from tp_controller.tasks.yaml_keys import yaml_key

UP = np.array([0.0, 0.0, 1.0])
# Sine of the angle between an axis and the vertical below which the weight of the upright row
# decreases.
MIN_VERTICAL_SINE = 0.3
# Largest cosine of the angle between `axis` and `up`.
MAX_UP_COSINE = 0.99
MIN_SQUARED_SINE = 1e-12


def _towards(kind: str) -> str:
    """Return the kind of the goals, or raise ValueError."""
    if not isinstance(kind, str) or kind not in AIMS:
        raise ValueError(unknown('kind of goal', kind, AIMS))
    return kind


class AxisTask(TurningTask, AimedTask):
    """
    Base class of tasks that turn an axis of a frame to a desired direction.

    The error is the shortest turn from the axis a to the direction d. It has no component along a,
    so there are two rows, about two axes of the frame at right angles to a. The direction to a
    point at the distance r turns as frame and point move: J = J_ω − [d]× (J_point − J_v) / r.
    """

    sketch_parts = {'frame': True, 'goal': True, 'axis': True, 'sight': True, 'cone': True,
                    'turn': False}
    example = {'frame': 'panda_hand_tcp'}
    units: tuple[str, ...] = ('rad', 'rad')
    # Axes u and a × u (2, 3) of a row that keeps the frame upright.
    _upright: Array | None = None

    def set_up(self) -> None:
        """Find the axes of the rows."""
        super().set_up()
        self._across = across(self.axis)

    def error(self, state: RobotState) -> Array:
        """Return the turn to the goal about the axes of the rows (rows,) [rad]."""
        return self.observe(state)[0]

    def jacobian(self, state: RobotState) -> Array:
        """Return J (rows, n) of the angular velocity about these axes relative to the goal."""
        return self.observe(state)[1]

    def make_evaluation(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` at a state."""
        error, J, about = self.observe(state)
        desired = self.gain * error
        twist = self.feed_forward(now)
        if twist is not None:
            desired = desired + about.dot(self.aim.turning(state, self.goal, twist))
        return Evaluation(self, Level(J, desired, self.mode), error)

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core, for an aim of this package; see `Task`."""
        if not isinstance(self.goal, np.ndarray) or type(self.aim) not in AIMS.values():
            return None
        return make_twin(AXIS, self._law(), (
            *frame_and_reference(self.robot, self.frame, self.reference),
            self.goal_type == 'point', read_only(self.goal), self.axis, self._across,
            self._upright, self._rotation_error.memory), self.mode)

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return the sketch, with an arc for the remaining turn."""
        drawn = super().sketch(state)
        if self.goal is None:
            return drawn
        axis, (direction, _) = self.axis_in_root(state), self.aim.sight(state, self.goal)
        return [*drawn, *arc('turn', state.position(self.frame), RAY_LENGTH * axis[np.newaxis],
                             self._rotation_error.follow(turn_between(axis, direction)))]

    def observe(self, state: RobotState) -> tuple[Array, Array, Array]:
        """
        Return error, Jacobian and axes of the rows at a `RobotState`.

        Returns
        -------
        error : ndarray (rows,)
            [rad]
        J : ndarray (rows, n)
        about : ndarray (rows, 3)
            Maps an angular velocity of the direction, in the axes of the root, to the rows.

        """
        R = state.rotation(self.frame)
        direction, J_direction = self.aim.sight(state, self.goal)
        about = self._across.dot(R.T)
        turn = self._rotation_error.follow(turn_between(R.dot(self.axis), direction))
        return about.dot(turn), about.dot(state.jacobian(self.frame)[3:] - J_direction), about


class Pointing(AxisTask):
    """
    Point an axis of a frame in a direction, or at a point; the turn about it stays free.

    With `position` it has the five rows of welding and drilling (wiki, What defines a Task?).

    The goal is a direction (3,) of any length, or a point (3,) [m], in the reference frame.
    """

    type_name = 'pointing'
    goal_type = 'direction'
    goal_types = tuple(AIMS)

    towards: str = yaml_key('kind of the goals: direction or point', _towards, 'direction')
    target: Any = yaml_key(
        'goal at the start, x, y, z; a point may be a frame of the robot instead', default=None)
    axis: Array = axis_key('axis of the frame: x, -x, y, -y, z, -z or three numbers', 'z')


class LookAt(AxisTask):
    """
    Point the axis of a camera at a point or at another frame, upright if desired (lecture 3.1).

    The first two rows are those of `pointing`. With `up` a third row turns the camera about its
    axis until the axis `up` points along z of the root, as far as the direction allows. The weight
    of this row fades to zero for a camera that looks straight up or down.

    The goal is a point (3,) [m] in the reference frame.
    """

    type_name = 'look_at'
    make_twin = AxisTask.make_twin
    goal_type = 'point'

    towards = 'point'
    frame: str = frame_key('frame of the camera')
    axis: Array = axis_key('axis of the camera: x, -x, y, -y, z, -z or three numbers', 'z')
    up: Any = yaml_key(
        'axis of the frame that is to point upwards, such as -y of an optical frame (default: '
        'the turn about the axis stays free)', default=None)

    def check_keys(self, keys: Keys) -> None:
        """Add a row for the key `up`."""
        super().check_keys(keys)
        if self.up is not None:
            self.units = ('rad',) * 3
            if self.axis is not None:
                self._upright = keys.check('up', _side, self.up, self.axis)

    def observe(self, state: RobotState) -> tuple[Array, Array, Array]:
        """Return error, J and axes of the rows, see `AxisTask.observe`; the turn about a last."""
        error, J, about = super().observe(state)
        if self._upright is None:
            return error, J, about
        # φ = atan2(w·(a×u), w·u) is the turn about a from u to the projection of the vertical w
        # across a; both products change with the orientation alone, by ω·(u×w) and the like.
        up, side = self._upright.dot(state.rotation(self.frame).T)
        cosine, sine = UP.dot(up), UP.dot(side)
        reach = cosine * cosine + sine * sine
        weight = min(1.0, reach / MIN_VERTICAL_SINE ** 2)
        row = skew(sine * up - cosine * side).dot(UP)
        row *= weight / max(reach, MIN_SQUARED_SINE)
        return (np.append(error, weight * math.atan2(sine, cosine)),
                np.vstack([J, row.dot(state.jacobian(self.frame)[3:])]),
                np.vstack([about, np.zeros(3)]))


def _side(value: Axis, axis: Array) -> Array:
    """Return u and a × u (2, 3) for an axis u across a, or raise ValueError."""
    side = parse_axis(value)
    if abs(side.dot(axis)) > MAX_UP_COSINE:
        raise ValueError(f'must be another axis than the one that points, got {value!r}')
    side = side - side.dot(axis) * axis
    side /= math.sqrt(side.dot(side))
    return np.array([side, skew(axis).dot(side)])
