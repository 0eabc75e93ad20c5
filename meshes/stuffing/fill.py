# SPDX-License-Identifier: BSD-3-Clause
"""From signs, cuts and moved points to vertices and tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel
from meshes.stuffing.lattice import DIRECTIONS, N_DIRECTIONS
from meshes.stuffing.signs import Sample
from meshes.stuffing.stencils import FIRST_CUT, tables
from meshes.stuffing.warp import Warped
from meshes.types import Cells, Points

INTERIOR = -1  # triangle number of vertices that lie on no triangle of the surface


@dataclass(frozen=True, eq=False)
class Filling:
    """Tetrahedra that fill a surface.

    Parameters
    ----------
    points : Vertex positions [m], shape [n_vertices, 3].
    cells : Positively oriented tetrahedra, shape [n_tets, 4].
    face : Triangle of the surface that each vertex lies on, INTERIOR for inside vertices; shape [n_vertices].
    """

    points: Points
    cells: Cells
    face: NDArray[np.int32]


def fill(sample: Sample, warped: Warped) -> Filling:
    """Number the vertices column by column and fill every lattice tetrahedron with its stencil."""
    lattice = sample.lattice
    points = np.empty((warped.vertices, 3))
    face = np.full(warped.vertices, INTERIOR, np.int32)
    vertex, cut_vertex = np.full(lattice.size, -1, np.int32), np.full(sample.cut.shape, -1, np.int32)
    _number_vertices(
        sample.sign, sample.slot, sample.cut, sample.face, warped.way, lattice.steps,
        np.array(lattice.shape), DIRECTIONS, vertex, cut_vertex, points, face,
    )  # fmt: skip
    points *= 0.5 * lattice.spacing
    points += lattice.origin
    count, parts, cuts = tables()
    inner = (sample.sign, sample.slot, vertex, cut_vertex, np.array(lattice.shape), lattice.tetrahedra)
    n = _emit(*inner, count, parts, cuts, np.empty((0, 4), np.int32))
    cells = np.empty((n, 4), np.int32)
    _emit(*inner, count, parts, cuts, cells)
    return Filling(points, cells, face)


@kernel
def _number_vertices(
    sign: NDArray[np.int8],
    slot: NDArray[np.int32],
    cut: NDArray[np.float64],
    face: NDArray[np.int32],
    way: NDArray[np.int8],
    steps: NDArray[np.int64],
    shape: NDArray[np.int64],
    directions: NDArray[np.int64],
    vertex: NDArray[np.int32],
    cut_vertex: NDArray[np.int32],
    points: Points,
    point_face: NDArray[np.int32],
) -> None:
    """Number of the vertex at each lattice point and on each edge from a near point; positions in half steps."""
    here = np.empty(3)
    n = 0
    for p in range(sign.shape[0]):
        i = slot[p]
        if sign[p] < 0 and i < 0:
            continue
        column = p >> 1
        here[2] = 2 * (column % shape[2]) + (p & 1)
        here[1] = 2 * (column // shape[2] % shape[1]) + (p & 1)
        here[0] = 2 * (column // shape[2] // shape[1]) + (p & 1)
        if sign[p] > 0:
            vertex[p] = n
            for c in range(3):  # an assignment of rows would compile for three seconds
                points[n, c] = here[c]
            n += 1
        if i < 0:
            continue
        beside = False
        for e in range(2 * N_DIRECTIONS):
            beside |= sign[p + steps[p & 1, e]] > 0
        if sign[p] == 0 and beside:
            e = way[i]
            d = e % N_DIRECTIONS
            j = i if e < N_DIRECTIONS else slot[p + steps[p & 1, e]]
            t = cut[j, d] if e < N_DIRECTIONS else cut[j, d] - 1.0
            for c in range(3):
                points[n, c] = here[c] + t * directions[d, c]
            point_face[n] = face[j, d]
            vertex[p] = n
            n += 1
        for d in range(N_DIRECTIONS):
            if sign[p] * sign[p + steps[p & 1, d]] < 0:
                for c in range(3):
                    points[n, c] = here[c] + cut[i, d] * directions[d, c]
                point_face[n] = face[i, d]
                cut_vertex[i, d] = n
                n += 1


@kernel
def _emit(
    sign: NDArray[np.int8],
    slot: NDArray[np.int32],
    vertex: NDArray[np.int32],
    cut_vertex: NDArray[np.int32],
    shape: NDArray[np.int64],
    tetrahedra: NDArray[np.int64],
    count: NDArray[np.int8],
    parts: NDArray[np.int8],
    cuts: NDArray[np.int8],
    cells: Cells,
) -> int:
    """Write the tetrahedra of all stencils, or only count them when cells is empty."""
    n = 0
    for i in range(1, shape[0] - 1):
        for j in range(1, shape[1] - 1):
            base = 2 * ((i * shape[1] + j) * shape[2]) + 1
            for k in range(1, shape[2] - 1):
                centre = base + 2 * k
                for tet in range(tetrahedra.shape[0]):
                    code, power = 0, 1
                    for corner in range(4):
                        code += (sign[centre + tetrahedra[tet, corner]] + 1) * power
                        power *= 3
                    if cells.shape[0] > 0:
                        for m in range(count[code]):
                            for corner in range(4):
                                part = parts[tet, code, m, corner]
                                if part < FIRST_CUT:
                                    number = vertex[centre + tetrahedra[tet, part]]
                                else:
                                    low = cuts[tet, part - FIRST_CUT, 0]
                                    row = slot[centre + tetrahedra[tet, low]]
                                    number = cut_vertex[row, cuts[tet, part - FIRST_CUT, 1]]
                                cells[n + m, corner] = number
                    n += count[code]
    return n
