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

"""Bounds of a robot: corners and lowest point of the solids of its links."""

from collections.abc import Mapping, Sequence
from itertools import product
import math

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tools.view.parts import Part

# Signs of the corners of a box.
SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))


def corners(parts: Mapping[str, Sequence[Part]]) -> dict[str, Array]:
    """Return {link: points (k, 3)}: the corners of boxes around its parts, in its axes [m]."""
    return {link: np.concatenate([_corners(part) for part in each])
            for link, each in parts.items() if each}


def outer_points(state: RobotState, own: Mapping[str, Array]) -> Array:
    """
    Return points whose convex hull contains a robot.

    Parameters
    ----------
    state : RobotState
        State of the robot.
    own : mapping
        {link: points (k, 3) in its axes}, as `corners` returns them [m].

    Returns
    -------
    ndarray (k, 3)
        In the root frame [m]; empty for a robot without parts.

    """
    found = [np.zeros((0, 3))]
    for link, points in own.items():
        T = state.pose(link)
        found.append(points @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(found)


def lowest(state: RobotState, parts: Mapping[str, Sequence[Part]]) -> float:
    """Return the height of the lowest point of a robot [m]; infinite if it has no parts."""
    return min((_lowest(part, state.pose(link) @ part.T)
                for link, each in parts.items() for part in each), default=math.inf)


def _lowest(part: Part, T: Array) -> float:
    """Return the height of the lowest point of a part that is at a pose (4, 4) [m]."""
    up, size = T[2, :3], np.array(part.size)
    if part.mesh is not None:
        return float(T[2, 3] + (part.mesh.points @ (size * up)).min())
    if part.kind == 'box':
        depth = float(0.5 * size @ np.abs(up))
    elif part.kind == 'sphere':
        depth = float(np.linalg.norm(size * up))
    else:
        # Exact, not of the bounding box: a turned wheel stands on the same ground.
        depth = size[0] * math.hypot(up[0], up[1]) + 0.5 * size[1] * abs(up[2])
    return float(T[2, 3] - depth)


def _corners(part: Part) -> Array:
    """Return the corners (8, 3) of a box around a part, in the axes of its link [m]."""
    low, high = _box(part)
    points = 0.5 * (low + high) + 0.5 * (high - low) * SIGNS
    return points @ part.T[:3, :3].T + part.T[:3, 3]


def _box(part: Part) -> tuple[Array, Array]:
    """Return the lower and upper corner (3,) of a box around a part, in its own axes [m]."""
    size = np.array(part.size)
    if part.mesh is not None:
        ends = size * part.mesh.points.min(axis=0), size * part.mesh.points.max(axis=0)
        return np.minimum(*ends), np.maximum(*ends)
    if part.kind == 'box':
        half = 0.5 * size
    elif part.kind == 'sphere':
        half = size * np.ones(3)
    else:
        half = np.array([size[0], size[0], 0.5 * size[1]])
    return -half, half
