# SPDX-License-Identifier: BSD-3-Clause
"""The rabbit.

1. Its surface is one closed, outward 2-manifold of genus 0 without thin triangles, 1 m tall, standing on z = 0.
2. A plane 4% below the top selects the tip of the left ear only; the right ear is a separate, lower piece.
3. Its left and right halves differ by the ears only.
4. The number of triangles is met within 5%.
5. Filled with 5000 vertices it is one piece, keeps its volume, and its ears are at least two elements thick.
6. Counts out of range are refused.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.errors import InputError
from meshes.rabbit import rabbit_surface, rabbit_values
from meshes.types import TriMesh


@pytest.fixture(scope="module")
def rabbit() -> TriMesh:
    return rabbit_surface()


def pieces_above(surface: TriMesh, height: float) -> list[np.ndarray]:
    """Vertex sets of the connected pieces of the surface above a height."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(surface.points)
    above = surface.points[:, 2] > height
    kept = surface.cells[above[surface.cells].all(axis=1)]
    rows, columns = kept[:, [0, 1]].ravel(), kept[:, [1, 2]].ravel()
    _, labels = connected_components(coo_array((np.ones(len(rows)), (rows, columns)), (n, n)), directed=False)
    used = np.unique(kept)
    return [used[labels[used] == label] for label in np.unique(labels[used])]


def test_surface_is_a_closed_manifold_one_metre_tall(rabbit):
    directed = rabbit.cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    forward = np.sort(directed[:, 0] * len(rabbit.points) + directed[:, 1])
    backward = np.sort(directed[:, 1] * len(rabbit.points) + directed[:, 0])
    assert (np.diff(forward) > 0).all()
    np.testing.assert_array_equal(forward, backward)
    assert len(rabbit.points) - len(directed) // 2 + len(rabbit.cells) == 2
    assert len(pieces_above(rabbit, -1.0)) == 1
    assert rabbit.points[:, 2].min() == 0.0
    assert rabbit.points[:, 2].max() == 1.0
    assert 0.06 < rabbit.enclosed_volume < 0.1
    a, b, c = (rabbit.points[rabbit.cells[:, k]] for k in range(3))
    edges = np.stack([np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))])
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert (areas > 0.1 * edges.max(axis=0) ** 2).all()


def test_top_selects_the_tip_of_one_ear(rabbit):
    tip, *others = pieces_above(rabbit, 0.96)
    assert not others
    assert (rabbit.points[tip, 1] > 0.0).all()
    assert np.ptp(rabbit.points[tip, :2], axis=0).max() < 0.1
    ears = pieces_above(rabbit, 0.75)
    assert len(ears) == 2
    tops = sorted(float(rabbit.points[ear, 2].max()) for ear in ears)
    assert tops[0] < 0.93
    assert tops[1] == 1.0


def test_left_and_right_differ_by_the_ears_only():
    random = np.random.default_rng(987654321)
    points = random.uniform((-0.5, -0.3, 0.0), (0.4, 0.3, 0.5), (20_000, 3))
    mirrored = points * (1.0, -1.0, 1.0)
    values = rabbit_values(points)
    near = values < 0.03  # farther away the lower ear is felt
    assert near.sum() > 5000
    np.testing.assert_allclose(values[near], rabbit_values(mirrored)[near], atol=1e-12)
    ear = np.array([[0.06, 0.07, 0.9]])
    assert rabbit_values(ear)[0] < 0.0 < rabbit_values(ear * (1.0, -1.0, 1.0))[0]


@pytest.mark.parametrize("triangles", [3000, 20_000])
def test_triangle_count_is_met(triangles):
    assert len(rabbit_surface(triangles).cells) == pytest.approx(triangles, rel=0.05)


def test_five_thousand_vertices_resolve_the_ears(rabbit):
    pytest.importorskip("meshes.stuffing.tetrahedralise")
    from meshes.make import make_tets
    from meshes.quality import quality

    made = make_tets("rabbit", 5000)
    mesh = made.mesh
    assert len(mesh.points) == pytest.approx(5000, rel=0.05)
    assert mesh.volumes.sum() == pytest.approx(rabbit.enclosed_volume, rel=0.02)
    assert quality(mesh).components == 1
    # Vertices strictly inside the ears, away from every boundary face, are where two elements meet across.
    faces = np.sort(mesh.cells[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3), axis=1)
    unique, counts = np.unique(faces, axis=0, return_counts=True)
    inner = np.ones(len(mesh.points), bool)
    inner[unique[counts == 1]] = False
    for side, heights in ((1.0, (0.72, 0.92)), (-1.0, (0.70, 0.84))):
        ear = (
            inner
            & (side * mesh.points[:, 1] > 0.0)
            & (mesh.points[:, 2] > heights[0])
            & (mesh.points[:, 2] < heights[1])
        )
        levels = np.unique((40 * mesh.points[ear, 2]).astype(int))
        assert len(levels) >= 40 * (heights[1] - heights[0]) - 2, "an inner vertex at every height of the ear"
    tip = mesh.points[mesh.points[:, 2] > 0.96]
    assert len(tip) >= 3
    assert (tip[:, 1] > 0.0).all()


@pytest.mark.parametrize("triangles", [100, 10**9])
def test_impossible_counts_are_refused(triangles):
    with pytest.raises(InputError, match=str(triangles)):
        rabbit_surface(triangles)
