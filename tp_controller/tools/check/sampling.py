# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Random configurations of a robot."""

import math

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, rotation_from_vector
from tp_controller.solver.level import Mask

# Half of the range over which a joint without limits is sampled, and by which a base is moved
# [rad or m]. Limits farther away than so many times that count as none.
SPAN = {'rad': math.pi, 'm': 1.0}
MOST_SPANS = 1e3


def random_configuration(robot: Robot, random: np.random.Generator, around: Array,
                         far: float = 1.0) -> Array:
    """
    Return a random configuration, uniform within the limits.

    A continuous joint is sampled over one turn, a prismatic joint without limits over 2 m; a joint
    with a single limit over the same range from there. A base is translated by up to a metre along
    each axis that it can move along, and rotated by any angle about each that it can rotate about.

    Parameters
    ----------
    robot : Robot
        Robot with these limits.
    random : numpy.random.Generator
        Random number generator.
    around : ndarray (nq,)
        Configuration from which a base is moved.
    far : float
        Share of the distance from there to a uniform configuration, in [0, 1].

    Returns
    -------
    ndarray (nq,)

    """
    columns = robot.joint_columns
    lower, upper = _ranges(robot.lower[columns], robot.upper[columns], robot.joint_units)
    joints = around[robot.joint_rows]
    joints = joints + far * (random.uniform(lower, upper) - joints)
    if not robot.moves:
        return robot.configuration(joints)
    return robot.configuration(joints, _random_pose(robot, random, around, far))


def moved_from(robot: Robot, around: Array, q: Array, moved: Mask) -> Array:
    """
    Return a configuration (nq,) with some joints as in `q` and the others as in `around`.

    `moved` (n,) marks the velocities of the former; a base is as in `q` if it has one of them.
    """
    found, columns, rows = q.copy(), robot.joint_columns, robot.joint_rows
    found[rows] = np.where(moved[columns], q[rows], around[rows])
    if not moved[:columns.start].any():
        found[:rows.start] = around[:rows.start]
    return found


def _ranges(lower: Array, upper: Array, units: tuple[str, ...]) -> tuple[Array, Array]:
    """Return the sampling ranges of joints: from, to."""
    span = np.array([SPAN[unit] for unit in units])
    lower, upper = (np.where(np.abs(limit) < MOST_SPANS * span, limit, np.copysign(np.inf, limit))
                    for limit in (lower, upper))
    above = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2.0 * span,
                                                         -span))
    return above, np.where(np.isfinite(upper), upper, above + 2.0 * span)


def _random_pose(robot: Robot, random: np.random.Generator, around: Array, far: float) -> Array:
    """Return a random pose of the base (4, 4) near that in a configuration."""
    T = robot.state(around).pose(robot.base_frame).copy()
    moved = far * random.uniform(-SPAN['m'], SPAN['m'], 3)
    angle = far * random.uniform(-SPAN['rad'], SPAN['rad'])
    axis = random.standard_normal(3) if 3 in robot.base_reach else np.array([0.0, 0.0, 1.0])
    T[:3, 3] += np.where(np.isin(range(3), robot.base_reach), moved, 0.0)
    if 5 in robot.base_reach:
        T[:3, :3] = rotation_from_vector(angle * axis / np.linalg.norm(axis)) @ T[:3, :3]
    return T
