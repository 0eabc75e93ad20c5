# SPDX-License-Identifier: BSD-3-Clause
"""Mesh quality.

1. The regular tetrahedron has radius ratio 1 and dihedral angles arccos(1/3); the corner tetrahedron its own values.
2. All figures agree with a plain NumPy computation on an irregular mesh.
3. A sliver and a broken boundary are reported in words and numbers, not refused.
4. The table and the dictionary hold the same figures.
"""

from __future__ import annotations

import json
from itertools import combinations

import numpy as np
import pytest

from meshes.generators import cube
from meshes.quality import dihedrals, quality
from meshes.types import TetMesh

REGULAR = np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]], float)
ONE = np.array([[0, 1, 2, 3]])


def plain_dihedrals(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """All six angles of each tetrahedron [degrees] from the parts of two edges perpendicular to the third."""
    angles = []
    for i, j in combinations(range(4), 2):
        k, m = (v for v in range(4) if v not in (i, j))
        p = points[cells[:, [i, j, k, m]]]
        axis = p[:, 1] - p[:, 0]
        axis /= np.linalg.norm(axis, axis=1)[:, None]
        u, v = (p[:, n] - p[:, 0] for n in (2, 3))
        u, v = (x - axis * (x * axis).sum(1)[:, None] for x in (u, v))
        angles.append(np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1))))
    return np.array(angles)


def plain_radius_ratios(points: np.ndarray, cells: np.ndarray, volumes: np.ndarray) -> np.ndarray:
    p = points[cells]
    rows = p[:, 1:] - p[:, :1]
    centre = np.linalg.solve(2.0 * rows, (rows**2).sum(axis=2)[:, :, None])[:, :, 0]
    faces = [p[:, f] for f in ([1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2])]
    area = sum(np.linalg.norm(np.cross(f[:, 1] - f[:, 0], f[:, 2] - f[:, 0]), axis=1) / 2 for f in faces)
    return 3.0 * (3.0 * volumes / area) / np.linalg.norm(centre, axis=1)


def test_regular_tetrahedron():
    found = quality(TetMesh(REGULAR, ONE))
    angle = np.degrees(np.arccos(1 / 3))
    assert found.dihedral_min == pytest.approx(angle, rel=1e-6)
    assert found.dihedral_max == pytest.approx(angle, rel=1e-12)
    assert found.radius_ratio_min == pytest.approx(1.0, rel=1e-6)
    assert found.volume == pytest.approx(8 / 3, rel=1e-14)
    assert found.edge_min == pytest.approx(8**0.5, rel=1e-6)
    assert found.manifold
    assert found.warnings == ()


def test_corner_tetrahedron():
    found = quality(TetMesh(np.vstack([np.zeros(3), np.eye(3)]), ONE))
    assert found.dihedral_min == pytest.approx(np.degrees(np.arccos(3**-0.5)), rel=1e-6)
    assert found.dihedral_max == pytest.approx(90.0, rel=1e-12)
    assert found.radius_ratio_min == pytest.approx((3 - 3**0.5) / 3**0.5, rel=1e-6)
    assert (found.edge_min, found.edge_max) == pytest.approx((1.0, 2**0.5), rel=1e-6)


def test_agrees_with_plain_numpy():
    mesh = cube(700, jitter=0.1)
    found = quality(mesh)
    angles = plain_dihedrals(mesh.points, mesh.cells)
    expected = np.percentile(angles.min(axis=0), (0, 1, 5, 50))
    measured = (found.dihedral_min, found.dihedral_1, found.dihedral_5, found.dihedral_median)
    np.testing.assert_allclose(measured, expected, rtol=1e-6)
    assert found.dihedral_max == pytest.approx(angles.max(), rel=1e-12)
    ratios = plain_radius_ratios(mesh.points, mesh.cells, mesh.volumes)
    np.testing.assert_allclose(
        (found.radius_ratio_min, found.radius_ratio_1, found.radius_ratio_median),
        np.percentile(ratios, (0, 1, 50)),
        rtol=1e-6,
    )
    pairs = np.sort(np.vstack([mesh.cells[:, list(pair)] for pair in combinations(range(4), 2)]), axis=1)
    pairs = np.unique(pairs, axis=0)
    lengths = np.linalg.norm(mesh.points[pairs[:, 0]] - mesh.points[pairs[:, 1]], axis=1)
    np.testing.assert_allclose(
        (found.edge_min, found.edge_median, found.edge_max, found.edge_mean),
        (lengths.min(), np.median(lengths), lengths.max(), lengths.mean()),
        rtol=1e-6,
    )
    np.testing.assert_allclose(
        (found.volume_min, found.volume_median, found.volume_max),
        (mesh.volumes.min(), np.median(mesh.volumes), mesh.volumes.max()),
        rtol=1e-6,
    )
    assert found.volume == pytest.approx(mesh.volumes.sum(), rel=1e-12)
    assert dihedrals(mesh.points, mesh.cells).minimum == found.dihedral_min


def test_sliver_is_a_warning():
    flat = np.array([[0, 0, 0], [1, 0, 0.002], [1, 1, 0], [0, 1, 0.002]], float)
    found = quality(TetMesh(flat, [[0, 1, 3, 2]] if np.linalg.det(flat[[1, 3, 2]]) > 0 else ONE))
    assert (found.below_1, found.below_5) == (1, 1)
    assert found.dihedral_min < 0.5
    assert "1 of 1 tetrahedra have a dihedral angle below 5 degrees" in found.warnings[0]


def test_contact_is_a_warning():
    twin = 2.0 * REGULAR[0] - REGULAR[1:]
    mesh = TetMesh(np.vstack([REGULAR, twin]), [[0, 1, 2, 3], [0, 4, 6, 5]])
    found = quality(mesh)
    assert not found.manifold
    assert found.components == 1
    assert "not a closed 2-manifold" in found.warnings[0]


def test_table_and_dictionary():
    found = quality(cube(300))
    rows = dict(found.rows())
    assert rows["vertices"] == f"{found.vertices:,}"
    assert rows["boundary"] == "closed 2-manifold"
    assert json.loads(json.dumps(found.as_dict()))["radius_ratio_1"] == found.radius_ratio_1
