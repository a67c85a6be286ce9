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

"""Surfaces of revolution about z: drums with round edges, tapered limbs, feet and pointers."""

from collections.abc import Iterable

import numpy as np
from tp_controller.tools.view.meshes import Mesh

SIDES, EDGE_SEGMENTS = 40, 6  # of a full turn, of a rounded edge


def surface(outline: Iterable[tuple[float, float]]) -> Mesh:
    """
    Return the surface that an outline sweeps.

    Parameters
    ----------
    outline : iterable of (float, float)
        Radius and height of its points, from bottom to top [m]; a repeated point makes a sharp
        edge.

    """
    points = np.array(list(outline))
    angles = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    radius, height = points[:, :1], np.repeat(points[:, 1:], SIDES, axis=1)
    vertices = np.stack((radius * np.cos(angles), radius * np.sin(angles), height),
                        axis=-1).reshape(-1, 3)
    lower = np.arange(len(points) - 1)[:, np.newaxis] * SIDES
    one, other = lower + np.arange(SIDES), lower + np.roll(np.arange(SIDES), -1)
    faces = np.concatenate([np.stack((one, other, other + SIDES), axis=-1).reshape(-1, 3),
                            np.stack((one, other + SIDES, one + SIDES), axis=-1).reshape(-1, 3)])
    return Mesh(vertices=vertices, faces=faces, points=vertices)


def drum(radius: float, length: float, edge: float) -> Mesh:
    """Return a cylinder about its centre with rounded edges of a radius [m]."""
    half, quarter = 0.5 * length, np.linspace(0.0, 0.5 * np.pi, EDGE_SEGMENTS)
    upper = [(radius - edge + edge * np.cos(turn), half - edge + edge * np.sin(turn))
             for turn in quarter]
    outline = [(0.0, -half), *((r, -z) for r, z in reversed(upper)), *upper, (0.0, half)]
    return surface(outline)


def limb(start: float, end: float, length: float, waist: float = 0.8,
         flat: bool = False) -> Mesh:
    """
    Return a limb along z, from the origin, with round ends around both points.

    Parameters
    ----------
    start, end : float
        Radii at its ends [m].
    length : float
        Between the ends [m].
    waist : float
        Radius in the middle as a share of that of a straight limb.
    flat : bool
        Begin with a plane, as on the ground.

    """
    shares = np.linspace(0.0, 1.0, 2 * EDGE_SEGMENTS)
    # Zero slope at the ends, for a smooth transition to the round ends.
    bend = 1.0 - (1.0 - waist) * np.sin(np.pi * shares) ** 2
    body = [((start + (end - start) * share) * each, length * share)
            for share, each in zip(shares, bend)]
    quarter = np.linspace(0.0, 0.5 * np.pi, EDGE_SEGMENTS)[:-1]
    below = [(0.0, 0.0)] if flat else [
        (start * np.sin(turn), -start * np.cos(turn)) for turn in quarter]
    above = [(end * np.sin(turn), length + end * np.cos(turn)) for turn in quarter[::-1]]
    return surface([*below, *body, *above])


def foot(radius: float, height: float, plate: float) -> Mesh:
    """Return a foot that stands at the origin: a plate, and a cone that ends at a radius [m]."""
    wide, rim = 2.1 * radius, 0.12 * radius
    quarter = np.linspace(0.0, 1.0, 2 * EDGE_SEGMENTS)
    cone = [(radius + (0.8 * wide - radius) * (1.0 - share) ** 2, plate + (height - plate) * share)
            for share in quarter]
    return surface([(0.0, 0.0), (wide, 0.0), (wide, 0.0), (wide, plate - rim), (wide - rim, plate),
                    (wide - rim, plate), cone[0], cone[0], *cone, (0.0, height)])


def pointer(start: float, end: float, length: float) -> Mesh:
    """Return a tool along z from the origin: a plate, then a cone with a round tip [m]."""
    plate = min(0.35 * start, 0.3 * length)
    quarter = np.linspace(0.0, 0.5 * np.pi, EDGE_SEGMENTS)
    neck = 0.62 * start
    tip = [(end * np.cos(turn), length - end + end * np.sin(turn)) for turn in quarter]
    return surface([(0.0, 0.0), (start, 0.0), (start, 0.0), (start, plate), (start, plate),
                    (neck, plate), (neck, plate), *tip])
