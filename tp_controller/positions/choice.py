# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Choice among configurations that reach the same goals."""

from collections.abc import Callable

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.positions.position_stack import PositionStack
from tp_controller.positions.search import Attempts, is_better
from tp_controller.tasks.task import norm

FULL_TURN = 2.0 * np.pi


def turning(robot: Robot) -> Array:
    """Return 1 for each position (n,) of a driven joint that turns, 0 for others."""
    found = np.zeros(robot.n)
    found[robot.joint_columns] = np.array(robot.joint_units) == 'rad'
    return found


def whole_turns(robot: Robot, q: Array, start: Array) -> Array:
    """
    Return the turns (count, joints) of driven joints that lead q towards `start`.

    Turns beyond the position limits are left out, and a joint that slides has none.

    Parameters
    ----------
    robot : Robot
        Robot with the limits.
    q, start : ndarray (count, nq), (count or 1, nq)
        Configurations [rad or m].

    """
    rows, columns = robot.joint_rows, robot.joint_columns
    turns = np.round((start[:, rows] - q[:, rows]) / FULL_TURN)
    if turns.any():
        moved = q[:, rows] + FULL_TURN * turns
        turns[(moved < robot.lower[columns]) | (moved > robot.upper[columns])] = 0.0
        turns[:, turning(robot)[columns] == 0.0] = 0.0
    return turns


def has_whole_turns(robot: Robot) -> bool:
    """Return whether the position limits of a joint are a whole turn apart."""
    columns = robot.joint_columns
    ranges = robot.upper[columns] - robot.lower[columns]
    return bool((ranges[turning(robot)[columns] > 0.0] >= FULL_TURN).any())


def unwound(tasks: PositionStack, found: Attempts, start: Array) -> Attempts:
    """Return a search whose joints are turned by whole turns towards `start`, if no task minds."""
    turns = whole_turns(tasks.robot, found.q[np.newaxis], start[np.newaxis])[0]
    if not turns.any():
        return found
    q = found.q.copy()
    q[tasks.robot.joint_rows] += FULL_TURN * turns
    # Joints that follow others, and goals of joints, may not be the same after a turn.
    costs = tasks.at(q).costs
    return found if is_better(found.costs, costs) else found._replace(q=q, costs=costs)


def _distance(tasks: PositionStack, q: Array, start: Array) -> float:
    """Return the distance from the start, of joints and the position of a base."""
    robot = tasks.robot
    base = robot.base_placement(q)[:3] - robot.base_placement(start)[:3]
    return norm(np.concatenate((base, q[robot.joint_rows] - start[robot.joint_rows])))


def _nearness_to_limits(tasks: PositionStack, q: Array, start: Array) -> float:
    """Return the least distance from a position limit as a share of the range, negative."""
    robot, columns = tasks.robot, tasks.robot.joint_columns
    lower, upper = robot.lower[columns], robot.upper[columns]
    limited = np.isfinite(upper - lower)
    joints, range_ = q[robot.joint_rows], np.where(limited, upper - lower, np.inf)
    share = np.minimum(joints - lower, upper - joints)[limited] / range_[limited]
    return -float(share.min(initial=1.0))


def _stiffness(tasks: PositionStack, q: Array, start: Array) -> float:
    """Return the manipulability of the first task with a goal, negative."""
    level = next((level for level in tasks.at(q).levels if level.v is not None), None)
    return 0.0 if level is None else -float(np.prod(np.linalg.svd(level.J, compute_uv=False)))


# What each criterion makes as small as it can, of tasks, configuration and start.
CRITERIA: dict[str, Callable[[PositionStack, Array, Array], float]] = {
    'nearest': _distance, 'manipulability': _stiffness, 'limits': _nearness_to_limits}
