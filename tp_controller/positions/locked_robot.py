# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robot whose locked joints stay where they are, for searches of configurations."""

from collections.abc import Collection
from copy import copy

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.model.joint_groups import check_velocities
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array


def with_locks(robot: Robot, locked: Collection[str], q: ArrayLike) -> Robot:
    """
    Return a robot that leaves locked joints, or velocities of its base, as they are.

    Parameters
    ----------
    robot : Robot
        Robot with all its position limits.
    locked : collection of str
        Names among `Robot.velocity_names`.
    q : array_like (nq,)
        Configuration with their positions [rad or m], which become both position limits.

    Raises
    ------
    RobotError
        A name is unknown, or `q` is no configuration.

    """
    check_velocities(locked, robot.velocity_names)
    if not locked:
        return robot
    found, positions = copy(robot), robot.state(q).positions
    fixed = np.isin(np.array(robot.velocity_names), list(locked))
    found.lower = np.where(fixed, positions, robot.lower)
    found.upper = np.where(fixed, positions, robot.upper)
    return found


def fixed(robot: Robot) -> Array:
    """Return whether the position limits of each velocity (n,) leave it no range."""
    return np.asarray(robot.lower == robot.upper)
