# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Camera poses that fit all points into the picture."""

from dataclasses import dataclass

import numpy as np
from tp_controller.model.spatial import Array

# Vertical field of view of pictures and films [rad].
FILM_FOV = 0.6
# Margins as shares of the picture; a caption is at the bottom.
MARGIN_SIDE, MARGIN_TOP, MARGIN_BOTTOM = 0.05, 0.05, 0.12
# Initial view of a page: angles [deg], vertical field of view [rad], aspect ratio of the scene
# beside the panel and its edge in a window of 800 x 600, and minimum distance [m].
FIRST_ANGLES, FIELD_OF_VIEW, FIRST_ASPECT, MIN_DISTANCE = (-43.5, 21.7), 0.75, 0.685, 1.4
# Factors on the fitting distance, for goals around the robot and for mobile robots.
DISTANCE_FACTOR, MOBILE_DISTANCE_FACTOR = 1.15, 2.0


@dataclass(frozen=True, eq=False)
class Camera:
    """
    Pose of a camera.

    Attributes
    ----------
    position : ndarray (3,)
        [m]
    R : ndarray (3, 3)
        Axes of the camera in the root frame: right, down, forward.
    distance : float
        Distance to the mean depth of the points [m].

    """

    position: Array
    R: Array
    distance: float


def camera_for(points: Array, view: tuple[float, float], aspect: float,
               field: float = FILM_FOV) -> Camera:
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
        Vertical field of view [rad].

    Returns
    -------
    Camera

    """
    R = _axes(*np.radians(view))
    x, y, z = (points @ R).T
    half = np.tan(0.5 * field)
    # Tangents of the largest angles of points: to a side, up and down.
    side, up, down = (half * factor for factor in (
        aspect * (1.0 - 2.0 * MARGIN_SIDE), 1.0 - 2.0 * MARGIN_TOP, 1.0 - 2.0 * MARGIN_BOTTOM))
    left, right = (side * z + x).min(), (side * z - x).min()
    above, below = (up * z + y).min(), (down * z - y).min()
    # A camera at (X, Y, Z) sees a point if ``|x - X| <= side (z - Z)``, and so on.
    Z = min((left + right) / (2.0 * side), (above + below) / (up + down))
    X = 0.5 * (left - right)
    Y = 0.5 * ((above - up * Z) + (down * Z - below))
    return Camera(R @ (X, Y, Z), R, float(z.mean() - Z))


def first_view(points: Array, moves: bool = False) -> tuple[Array, Array]:
    """
    Return the initial camera of a page, for the field of view `FIELD_OF_VIEW`.

    Parameters
    ----------
    points : ndarray (k, 3)
        Points to show [m].
    moves : bool
        Whether the robot has a mobile base.

    Returns
    -------
    position, target : ndarray (3,)
        Position of the camera and the point it looks at [m].

    """
    camera = camera_for(points, FIRST_ANGLES, FIRST_ASPECT, FIELD_OF_VIEW)
    forward = camera.R[:, 2]
    target = camera.position + camera.distance * forward
    factor = MOBILE_DISTANCE_FACTOR if moves else DISTANCE_FACTOR
    return target - max(factor * camera.distance, MIN_DISTANCE) * forward, target


def _axes(azimuth: float, elevation: float) -> Array:
    """Return the axes (3, 3) of a camera that looks from a direction [rad]."""
    forward = -np.array([np.cos(elevation) * np.cos(azimuth),
                         np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.column_stack((right, np.cross(forward, right), forward))
