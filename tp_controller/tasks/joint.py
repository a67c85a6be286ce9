# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks about joint positions and velocities (lecture 3.5; lab exercise 2 [4], [6])."""

from collections.abc import Sequence
import math
from typing import Any, ClassVar, TypeAlias, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import GoalError, unknown
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, read_only, wrap_angle
from tp_controller.model.state import RobotState
from tp_controller.solver.level import identity
from tp_controller.tasks.goal_remarks import looks_like_degrees
from tp_controller.tasks.keys import finite_vector, Keys
from tp_controller.tasks.task import Task
from tp_controller.tasks.twin import JOINTS, make_twin, Twin
from tp_controller.tasks.velocity import VelocityTask
from tp_controller.tasks.yaml_keys import REQUIRED, yaml_key

Joints: TypeAlias = str | Sequence[str]
# A number for each joint, or some by name.
ByJoint: TypeAlias = ArrayLike | dict[str, float]
SomeTask = TypeVar('SomeTask', bound='JointTask')


def joints_key(default: Any = REQUIRED) -> Any:
    """Declare the key `joints` of a type, see `yaml_key`; None stands for all driven joints."""
    return yaml_key('driven joint or group, or list of them, in the order of the rows',
                    default=default, parse_for=lambda task, joints: _joints(task.robot, joints))


def _joints(robot: Robot, joints: Joints | None) -> tuple[str, ...]:
    """Return the names of driven joints as a tuple, all for None; raise if invalid."""
    if joints is None:
        return tuple(robot.joint_names)
    listed = [joints] if isinstance(joints, str) else joints
    if not isinstance(listed, (list, tuple)) or not listed:
        raise ValueError(f'needs a driven joint or a list of them, got {joints!r}')
    names = [name for each in listed
             for name in (robot.groups.get(each, (each,)) if isinstance(each, str) else (each,))]
    for name in names:
        if name not in robot.joint_names:
            groups = [group for group, members in robot.groups.items()
                      if set(members) <= set(robot.joint_names)]
            raise ValueError(unknown('driven joint or group', name, [*groups, *robot.joint_names]))
    if len(set(names)) < len(names):
        raise ValueError(f'names a joint twice: {", ".join(names)}')
    return tuple(names)


class JointTask(Task):
    """
    Base class of tasks about driven joints; J has single-entry rows (lecture 3.5).

    Attributes
    ----------
    joints : tuple of str
        Joints in the order of the rows. The task may move others, too, unless they are excluded:
        below a pose, one joint of an arm can only move with the others.

    """

    needs = ('driven_joints',)
    feed_forward_type: ClassVar[str | None] = 'joint_velocities'

    joints: tuple[str, ...] = joints_key(None)
    # The word names the rows.
    used_joints = None

    def __init__(self, robot: Robot, name: str, keys: Keys | None = None,
                 joints: Any = REQUIRED, **given: Any) -> None:
        # A type of another package may pass the joints by place.
        if joints is not REQUIRED:
            given['joints'] = joints
        super().__init__(robot, name, keys=keys, **given)

    def check_keys(self, keys: Keys) -> None:
        """Set the units, of all joints if the key has a fault."""
        super().check_keys(keys)
        robot = self.robot
        self.joints = self.joints or robot.joint_names
        self._indices = np.array([robot.joint_index(joint) for joint in self.joints], dtype=int)
        self.units = tuple(robot.velocity_units[index] for index in self._indices)

    def weight_names(self) -> dict[str, list[int]]:
        """Return {name: indices of its rows} of joints, and of groups that have some of them."""
        rows = {joint: [row] for row, joint in enumerate(self.joints)}
        groups = {name: [rows[joint][0] for joint in joints if joint in rows]
                  for name, joints in self.robot.groups.items()}
        return {**{name: found for name, found in groups.items() if found}, **rows}

    def set_up(self) -> None:
        """Select the rows of the joints."""
        super().set_up()
        # False if the base moves as well.
        self.every_joint = self.joints == self.robot.velocity_names
        # Every cycle returns this array, hence read-only.
        self._jacobian = identity(self.robot.n)[self._indices]
        self._jacobian.setflags(write=False)

    def is_compatible(self: SomeTask, other: Task) -> TypeGuard[SomeTask]:
        """Return whether goals of `other` are valid for this task."""
        return super().is_compatible(other) and self.joints == other.joints

    def positions(self, state: RobotState) -> Array:
        """Return the positions of the joints (rows,) [rad or m]."""
        return state.positions if self.every_joint else state.positions[self._indices]

    def jacobian(self, state: RobotState) -> Array:
        """Return the rows of the identity (rows, n) that select the joints."""
        return self._jacobian

    def joints_twin(self, goal: Array | None, wraps: Array) -> Twin | None:
        """Return the twin with a goal (rows,), or a velocity alone, and joints that wrap."""
        return make_twin(JOINTS, self._law(), (
            self._indices.astype(float), self.every_joint, goal, wraps.astype(float)), self.mode)

    def parse_feed_forward(self, velocity: ByJoint) -> Array:
        """Return joint velocities (rows,), or raise `GoalError`."""
        return self.by_name(velocity, 0.0, f'the velocity of task {self.name!r}')

    def by_name(self, values: ByJoint, default: float, what: str) -> Array:
        """
        Return one number for each joint of the task.

        Parameters
        ----------
        values : array_like (rows,) or dict
            All numbers, or some by joint name.
        default : float
            Number of joints that a dict leaves out.
        what : str
            Name of the values in error messages.

        Raises
        ------
        GoalError
            A name is unknown, the shape is wrong or a number is not finite.

        """
        if not isinstance(values, dict):
            return finite_vector(values, len(self.joints), f'{what} ({", ".join(self.joints)})')
        for joint in values:
            if joint not in self.joints:
                raise GoalError(f'{what}: {unknown("joint", joint, self.joints)}')
        given = finite_vector(list(values.values()), len(values), what)
        vector = np.full(len(self.joints), default)
        vector[[self.joints.index(joint) for joint in values]] = given
        return vector


class Joint(JointTask):
    """
    Bring joints to positions: σ = q_i, error q_i,d − q_i (lecture 3.5).

    The goal is one position for each joint, or some by name; joints that a goal leaves out keep
    their goals. The default goal of a joint is its position at the start.
    """

    type_name = 'joint'
    goal_type = 'joints'
    example = {'joints': 'panda_joint1'}

    target: Any = yaml_key('goal at the start, {joint: position} or a list', default=None,
                           unit='rad or m')
    joints: tuple[str, ...] = joints_key()

    def check_keys(self, keys: Keys) -> None:
        """Set the target as the goal."""
        known = self.joints is not None
        super().check_keys(keys)
        if self.target is not None and known:
            self.goal = keys.check('target', self.parse_goal, self.target)

    def set_up(self) -> None:
        """Find the joints that turn without end."""
        super().set_up()
        self._wrapped = self.robot.continuous[self._indices]
        self._wraps = bool(self._wrapped.any())
        self._default_rows = np.zeros(self.rows, dtype=bool)

    def value(self, state: RobotState) -> Array:
        """Return the positions of the joints (rows,) [rad or m]."""
        return self.positions(state)

    def start(self, state: RobotState) -> None:
        """Set the positions of joints without a goal as their default goals."""
        if self.goal is None:
            self.goal = np.full(self.rows, math.nan)
        waiting = np.isnan(self.goal)
        self.goal = np.where(waiting, self.value(state), self.goal)
        self._default_rows = self._default_rows | waiting
        self.has_default_goal = bool(self._default_rows.any())

    def set_goal(self, goal: Array, now: float) -> None:
        """Set a goal; joints whose goals it changes no longer have a default goal."""
        if self.has_default_goal:
            # A copy may share the array.
            self._default_rows = self._default_rows & (goal == self.goal)
        super().set_goal(goal, now)
        self.has_default_goal = bool(self._default_rows.any())

    def reset(self) -> None:
        """Drop default goals."""
        if self.has_default_goal:
            self.goal = np.where(self._default_rows, math.nan, self.goal)

    def forget_goal(self) -> None:
        """Drop the goals of all joints."""
        super().forget_goal()
        self._default_rows = np.zeros(self.rows, dtype=bool)
        self.has_default_goal = False

    def inherit_goal(self, other: Task) -> None:
        """Inherit goals of a task that this one replaces, for joints without a goal."""
        if not self.is_compatible(other):
            return
        mine = np.full(self.rows, math.nan) if self.goal is None else self.goal
        taken = np.isnan(mine)
        if other.goal is not None:
            self.goal = np.where(taken, other.goal, mine)
            self._default_rows = taken & other._default_rows
            self.has_default_goal = bool(self._default_rows.any())
        if other._feed_forward is not None:
            self._feed_forward = np.where(taken, other._feed_forward, 0.0)
            self._feed_forward_time = other._feed_forward_time

    def error(self, state: RobotState) -> Array:
        """Return goal minus position (rows,); for continuous joints the shorter turn."""
        error = self.goal - self.positions(state)
        if self._wraps:
            error[self._wrapped] = wrap_angle(error[self._wrapped])
        return error

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        if not isinstance(self.goal, np.ndarray):
            return None
        return self.joints_twin(read_only(self.goal), self._wrapped)

    def parse_goal(self, goal: ByJoint) -> Array:
        """
        Return one position for each joint; NaN for a joint without a goal.

        Raises
        ------
        GoalError
            Wrong shape, unknown joint, not finite, or outside the joint's limits.

        """
        what = f'the goal of task {self.name!r}'
        given = self.by_name(goal, math.nan, what)
        for joint, index, value in zip(self.joints, self._indices, given):
            lower, upper = self.robot.lower[index], self.robot.upper[index]
            if value < lower or value > upper:
                unit = self.robot.velocity_units[index]
                hint = '; goals are in radians, not in degrees' \
                    if unit == 'rad' and looks_like_degrees(value, lower, upper) else ''
                raise GoalError(f'{what}: {joint} = {value:g} is outside its limits '
                                f'[{lower:g}, {upper:g}]{hint}')
        return given if self.goal is None else np.where(np.isnan(given), self.goal, given)


class Posture(Joint):
    """
    Bring all joints to a posture; as the last task it uses the remaining null space.

    It equals `joint` with all joints; no joint needs a goal.
    """

    type_name = 'posture'
    example = {}

    joints: tuple[str, ...] = joints_key(None)


class JointVelocity(VelocityTask, JointTask):
    """
    Move joints with desired velocities, as y in the null space (lecture 1.2; lab exercise 1 [2]).

    The goal is one velocity for each joint, or some by name [rad/s or m/s]. After a timeout the
    demand is zero.
    """

    type_name = 'joint_velocity'
    goal_type = 'joint_velocities'
    feed_forward_type = None
    without = ('gain', 'tolerance')

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        return self.joints_twin(None, np.zeros(self.rows))
