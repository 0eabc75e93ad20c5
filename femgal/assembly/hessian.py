# SPDX-License-Identifier: BSD-3-Clause
"""Assembly of the Hessian of the incremental potential over the free vertices.

Rows are cut into ranges of ROWS. Whoever assembles a range computes all elements that touch it, tile by tile, and
adds their blocks to its own rows only; elements between two ranges are computed for both, a quarter of all. So threads
never write the same row, every row adds its elements in ascending order, and the number of threads changes no bit.

Sums are float64 also where elements and matrix are float32. Rounding in every sum has a bias that coarse matrices, the
sums of many rows, do not average out: on a bunny of 200,000 vertices, so stiff that its inertia counts for nothing, it
was 1e-5 of the coarsest one, which is as much as its softest modes, and doubled the iterations of the V-cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.element_blocks import BLOCKS, INPUT, definite_blocks, exact_blocks, gather_elements
from femgal.assembly.matrix import BlockMatrix
from femgal.assembly.pattern import Pattern, vertex_pattern
from femgal.discretisation import Discretisation
from femgal.kernels.backend import Precision
from femgal.kernels.cpu.simd import W
from femgal.kernels.cpu.threads import Workers
from meshes.errors import MeshError
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Shorts = NDArray[np.uint16]

# Rows per range.
ROWS = 2048

# Place of a block that nobody owns, because one of its vertices is constrained.
NOWHERE = 65535

# Block of a tile (`femgal.assembly.element_blocks`) for each pair of an element's vertices, 4 a + b; below the diagonal
# it is to be transposed.
_BLOCK_OF = np.array([9, 6, 7, 8, 6, 0, 1, 2, 7, 1, 3, 4, 8, 2, 4, 5])


@dataclass(frozen=True, eq=False)
class _Ranges:
    """Elements of every range of rows, and where the blocks of an element go.

    Parameters
    ----------
    ptr, element : Elements that touch range k, ascending: element[ptr[k] : ptr[k + 1]].
    place : For vertices a and b of an element, the block within row a, or NOWHERE, shape [m, 16].
    """

    ptr: Longs
    element: Ints
    place: Shorts


class HessianAssembly:
    """Assembles d2 phi(x) = M / h^2 + d2 E(x) over the free vertices; all that x does not change is made once.

    Parameters
    ----------
    disc : The discretised bodies.
    precision : Of the element blocks and of the values.
    threads : Number of threads; None takes the processors that this process may use. Never changes a bit.

    Raises
    ------
    MeshError
        A vertex has NOWHERE neighbours or more.
    """

    def __init__(self, disc: Discretisation, precision: Precision = "float32", threads: int | None = None) -> None:
        self.disc, self.precision, self.workers = disc, precision, Workers(threads)
        self.pattern = vertex_pattern(disc)
        self._row = np.where(disc.free, np.cumsum(disc.free) - 1, -1).astype(np.int32)
        self._ranges = _build_ranges(disc, self.pattern, self._row)
        self._mass = np.ascontiguousarray(disc.mass[disc.free])

    def matrix(self) -> BlockMatrix:
        """A matrix of the right pattern without values yet."""
        return BlockMatrix(self.pattern, np.empty((self.pattern.n_blocks, 9), self.precision), self.workers)

    def assemble(
        self, x: Floats, inverse_h2: float, *, definite: bool = True, out: BlockMatrix | None = None
    ) -> BlockMatrix:
        """The Hessian at positions x.

        Parameters
        ----------
        x : Positions of all vertices [m], shape [n, 3].
        inverse_h2 : Factor of the mass [1/s^2]; 0 leaves the elastic Hessian.
        definite : Replace every element's Hessian by its positive semi-definite part (Smith et al. 2019), as
            `Backend.hessian_product(definite=True)` does; otherwise it is the exact one.
        out : A matrix made before by this assembly, to be overwritten.

        Returns
        -------
        The matrix [N/m]; rows and columns are the free vertices in their order.
        """
        out = out or self.matrix()
        disc, ranges, pattern = self.disc, self._ranges, self.pattern
        elements = (ranges.ptr, ranges.element, ranges.place, disc.mesh.cells, disc.B, disc.Vmu, disc.Vlam)
        rows = (self._row, pattern.ptr, pattern.diagonal, self._mass, inverse_h2)
        run = self.workers.run
        run(
            _assemble,
            len(ranges.ptr) - 1,
            definite,
            x,
            *elements,
            *rows,
            _BLOCK_OF,
            out.values.reshape(-1),
            smallest_share=1,
        )
        return out


def assemble(
    disc: Discretisation, x: Floats, inverse_h2: float, *, definite: bool = True, precision: Precision = "float64"
) -> BlockMatrix:
    """`HessianAssembly.assemble` for one position only."""
    return HessianAssembly(disc, precision, 1).assemble(x, inverse_h2, definite=definite)


def _build_ranges(disc: Discretisation, pattern: Pattern, row: Ints) -> _Ranges:
    tets = disc.mesh.cells
    longest = int(np.diff(pattern.ptr).max(initial=0))
    if longest >= NOWHERE:
        raise MeshError("a vertex has too many neighbours for an assembled matrix", found=longest, allowed=NOWHERE - 1)
    ptr = np.zeros(-(-pattern.n_rows // ROWS) + 1, np.int64)
    _list_elements(tets, row, ptr, np.empty(0, np.int32))
    np.cumsum(ptr, out=ptr)
    element = np.empty(ptr[-1], np.int32)
    _list_elements(tets, row, ptr[:-1].copy(), element)
    place = np.full((len(tets), 16), NOWHERE, np.uint16)
    _find_places(tets, row, pattern.ptr, pattern.column, place)
    return _Ranges(ptr, element, place)


@kernel
def _list_elements(tets: Ints, row: Ints, at: Longs, element: Ints) -> None:
    """Count the elements of range k in at[k + 1], or, where there is room for them, list them from at[k] on."""
    counting = len(element) == 0
    ranges = np.empty(4, np.int64)
    for e in range(len(tets)):
        n = 0
        for a in range(4):
            if row[tets[e, a]] < 0:
                continue
            r = row[tets[e, a]] // ROWS
            known = False
            for k in range(n):
                known |= ranges[k] == r
            if not known:
                ranges[n] = r
                n += 1
        for k in range(n):
            if counting:
                at[ranges[k] + 1] += 1
            else:
                element[at[ranges[k]]] = e
                at[ranges[k]] += 1


@kernel
def _find_places(tets: Ints, row: Ints, ptr: Longs, column: Ints, place: Shorts) -> None:
    for e in range(len(tets)):
        for a in range(4):
            i = row[tets[e, a]]
            if i < 0:
                continue
            for b in range(4):
                c = row[tets[e, b]]
                if c < 0:
                    continue
                j = ptr[i]
                while column[j] != c:
                    j += 1
                place[e, 4 * a + b] = j - ptr[i]


@scalar
def _add(values: Reals, k: np.uint64, blocks: Reals, f: np.uint64) -> None:
    """Add rows f, f + W, ... of a lane; all is read before anything is written, so that values move several at once."""
    v = (
        values[k] + blocks[f],
        values[k + 1] + blocks[f + W],
        values[k + 2] + blocks[f + 2 * W],
        values[k + 3] + blocks[f + 3 * W],
        values[k + 4] + blocks[f + 4 * W],
        values[k + 5] + blocks[f + 5 * W],
        values[k + 6] + blocks[f + 6 * W],
        values[k + 7] + blocks[f + 7 * W],
        values[k + 8] + blocks[f + 8 * W],
    )
    values[k], values[k + 1], values[k + 2], values[k + 3], values[k + 4] = v[0], v[1], v[2], v[3], v[4]
    values[k + 5], values[k + 6], values[k + 7], values[k + 8] = v[5], v[6], v[7], v[8]


@scalar
def _add_transposed(values: Reals, k: np.uint64, blocks: Reals, f: np.uint64) -> None:
    v = (
        values[k] + blocks[f],
        values[k + 1] + blocks[f + 3 * W],
        values[k + 2] + blocks[f + 6 * W],
        values[k + 3] + blocks[f + W],
        values[k + 4] + blocks[f + 4 * W],
        values[k + 5] + blocks[f + 7 * W],
        values[k + 6] + blocks[f + 2 * W],
        values[k + 7] + blocks[f + 5 * W],
        values[k + 8] + blocks[f + 8 * W],
    )
    values[k], values[k + 1], values[k + 2], values[k + 3], values[k + 4] = v[0], v[1], v[2], v[3], v[4]
    values[k + 5], values[k + 6], values[k + 7], values[k + 8] = v[5], v[6], v[7], v[8]


@scalar
def _add_symmetric(values: Reals, k: np.uint64, blocks: Reals, f: np.uint64) -> None:
    """Of a diagonal block the upper half only: rounding must not make the matrix unsymmetric."""
    xy, xz, yz = values[k + 1] + blocks[f + W], values[k + 2] + blocks[f + 2 * W], values[k + 5] + blocks[f + 5 * W]
    xx, yy, zz = values[k] + blocks[f], values[k + 4] + blocks[f + 4 * W], values[k + 8] + blocks[f + 8 * W]
    values[k], values[k + 1], values[k + 2], values[k + 3], values[k + 4] = xx, xy, xz, xy, yy
    values[k + 5], values[k + 6], values[k + 7], values[k + 8] = yz, xz, yz, zz


@scalar
def _scatter(
    e: int,
    l: int,  # noqa: E741
    first: int,
    last: int,
    place: Shorts,
    tets: Ints,
    row: Ints,
    ptr: Longs,
    block_of: Longs,
    blocks: Reals,
    values: Reals,
) -> None:
    """Add the blocks of element e, in lane l, to the rows first to last - 1."""
    for a in range(4):
        i = row[tets[e, a]]
        if i < first or i >= last:
            continue
        for b in range(4):
            p = np.int64(place[e, 4 * a + b])
            if p == NOWHERE:
                continue
            # Unsigned, which spares a test for negative indices at every access.
            k, f = np.uint64(9 * (ptr[i] - ptr[first] + p)), np.uint64(9 * W * block_of[4 * a + b] + l)
            if a == b:
                _add_symmetric(values, k, blocks, f)
            elif a < b:
                _add(values, k, blocks, f)
            else:
                _add_transposed(values, k, blocks, f)


@kernel
def _assemble(
    start: int,
    stop: int,
    definite: bool,
    x: Floats,
    range_ptr: Longs,
    element: Ints,
    place: Shorts,
    tets: Ints,
    B: Floats,
    Vmu: Floats,
    Vlam: Floats,
    row: Ints,
    ptr: Longs,
    diagonal: Longs,
    mass: Floats,
    inverse_h2: float,
    block_of: Longs,
    values: Reals,
) -> None:
    """Rows of the ranges start to stop - 1."""
    tile, blocks = np.empty(INPUT * W, values.dtype), np.empty(9 * BLOCKS * W, values.dtype)
    longest = 0
    for r in range(start, stop):
        longest = max(longest, ptr[min((r + 1) * ROWS, len(mass))] - ptr[r * ROWS])
    buffer = np.empty(9 * longest)
    for r in range(start, stop):
        first, last = r * ROWS, min((r + 1) * ROWS, len(mass))
        begin, end = 9 * ptr[first], 9 * ptr[last]
        sums = buffer[: end - begin]
        sums[:] = 0.0
        for i in range(first, last):
            for q in (0, 4, 8):
                sums[9 * diagonal[i] - begin + q] = mass[i] * inverse_h2
        for t in range(range_ptr[r], range_ptr[r + 1], W):
            gather_elements(element, t, range_ptr[r + 1], x, tets, B, Vmu, Vlam, tile)
            if definite:
                definite_blocks(tile, blocks)
            else:
                exact_blocks(tile, blocks)
            for l in range(min(W, range_ptr[r + 1] - t)):  # noqa: E741
                _scatter(element[t + l], l, first, last, place, tets, row, ptr, block_of, blocks, sums)
        values[begin:end] = sums
