# SPDX-License-Identifier: BSD-3-Clause
"""Signs and cuts.

1. Signs and cuts of a sphere agree with its equation; every edge between + and - has a cut, no other is read.
2. Two overlapping spheres in one surface are inside everywhere in their union, also where winding is 2; the overlap's
   volume is measured.
3. A void is outside.
4. Where vertices and faces of a surface lie exactly on lattice points, every cut that is found still lies on it, and
   those that are not are counted.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.generators import icosphere
from meshes.stuffing.lattice import DIRECTIONS, Lattice
from meshes.stuffing.signs import Sample, sample
from meshes.types import TriMesh


def together(*surfaces: TriMesh) -> TriMesh:
    offsets = np.cumsum([0] + [len(s.points) for s in surfaces])
    cells = np.vstack([s.cells + offset for s, offset in zip(surfaces, offsets[:-1], strict=True)])
    return TriMesh(np.vstack([s.points for s in surfaces]), cells)


def shifted(surface: TriMesh, x: float) -> TriMesh:
    return surface.moved(surface.points + np.array([x, 0, 0]))


def places(lattice: Lattice) -> np.ndarray:
    number = np.arange(lattice.size)
    column, (_, ny, nz) = number >> 1, lattice.shape
    cells = np.stack([column // nz // ny, column // nz % ny, column % nz], axis=1) + 0.5 * (number & 1)[:, None]
    return lattice.origin + lattice.spacing * cells


def cuts_of(found: Sample) -> tuple[np.ndarray, np.ndarray]:
    """Places of all cuts, and the rows and directions they belong to."""
    lattice, p = found.lattice, found.near
    q = p[:, None] + lattice.steps[p & 1, :7]
    row, way = np.nonzero(found.sign[p][:, None] * found.sign[q] < 0)
    along = 0.5 * lattice.spacing * DIRECTIONS[way] * found.cut[row, way][:, None]
    return places(lattice)[p[row]] + along, np.stack([row, way], axis=1)


def test_sphere():
    ball = icosphere(5, radius=1.0)
    found = sample(ball, Lattice.around(ball.points, 0.17))
    radius = np.linalg.norm(places(found.lattice), axis=1)
    sure = np.abs(radius - 1.0) > 1e-3
    np.testing.assert_array_equal(found.sign[sure] > 0, radius[sure] < 1.0)
    where, edges = cuts_of(found)
    assert np.abs(np.linalg.norm(where, axis=1) - 1.0).max() < 1e-3
    fractions = found.cut[edges[:, 0], edges[:, 1]]
    assert fractions.min() >= 0.0
    assert fractions.max() <= 1.0
    centroid = ball.points[ball.cells[found.face[edges[:, 0], edges[:, 1]]]].mean(axis=1)
    assert np.linalg.norm(centroid - where, axis=1).max() < 0.05
    assert (found.unresolved, found.unbalanced, found.doubled) == (0, 0, 0.0)
    assert found.inside == (found.sign > 0).sum()


def test_overlapping_spheres_are_a_union():
    a, b = shifted(icosphere(4, radius=1.0), -0.5), shifted(icosphere(4, radius=1.0), 0.5)
    found = sample(together(a, b), Lattice.around(together(a, b).points, 0.13))
    x = places(found.lattice)
    nearest = np.minimum(np.linalg.norm(x - [-0.5, 0, 0], axis=1), np.linalg.norm(x - [0.5, 0, 0], axis=1))
    sure = np.abs(nearest - 1.0) > 0.01
    np.testing.assert_array_equal(found.sign[sure] > 0, nearest[sure] < 1.0)
    lens = np.pi / 12 * (4 + 1) * (2 - 1) ** 2
    assert found.doubled == pytest.approx(lens, rel=0.03)
    where, _ = cuts_of(found)
    reach = np.minimum(np.linalg.norm(where - [-0.5, 0, 0], axis=1), np.linalg.norm(where - [0.5, 0, 0], axis=1))
    assert reach.min() > 0.99


def test_void_is_outside():
    ball, void = icosphere(3, radius=1.0), icosphere(3, radius=0.5)
    hollow = together(ball, TriMesh(void.points, void.cells[:, ::-1]))
    found = sample(hollow, Lattice.around(hollow.points, 0.12))
    radius = np.linalg.norm(places(found.lattice), axis=1)
    assert (found.sign[radius < 0.45] < 0).all()
    assert (found.sign[(radius > 0.52) & (radius < 0.97)] > 0).all()


def test_surface_on_lattice_points():
    points = np.vstack([np.eye(3), -np.eye(3)]) * 4.0
    cells = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    surface = TriMesh(points, cells)
    found = sample(surface, Lattice(np.full(3, -8.0), 1.0, (16, 16, 16)))
    where, _ = cuts_of(found)
    assert found.unbalanced == 0
    off = np.abs(np.abs(where).sum(axis=1) - 4.0) > 1e-5
    assert len(where) > 400
    assert off.sum() <= found.unresolved < 0.3 * len(where)
