# SPDX-License-Identifier: BSD-3-Clause
"""Distances between surfaces.

1. Tree queries equal brute force over all triangles, near and far, slivers and triangles without area included.
2. Concentric spheres are their difference of radii apart; the mean converges with the facets.
3. A hole on one side only shows in one direction only.
4. A shift along one axis is found exactly between planes.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.distance import BoxTree, surface_distance
from meshes.errors import MeshError
from meshes.generators import icosphere
from meshes.types import TriMesh


def brute_force(points: np.ndarray, surface: TriMesh) -> np.ndarray:
    """Distance from each point by projecting onto every triangle's plane and edges."""
    best = np.full(len(points), np.inf)
    for a, b, c in surface.points[surface.cells]:
        for p, q in ((a, b), (b, c), (c, a)):
            edge = q - p
            t = np.clip((points - p) @ edge / max(edge @ edge, 1e-300), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - p - t[:, None] * edge, axis=1))
        normal = np.cross(b - a, c - a)
        if normal @ normal > 0:
            height = (points - a) @ normal / np.linalg.norm(normal)
            inside = np.all([np.cross(q - p, points - p) @ normal >= 0 for p, q in ((a, b), (b, c), (c, a))], axis=0)
            best = np.where(inside, np.minimum(best, np.abs(height)), best)
    return best


@pytest.mark.parametrize("count", [1, 3, 4, 5, 200])
def test_tree_equals_brute_force(count):
    rng = np.random.default_rng(91_193)
    corners = rng.normal(size=(count, 1, 3)) + rng.normal(size=(count, 3, 3)) * rng.uniform(0.01, 1, (count, 1, 1))
    corners[-1, 2] = corners[-1, 0]  # no area
    surface = TriMesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    points = np.vstack([rng.normal(size=(150, 3)), 30 * rng.normal(size=(20, 3)), surface.points[:30]])
    distance, nearest = BoxTree.over(surface).distances(points)
    np.testing.assert_allclose(distance, brute_force(points, surface), rtol=1e-9, atol=1e-9)
    assert nearest.min() >= 0
    assert nearest.max() < count


def test_nearest_triangle_is_numbered_as_in_the_surface():
    ball = icosphere(3)
    centroids = ball.points[ball.cells].mean(axis=1)
    distance, nearest = BoxTree.over(ball).distances(centroids)
    np.testing.assert_array_equal(nearest, np.arange(len(ball.cells)))
    assert distance.max() < 1e-14


def test_concentric_spheres():
    inner, outer = icosphere(4, radius=1.0), icosphere(4, radius=1.1)
    found = surface_distance(inner, outer)
    assert found.forward.mean == pytest.approx(0.1, rel=0.01)
    assert found.forward.rms >= found.forward.mean
    assert found.maximum <= 0.1 + 1e-12
    assert found.diagonal == pytest.approx(1.1 * 12**0.5, rel=1e-3)
    assert found.as_dict()["relative_maximum"] == found.maximum / found.diagonal


def test_missing_part_shows_one_way():
    ball = icosphere(3)
    kept = ball.cells[ball.points[ball.cells].mean(axis=1)[:, 2] < 0.2]
    used, cells = np.unique(kept, return_inverse=True)
    found = surface_distance(TriMesh(ball.points[used], cells.reshape(-1, 3)), ball)
    assert found.forward.maximum < 1e-12
    assert found.backward.maximum > 0.25


def test_planes_apart():
    square = TriMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    found = surface_distance(square, square.moved(square.points + np.array([0, 0, 0.25])))
    for way in (found.forward, found.backward):
        assert (way.mean, way.rms, way.maximum) == pytest.approx((0.25, 0.25, 0.25), rel=1e-14)


def test_surface_without_area_is_refused():
    line = TriMesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    with pytest.raises(MeshError, match="no area"):
        surface_distance(line, icosphere(1))
