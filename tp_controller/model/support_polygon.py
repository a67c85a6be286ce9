# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Support polygon: the convex hull of points in a plane, and the distances from its edges."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array

# Twice the area of a triangle below which its corners count as collinear [m²].
COLLINEAR = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """
    Edges of a support polygon, seen from a point in its plane.

    Attributes
    ----------
    first, last : ndarray of int (m,)
        Corners at both ends of each edge, as indices of the points; anticlockwise.
    share : ndarray (m,)
        Place of the foot of the perpendicular from the point: 0 at the first end, 1 at the last.
    normals : ndarray (m, 2)
        Unit vectors inwards.
    distances : ndarray (m,)
        Distances of the point, negative outside of the edge [m].
    flat : bool
        The points are collinear: the only row is minus the distance from them.

    """

    first: NDArray[np.intp]
    last: NDArray[np.intp]
    share: Array
    normals: Array
    distances: Array
    flat: bool = False


def support_edges(points: Array, seen: Array) -> Edges:
    """
    Return the edges of the convex hull of points (k, 2), seen from a point (2,) [m].

    Collinear points have one row: minus the distance of the point from the segment between them.
    """
    first = convex_hull(points)
    last = np.roll(first, -1)
    along, offset = points[last] - points[first], seen - points[first]
    # A single point has no direction.
    squares = np.maximum((along * along).sum(axis=1), COLLINEAR)
    share = (offset * along).sum(axis=1) / squares
    if len(first) < 3:
        share = share[:1].clip(0.0, 1.0)
        gap = offset[:1] - share[:, np.newaxis] * along[:1]
        distance = np.sqrt((gap * gap).sum(axis=1))
        return Edges(first[:1], last[:1], share, -gap / np.maximum(distance, COLLINEAR),
                     -distance, flat=True)
    normals = along[:, ::-1] * (-1.0, 1.0) / np.sqrt(squares)[:, np.newaxis]
    return Edges(first, last, share, normals, (offset * normals).sum(axis=1))


def convex_hull(points: Array) -> NDArray[np.intp]:
    """
    Return the corners of the convex hull of points (k, 2), anticlockwise, as indices (m,).

    Collinear points have two corners, and points that coincide one (Andrew's monotone chain). The
    first corner is the one with the lowest index, so that rounding errors do not choose it.
    """
    order = np.lexsort((points[:, 1], points[:, 0])).tolist()
    corners = [*_chain(points, order), *_chain(points, reversed(order))] or order[:1]
    start = corners.index(min(corners))
    return np.array(corners[start:] + corners[:start])


def _chain(points: Array, order: Iterable[int]) -> list[int]:
    """Return the corners of one side of the hull, but for the last."""
    found: list[int] = []
    places = points.tolist()
    for index in order:
        while len(found) > 1 and _turn(places, found[-2], found[-1], index) <= COLLINEAR:
            found.pop()
        found.append(index)
    return found[:-1] if len(found) > 1 and places[found[0]] != places[found[-1]] else []


def _turn(places: list[list[float]], one: int, two: int, three: int) -> float:
    """Return twice the signed area of a triangle, positive anticlockwise [m²]."""
    (x, y), (u, v), (s, t) = places[one], places[two], places[three]
    return (u - x) * (t - y) - (v - y) * (s - x)
