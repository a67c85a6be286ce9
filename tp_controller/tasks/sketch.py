# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Sketches of tasks: plain values in the root frame, without ROS.

Each has a `part`, its meaning in the task: ``goal``, ``frame``, ``error`` … Parts of the same
kind of several objects have a name after a slash, as ``obstacle/box``.
"""

from dataclasses import dataclass
import math
from typing import TypeAlias

import numpy as np
from tp_controller.model.shapes import Shape
from tp_controller.model.spatial import Array, rotation_from_vector
from tp_controller.model.state import RobotState

# Length of the axes of a frame, and of an axis that points in a direction [m].
AXES_LENGTH, RAY_LENGTH = 0.08, 0.3
# Least length of a drawn arrow [m], and least turn of a drawn arc [rad].
MIN_ARROW_LENGTH, MIN_ARC_TURN = 1e-3, 5e-3
# Number of straight segments of an arc.
ARC_SEGMENTS = 12
# Least slope of a line with its label below it, since the arrow that drags it then points up.
STEEP_SLOPE = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Triad:
    """
    The three axes of a frame.

    Attributes
    ----------
    part : str
    T : ndarray (4, 4)
        T_root_frame.

    """

    part: str
    T: Array


@dataclass(frozen=True, slots=True, eq=False)
class Dot:
    """
    A point without axes.

    Attributes
    ----------
    part : str
    p : ndarray (3,)
        [m]

    """

    part: str
    p: Array


@dataclass(frozen=True, slots=True, eq=False)
class Arrow:
    """
    An arrow.

    Attributes
    ----------
    part : str
    start, end : ndarray (3,)
        [m]

    """

    part: str
    start: Array
    end: Array


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """
    A line through points.

    Attributes
    ----------
    part : str
    points : ndarray (k, 3)
        At least two [m].

    """

    part: str
    points: Array


@dataclass(frozen=True, slots=True, eq=False)
class Cone:
    """
    A cone about the z axis of a pose, with its tip at the origin.

    Attributes
    ----------
    part : str
    T : ndarray (4, 4)
        T_root_cone.
    half_angle : float
        Angle between the axis and the surface, less than π [rad].
    length : float
        Distance from the tip to the rim [m].

    """

    part: str
    T: Array
    half_angle: float
    length: float


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """
    A shape.

    Attributes
    ----------
    part : str
    T : ndarray (4, 4)
        T_root_shape.
    shape : object
        One of `tp_controller.model.shapes`.
    allowed : bool
        The robot may be inside.

    """

    part: str
    T: Array
    shape: Shape
    allowed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Gaps:
    """
    Lines between the nearest points of pairs of objects.

    Attributes
    ----------
    part : str
    starts, ends : ndarray (m, 3)
        The nearest points [m].
    distances : ndarray (m,)
        Distances of the points, negative for overlapping objects [m].
    least, within : float
        Least distance allowed, and distance below which a pair counts as near [m].

    """

    part: str
    starts: Array
    ends: Array
    distances: Array
    least: float
    within: float


Sketch: TypeAlias = Triad | Dot | Arrow | Path | Cone | Body | Gaps


def arrow(part: str, start: Array, end: Array) -> list[Sketch]:
    """Return an arrow between two points (3,); nothing if it is too short to see."""
    way = end - start
    return [Arrow(part, start, end)] if math.sqrt(way.dot(way)) >= MIN_ARROW_LENGTH else []


def arc(part: str, p: Array, tips: Array, turn: Array) -> list[Sketch]:
    """
    Return the path of the tip that a turn moves most; nothing if the turn is too small to see.

    Parameters
    ----------
    part : str
        Part of the task.
    p : ndarray (3,)
        Centre of the turn [m].
    tips : ndarray (k, 3)
        Tips relative to the centre [m].
    turn : ndarray (3,)
        Rotation vector [rad].

    """
    if math.sqrt(turn.dot(turn)) < MIN_ARC_TURN:
        return []
    moved = np.cross(turn, tips)
    tip = tips[(moved * moved).sum(axis=1).argmax()]
    return [Path(part, np.array([p + rotation_from_vector(share * turn).dot(tip)
                                 for share in np.linspace(0.0, 1.0, ARC_SEGMENTS + 1)]))]


def frame_and_goal(state: RobotState, frame: str, reference: str | None, root: str,
                   T_reference_goal: Array | None) -> tuple[list[Sketch], Array | None]:
    """
    Return the common part of the sketches of tasks about a frame.

    Parameters
    ----------
    state : RobotState
        State with the poses of the frames.
    frame, reference, root : str
        Frame of the task, the one that its goals are expressed in, if any, and the root.
    T_reference_goal : ndarray (4, 4) or None
        Goal; None if it is not a place.

    Returns
    -------
    list of Sketch
        Axes of the frame and the goal, and a line from a reference that is not the root.
    ndarray (4, 4) or None
        T_root_goal; None if the goal is not a place.

    """
    drawn: list[Sketch] = [Triad('frame', state.pose(frame))]
    if T_reference_goal is None or reference is None:
        return drawn, None
    T_root_reference = state.pose(reference)
    T_root_goal = T_root_reference.dot(T_reference_goal)
    drawn.append(Triad('goal', T_root_goal))
    if reference not in (frame, root):
        drawn.append(Path('reference', np.array([T_root_reference[:3, 3], T_root_goal[:3, 3]])))
    return drawn, T_root_goal
