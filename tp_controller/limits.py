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

"""Bounds on the joint velocities, from velocity and position limits."""

import numpy as np


def velocity_bounds(robot, q, braking_gain):
    """
    Return the velocities that every joint may have at `q`.

    The speed towards a position limit is at most `braking_gain` times the distance to it. With
    commands that act at once for at most 1/braking_gain seconds a limit is never crossed; with
    commands that act d periods late that holds for braking_gain · period ≤ d^d / (d+1)^(d+1),
    which is 0.25, 0.148 and 0.105 for d = 1, 2, 3. Outside its range a joint may only move
    inwards. Zero is always allowed.

    Parameters
    ----------
    robot : Robot
        Whose limits hold.
    q : ndarray (n,)
        Positions [rad or m].
    braking_gain : float
        [1/s]

    Returns
    -------
    lower, upper : ndarray (n,)
        Bounds [rad/s or m/s], lower ≤ 0 ≤ upper.

    """
    upper = np.minimum(robot.velocity, np.maximum(braking_gain * (robot.upper - q), 0.0))
    lower = np.maximum(-robot.velocity, np.minimum(braking_gain * (robot.lower - q), 0.0))
    return lower, upper
