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

"""What is probably a mistake in a goal, in words."""

from collections.abc import Sequence
import math

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array

# Numbers and turns that are so small were not meant to count.
IGNORED = 1e-9
# No goal is nearer to its reference than that, or it would not be one in millimetres [m].
MILLIMETRES, NEAREST = 1e-3, 0.05


def out_of_reach(place: Array, counts: NDArray[np.bool_], reach: float,
                 reference: str) -> str:
    """
    Return a remark about a place that the robot cannot reach, however it stands; else nothing.

    Parameters
    ----------
    place : ndarray (3,)
        In the reference frame [m].
    counts : ndarray (3,)
        Of its coordinates, whether they count.
    reach : float
        See `Robot.reach` [m].
    reference : str
        Name of the frame.

    """
    distance = float(np.linalg.norm(place[counts]))
    if distance <= reach:
        return ''
    unit = '; goals are in metres, not in millimetres' \
        if NEAREST <= distance * MILLIMETRES <= reach else ''
    return (f'the goal is {distance:.3g} m from {reference}, and out of reach: all links in a '
            f'line are {reach:.3g} m long{unit}')


def masked_place(place: Array, axes: Sequence[str]) -> str:
    """Return a remark about coordinates, not zero, along axes that do not count; else nothing."""
    lost = [f'{axis} = {value:g}' for axis, value in zip('xyz', place.tolist())
            if axis not in axes and abs(value) > IGNORED]
    return _masked(lost, axes)


def masked_turn(R: Array, axes: Sequence[str], turns: Sequence[str]) -> str:
    """Return a remark about a turn where no axis to turn about counts; else nothing."""
    turned = not set(axes) & set(turns) and not np.allclose(R, np.eye(3), atol=IGNORED)
    return _masked(['the orientation'] if turned else [], axes)


def looks_like_degrees(value: float, lower: float, upper: float) -> bool:
    """Say whether an angle is more than a turn, and in its range if it is in degrees."""
    return abs(value) > 2.0 * math.pi and lower <= math.radians(value) <= upper


def _masked(lost: Sequence[str], axes: Sequence[str]) -> str:
    """Return that something does not count, if there is something."""
    if not lost:
        return ''
    return f'not counted: {", ".join(lost)}; the axes of the task are {", ".join(axes)}'
