# SPDX-License-Identifier: BSD-3-Clause
"""Surface defects, orientation and tetrahedral boundaries.

1. The boundary of a box mesh is the closed, outward surface of its volume; of one tetrahedron, its four faces. Every
   boundary triangle is a face of its owner, and every face of one cell only is there.
2. The report counts open, crowded and inconsistent edges, pinched vertices and components of constructed cases.
3. An open, a crowded and an inconsistently wound surface are refused with the counts.
4. No triangles and no cells have no defects and no boundary.
5. `outward` turns an inverted surface, and an inverted component beside others, but leaves a void alone.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from meshes.errors import MeshError
from meshes.generators import box, icosphere
from meshes.surface import (
    boundary,
    boundary_with_owners,
    check_closed,
    edge_table,
    manifold_report,
    outward,
    pinched_vertices,
    triangle_components,
)
from meshes.types import TriMesh

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)


def together(*surfaces: TriMesh) -> TriMesh:
    offsets = np.cumsum([0] + [len(s.points) for s in surfaces])
    cells = np.vstack([s.cells + offset for s, offset in zip(surfaces, offsets[:-1], strict=True)])
    return TriMesh(np.vstack([s.points for s in surfaces]), cells)


def flipped(surface: TriMesh) -> TriMesh:
    return TriMesh(surface.points, surface.cells[:, ::-1])


def shifted(surface: TriMesh, x: float) -> TriMesh:
    return surface.moved(surface.points + np.array([x, 0, 0]))


def test_boundary_of_one_tetrahedron():
    triangles = boundary(np.array([[0, 1, 2, 3]], np.int32))
    assert sorted(map(sorted, triangles.tolist())) == [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]
    assert TriMesh(CORNERS, triangles).enclosed_volume == pytest.approx(1 / 6, rel=1e-14)


def test_boundary_of_a_box_is_closed_and_outward():
    mesh = box((1.0, 2.0, 3.0), (3, 4, 5))
    triangles = boundary(mesh.cells)
    assert len(triangles) == 2 * 2 * (3 * 4 + 4 * 5 + 5 * 3)
    assert manifold_report(triangles).manifold
    used, cells = np.unique(triangles, return_inverse=True)
    skin = TriMesh(mesh.points[used], cells.reshape(-1, 3))
    assert skin.enclosed_volume == pytest.approx(6.0, rel=1e-13)


def test_owners():
    mesh = box((1.0, 1.0, 1.0), (4, 3, 2))
    cells = mesh.cells[np.random.default_rng(48_611).permutation(len(mesh.cells))[:70]]
    triangles, owners = boundary_with_owners(cells)
    np.testing.assert_array_equal(triangles, boundary(cells))
    faces = [(row, *sorted(np.delete(cell, k))) for row, cell in enumerate(cells.tolist()) for k in range(4)]
    inner = Counter(face[1:] for face in faces)
    expected = sorted(face for face in faces if inner[face[1:]] == 1)
    found = sorted((row, *sorted(triangle)) for row, triangle in zip(owners.tolist(), triangles.tolist(), strict=True))
    assert found == expected


def test_nothing_has_no_defects():
    none, no_cells = np.empty((0, 3), np.int32), np.empty((0, 4), np.int32)
    assert boundary(no_cells).shape == (0, 3)
    assert [len(part) for part in boundary_with_owners(no_cells)] == [0, 0]
    edges, faces, balance = edge_table(none)
    assert (edges.shape, len(faces), len(balance)) == ((0, 2), 0, 0)
    assert len(pinched_vertices(none)) == len(triangle_components(none)) == 0
    report = manifold_report(none)
    assert (report.triangles, report.edges, report.vertices, report.components) == (0, 0, 0, 0)


def test_report_of_a_closed_surface():
    report = manifold_report(TETRAHEDRON)
    assert (report.triangles, report.edges, report.vertices, report.components) == (4, 6, 4, 1)
    assert report.closed
    assert report.manifold
    assert report.as_dict()["manifold"] is True


def test_report_counts_open_and_inconsistent_edges():
    assert manifold_report(TETRAHEDRON[:3]).open_edges == 3
    turned = TETRAHEDRON.copy()
    turned[0] = turned[0, ::-1]
    report = manifold_report(turned)
    assert report.closed
    assert report.inconsistent_edges == 3
    assert not report.manifold


def test_report_counts_contacts():
    in_a_vertex = np.vstack([TETRAHEDRON, [[0, 5, 4], [0, 4, 6], [0, 6, 5], [4, 5, 6]]])
    report = manifold_report(in_a_vertex)
    assert report.closed
    assert (report.pinched_vertices, report.components) == (1, 1)
    in_an_edge = np.vstack([TETRAHEDRON, [[0, 4, 1], [0, 1, 5], [0, 5, 4], [1, 4, 5]]])
    report = manifold_report(in_an_edge)
    assert (report.crowded_edges, report.open_edges) == (1, 0)
    assert manifold_report(np.vstack([TETRAHEDRON, TETRAHEDRON + 4])).components == 2


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (TETRAHEDRON[:3], "3 open edges"),
        (np.vstack([TETRAHEDRON, [[0, 1, 2]]]), "3 edges of 3 or more"),
        (np.vstack([TETRAHEDRON[:3], [[2, 1, 3]]]), "3 such edges among 6"),
    ],
)
def test_unusable_surfaces_are_refused(cells, words):
    with pytest.raises(MeshError, match=words):
        check_closed(TriMesh(CORNERS, cells))


def test_outward_turns_an_inverted_surface():
    ball = icosphere(2)
    check_closed(ball)
    assert outward(ball) is ball
    assert outward(flipped(ball)).enclosed_volume == pytest.approx(ball.enclosed_volume, rel=1e-13)


def test_outward_turns_one_inverted_body_of_two():
    ball, small = icosphere(2), shifted(icosphere(2, radius=0.2), 2.0)
    mixed = together(ball, flipped(small))
    expected = ball.enclosed_volume + small.enclosed_volume
    assert outward(mixed).enclosed_volume == pytest.approx(expected, rel=1e-13)
    assert triangle_components(mixed.cells).tolist() == [0] * len(ball.cells) + [1] * len(small.cells)


def test_outward_keeps_a_void():
    ball, void = icosphere(2), icosphere(2, radius=0.2)
    hollow = together(ball, flipped(void))
    expected = ball.enclosed_volume - void.enclosed_volume
    assert outward(hollow).enclosed_volume == pytest.approx(expected, rel=1e-13)
    assert outward(flipped(hollow)).enclosed_volume == pytest.approx(expected, rel=1e-13)
