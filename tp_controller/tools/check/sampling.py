# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Random configurations of a robot."""

import math

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, rotation_from_vector

# What a joint without limits is sampled over, and how far a base is moved, to both sides
# [rad or m].
SPAN = {'rad': math.pi, 'm': 1.0}


def random_configuration(robot: Robot, random: np.random.Generator, around: Array,
                         far: float = 1.0) -> Array:
    """
    Return a configuration, uniform within the limits.

    A joint that turns without end is sampled over one turn, a slide without limits over 2 m; one
    with a single limit over as much from there. A base is moved by up to a metre along each axis
    that it can be moved along, and turned by any angle about each that it can be turned about.

    Parameters
    ----------
    robot : Robot
        Whose limits they are.
    random : numpy.random.Generator
        What it is drawn from.
    around : ndarray (nq,)
        A configuration, which a base is moved from.
    far : float
        How much of the way from there to a uniform configuration, in [0, 1].

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


def _ranges(lower: Array, upper: Array, units: tuple[str, ...]) -> tuple[Array, Array]:
    """Return what joints are sampled over: from, to."""
    span = np.array([SPAN[unit] for unit in units])
    above = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2.0 * span,
                                                         -span))
    return above, np.where(np.isfinite(upper), upper, above + 2.0 * span)


def _random_pose(robot: Robot, random: np.random.Generator, around: Array, far: float) -> Array:
    """Return a pose of the base (4, 4) near where it is in a configuration."""
    T = robot.state(around).pose(robot.base_frame).copy()
    moved = far * random.uniform(-SPAN['m'], SPAN['m'], 3)
    angle = far * random.uniform(-SPAN['rad'], SPAN['rad'])
    axis = random.standard_normal(3) if 3 in robot.base_reach else np.array([0.0, 0.0, 1.0])
    T[:3, 3] += np.where(np.isin(range(3), robot.base_reach), moved, 0.0)
    if 5 in robot.base_reach:
        T[:3, :3] = rotation_from_vector(angle * axis / np.linalg.norm(axis)) @ T[:3, :3]
    return T
