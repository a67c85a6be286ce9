# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Random postures of a robot."""

import math

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.positions.locked_robot import fixed

# Range of a joint without limits, and of each velocity of a base about the start [rad or m].
FREE_RANGE, BASE_RANGE = math.pi, 1.0


def random_postures(robot: Robot, start: Array, generator: np.random.Generator, count: int
                    ) -> Array:
    """
    Return random configurations (count, nq): joints within their limits, a base about `start`.

    Parameters
    ----------
    robot : Robot
        Robot with the limits.
    start : ndarray (nq,)
        Configuration [rad or m].
    generator : numpy.random.Generator
        Source of the numbers.
    count : int
        Number of configurations.

    """
    columns, rows = robot.joint_columns, robot.joint_rows
    lower, upper = robot.lower[columns], robot.upper[columns]
    drawn = generator.uniform(np.where(np.isfinite(lower), lower, -FREE_RANGE),
                              np.where(np.isfinite(upper), upper, FREE_RANGE),
                              (count, len(lower)))
    if not robot.moves:
        return drawn
    found = np.empty((count, robot.nq))
    still = fixed(robot)
    for q, joints in zip(found, drawn):
        velocity = np.zeros(robot.n)
        velocity[:columns.start] = generator.uniform(-BASE_RANGE, BASE_RANGE, columns.start)
        velocity[still] = 0.0
        q[:] = robot.integrate(start, velocity, 1.0)
        q[rows] = joints
    return found
