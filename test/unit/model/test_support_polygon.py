# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Support polygons, compared with those of Qhull; points on a line and points that coincide."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from tp_controller.model.support_polygon import convex_hull, support_edges

SEEDS = st.integers(0, 2 ** 32 - 1)


@given(seed=SEEDS, count=st.integers(3, 32), grid=st.booleans())
def test_edges_are_those_of_qhull(seed, count, grid):
    rng = np.random.default_rng(seed)
    # On a grid points coincide and lie on edges.
    points = rng.integers(0, 5, (count, 2)) * 0.1 if grid else rng.normal(size=(count, 2))
    if np.linalg.matrix_rank(points - points[0], tol=1e-9) < 2:
        return
    expected = ConvexHull(points)
    corners = convex_hull(points)
    assert {tuple(point) for point in points[corners]} == {
        tuple(point) for point in points[expected.vertices]}
    seen = rng.normal(size=2)
    edges = support_edges(points, seen)
    # Qhull has outward normals, and for lines through several points one equation each.
    ways = np.unique((-expected.equations @ [*seen, 1.0]).round(9))
    np.testing.assert_allclose(np.unique(edges.distances.round(9)), ways, atol=1e-8)
    assert not edges.flat
    # The middle is inside; the foot of the perpendicular is where the share says.
    middle = support_edges(points, points[corners].mean(axis=0))
    assert (middle.distances > 0.0).all()
    feet = (1 - edges.share[:, None]) * points[edges.first] + edges.share[:, None] * points[
        edges.last]
    np.testing.assert_allclose(feet + edges.distances[:, None] * edges.normals,
                               np.tile(seen, (len(feet), 1)), atol=1e-9)


@pytest.mark.parametrize('points, seen, distance, share', [
    ([[0, 0], [2, 0], [1, 0]], [0.5, 0.3], -0.3, 0.25),
    ([[0, 0], [2, 0], [1, 0]], [3.0, 0.0], -1.0, 1.0),
    ([[1, 1], [1, 1], [1, 1]], [1.0, 0.5], -0.5, 0.0),
    ([[0, 0], [2, 2], [1, 1]], [1.0, 1.0], 0.0, 0.5)])
def test_points_on_one_line_have_one_row_back_to_them(points, seen, distance, share):
    edges = support_edges(np.array(points, float), np.array(seen))
    assert edges.flat and len(edges.first) == 1
    assert edges.distances == pytest.approx([distance]) and edges.share == pytest.approx([share])
    foot = (1 - share) * np.array(points[edges.first[0]]) + share * np.array(
        points[edges.last[0]])
    np.testing.assert_allclose(foot + edges.distances * edges.normals[0], seen, atol=1e-9)
