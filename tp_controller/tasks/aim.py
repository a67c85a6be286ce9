# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks that aim an axis of a frame, and the kinds of goals that they take."""

from collections.abc import Sequence
import math
from typing import Any, ClassVar, Protocol, TypeAlias, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import GoalError
from tp_controller.model.spatial import Array, pose, rotation_from_vector, skew
from tp_controller.model.state import RobotState
from tp_controller.tasks.frame import frame_key, MovingGoalTask, parse_reference
from tp_controller.tasks.keys import finite_vector, Keys
from tp_controller.tasks.sketch import Arrow, arrow, Cone, RAY_LENGTH, Sketch, Triad
from tp_controller.tasks.task import norm, Task
from tp_controller.tasks.yaml_keys import REQUIRED, yaml_key

Axis: TypeAlias = str | Sequence[float] | Array
SomeTask = TypeVar('SomeTask', bound='AimedTask')

# Distance of a default goal that is a point [m].
DEFAULT_POINT_DISTANCE = 1.0
# Least distance in the angular velocity of the direction to a point [m].
MIN_POINT_DISTANCE = 0.01
# Largest length of a drawn cone [m].
MAX_CONE_LENGTH = 1.0
# Largest half-angle of a drawn cone [rad].
MAX_CONE_ANGLE = math.pi - 1e-3
# Unit vectors of the axes.
AXIS_VECTORS = {'x': (1.0, 0.0, 0.0), 'y': (0.0, 1.0, 0.0), 'z': (0.0, 0.0, 1.0)}
# Length, or sine of an angle, below which a direction is undefined [m or 1].
MIN_VECTOR_LENGTH = 1e-6


def parse_axis(value: Axis) -> Array:
    """Return the unit vector (3,) of x, -x, y, -y, z, -z or three numbers, or ValueError."""
    if isinstance(value, str):
        letter = value.strip().removeprefix('-')
        if letter in AXIS_VECTORS:
            sign = -1.0 if value.strip().startswith('-') else 1.0
            return sign * np.array(AXIS_VECTORS[letter])
    if isinstance(value, (list, tuple, np.ndarray)):
        return parse_direction(value, 'an axis')
    raise ValueError(f'needs x, y, z, -x, -y, -z or three numbers, got {value!r}')


def axis_key(text: str, default: Any = REQUIRED) -> Any:
    """Declare a key that is an axis of a frame; see `yaml_key`."""
    return yaml_key(text, parse_axis, default)


def parse_direction(values: ArrayLike, what: str) -> Array:
    """Return the unit vector (3,) along `values`, or raise `GoalError`."""
    vector = finite_vector(values, 3, f'{what} (a direction x, y, z)')
    length = math.sqrt(vector.dot(vector))
    if length < MIN_VECTOR_LENGTH:
        raise GoalError(f'{what} needs a direction, not {vector.tolist()}')
    return vector / length


def across(axis: Array) -> Array:
    """Return two unit vectors (2, 3) at right angles to an axis (3,) and to each other."""
    other = np.eye(3)[np.abs(axis).argmin()]
    first = skew(axis).dot(other)
    first /= math.sqrt(first.dot(first))
    return np.array([first, skew(axis).dot(first)])


def pose_along(axis: Array, p: Array) -> Array:
    """Return the pose (4, 4) of a frame at p (3,) whose z axis is a unit vector (3,)."""
    return pose(np.column_stack([*across(axis), axis]), p)


def turn_between(start: Array, end: Array) -> Array:
    """
    Return the rotation vector (3,) of the shortest turn from one unit vector to another [rad].

    Between opposite vectors every half turn is the shortest; one of them is returned.
    """
    normal = skew(start).dot(end)
    sine, cosine = math.sqrt(normal.dot(normal)), start.dot(end)
    if sine > MIN_VECTOR_LENGTH:
        return normal * (math.atan2(sine, cosine) / sine)
    return normal if cosine > 0.0 else math.pi * across(start)[0]


class Aim(Protocol):
    """Kind of goal of an axis of a frame; `goal` is (3,), in a reference frame."""

    goal_type: ClassVar[str]
    # Rows of a twist (linear, then angular velocity) that move the goal.
    twist_rows: ClassVar[slice]

    def __init__(self, frame: str, reference: str) -> None:
        """Set the frame that points, and the reference frame of goals."""

    def parse(self, goal: ArrayLike, what: str) -> Array:
        """Return a goal (3,), or raise `GoalError`."""

    def in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Transform a goal from another frame to the reference frame."""

    def current(self, state: RobotState, axis: Array) -> Array:
        """Return the goal (3,) that the axis (3,) of the frame meets now."""

    def sight(self, state: RobotState, goal: Array) -> tuple[Array, Array]:
        """
        Return the desired direction of the axis and its Jacobian.

        Returns
        -------
        direction : ndarray (3,)
            Unit vector in the axes of the root.
        J : ndarray (3, n)
            Angular velocity of the direction, in the axes of the root.

        """

    def turning(self, state: RobotState, goal: Array, twist: Array) -> Array:
        """Return the angular velocity (3,) of the direction due to a twist (6,) of the goal."""

    def place(self, state: RobotState, goal: Array, turn: Array) -> Array:
        """Return T_reference_goal (4, 4) of a frame with the remaining turn `turn` (3,)."""


class DirectionAim:
    """A direction (3,) in the axes of a reference frame; see `Aim`."""

    goal_type: ClassVar[str] = 'direction'
    twist_rows: ClassVar[slice] = slice(3, 6)

    def __init__(self, frame: str, reference: str) -> None:
        self._frame, self._reference = frame, reference

    def parse(self, goal: ArrayLike, what: str) -> Array:
        """Return a unit vector (3,), or raise `GoalError`."""
        return parse_direction(goal, what)

    def in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Rotate a direction from the axes of another frame to those of the reference."""
        return T_reference_frame[:3, :3].dot(goal)

    def current(self, state: RobotState, axis: Array) -> Array:
        """Return the current direction of the axis (3,) of the frame."""
        return state.rotation(self._reference).T.dot(state.rotation(self._frame).dot(axis))

    def sight(self, state: RobotState, goal: Array) -> tuple[Array, Array]:
        """Return the direction and its J."""
        return state.rotation(self._reference).dot(goal), state.jacobian(self._reference)[3:]

    def turning(self, state: RobotState, goal: Array, twist: Array) -> Array:
        """Return the angular velocity (3,) of the direction due to a twist (6,) of the goal."""
        return state.rotation(self._reference).dot(twist[3:])

    def place(self, state: RobotState, goal: Array, turn: Array) -> Array:
        """Return T_reference_goal (4, 4) of a frame with the remaining turn `turn` (3,)."""
        R_T, p = state.rotation(self._reference).T, state.position(self._reference)
        return pose(R_T.dot(rotation_from_vector(turn)).dot(state.rotation(self._frame)),
                    R_T.dot(state.position(self._frame) - p))


class PointAim:
    """A point (3,) [m] that belongs to a reference frame and moves with it; see `Aim`."""

    goal_type: ClassVar[str] = 'point'
    twist_rows: ClassVar[slice] = slice(0, 3)

    def __init__(self, frame: str, reference: str) -> None:
        self._frame, self._reference = frame, reference

    def parse(self, goal: ArrayLike, what: str) -> Array:
        """Return a point (3,), or raise `GoalError`."""
        return finite_vector(goal, 3, f'{what} (a point x, y, z)')

    def in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Transform a point from another frame to the reference frame."""
        return T_reference_frame[:3, :3].dot(goal) + T_reference_frame[:3, 3]

    def current(self, state: RobotState, axis: Array) -> Array:
        """Return a point on the axis (3,) of the frame, at `DEFAULT_POINT_DISTANCE`."""
        ahead = state.position(self._frame) + DEFAULT_POINT_DISTANCE * state.rotation(
            self._frame).dot(axis)
        return state.rotation(self._reference).T.dot(ahead - state.position(self._reference))

    def sight(self, state: RobotState, goal: Array) -> tuple[Array, Array]:
        """Return the direction to the point and its J."""
        direction, distance, offset = self._line_of_sight(state, goal)
        J_point, J_frame = state.jacobian(self._reference), state.jacobian(self._frame)
        J = J_point[:3] - skew(offset).dot(J_point[3:]) - J_frame[:3]
        # ω = d × ḋ, and ḋ is the part of the velocity across d, per distance.
        return direction, skew(direction / distance).dot(J)

    def turning(self, state: RobotState, goal: Array, twist: Array) -> Array:
        """Return the angular velocity (3,) of the direction due to a twist (6,) of the goal."""
        direction, distance, _ = self._line_of_sight(state, goal)
        return skew(direction / distance).dot(state.rotation(self._reference).dot(twist[:3]))

    def place(self, state: RobotState, goal: Array, turn: Array) -> Array:
        """Return T_reference_goal (4, 4) of a frame with the remaining turn `turn` (3,)."""
        R = state.rotation(self._reference).T.dot(rotation_from_vector(turn))
        return pose(R.dot(state.rotation(self._frame)), goal)

    def _line_of_sight(self, state: RobotState, goal: Array) -> tuple[Array, float, Array]:
        """Return direction and distance of the point, and its offset from the reference."""
        offset = state.rotation(self._reference).dot(goal)
        line = state.position(self._reference) + offset - state.position(self._frame)
        distance = math.sqrt(line.dot(line))
        if distance < MIN_VECTOR_LENGTH:
            # The direction to a coincident point is arbitrary.
            return np.array([0.0, 0.0, 1.0]), MIN_POINT_DISTANCE, offset
        return line / distance, max(distance, MIN_POINT_DISTANCE), offset


AIMS: dict[str, type[Aim]] = {'direction': DirectionAim, 'point': PointAim}


class AimedTask(MovingGoalTask):
    """
    Base class of tasks about an axis of a frame and a goal direction or point.

    The goal belongs to a reference frame, and moves with it.

    Attributes
    ----------
    axis : ndarray (3,)
        Axis of the frame, a unit vector in the frame.
    towards : str
        ``direction`` or ``point``.
    aim : Aim
        Kind of the goals.

    """

    towards: str
    frame: str = frame_key('frame of the robot that the task is about')
    axis: Array = axis_key('axis of the frame: x, -x, y, -y, z, -z or three numbers')
    target: Any = yaml_key(
        'point at the start, x, y, z, or a frame of the robot whose origin it is', default=None,
        unit='m')
    reference: str = yaml_key(
        'frame that goals are expressed in, and move with (default: the root)', default=None)

    def check_keys(self, keys: Keys) -> None:
        """Set the kind of the goals, their reference and the target."""
        super().check_keys(keys)
        reference, target = self.reference, self.target
        if self.towards == 'point' and isinstance(target, str):
            keys.check('target', _check_alone, target, reference, self.frame)
            self.reference = keys.check('target', self.robot.check_frame, target)
            target = np.zeros(3)
        else:
            self.reference = keys.check('reference', parse_reference, self.robot, reference)
        self.aim = AIMS[self.towards or 'direction'](self.frame, self.reference)
        self.goal_type, self.twist_rows = self.aim.goal_type, self.aim.twist_rows
        if target is not None:
            self.goal = keys.check('target', self.aim.parse, target, 'the target')

    def axis_in_root(self, state: RobotState) -> Array:
        """Return the axis (3,), a unit vector in the axes of the root."""
        return state.rotation(self.frame).dot(self.axis)

    def value(self, state: RobotState) -> Array:
        """Return the direction or point that the axis points at (3,), in the form of a goal."""
        return self.aim.current(state, self.axis)

    def parse_goal(self, goal: ArrayLike) -> Array:
        """Return a goal (3,), or raise `GoalError` if it cannot be one."""
        return self.aim.parse(goal, f'the goal of task {self.name!r}')

    def goal_in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Transform a goal from another frame to the reference frame."""
        return self.aim.in_reference(goal, T_reference_frame)

    def goal_pose(self, state: RobotState) -> Array:
        """Return the desired orientation at the point, or at the origin of the frame (4, 4)."""
        direction, _ = self.aim.sight(state, self.goal)
        return self.aim.place(state, self.goal,
                              turn_between(self.axis_in_root(state), direction))

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return the sketch: frame, goal, axis, line of sight and cone."""
        p, axis = state.position(self.frame), self.axis_in_root(state)
        drawn: list[Sketch] = [Triad('frame', state.pose(self.frame)),
                               Arrow('axis', p, p + RAY_LENGTH * axis)]
        if self.goal is None:
            return drawn
        T_root_goal = state.pose(self.reference).dot(self.goal_pose(state))
        direction, _ = self.aim.sight(state, self.goal)
        end = T_root_goal[:3, 3] if self.goal_type == 'point' else p + RAY_LENGTH * direction
        length = min(max(norm(end - p), RAY_LENGTH), MAX_CONE_LENGTH)
        return [*drawn, Triad('goal', T_root_goal), *arrow('sight', p, end),
                self.cone(state, direction, length)]

    def cone(self, state: RobotState, direction: Array, length: float) -> Sketch:
        """
        Return the cone about the direction to the goal (3,) whose surface contains the axis.

        Its half-angle is at least the tolerance.
        """
        turn = turn_between(self.axis_in_root(state), direction)
        angle = max(norm(turn), self.groups[0].tolerance)
        return Cone('cone', pose_along(direction, state.position(self.frame)),
                    min(angle, MAX_CONE_ANGLE), length)

    def is_compatible(self: SomeTask, other: Task) -> TypeGuard[SomeTask]:
        """Return whether goals of `other` are valid for this task."""
        return super().is_compatible(other) and self.frame == other.frame \
            and self.goal_type == other.goal_type and np.array_equal(self.axis, other.axis)


def _check_alone(target: str, reference: str | None, frame: str) -> None:
    """Raise ValueError if a target frame is `frame` itself, or a reference is given as well."""
    if target == frame:
        raise ValueError(f'a frame cannot point at itself: {target}')
    if reference is not None:
        raise ValueError('a frame as target is its own reference: leave the key reference out')
