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

"""A camera that has everything in its picture."""

from dataclasses import dataclass

import numpy as np
from tp_controller.model.spatial import Array

# Vertical angle of the view [rad].
FIELD = 0.6
# How much of the picture stays free beside, above and below what is seen; a caption is below.
FREE_SIDE, FREE_TOP, FREE_BOTTOM = 0.05, 0.05, 0.12
# Of the first view of a page: its angles [deg] and field [rad]; width per height of the scene of a
# window of 800 x 600 beside the panel; and how near it is at most [m].
FIRST_ANGLES, FIELD_OF_VIEW, FIRST_ASPECT, NEAREST = (-43.5, 21.7), 0.75, 0.69, 1.4
# How much farther away it is than need be: goals are around a robot, and a moving one goes there.
FARTHER, MUCH_FARTHER = 1.15, 2.0


@dataclass(frozen=True, eq=False)
class Camera:
    """
    From where a picture is taken.

    Attributes
    ----------
    position : ndarray (3,)
        [m]
    R : ndarray (3, 3)
        Axes of the camera in the root: to the right, down, forward.
    distance : float
        To the middle of what is seen [m].

    """

    position: Array
    R: Array
    distance: float


def camera_for(points: Array, view: tuple[float, float], aspect: float,
               field: float = FIELD) -> Camera:
    """
    Return the nearest camera that sees all points.

    Parameters
    ----------
    points : ndarray (k, 3)
        [m]
    view : tuple of float
        Azimuth and elevation of the camera, seen from the points [deg].
    aspect : float
        Width per height of the picture.
    field : float
        Vertical angle of the view [rad].

    Returns
    -------
    Camera

    """
    R = _axes(*np.radians(view))
    x, y, z = (points @ R).T
    half = np.tan(0.5 * field)
    # Tangents of the angles up to which points may be: to a side, up and down.
    side, up, down = (half * factor for factor in (
        aspect * (1.0 - 2.0 * FREE_SIDE), 1.0 - 2.0 * FREE_TOP, 1.0 - 2.0 * FREE_BOTTOM))
    left, right = (side * z + x).min(), (side * z - x).min()
    above, below = (up * z + y).min(), (down * z - y).min()
    # A camera at (X, Y, Z) sees a point if ``|x - X| <= side (z - Z)``, and so on.
    Z = min((left + right) / (2.0 * side), (above + below) / (up + down))
    X = 0.5 * (left - right)
    Y = 0.5 * ((above - up * Z) + (down * Z - below))
    return Camera(R @ (X, Y, Z), R, float(z.mean() - Z))


def first_view(points: Array, moves: bool = False) -> tuple[Array, Array]:
    """
    Return from where a page shows a robot when it opens, with the field `FIELD_OF_VIEW`.

    Parameters
    ----------
    points : ndarray (k, 3)
        That are to be seen [m].
    moves : bool
        Whether the robot is going to leave its place.

    Returns
    -------
    position, target : ndarray (3,)
        Of the camera, and what it looks at [m].

    """
    camera = camera_for(points, FIRST_ANGLES, FIRST_ASPECT, FIELD_OF_VIEW)
    forward = camera.R[:, 2]
    target = camera.position + camera.distance * forward
    farther = MUCH_FARTHER if moves else FARTHER
    return target - max(farther * camera.distance, NEAREST) * forward, target


def _axes(azimuth: float, elevation: float) -> Array:
    """Return the axes (3, 3) of a camera that looks from a direction [rad]."""
    forward = -np.array([np.cos(elevation) * np.cos(azimuth),
                         np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.column_stack((right, np.cross(forward, right), forward))
