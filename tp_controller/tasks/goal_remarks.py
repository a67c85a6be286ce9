# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Remarks on probable mistakes in goals."""

from collections.abc import Sequence
import math

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array

# Coordinates and turns up to this count as zero [m or rad].
ZERO_TOLERANCE = 1e-9
# Metres per millimetre, and least distance of a goal that may be in millimetres [m].
METRES_PER_MILLIMETRE, MIN_GOAL_DISTANCE = 1e-3, 0.05


def out_of_reach(place: Array, counts: NDArray[np.bool_], reach: float,
                 reference: str) -> str:
    """
    Return a remark about a place that no posture of the robot reaches; empty if none applies.

    Parameters
    ----------
    place : ndarray (3,)
        Position in the reference frame [m].
    counts : ndarray (3,)
        Mask of the selected coordinates.
    reach : float
        Reach of the frame, see `Robot.reach` [m].
    reference : str
        Name of the reference frame.

    """
    distance = float(np.linalg.norm(place[counts]))
    if distance <= reach:
        return ''
    unit = '; goals are in metres, not in millimetres' \
        if MIN_GOAL_DISTANCE <= distance * METRES_PER_MILLIMETRE <= reach else ''
    return (f'the goal is {distance:.3g} m from {reference}, and out of reach: all links in a '
            f'line are {reach:.3g} m long{unit}')


def masked_place(place: Array, axes: Sequence[str]) -> str:
    """Return a remark about nonzero coordinates along unselected axes; empty if none applies."""
    lost = [f'{axis} = {value:g}' for axis, value in zip('xyz', place.tolist())
            if axis not in axes and abs(value) > ZERO_TOLERANCE]
    return _masked(lost, axes)


def masked_turn(R: Array, axes: Sequence[str], turns: Sequence[str]) -> str:
    """Return a remark about a turn if no rotation axis is selected; empty if none applies."""
    turned = not set(axes) & set(turns) and not np.allclose(R, np.eye(3), atol=ZERO_TOLERANCE)
    return _masked(['the orientation'] if turned else [], axes)


def looks_like_degrees(value: float, lower: float, upper: float) -> bool:
    """Return whether an angle exceeds a turn, and is in its range if taken as degrees."""
    return abs(value) > 2.0 * math.pi and lower <= math.radians(value) <= upper


def _masked(lost: Sequence[str], axes: Sequence[str]) -> str:
    """Return a remark about unselected parts of a goal; empty if there are none."""
    if not lost:
        return ''
    return f'not counted: {", ".join(lost)}; the axes of the task are {", ".join(axes)}'
