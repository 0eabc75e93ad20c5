# SPDX-License-Identifier: BSD-3-Clause
"""Which blocks of an assembled Hessian can be non-zero: those of free vertices that share an element."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from meshes.connectivity import vertex_cells
from meshes.jit import kernel

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Pattern:
    """Blocks of a square matrix in compressed rows; n rows.

    Parameters
    ----------
    ptr : Row i owns the blocks ptr[i] to ptr[i + 1] - 1, shape [n + 1].
    column : Columns, ascending within a row, the diagonal among them, shape [blocks].
    diagonal : Block on the diagonal of each row, shape [n].
    """

    ptr: Longs
    column: Ints
    diagonal: Longs

    @property
    def n_rows(self) -> int:
        """Number of block rows."""
        return len(self.diagonal)

    @property
    def n_blocks(self) -> int:
        """Number of blocks."""
        return len(self.column)


def vertex_pattern(disc: Discretisation) -> Pattern:
    """Pattern of the Hessian over the free vertices, which are numbered in their order."""
    n_free = int(disc.free.sum())
    row = np.full(disc.n_vertices, -1, np.int32)
    row[disc.free] = np.arange(n_free, dtype=np.int32)
    around = vertex_cells(disc.mesh.cells, disc.n_vertices)
    vertices = np.flatnonzero(disc.free)
    ptr, stamp = np.zeros(n_free + 1, np.int64), np.full(n_free, -1, np.int32)
    _list_columns(disc.mesh.cells, row, *around, vertices, stamp, ptr, np.empty(0, np.int32))
    np.cumsum(ptr, out=ptr)
    column = np.empty(ptr[-1], np.int32)
    stamp[:] = -1
    _list_columns(disc.mesh.cells, row, *around, vertices, stamp, ptr, column)
    return sorted_pattern(ptr, column)


def sorted_pattern(ptr: Longs, column: Ints) -> Pattern:
    """Pattern of rows whose columns come in any order; sorts them in place. Every row has its diagonal."""
    diagonal = np.empty(len(ptr) - 1, np.int64)
    _sort_rows(ptr, column, diagonal)
    return Pattern(ptr, column, diagonal)


@kernel
def _list_columns(
    tets: Ints, row: Ints, start: Longs, cell: Ints, vertices: Longs, stamp: Ints, ptr: Longs, column: Ints
) -> None:
    """Count the columns of row i in ptr[i + 1], or, where there is room for them, list them from ptr[i] on."""
    counting = len(column) == 0
    for i in range(len(vertices)):
        n = 0
        v = vertices[i]
        for j in range(start[v], start[v + 1]):
            for k in range(4):
                c = row[tets[cell[j], k]]
                if c >= 0 and stamp[c] != i:
                    stamp[c] = i
                    if not counting:
                        column[ptr[i] + n] = c
                    n += 1
        if counting:
            ptr[i + 1] = n


@kernel
def _sort_rows(ptr: Longs, column: Ints, diagonal: Longs) -> None:
    for i in range(len(ptr) - 1):
        for j in range(ptr[i] + 1, ptr[i + 1]):
            c = column[j]
            k = j
            while k > ptr[i] and column[k - 1] > c:
                column[k] = column[k - 1]
                k -= 1
            column[k] = c
        for j in range(ptr[i], ptr[i + 1]):
            if column[j] == i:
                diagonal[i] = j
