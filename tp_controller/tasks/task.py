# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Base class of tasks: error, Jacobian, and the control law from error to velocity."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
import math
from typing import Any, ClassVar, TypeGuard, TypeVar

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.level import Level
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.keys import DEFAULT_TOLERANCE, finite_vector, Keys, positive
from tp_controller.tasks.sketch import arrow, frame_and_goal, Sketch
from tp_controller.tasks.twin_holder import EVALUATION_METHODS, TwinHolder
from tp_controller.tasks.yaml_keys import DEFAULT_GAIN, DEFAULT_MODE, DEFAULT_TIMEOUT

# Types of other packages may import `Keys` and the like from here.
__all__ = [
    'DEFAULT_GAIN', 'DEFAULT_MODE', 'DEFAULT_TIMEOUT', 'DEFAULT_TOLERANCE', 'Evaluation',
    'finite_vector', 'Goal', 'Keys', 'norm', 'positive', 'Task']

SomeTask = TypeVar('SomeTask', bound='Task')


@dataclass(slots=True, eq=False)
class Evaluation:
    """
    Evaluation of a task in one cycle, for the solver and the report.

    Attributes
    ----------
    task : Task
        Task, with its constant name, units and tolerances.
    level : Level
        Demand of the task.
    error : ndarray (rows,)
        Error, in the units of the task.
    row_names : sequence of str
        Name of each row; empty if the name of the task is enough.

    """

    task: 'Task'
    level: Level
    error: Array
    row_names: Sequence[str] = ()


class Task(TwinHolder):
    """
    Base class of the tasks of a stack: a value σ(q) with a goal, or a desired velocity.

    Conventions, for all tasks: ``error = desired − actual``, ``J = ∂σ/∂q``, and the desired
    velocity is ``v = v_feed_forward + K error`` with the gain K in 1/s (lecture 1.1; wiki [1]), so
    that an error that the robot can follow decays as exp(−K t).

    A subclass sets `type_name`, which registers it, declares its keys with ``yaml_key``, and
    implements `value`, `error`, `jacobian` and `parse_goal`. A type whose error and Jacobian share
    a calculation overrides `make_evaluation`.

    Attributes
    ----------
    name, goal, has_default_goal, reference, goal_type, goal_types, feed_forward_type :
        See ``GoalHolder``.
    led :
        See ``TwinHolder``.
    gain, groups, timeout, mode, units, rows, needs, without, example, joint_mask :
        See ``KeyHolder``.
    sketch_parts : dict
        {part: it is always drawn} of the parts that `sketch` returns, without names of objects
        after a slash.
    bounded : bool
        The task is an inequality task, with bounds instead of a demand; see `BoundedTask`.
    row_names : sequence of str
        Name of each row, for the report; empty if the name of the task is enough.
    remarks : tuple of str
        Warnings for the user.
    every_joint : bool
        The Jacobian is the identity.
    row_scale : float
        Factor of the rows of the level. Singular values count as small or large in metres and
        radians per radian; rows that are short by nature are scaled to compare with those of a
        frame.
    has_position : bool
        The task has an error at rest; others demand or limit a velocity alone.
    is_objective : bool
        The error is the slope of an objective, not the way to a goal; see `GradientTask`.
    frame : str or None
        Frame of the robot that the task is about; None for no frame or several.
    owner : object or None
        Mark of the controller that uses or used the task; see `Stack.check_owner`.

    """

    types: ClassVar[dict[str, type['Task']]] = {}
    frame: str | None = None
    bounded: ClassVar[bool] = False
    row_names: Sequence[str] = ()
    remarks: tuple[str, ...] = ()
    row_scale = 1.0
    every_joint = False
    has_position: ClassVar[bool] = True
    is_objective: ClassVar[bool] = False
    owner: object = None
    sketch_parts: ClassVar[Mapping[str, bool]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        """Register the type."""
        super().__init_subclass__(**options)
        # A subclass that only inherits the name does not replace that type.
        if vars(cls).get('type_name'):
            Task.types[cls.type_name] = cls
        if EVALUATION_METHODS & vars(cls).keys() and 'make_twin' not in vars(cls):
            cls.make_twin = Task.make_twin  # type: ignore[method-assign]
        if cls.level is not Task.level:
            # Set on the class, not on a task.
            cls.evaluate = Task._evaluate_around_level  # type: ignore[method-assign]

    # Definition of a type

    @abstractmethod
    def error(self, state: RobotState) -> Array:
        """Return desired − actual (rows,), in `units`."""

    @abstractmethod
    def jacobian(self, state: RobotState) -> Array:
        """Return J (rows, n), with the velocity J q_dot of the value."""

    def make_evaluation(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` at a state."""
        error = self.error(state)
        return Evaluation(
            self, Level(self.jacobian(state), self.velocity(error, now), self.mode,
                        is_identity=self.every_joint), error, self.row_names)

    # Sketches

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """
        Return the sketches of the task; none for a task without a frame.

        Called on a `probe`, outside the cycles.

        Parameters
        ----------
        state : RobotState
            State of the robot, which no cycle uses.

        Returns
        -------
        sequence of Sketch
            See `tp_controller.tasks.sketch`: by default the axes of the frame, and those of the
            goal if `goal_pose` returns one, with an arrow between both.

        """
        drawn, T_root_goal = self._frame_and_goal(state)
        if T_root_goal is None or self.frame is None:
            return drawn
        return [*drawn, *arrow('error', state.position(self.frame), T_root_goal[:3, 3])]

    def _frame_and_goal(self, state: RobotState) -> tuple[list[Sketch], Array | None]:
        """Return the sketches of frame and goal, and T_root_goal; see `frame_and_goal`."""
        if self.frame is None:
            return [], None
        # A task that has not started may have no goal.
        T_reference_goal = None if self.goal is None or self.reference is None \
            else self.goal_pose(state)
        return frame_and_goal(state, self.frame, self.reference, self.robot.root,
                              T_reference_goal)

    # One cycle

    def velocity(self, error: Array, now: float) -> Array:
        """
        Return the desired velocity, feed-forward + K error (lecture 1.1).

        Parameters
        ----------
        error : ndarray (rows,)
            Error, in `units`.
        now : float
            Time on the clock of `set_feed_forward` [s].

        Returns
        -------
        ndarray (rows,)
            Desired velocity, in `units` per second.

        """
        if self._feed_forward is None:
            return self.gain * error
        added = self.feed_forward(now)
        return self.gain * error if added is None else self.gain * error + self.in_rows(added)

    def evaluate(self, state: RobotState, now: float) -> Evaluation:
        """
        Return the `Evaluation` of the task in a cycle.

        Parameters
        ----------
        state : RobotState
            State of the robot.
        now : float
            Time [s].

        Returns
        -------
        Evaluation

        """
        return self.complete(self._evaluation_by_twin(state, now)
                             or self.make_evaluation(state, now))

    def complete(self, evaluation: Evaluation) -> Evaluation:
        """Return an evaluation of the task, whose level gets its joints and weights."""
        if self.joint_mask is not None:
            evaluation.level.joints = self.joint_mask
        if self.row_weights is not None:
            weights = self.row_weights
            # One number also stands for rows that change from cycle to cycle.
            evaluation.level.weights = np.full(len(evaluation.level.J), weights) \
                if weights.size == 1 else weights
        return evaluation

    def _evaluation_by_twin(self, state: RobotState, now: float) -> Evaluation | None:
        """Return the `Evaluation` by one compiled call; None where the reference is needed."""
        if self._feed_forward is not None:
            # Drop a velocity that has timed out.
            self.feed_forward(now)
        motion, twin = state.motion, self.twin
        if motion is None or twin is None:
            return None
        m, n = self.rows, self.robot.n
        error, J, v = np.empty(m), np.empty((m, n)), np.empty(m)
        upper = np.empty(m) if self.bounded else None
        if not twin.task.evaluate(motion, state.positions, state.velocity, now, error, J, v,
                                  upper):
            return None
        level = Level(J, v, self.mode, is_identity=self.every_joint) if upper is None else \
            Level(J, lower=v, upper=upper)
        return Evaluation(self, level, error, self.row_names)

    def row_names_of(self, keys: Array) -> Sequence[str]:
        """Return the names of the rows by the keys that a twin gives them; see `row_names`."""
        return self.row_names

    def level(self, state: RobotState, now: float) -> Level:
        """Return the `Level` alone; a type may override this in place of `make_evaluation`."""
        return self.make_evaluation(state, now).level

    def _evaluate_around_level(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` of a type that overrides `level`."""
        return self.complete(
            Evaluation(self, self.level(state, now), self.error(state), self.row_names))

    def probe(self: SomeTask) -> SomeTask:
        """Return an independent copy for evaluation outside the cycles."""
        return copy(self)

    def at_positions(self: SomeTask, gain: float = 1.0) -> SomeTask:
        """Return an independent copy that demands this share of the error, and nothing else."""
        other = self.probe()
        other.gain = np.full(other.rows, gain)
        other.forget_feed_forward()
        other.led = False
        return other

    def forget_cycles(self) -> None:
        """Drop the previous cycles, so that the next evaluation depends on the state alone."""

    def reported_errors(self, error: Array, residual: Array) -> tuple[tuple[float, str, float],
                                                                      ...]:
        """
        Return the errors for the report.

        Parameters
        ----------
        error : ndarray (rows,)
            Error of the value.
        residual : ndarray (rows,)
            Desired minus achieved velocity.

        Returns
        -------
        tuple of (float, str, float)
            For each unit: norm of the error, unit, tolerance.

        """
        return tuple((norm(error[rows]), unit, tolerance)
                     for rows, unit, tolerance in self.groups)

    # From one stack to the next

    def is_compatible(self: SomeTask, other: 'Task') -> TypeGuard[SomeTask]:
        """Return whether goals of `other` are valid for this task."""
        return type(self) is type(other) and self.reference == other.reference

    def inherit_goal(self, other: 'Task') -> None:
        """
        Inherit the goal of a task that this one replaces, unless this one has a goal.

        The feed-forward velocity belongs to the goal, and keeps its time of arrival.
        """
        if self.goal is None and self.is_compatible(other):
            self.goal, self.has_default_goal = other.goal, other.has_default_goal
            self._feed_forward = other._feed_forward
            self._feed_forward_time = other._feed_forward_time

    def is_equivalent(self, other: 'Task') -> bool:
        """Return whether the task has the same demand as `other` at every state and time."""
        return self is other or (
            self.is_compatible(other) and self.robot is other.robot
            and self._feed_forward_time == other._feed_forward_time
            and all(_equal(one, another) for one, another in zip(self._demand(), other._demand())))

    def _demand(self) -> tuple[object, object, object]:
        """Return the inputs of the level besides state and time: keys, goal and feed-forward."""
        return self._acting_keys(), self.goal, self._feed_forward


def norm(vector: Array) -> float:
    """Return the Euclidean norm as a float."""
    return math.sqrt(vector.dot(vector))


def _equal(one: Any, other: Any) -> bool:
    """Return whether keys or goals are equal; False if the comparison fails."""
    if one is other:
        return True
    try:
        equal = one == other
        return equal if isinstance(equal, bool) else bool(np.array_equal(one, other))
    except ValueError:
        return False
