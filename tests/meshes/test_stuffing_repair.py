# SPDX-License-Identifier: BSD-3-Clause
"""Repairs.

1. Two bodies that touch in a vertex or in an edge are separated by copies, and keep all their tetrahedra.
2. A ring closed by a contact in an edge, and one pinched at a vertex, become manifold by losing a few tetrahedra.
3. Random fillings, full of contacts, become closed 2-manifolds with positive volumes.
4. Fragments of a body are dropped, bodies of their own are kept; vertices are renumbered without gaps.
5. A filling without tetrahedra comes out empty.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.generators import icosphere
from meshes.stuffing.fill import INTERIOR, Filling
from meshes.stuffing.repair import Repairs, repair
from meshes.surface import boundary, manifold_report
from meshes.types import TriMesh, signed_volumes


def box_cells(keep: np.ndarray) -> Filling:
    """Kuhn tetrahedra of the kept unit cells of a grid; every vertex counts as on the surface."""
    _, ny, nz = keep.shape
    cells = []
    for cell in np.argwhere(keep):
        for axes in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (1, 0, 2), (2, 1, 0)):
            path = [cell]
            for axis in axes:
                path.append(path[-1] + np.eye(3, dtype=int)[axis])
            cells.append([(p[0] * (ny + 1) + p[1]) * (nz + 1) + p[2] for p in path])
    grid = np.stack(np.meshgrid(*[np.arange(n + 1.0) for n in keep.shape], indexing="ij"), -1).reshape(-1, 3)
    cells = np.array(cells, np.int32)
    cells[signed_volumes(grid, cells) < 0] = cells[signed_volumes(grid, cells) < 0][:, [0, 1, 3, 2]]
    used, numbered = np.unique(cells, return_inverse=True)
    return Filling(grid[used], numbered.reshape(-1, 4).astype(np.int32), np.zeros(len(used), np.int32))


def two_bodies() -> TriMesh:
    ball = icosphere(0)
    n = len(ball.points)
    return TriMesh(np.vstack([ball.points, ball.points + 5]), np.vstack([ball.cells, ball.cells + n]))


def belonging(filling: Filling, axis: int, limit: float) -> Filling:
    """Vertices beyond a plane belong to the second body of `two_bodies`."""
    faces_of_one = len(icosphere(0).cells)
    second = filling.points[:, axis] > limit
    return Filling(filling.points, filling.cells, np.where(second, faces_of_one, 0).astype(np.int32))


@pytest.mark.parametrize(("corner", "copies"), [((1, 1, 1), 1), ((1, 1, 0), 2)])
def test_touching_bodies_are_separated(corner, copies):
    keep = np.zeros((2, 2, 2), bool)
    keep[0, 0, 0] = keep[corner] = True
    filling = box_cells(keep)
    assert not manifold_report(boundary(filling.cells)).manifold
    repaired, repairs = repair(belonging(filling, 0, 1.5), two_bodies())
    report = manifold_report(boundary(repaired.cells))
    assert report.manifold
    assert report.components == 2
    assert (repairs.split_vertices, repairs.removed_tets, repairs.fragments) == (copies, 0, 0)
    assert len(repaired.cells) == 12


@pytest.mark.parametrize("touching", ["edge", "vertex"])
def test_rings_that_touch_themselves_are_opened(touching):
    keep = np.ones((3, 3, 3), bool)
    if touching == "edge":
        # In the middle layer only two cells, which share an edge and hang together above and below it.
        keep[:, :, 1] = False
        keep[0, 0, 1] = keep[1, 1, 1] = True
    else:
        # Two empty corners of the middle meet in one vertex that is solid all around otherwise.
        keep[0, 0, :2] = keep[1, 1, 2:] = False
    filling = box_cells(keep)
    before = manifold_report(boundary(filling.cells))
    assert before.crowded_edges + before.pinched_vertices > 0
    repaired, repairs = repair(filling, icosphere(0))
    assert manifold_report(boundary(repaired.cells)).manifold
    assert len(repaired.cells) + repairs.removed_tets == len(filling.cells)
    assert 0 < repairs.removed_tets <= 30


@pytest.mark.parametrize("seed", [21_001, 21_011, 21_013, 21_017])
def test_random_fillings_become_manifold(seed):
    keep = np.random.default_rng(seed).random((5, 5, 5)) < 0.5
    filling = box_cells(keep)
    assert manifold_report(boundary(filling.cells)).crowded_edges > 10
    repaired, repairs = repair(filling, icosphere(0))
    report = manifold_report(boundary(repaired.cells))
    assert report.manifold
    volumes = signed_volumes(repaired.points, repaired.cells)
    assert volumes.min() > 0
    assert len(np.unique(repaired.cells)) == len(repaired.points)
    removed = repairs.removed_tets / 6 + repairs.fragment_volume
    assert volumes.sum() + removed == pytest.approx(keep.sum(), rel=1e-12)


def test_fragments_go_and_bodies_stay():
    keep = np.zeros((7, 1, 1), bool)
    keep[[0, 1, 3, 5, 6]] = True
    filling = box_cells(keep)
    one, repairs = repair(filling, icosphere(0))
    assert (len(one.cells), repairs.fragments, repairs.fragment_volume) == (12, 2, pytest.approx(3.0))
    both, repairs = repair(belonging(filling, 0, 4.5), two_bodies())
    assert (len(both.cells), repairs.fragments) == (24, 1)
    assert both.cells.max() == len(both.points) - 1


def test_nothing_stays_nothing():
    points = np.arange(12.0).reshape(4, 3)
    for face in (np.zeros(4, np.int32), np.full(4, INTERIOR, np.int32)):
        repaired, repairs = repair(Filling(points, np.empty((0, 4), np.int32), face), icosphere(0))
        assert (repaired.points.shape, repaired.cells.shape, repaired.face.shape) == ((0, 3), (0, 4), (0,))
        assert repairs == Repairs()
