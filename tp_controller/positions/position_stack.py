# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks of a stack at a configuration: errors in place of demands."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.positions.locked_robot import fixed
from tp_controller.solver.level import Level
from tp_controller.tasks.stack import levels_of, Stack
from tp_controller.tasks.task import Evaluation
from tp_controller.tasks.task_errors import attempt


class Point(NamedTuple):
    """
    Configuration of the robot, with the tasks evaluated there.

    Attributes
    ----------
    q : ndarray (nq,)
        Configuration [rad or m].
    positions : ndarray (n,)
        Positions that are subject to limits [rad or m].
    evaluations : list of list of Evaluation
        Tasks of each level.
    levels : list of Level
        Levels whose demand is the error, or whose bounds are those of a change of the value.
    errors : list of ndarray
        Error of each level: its demand, or the distance back to its bounds.
    costs : list of float
        Squared norms of these, with the weights of the rows, 0 where a level is met; 0 for
        objectives.

    """

    q: Array
    positions: Array
    evaluations: list[list[Evaluation]]
    levels: list[Level]
    errors: list[Array]
    costs: list[float]


class PositionStack:
    """
    Copies of the tasks of a stack whose demand is their whole error: the gain is 1.

    A change of the positions by x changes the values of a level by J x, so levels and bounds are
    those of a cycle of one second without acceleration or velocity limits. Tasks that demand a
    velocity have no error, and are left out.

    Parameters
    ----------
    robot : Robot
    stack : Stack
        Stack, which is not changed; disabled tasks are left out.

    Attributes
    ----------
    groups : tuple of tuple of Task
        Tasks of each level.
    objectives : tuple of bool
        Whether a level is made of objectives, which have a slope, not an error; its costs are 0.
    stack : Stack
        Stack of these copies.

    """

    def __init__(self, robot: Robot, stack: Stack) -> None:
        self.robot = robot
        groups = [[attempt(task, task.at_positions) for task in group if task.has_position]
                  for group in stack.active]
        self.stack = Stack([group for group in groups if group])
        self.groups = self.stack.active
        self.objectives = tuple([all(task.is_objective for task in group)
                                 for group in self.groups])
        self._state = robot.state(robot.neutral())
        self._state.still = np.flatnonzero(fixed(robot)).tolist()
        self._rows, self._columns = robot.joint_rows, robot.joint_columns
        self._lower, self._upper = robot.lower[self._columns], robot.upper[self._columns]

    def place(self, q: ArrayLike, passive: ArrayLike) -> RobotState:
        """Return the state at a configuration (nq,) and passive positions (p,), which stay."""
        self._state.update(q, passive)
        return self._state

    def at(self, q: Array) -> Point:
        """Return the point at a configuration (nq,)."""
        state = self._state
        state.update(q)
        for task in self.stack.active_tasks:
            attempt(task, task.forget_cycles)
        evaluations = self.stack.evaluate(state, 0.0)
        levels = levels_of(evaluations)
        errors = [_violation(group) if level.v is None else level.v
                  for level, group in zip(levels, evaluations)]
        return Point(state.q, state.positions, evaluations, levels, errors,
                     [0.0 if objective else cost(level, error)
                      for level, error, objective in zip(levels, errors, self.objectives)])

    def within_limits(self, q: Array) -> Array:
        """Return the configuration (nq,) within the position limits that is nearest to q."""
        q = np.array(q)
        q[self._rows] = np.clip(q[self._rows], self._lower, self._upper)
        return q

    def moved(self, point: Point, step: Array) -> Point:
        """Return the point after a change (n,) of the positions, within the position limits."""
        return self.at(self.within_limits(self.robot.integrate(point.q, step, 1.0)))


def _violation(evaluations: Sequence[Evaluation]) -> Array:
    """Return the distance back to the bounds of inequality tasks of one level (m,)."""
    return evaluations[0].error if len(evaluations) == 1 \
        else np.concatenate([each.error for each in evaluations])


def cost(level: Level, error: Array) -> float:
    """Return the squared norm of an error (m,) of a level, with its weights."""
    if level.weights is not None:
        error = level.root * error
    return float(error.dot(error))


def linear_cost(level: Level, error: Array, step: Array) -> float:
    """Return the cost of a level after a change (n,) of the positions, if J were constant."""
    moved = level.J.dot(step)
    if level.v is not None:
        left = error - moved
    else:
        # Outside, the distance back counts, not the part of it that one step may go.
        lower = np.where(error > 0.0, error, level.lower)
        upper = np.where(error < 0.0, error, level.upper)
        left = np.minimum(np.maximum(moved, lower), upper) - moved
    return cost(level, left)
