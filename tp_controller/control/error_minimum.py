# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Errors of a task at other configurations of the robot than the present one."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.task import Evaluation, norm
from tp_controller.untrusted.calls import foreign

# Share of the demand of a task, or of its residual, above which a part of it is significant.
SIGNIFICANT_SHARE = 0.01
# Step of finite differences between two states [rad or m].
DIFFERENCE_STEP = 1e-5


class Place(NamedTuple):
    """
    Configuration of the robot in a cycle.

    Attributes
    ----------
    q : ndarray (nq,)
        Configuration [rad or m].
    passive : ndarray (p,) or None
        Positions of the passive joints; see `Robot.state`.
    now : float
        [s]
    spare : RobotState
        Scratch state for nearby configurations; the search for causes changes it.

    """

    q: Array
    passive: Array | None
    now: float
    spare: RobotState


def is_at_minimum(evaluation: Evaluation, robot: Robot, place: Place,
                  standing: Sequence[int] = ()) -> bool:
    """
    Return whether the error of a task is at a minimum; False if the task fails.

    Parameters
    ----------
    evaluation : Evaluation
        Evaluation of the task.
    robot : Robot
        Robot that it moves.
    place : Place
        Configuration of the robot.
    standing : sequence of int
        Joints that do not move.

    """
    try:
        with foreign:
            return _is_minimum(evaluation, robot, place, standing)
    except Exception:
        # A task type of another package may raise any exception.
        return False


def _is_minimum(evaluation: Evaluation, robot: Robot, place: Place,
                standing: Sequence[int]) -> bool:
    """
    Return whether the error of a task is at a minimum.

    Along all motions of the robot the gradient of ½ eᵀ K e has to vanish, and its Jacobian H
    has to be positive semidefinite. H must be symmetric: otherwise, as for a base that has to
    turn before it drives on, two alternating motions lead to a third that reduces the error.
    """
    task, (q, passive, now, state) = evaluation.task.probe(), place
    state.update(q, passive)
    state.still = standing
    motions_left = np.delete(np.eye(robot.n), list(standing), axis=0)

    def gradient() -> Array:
        level = task.evaluate(state, now).level
        return -motions_left.dot(level.J.T.dot(level.v))

    here = gradient()
    H = np.empty((len(here), len(here)))
    for column, motion in enumerate(motions_left):
        state.update(robot.integrate(q, motion, DIFFERENCE_STEP))
        H[:, column] = (gradient() - here) / DIFFERENCE_STEP
    # Tolerance that scales with H, which grows with the error.
    demand = norm(evaluation.level.v)
    least = SIGNIFICANT_SHARE * demand
    values, motions = np.linalg.eigh(0.5 * (H + H.T))
    along = motions.T.dot(here)
    to_gain = (along * along / np.maximum(values, least)).sum()
    return bool(values.min(initial=0.0) > -least and np.abs(H - H.T).max(initial=0.0) < least
                and to_gain <= SIGNIFICANT_SHARE * demand * norm(evaluation.error))
