# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks about the pose of a frame of the robot relative to another frame."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, TypeAlias, TypeGuard, TypeVar

import numpy as np
from tp_controller.errors import unknown
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, read_only, skew
from tp_controller.model.state import RobotState
from tp_controller.tasks.keys import finite_vector, has_shape, Keys
from tp_controller.tasks.task import Task
from tp_controller.tasks.twin import FRAME, make_twin, Twin
from tp_controller.tasks.yaml_keys import yaml_key

Axes: TypeAlias = str | Sequence[str]
SomeTask = TypeVar('SomeTask', bound='RelativeTask')
# Ways to a goal.
STRAIGHT, BY_POSTURE = APPROACHES = 'straight', 'posture'
TWIST_AXES: tuple[str, ...] = ('x', 'y', 'z', 'rx', 'ry', 'rz')


def frame_key(text: str) -> Any:
    """Declare a required key that names a frame of the robot; see `yaml_key`."""
    return yaml_key(text, parse_for=lambda task, frame: task.robot.check_frame(frame))


def reference_key(text: str) -> Any:
    """Declare a key that names a frame of the robot, by default the root; see `yaml_key`."""
    return yaml_key(text, default=None,
                    parse_for=lambda task, reference: parse_reference(task.robot, reference))


def parse_reference(robot: Robot, reference: str | None) -> str:
    """Return the frame named by a key `reference`, the root for None, or raise `RobotError`."""
    return robot.check_frame(robot.root if reference is None else reference)


def frame_and_reference(robot: Robot, frame: str, reference: str) -> tuple[int, int]:
    """Return two frames as inputs of a twin: their indices, -1 for the root as reference."""
    index = robot.kinematics.frame_index
    return index(frame), -1 if reference == robot.root else index(reference)


class RelativeFrame:
    """
    Frame of the robot relative to a reference frame, which may also move with the joints.

    Parameters
    ----------
    robot : Robot
    frame, reference : str
        Names of frames of the robot.

    """

    def __init__(self, robot: Robot, frame: str, reference: str) -> None:
        self._frame, self._reference = frame, reference
        self._in_root = reference == robot.root

    def position(self, state: RobotState) -> Array:
        """Return the origin of the frame (3,) [m], in the reference frame."""
        if self._in_root:
            return state.position(self._frame)
        return state.rotation(self._reference).T.dot(
            state.position(self._frame) - state.position(self._reference))

    def rotation(self, state: RobotState) -> Array:
        """Return R_reference_frame (3, 3)."""
        if self._in_root:
            return state.rotation(self._frame)
        return state.rotation(self._reference).T.dot(state.rotation(self._frame))

    def jacobian(self, state: RobotState) -> Array:
        """Return J (6, n) of the twist of the frame relative to the reference frame."""
        J_frame = state.jacobian(self._frame)
        if self._in_root:
            return J_frame
        # d/dt Rᵀ(p − p_ref) = Rᵀ(v − v_ref − ω_ref × (p − p_ref)); −ω × d = [d]× ω.
        J_reference = state.jacobian(self._reference)
        J = J_frame - J_reference
        between = state.position(self._frame) - state.position(self._reference)
        J[:3] += skew(between).dot(J_reference[3:])
        R_T = state.rotation(self._reference).T
        return np.concatenate((R_T.dot(J[:3]), R_T.dot(J[3:])))


class MovingGoalTask(Task):
    """Base class of tasks that accept a velocity of the goal, in the axes of the reference."""

    feed_forward_type = 'twist'
    # Rows of a twist (linear, then angular velocity) that the task controls.
    twist_rows: slice = slice(0, 6)

    def parse_feed_forward(self, velocity: Any) -> Array:
        """
        Return a twist (6,).

        Parameters
        ----------
        velocity : array_like (6,) or (3,)
            Linear then angular velocity [m/s, rad/s] in the axes of the reference frame; a type
            that controls one of them also accepts that part alone.

        Raises
        ------
        GoalError
            Wrong shape or not finite.

        """
        rows = slice(0, 6) if has_shape(velocity, (6,)) else self.twist_rows
        twist = np.zeros(6)
        twist[rows] = finite_vector(velocity, rows.stop - rows.start,
                                    f'the velocity of task {self.name!r}')
        return twist

    def feed_forward_in_reference(self, velocity: Array, R_reference_frame: Array) -> Array:
        """Rotate a twist (6,) from the axes of another frame to those of the reference."""
        return np.concatenate((R_reference_frame.dot(velocity[:3]),
                               R_reference_frame.dot(velocity[3:])))


class RelativeTask(Task):
    """Mixin of tasks about a frame relative to a reference frame; precedes the base class."""

    frame: str
    reference: str

    def set_up(self) -> None:
        """Prepare the motion of the frame relative to the reference."""
        super().set_up()
        self._motion = RelativeFrame(self.robot, self.frame, self.reference)

    def is_compatible(self: SomeTask, other: Task) -> TypeGuard[SomeTask]:
        """Return whether goals of `other` are valid for this task."""
        return super().is_compatible(other) and self.frame == other.frame


class FrameTask(RelativeTask, MovingGoalTask):
    """
    Base class of tasks about a frame, expressed in a reference frame of the robot.

    The reference may also move with the joints: value and Jacobian are then those of the
    relative motion.

    Attributes
    ----------
    frame, reference : str
        The frame, and the one that goals, errors and axes are expressed in.
    axes : tuple of str
        Selected axes of the reference frame, a subset of `axis_names`.
    counts : ndarray (6,)
        Mask of the selected rows of a twist.

    """

    sketch_parts = {'frame': True, 'goal': True, 'error': False}

    frame: str = frame_key('frame of the robot that the task moves')
    reference: str = reference_key(
        'frame that goals, errors and axes are expressed in (default: the root)')
    approach: str = yaml_key(
        'way of a node to a goal: straight, or posture: all joints along a straight line to the '
        'posture that inverse kinematics finds', default=STRAIGHT,
        parse_for=lambda task, approach: parse_approach(task.robot, approach), acts=False)
    axes: tuple[str, ...] = yaml_key(
        'axes of the reference frame that count (default: all)', default=None,
        parse_for=lambda task, axes: parse_axes(axes, task.axis_names()))

    def check_keys(self, keys: Keys) -> None:
        """Set rows and units, of all axes if the key has a fault."""
        super().check_keys(keys)
        self.axes = self.axes or self.axis_names()
        rows = [TWIST_AXES.index(axis) for axis in _twist_names(self.axes, self.twist_rows)]
        self.units = tuple('m' if row < 3 else 'rad' for row in rows)
        self.counts = np.isin(np.arange(6), rows)
        self._twist_rows = _selection(rows)
        self._mask = _selection([row - self.twist_rows.start for row in rows])

    @classmethod
    def axis_names(cls) -> tuple[str, ...]:
        """Return the names that `axes` may use."""
        names = TWIST_AXES[cls.twist_rows]
        return tuple(name[-1] for name in names) if len(names) == 3 else names

    @cached_property
    def _place(self) -> tuple[int, int, bytes]:
        """Return frame, reference and rows as inputs of a twin."""
        return (*frame_and_reference(self.robot, self.frame, self.reference),
                bytes(np.flatnonzero(self.counts).tolist()))

    @cached_property
    def reach(self) -> float:
        """Return an upper bound of the distance of the frame from its reference [m]."""
        return self.robot.reach(self.frame, self.reference)

    def position(self, state: RobotState) -> Array:
        """Return the origin of the frame (3,) [m], in the reference frame."""
        return self._motion.position(state)

    def rotation(self, state: RobotState) -> Array:
        """Return R_reference_frame (3, 3)."""
        return self._motion.rotation(state)

    def selected_place(self, place: Array, state: RobotState) -> Array:
        """Return a place (3,) with the coordinates of the frame along unselected axes [m]."""
        return np.where(self.counts[:3], place, self.position(state))

    def jacobian(self, state: RobotState) -> Array:
        """
        Return J (rows, n) of the twist of the frame relative to the reference frame.

        Its selected rows are those of lecture 3.2, 3.3 and lab exercise 2 [5].
        """
        return self._motion.jacobian(state)[self._twist_rows]

    def twin_with_goal(self) -> Twin | None:
        """Return the twin of a type whose error is the way from the frame to its goal."""
        if not isinstance(self.goal, np.ndarray):
            return None
        return make_twin(FRAME, self._law(), (*self._place, read_only(self.goal), self._turned()),
                         self.mode)

    def twin_of_velocity(self) -> Twin | None:
        """Return the twin of a type that demands a velocity alone."""
        return make_twin(FRAME, self._law(), (*self._place, None, None), self.mode)

    def _turned(self) -> Array | None:
        """Return the memory of the rotation error (4,); None for a type without one."""
        return None

    def in_rows(self, feed_forward: Array) -> Array:
        """Return the selected rows of a twist (6,)."""
        return feed_forward[self._twist_rows]

    def from_rows(self, velocity: Array) -> Array:
        """Return the twist (6,) of selected rows."""
        return spread(velocity, self._twist_rows)


def spread(velocity: Array, rows: slice | list[int]) -> Array:
    """Return the twist (6,) with velocities in some rows."""
    twist = np.zeros(6)
    twist[rows] = velocity
    return twist


def parse_approach(robot: Robot, value: object) -> str:
    """Return the way to a goal, or raise ValueError."""
    if not isinstance(value, str) or value not in APPROACHES:
        raise ValueError(unknown('approach', value, APPROACHES))
    if value == BY_POSTURE and robot.moves:
        raise ValueError(f'{BY_POSTURE} needs a robot whose base does not move')
    return value


def _selection(rows: list[int]) -> slice | list[int]:
    """Return the index of rows: a slice if they are consecutive, which avoids a copy."""
    without_gap = rows == list(range(rows[0], rows[-1] + 1))
    return slice(rows[0], rows[-1] + 1) if without_gap else rows


def _twist_names(axes: Sequence[str], rows: slice) -> list[str]:
    """Return the names in `TWIST_AXES` of axes of a type, in the order of `TWIST_AXES`."""
    names = TWIST_AXES[rows]
    return [name for name in names if name in axes or (len(names) == 3 and name[-1] in axes)]


def parse_axes(axes: Axes | None, valid: Sequence[str]) -> tuple[str, ...]:
    """Return the axes (tuple of str) of a string or list, all for None, or raise ValueError."""
    if axes is None:
        return tuple(valid)
    names = axes
    if isinstance(axes, str):
        words = axes.replace(',', ' ').split()
        names = [letter for word in words for letter in ([word] if word in valid else word)]
    if not isinstance(names, list) or not names or any(name not in valid for name in names):
        raise ValueError(f'needs some of {", ".join(valid)}, got {axes!r}')
    if len(set(names)) < len(names):
        raise ValueError(f'names an axis twice: {axes!r}')
    return tuple(axis for axis in valid if axis in names)
