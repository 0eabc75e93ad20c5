# SPDX-License-Identifier: BSD-3-Clause
"""Mesh types.

1. Points, cells and regions come out as contiguous float64, int32, int32, whatever real arrays they came from.
2. What is no mesh is refused with where, found and allowed: shapes, types, NaN, indices, unused vertices, volumes.
3. Region ids that int32 cannot hold exactly are refused; whole floats are taken.
4. The content hash covers points, cells and regions and nothing else.
5. Volumes and the enclosed volume are those of known bodies.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes.errors import MeshError
from meshes.generators import box, icosphere
from meshes.types import Origin, TetMesh, TriMesh, signed_volumes

POINTS = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
CELL = [[0, 1, 2, 3]]


def test_arrays_are_converted():
    mesh = TetMesh(np.asfortranarray(np.array(POINTS, np.float32)), np.array(CELL, np.uint64), regions=[2.0])
    assert (mesh.points.dtype, mesh.cells.dtype, mesh.regions.dtype) == (np.float64, np.int32, np.int32)
    assert all(array.flags.c_contiguous for array in (mesh.points, mesh.cells, mesh.regions))
    assert mesh.regions.tolist() == [2]
    assert TetMesh(POINTS, CELL).regions.tolist() == [0]


@pytest.mark.parametrize(
    ("points", "cells", "parts"),
    [
        ([], CELL, ("not points in space", "shape (0,)", "3 coordinates")),
        (np.empty((0, 3)), CELL, ("0 points of 3 coordinates", "1 point or more")),
        (np.zeros((4, 2)), CELL, ("4 points of 2 coordinates",)),
        ([[0, 0, 0], [1, 0]], CELL, ("vertex positions are not a table", "rows of one length")),
        ([["0", "0", "0"]], CELL, ("vertex positions are not numbers", "<U1")),
        (np.zeros((4, 3), complex), CELL, ("vertex positions are not numbers", "complex128")),
        ([*POINTS[:3], [0, 0, np.inf]], CELL, ("1 vertex positions are not finite", "inf", "vertex 3")),
        (POINTS, np.empty((0, 4), int), ("no usable tetrahedron list", "(0, 4)")),
        (POINTS, [[0, 1, 2]], ("(1, 3)", "(n > 0, 4)")),
        (POINTS, [[0.0, 1, 2, 3]], ("tetrahedron indices are not integers", "float64")),
        (POINTS, [[0, 1, 2, 4], [0, 1, 2, -1]], ("tetrahedron 0", "(2 such)", "[0, 1, 2, 4]", "indices 0 to 3")),
        ([*POINTS, [5, 5, 5]], CELL, ("1 of 5 vertices belong to no cell", "vertex 4")),
        (POINTS, [[0, 2, 1, 3]], ("no positive volume", "-0.167 m^3 in tetrahedron 0")),
    ],
)
def test_refusals(points, cells, parts):
    with pytest.raises(MeshError) as caught:
        TetMesh(points, cells, Origin(name="made up"))
    for part in ("made up", *parts):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("regions", "parts"),
    [
        ([1.5], ("1 region ids are not whole numbers", "1.5 in cell 0")),
        ([np.nan], ("nan in cell 0",)),
        ([2**31], ("2147483648 in cell 0", "-2147483648 to 2147483647")),
        ([1, 2], ("do not match the cells", "(2,)", "(1,)")),
        ([[1]], ("do not match the cells", "(1, 1)")),
        (["bone"], ("region ids are not numbers",)),
    ],
)
def test_regions_that_are_refused(regions, parts):
    with pytest.raises(MeshError) as caught:
        TetMesh(POINTS, CELL, regions=regions)
    for part in parts:
        assert part in str(caught.value)


def test_content_hash():
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    same = TetMesh(mesh.points.tolist(), mesh.cells.astype(np.int64), Origin(name="other"), [0.0] * len(mesh.cells))
    assert same.content_hash == mesh.content_hash
    regions = np.arange(len(mesh.cells)) % 2
    others = [
        mesh.moved(1.5 * mesh.points),
        replace(mesh, cells=mesh.cells[::-1]),
        replace(mesh, regions=regions),
        replace(mesh, regions=1 - regions),
    ]
    assert len({mesh.content_hash, *(other.content_hash for other in others)}) == 5


def test_volumes():
    mesh = box((1.0, 2.0, 3.0), (40, 30, 20))  # more cells than one piece holds
    assert mesh.volumes.sum() == pytest.approx(6.0, rel=1e-13)
    assert signed_volumes(mesh.points, mesh.cells[:, [0, 2, 1, 3]]) == pytest.approx(-mesh.volumes, rel=1e-12)
    ball = icosphere(5, radius=1.0)
    assert ball.enclosed_volume == pytest.approx(4 * np.pi / 3, rel=2e-3)
    assert TriMesh(ball.points, ball.cells[:, ::-1]).enclosed_volume == pytest.approx(-ball.enclosed_volume, rel=1e-13)
