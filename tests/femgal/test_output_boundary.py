# SPDX-License-Identifier: BSD-3-Clause
"""The surface of a mesh.

1. Every face of one tetrahedron is outward; the surface of a box has the right count, area and enclosed volume.
2. Every boundary triangle is a face of its owner.
3. The weighted vertex average of a constant is the constant, and of two cells their weighted mean.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.output.boundary import boundary_triangles, vertex_average
from meshes.types import TriMesh
from tests.femgal.series_samples import sample_mesh


def surface_of(points, triangles):
    used, renumbered = np.unique(triangles, return_inverse=True)
    return TriMesh(points[used], renumbered.reshape(-1, 3).astype(np.int32))


def test_one_tetrahedron():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    triangles, owners = boundary_triangles(np.array([[0, 1, 2, 3]], np.int32))
    assert owners.tolist() == [0, 0, 0, 0]
    assert surface_of(points, triangles).enclosed_volume == pytest.approx(1 / 6, rel=1e-14)


def test_box():
    mesh = sample_mesh((3, 4, 5))
    triangles, owners = boundary_triangles(mesh.cells)
    assert len(triangles) == 2 * 2 * (3 * 4 + 3 * 5 + 4 * 5)
    a, b, c = (mesh.points[triangles[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert area == pytest.approx(2 * (0.3 * 0.3 + 0.3 * 0.2 + 0.3 * 0.2), rel=1e-12)
    assert surface_of(mesh.points, triangles).enclosed_volume == pytest.approx(0.3 * 0.3 * 0.2, rel=1e-12)
    assert (
        np.isin(triangles, mesh.cells) & (triangles[:, :, None] == mesh.cells[owners][:, None, :]).any(axis=2)
    ).all()


def test_vertex_average():
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]], np.int32)
    mean = vertex_average(np.array([2.0, 5.0]), cells, np.array([1.0, 3.0]))
    assert mean.tolist() == [2.0, 4.25, 4.25, 4.25, 5.0]
    constant = vertex_average(np.full(2, 7.0), cells, np.array([0.1, 0.7]))
    assert np.allclose(constant, 7.0, rtol=1e-15)
