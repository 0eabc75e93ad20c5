# SPDX-License-Identifier: BSD-3-Clause
"""Planted slivers: the same body with a bad mesh, to see what that does to a solver."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.connectivity import vertex_cells
from meshes.errors import InputError
from meshes.quality import shapes
from meshes.surface import boundary
from meshes.types import Cells, TetMesh

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]

# Share of the vertices that are moved: what a mesher without a clean-up of its own leaves.
SHARE = 0.01

_BISECTIONS = 40


def with_slivers(mesh: TetMesh, degrees: float) -> TetMesh:
    """Move one vertex in a hundred until its flattest tetrahedron has this angle.

    Only vertices inside are moved, each towards a face of its star, and no two of one tetrahedron, so the body keeps
    its shape and its volume, and no tetrahedron is turned inside out. Every time the same ones.

    Parameters
    ----------
    mesh : Tetrahedral mesh.
    degrees : Smallest dihedral angle [degrees] around each vertex that is moved.

    Raises
    ------
    InputError
        No inner vertex, or none whose tetrahedra have larger angles.
    """
    start, around = vertex_cells(mesh.cells, len(mesh.points))
    smallest = shapes(mesh.points, mesh.cells)[0]
    fit = np.minimum.reduceat(smallest[around], start[:-1]) > degrees
    fit[boundary(mesh.cells)] = False
    if not fit.any():
        raise InputError(
            "no vertex inside has tetrahedra that could become slivers",
            found=f"an angle of {degrees:g} degrees is asked for",
            allowed="an angle smaller than those of the mesh, and a body with vertices inside",
            advice="ask for a smaller angle or for more vertices",
        )
    moved, stars, begin = _apart(mesh.cells, start, around, np.flatnonzero(fit))
    return mesh.moved(_flattened(mesh, moved, stars, begin, degrees))


def _apart(cells: Cells, start: Longs, around: Cells, candidates: Longs) -> tuple[Longs, Longs, Longs]:
    """Vertices to move, no two of one tetrahedron; tetrahedra of their stars, and where each star begins."""
    random = np.random.default_rng(1)
    wanted = max(1, round(SHARE * (len(start) - 1)))
    taken = np.zeros(len(start) - 1, bool)
    moved: list[int] = []
    stars: list[Longs] = []
    for v in random.permutation(candidates):
        star = around[start[v] : start[v + 1]]
        if not taken[cells[star]].any():
            taken[cells[star]] = True
            moved.append(int(v))
            stars.append(random.permutation(star))
            if len(moved) == wanted:
                break
    begin = np.cumsum([0, *(len(star) for star in stars[:-1])])
    return np.array(moved), np.concatenate(stars), begin


def _flattened(mesh: TetMesh, moved: Longs, stars: Longs, begin: Longs, degrees: float) -> Floats:
    """Positions in which the smallest angle of each star is this, by bisection on the way to the face of its first.

    Volumes change linearly on that way, and the first tetrahedron ends flat: somewhere before one of the star is, so
    the smallest angle takes every value down to zero while all volumes are positive.
    """
    points, cells = mesh.points.copy(), mesh.cells[stars]
    # The mean of the four is a quarter of the way from the centre of the face to the vertex.
    centre = mesh.points[mesh.cells[stars[begin]]].mean(axis=1)
    way = (centre - mesh.points[moved]) * (4.0 / 3.0)
    least, most = np.zeros(len(moved)), np.ones(len(moved))
    for _ in range(_BISECTIONS):
        t = 0.5 * (least + most)
        points[moved] = mesh.points[moved] + t[:, None] * way
        smallest, _, volume = shapes(points, cells)
        angle = np.minimum.reduceat(np.where(volume > 0.0, smallest, 0.0), begin)
        least, most = np.where(angle > degrees, t, least), np.where(angle > degrees, most, t)
    points[moved] = mesh.points[moved] + least[:, None] * way
    return points
