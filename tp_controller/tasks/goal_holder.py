# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goal of a task in force, and the feed-forward velocity that belongs to it."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
import math
from typing import Any, ClassVar, TypeAlias, TypeVar

from tp_controller.errors import GoalError
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState

# Each type has its own form: a point, a pose, a mapping of obstacles …
Goal: TypeAlias = Any
SomeHolder = TypeVar('SomeHolder', bound='GoalHolder')


class GoalHolder(ABC):
    """
    Holder of a goal and of a feed-forward velocity, and base class of `Task`.

    A subclass implements `value` and `parse_goal`. It overrides what depends on the form of its
    goals: their frames, remarks and places, and feed-forward velocities.

    Attributes
    ----------
    name : str
    timeout : float
        Time that a feed-forward velocity stays in force [s].
    goal : object or None
        Goal in force, as `parse_goal` returns it; None before the task has started.
    has_default_goal : bool
        The goal is the value of the task at its start, since no goal was set.
    reference : str or None
        Frame that goals are expressed in; None if they have no frame.
    goal_type, feed_forward_type : str or None
        Kind of goal or velocity that the task accepts: ``point``, ``direction``,
        ``quaternion``, ``pose``, ``joints``, ``joint_velocities``, ``obstacles`` or ``twist``.
    goal_types : tuple of str
        Possible values of `goal_type`, if a key decides.

    """

    goal_type: str | None = None
    goal_types: ClassVar[tuple[str, ...]] = ()
    feed_forward_type: ClassVar[str | None] = None
    reference: str | None = None
    goal: Goal
    timeout: float

    def __init__(self, name: str) -> None:
        self.name = name
        self.goal = None
        self.has_default_goal = False
        self._feed_forward: Array | None = None
        self._feed_forward_time = -math.inf

    @abstractmethod
    def value(self, state: RobotState) -> Array:
        """Return the actual value at a `RobotState`, in the form of a goal."""

    @abstractmethod
    def parse_goal(self, goal: Goal) -> Goal:
        """Return a goal in internal form, or raise `GoalError`."""

    def parse_goals(self, goals: Sequence[Goal]) -> Sequence[Goal]:
        """Return the goals of `parse_goal`, or raise `GoalError` for the first invalid one."""
        return [self.parse_goal(goal) for goal in goals]

    def goal_in_reference(self, goal: Goal, T_reference_frame: Array) -> Goal:
        """Transform a goal from another frame to the reference frame, or raise `GoalError`."""
        raise GoalError(f'a goal of task {self.name!r} is not expressed in a frame: leave it out')

    def out_of_reach(self, goal: Goal) -> str:
        """Return a remark if no posture of the robot reaches a goal; else an empty text."""
        return ''

    def goal_remarks(self, goal: Goal, converted: bool) -> tuple[str, ...]:
        """
        Return remarks on probable mistakes in a goal.

        Parameters
        ----------
        goal : object
            Goal in internal form.
        converted : bool
            The goal was given in a frame other than the reference.

        """
        return ()

    def goal_place(self, goal: Goal, state: RobotState) -> Array | None:
        """Return the position of the frame at a goal (3,) [m], in the reference, or None."""
        return None

    def with_goal(self: SomeHolder, goal: Goal) -> SomeHolder:
        """Return an independent copy with a goal, for trials."""
        tried = copy(self)
        tried.goal = goal
        return tried

    def goal_pose(self, state: RobotState) -> Array | None:
        """
        Return T_reference_goal (4, 4) for display; None if the goal is not a place.

        Along and about unselected axes it has the current pose of the frame.
        """
        return None

    def set_goal(self, goal: Goal, now: float) -> None:
        """Set a goal, as `parse_goal` returned it."""
        self.goal = goal
        self.has_default_goal = False

    def start(self, state: RobotState) -> None:
        """Set the current value of the task as the default goal, unless there is a goal."""
        if self.goal is None:
            self.goal = self.value(state)
            self.has_default_goal = True

    def reset(self) -> None:
        """Drop a default goal; the next start sets a new one."""
        if self.has_default_goal:
            self.goal = None

    def forget_goal(self) -> None:
        """Drop the goal; the next start sets a default goal."""
        if self.goal is not None:
            self.goal, self.has_default_goal = None, True

    def parse_feed_forward(self, velocity: Any) -> Array:
        """Return a velocity in internal form, or raise `GoalError`."""
        raise GoalError(f'task {self.name!r} takes no feed-forward velocity')

    def feed_forward_in_reference(self, velocity: Array, R_reference_frame: Array) -> Array:
        """Rotate a velocity from the axes of another frame, or raise `GoalError`."""
        raise GoalError(f'a velocity of task {self.name!r} is not expressed in a frame: '
                        'leave it out')

    def set_feed_forward(self, velocity: Array, now: float) -> None:
        """Set a velocity, as `parse_feed_forward` returned it, until it times out."""
        self._feed_forward = velocity
        self._feed_forward_time = now

    def forget_feed_forward(self) -> None:
        """Drop the feed-forward velocity."""
        self._feed_forward = None

    def feed_forward(self, now: float) -> Array | None:
        """Return the feed-forward velocity in force; None if it is absent or timed out."""
        # A clock that was set back must not extend an old velocity either.
        if self._feed_forward is not None and \
                not abs(now - self._feed_forward_time) <= self.timeout:
            self._feed_forward = None
        return self._feed_forward

    def in_rows(self, feed_forward: Array) -> Array:
        """Return the components of a feed-forward velocity along the rows (rows,)."""
        return feed_forward

    def from_rows(self, velocity: Array) -> Array:
        """Return a velocity of the rows (rows,) in the form of a feed-forward velocity."""
        return velocity
