# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Scalar objectives of the joints, maximized in the null space of the tasks above."""

from abc import abstractmethod
from typing import Any, TypeVar

import numpy as np
from tp_controller.errors import GoalError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.level import identity, Level
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.keys import Keys, positive, UnitRows
from tp_controller.tasks.task import Evaluation, norm, Task
from tp_controller.tasks.yaml_keys import gain_key, tolerance_key, yaml_key

SomeGradientTask = TypeVar('SomeGradientTask', bound='GradientTask')

# Default of the key `max_speed` [rad/s or m/s].
DEFAULT_SPEED = 0.5


class GradientTask(Task):
    """
    Base class of objectives h(q): the demand K ∂h/∂q is projected by the levels above.

    The gradient is a demand for a velocity of all joints, J = I. A single row J = ∂h/∂q would
    demand a rate of h: if the levels above leave only a small part of the gradient, the joints
    would race along it.

    A subclass implements `measure`.

    Parameters
    ----------
    robot, name, keys
        See `Task`.
    **given
        Values of keys.

    Attributes
    ----------
    max_speed : float
        Largest norm of the desired velocity [rad/s or m/s].

    """

    without = ('timeout',)
    every_joint = True
    is_objective = True

    max_speed: float = yaml_key('largest norm of the desired joint velocities', positive,
                                DEFAULT_SPEED, unit='rad/s or m/s')
    gain: Array = gain_key('gain K: joint velocity per slope of the objective')
    groups: tuple[UnitRows, ...] = tolerance_key(
        'joint speed along the gradient below which the maximum counts as reached',
        'rad/s or m/s')

    def __init__(self, robot: Robot, name: str, keys: Keys | None = None, **given: Any) -> None:
        # One unit for the norm over all joints.
        super().__init__(robot, name, ['rad'] * robot.n, keys, **given)

    @abstractmethod
    def measure(self, state: RobotState) -> tuple[float, Array]:
        """
        Return the objective and its gradient at a `RobotState`.

        Returns
        -------
        float
            h
        ndarray (n,)
            ∂h/∂q [1/rad or 1/m].

        """

    def slowdown(self, state: RobotState) -> Array | float:
        """Return the factor ≥ 1 (n,) that reduces the demand at high curvature of h."""
        return 1.0

    def value(self, state: RobotState) -> Array:
        """Return h (1,)."""
        return np.array([self.measure(state)[0]])

    def error(self, state: RobotState) -> Array:
        """Return the desired joint velocities (n,) [rad/s or m/s]."""
        desired = self.gain * self.measure(state)[1] / self.slowdown(state)
        speed = norm(desired)
        return desired if speed <= self.max_speed else desired * (self.max_speed / speed)

    def jacobian(self, state: RobotState) -> Array:
        """Return the identity (n, n)."""
        return identity(self.robot.n)

    def make_evaluation(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` at a state."""
        error = self.error(state)
        return Evaluation(self, Level.of_joints(error, self.mode), error)

    def at_positions(self: SomeGradientTask, gain: float = 1.0) -> SomeGradientTask:
        """Return a copy with its own gain, since the gradient is no error; see `Task`."""
        other = super().at_positions()
        other.gain = self.gain
        return other

    def start(self, state: RobotState) -> None:
        """Do nothing: there is no default goal."""

    def parse_goal(self, goal: Any) -> Goal:
        """Raise `GoalError`: the goal is the maximum."""
        raise GoalError(f'task {self.name!r} takes no goal: it maximizes an objective')

    def reported_errors(self, error: Array, residual: Array) -> tuple[tuple[float, str, float],
                                                                      ...]:
        """Return the joint speed along the gradient; see `Task`."""
        speed = norm(error)
        rate = float(error.dot(error - residual)) / speed if speed > 0.0 else 0.0
        (_, unit, tolerance), = self.groups
        # A decrease that the tasks above require does not count as reached either.
        return (abs(rate), f'{unit}/s', tolerance),
