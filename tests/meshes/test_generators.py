# SPDX-License-Identifier: BSD-3-Clause
"""Generated meshes.

1. A box has the counts of its grid, fills its volume exactly and is conforming: every inner face belongs to two
   tetrahedra, the surface is that of the box.
2. Jitter moves inner vertices only, is reproducible, and never turns a tetrahedron up to its limit of 1/6.
3. Counts by vertices come within 5% from 500 vertices upwards, with near-cubic cells.
4. Icospheres are closed and outward, and their volume converges with order 2.
5. The solid sphere has the wanted count within 5% and the volume of the ball within 2%.
6. Impossible wishes are refused with numbers.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.errors import InputError
from meshes.generators import beam, box, cells_for, cube, icosphere, sphere


def faces_of(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unique faces and in how many tetrahedra each is."""
    faces = np.sort(cells[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3), axis=1)
    return np.unique(faces, axis=0, return_counts=True)


@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 3, 4), (5, 1, 2)])
def test_box_is_conforming_and_exact(shape):
    size = (1.5, 0.4, 2.0)
    mesh = box(size, shape)
    nx, ny, nz = shape
    assert len(mesh.points) == (nx + 1) * (ny + 1) * (nz + 1)
    assert len(mesh.cells) == 6 * nx * ny * nz
    np.testing.assert_allclose(mesh.volumes, np.prod(size) / len(mesh.cells), rtol=1e-12)
    faces, counts = faces_of(mesh.cells)
    assert counts.max() <= 2
    outer = mesh.points[faces[counts == 1]]
    area = 0.5 * np.linalg.norm(np.cross(outer[:, 1] - outer[:, 0], outer[:, 2] - outer[:, 0]), axis=1).sum()
    assert area == pytest.approx(2 * (1.5 * 0.4 + 0.4 * 2 + 2 * 1.5))
    np.testing.assert_array_equal(mesh.points.max(axis=0), size)
    np.testing.assert_array_equal(mesh.points.min(axis=0), 0.0)


def test_beam_has_the_published_grid():
    mesh = beam()
    assert (len(mesh.points), len(mesh.cells)) == (16 * 6 * 6, 6 * 15 * 5 * 5)
    assert mesh.origin.name == "beam"


@pytest.mark.parametrize("seed", [987654321, 20250731, 1234567891])
def test_jitter_keeps_volumes_positive_and_the_surface_still(seed):
    plain, moved = box(cells=(6, 6, 6)), box(cells=(6, 6, 6), jitter=0.1666, seed=seed)
    assert moved.volumes.min() > 0.0
    assert moved.volumes.sum() == pytest.approx(1.0)
    shift = np.abs(moved.points - plain.points)
    outer = ((plain.points == 0.0) | (plain.points == 1.0)).any(axis=1)
    assert not shift[outer].any()
    assert (shift[~outer].max(axis=1) > 0.0).all()
    assert shift.max() <= 0.1666 / 6
    assert moved.content_hash == box(cells=(6, 6, 6), jitter=0.1666, seed=seed).content_hash
    assert moved.content_hash != box(cells=(6, 6, 6), jitter=0.1666, seed=seed + 2).content_hash


@pytest.mark.parametrize("vertices", [500, 1000, 2000, 5000, 13_000, 50_000])
@pytest.mark.parametrize("make", [cube, lambda n: beam(vertices=n), lambda n: box((1.0, 0.7, 0.3), vertices=n)])
def test_counts_by_vertices(make, vertices):
    assert len(make(vertices).points) == pytest.approx(vertices, rel=0.05)


def test_cells_stay_near_cubic():
    for vertices in (600, 3000, 20_000, 1_000_000):
        spacing = np.array([3.0, 1.0, 1.0]) / cells_for(np.array([3.0, 1.0, 1.0]), vertices)
        assert spacing.max() / spacing.min() < 1.35
    assert cells_for(np.ones(3), 1_000_000) == (99, 99, 99)


def test_icosphere_converges_to_the_ball():
    errors = []
    for level in range(5):
        ball = icosphere(level)
        assert len(ball.cells) == 20 * 4**level
        edges = np.sort(ball.cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
        np.testing.assert_allclose(np.linalg.norm(ball.points, axis=1), 0.5, rtol=1e-14)
        errors.append(np.pi / 6 - ball.enclosed_volume)
    assert min(errors) > 0.0
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert slopes[-1] == pytest.approx(2.0, abs=0.02)
    assert errors[-1] < 2.5e-3 * np.pi / 6


@pytest.mark.parametrize("vertices", [1000, 5000])
def test_solid_sphere(vertices):
    pytest.importorskip("meshes.stuffing.tetrahedralise")
    ball = sphere(vertices)
    assert len(ball.points) == pytest.approx(vertices, rel=0.05)
    assert ball.volumes.sum() == pytest.approx(np.pi / 6, rel=0.02)
    assert np.linalg.norm(ball.points, axis=1).max() <= 0.5 + 1e-9


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: box(cells=(0, 1, 1)), ("(0, 1, 1)", "whole numbers >= 1")),
        (lambda: box(cells=(1.5, 1, 1)), ("not a grid",)),
        (lambda: box((1.0, -1.0, 1.0)), ("-1.0", "lengths > 0")),
        (lambda: box((1.0, np.nan, 1.0)), ("nan",)),
        (lambda: box(jitter=0.2), ("0.2", "jitter < 1/6")),
        (lambda: cube(7), ("7", "8 to")),
        (lambda: icosphere(12), ("12", "0 to 9")),
    ],
)
def test_impossible_wishes_are_refused(call, parts):
    with pytest.raises(InputError) as caught:
        call()
    for part in parts:
        assert part in str(caught.value)
