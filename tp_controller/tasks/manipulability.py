# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Manipulability of a frame, as a measure of distance to singularities, and its tasks."""

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.bounded import BoundedTask
from tp_controller.tasks.frame import Axes, frame_key, parse_axes, TWIST_AXES
from tp_controller.tasks.gradient import GradientTask
from tp_controller.tasks.keys import positive
from tp_controller.tasks.task import Task
from tp_controller.tasks.yaml_keys import yaml_key

# Least w of the logarithm and its gradient, in metres and radians.
MIN_MANIPULABILITY = 1e-6


class Mobility:
    """
    Yoshikawa's manipulability w = √det(J Jᵀ) of some rows of a frame's Jacobian.

    Joints that stand still, such as locked ones, have no column in J.

    Parameters
    ----------
    robot : Robot
    frame : str
    rows : list of int
        Selected rows of the Jacobian (6, n), at most as many as joints.

    References
    ----------
    wiki, Measures of Manipulability; wiki, Manipulability Gradient Estimation.

    """

    def __init__(self, robot: Robot, frame: str, rows: list[int]) -> None:
        self._frame, self._rows = frame, rows
        self._own = np.eye(len(rows), dtype=bool)
        self._weights = np.zeros((6, robot.n))

    def measure(self, state: RobotState) -> tuple[float, Array]:
        """
        Return the measure and its gradient, ∂w/∂q_k = w tr(J⁺ ∂J/∂q_k).

        Returns
        -------
        float
            w, the product of the singular values.
        ndarray (n,)
            ∂w/∂q.

        """
        # A copy.
        J, still = state.jacobian(self._frame)[self._rows], list(state.still)
        J[:, still] = 0.0
        U, s, V_T = np.linalg.svd(J, full_matrices=False)
        # w J⁺ without a division by singular values, which are zero at a singularity.
        others = np.where(self._own, 1.0, s).prod(axis=1)
        self._weights[self._rows] = (U * others).dot(V_T)
        self._weights[:, still] = 0.0
        return float(np.prod(s)), state.jacobian_gradient(self._frame, self._weights)


class MobilityTask(Task):
    """Mixin of tasks about the manipulability of a frame; precedes the base class."""

    sketch_parts = {'frame': True}

    frame: str = frame_key('frame of the robot whose manipulability is measured')
    _axis_rows: list[int] = yaml_key(
        'axes of the root that count, of x y z rx ry rz (default: all)', default=None,
        parse_for=lambda task, axes: _rows(task.robot, axes), name='axes')

    def set_up(self) -> None:
        """Select the rows of the Jacobian."""
        super().set_up()
        self._mobility = Mobility(self.robot, self.frame, self._axis_rows)


class Manipulability(MobilityTask, GradientTask):
    """
    Maximize the manipulability of a frame: the joints move away from singularities.

    The objective is ln w; its gradient does not depend on the size of the robot.
    """

    type_name = 'manipulability'
    example = {'frame': 'panda_hand_tcp'}

    def measure(self, state: RobotState) -> tuple[float, Array]:
        """Return ln w and its gradient (n,), zero for joints that stand still."""
        w, gradient = self._mobility.measure(state)
        gradient[list(state.still)] = 0.0
        w = max(w, MIN_MANIPULABILITY)
        return float(np.log(w)), gradient / w


class ManipulabilityAbove(MobilityTask, BoundedTask):
    """
    Keep the manipulability of a frame above a minimum: no singularities (lecture 3.1).

    The only row is w / minimum, with the lower bound 1.
    """

    type_name = 'manipulability_above'
    example = {'frame': 'panda_hand_tcp', 'minimum': 0.05}
    units = ('1',)

    minimum: float = yaml_key(
        'the least √det(J Jᵀ), J in metres and radians; compare it with the value of a good '
        'posture', positive)

    def set_up(self) -> None:
        """Set the bound."""
        super().set_up()
        self.lower, self.upper = np.ones(1), np.full(1, np.inf)

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return w / minimum (1,) and its gradient (1, n)."""
        w, gradient = self._mobility.measure(state)
        return np.array([w / self.minimum]), gradient[np.newaxis] / self.minimum


def _rows(robot: Robot, axes: Axes | None) -> list[int]:
    """Return the rows of a Jacobian for axes, or raise ValueError."""
    rows = [TWIST_AXES.index(axis) for axis in parse_axes(axes, TWIST_AXES)]
    if len(rows) > robot.n:
        raise ValueError(f'{robot.n} joints cannot move along {len(rows)} axes: name at most '
                         f'{robot.n}')
    return rows
