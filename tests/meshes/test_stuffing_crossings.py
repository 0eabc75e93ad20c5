# SPDX-License-Identifier: BSD-3-Clause
"""Crossings of lattice lines with surfaces.

1. Bundle coordinates put lattice points at integers, and every lattice edge on exactly one bundle.
2. Each line of a sphere is crossed twice, in and out, at the places where the chord of the sphere ends.
3. Lines exactly through vertices, edges and along faces of the surface still balance.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.generators import icosphere
from meshes.stuffing.crossings import BUNDLES, cross
from meshes.types import TriMesh


@pytest.mark.parametrize("bundle", BUNDLES)
def test_lattice_points_have_integer_coordinates(bundle):
    rng = np.random.default_rng(52_009)
    places = bundle.frame[0] + rng.integers(-5, 5, (20, 3)) @ bundle.frame[1:]
    coordinates = bundle.project(places.astype(float))
    np.testing.assert_allclose(coordinates, np.rint(coordinates), atol=1e-12)
    assert len(np.unique(places % 2, axis=1)[0]) == 1
    assert all(len(set(row % 2)) == 1 for row in places)
    assert np.linalg.norm(bundle.frame[3]) / 2 == bundle.step


@pytest.mark.parametrize("bundle", BUNDLES)
def test_lines_enter_and_leave_a_sphere(bundle):
    ball = icosphere(5, radius=8.0)
    centre = np.array([0.3, 0.2, 0.1])
    found = cross(bundle, ball.points + centre, ball.cells)
    assert found.unbalanced == 0
    counts = np.diff(found.start)
    assert set(counts.tolist()) <= {0, 2}
    np.testing.assert_array_equal(found.turn.reshape(-1, 2), np.tile([1, -1], (counts.sum() // 2, 1)))
    line = np.flatnonzero(counts)
    u, v = found.low[0] + line // found.columns, found.low[1] + line % found.columns
    frame = bundle.frame.astype(float)
    for turn in (0, 1):
        w = found.height.reshape(-1, 2)[:, turn]
        places = frame[0] + u[:, None] * frame[1] + v[:, None] * frame[2] + w[:, None] * frame[3]
        radius = np.linalg.norm(places - centre, axis=1)
        assert radius.max() < 8.0 + 1e-9
        assert radius.min() > 8.0 * 0.999  # facets of 20,480 triangles


@pytest.mark.parametrize("bundle", BUNDLES)
def test_degenerate_lines_balance(bundle):
    """An octahedron with all its corners, edges and symmetry planes on lattice lines."""
    points = np.vstack([np.eye(3), -np.eye(3)]) * 8.0
    cells = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    surface = TriMesh(points, cells)
    assert surface.enclosed_volume > 0
    found = cross(bundle, surface.points, surface.cells)
    assert len(found.height) > 20
    assert found.unbalanced == 0
