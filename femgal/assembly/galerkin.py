# SPDX-License-Identifier: BSD-3-Clause
"""Coarse matrices P^T A P.

A row of the coarse matrix is summed by one thread over the children of its node, in their order and in float64, so the
number of threads changes no bit. Blocks left of the diagonal are then made the mirror images of those right of it,
which they are up to rounding; to sum only one half took longer, because whether a block is wanted is hard to foresee.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.matrix import BlockMatrix
from femgal.assembly.pattern import Pattern, sorted_pattern
from femgal.assembly.transfer import Transfer
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class GalerkinProduct:
    """Forms P^T A P for matrices A of one pattern; what the values do not change is made once.

    Parameters
    ----------
    transfer : P.
    pattern : Of P^T A P.
    mirror : For blocks left of the diagonal their mirror image, else -1.
    """

    transfer: Transfer
    pattern: Pattern
    mirror: Longs

    def matrix(self, like: BlockMatrix) -> BlockMatrix:
        """A coarse matrix without values yet, in the precision of another."""
        return BlockMatrix(self.pattern, np.empty((self.pattern.n_blocks, 9), like.values.dtype), like.workers)

    def coarsen(self, A: BlockMatrix, out: BlockMatrix) -> None:
        """Overwrite the coarse matrix by P^T A P."""
        t, fine, coarse = self.transfer, A.pattern, self.pattern
        longest = int(np.diff(coarse.ptr).max(initial=0))
        arguments = (t.child_ptr, t.child, t.child_weight, fine.ptr, fine.column, A.values.reshape(-1))
        targets = (t.parent, t.weight, coarse.ptr, coarse.column, longest, out.values.reshape(-1))
        A.workers.run_ragged(_sum_rows, t.child_ptr, *arguments, *targets)
        A.workers.run_ragged(_mirror_rows, coarse.ptr, coarse.ptr, coarse.diagonal, self.mirror, out.values)


def galerkin_product(transfer: Transfer, fine: Pattern) -> GalerkinProduct:
    """Find the pattern of P^T A P."""
    ptr, stamp = np.zeros(transfer.n_coarse + 1, np.int64), np.full(transfer.n_coarse, -1, np.int32)
    children = (transfer.child_ptr, transfer.child, transfer.parent)
    _list_columns(*children, fine.ptr, fine.column, stamp, ptr, np.empty(0, np.int32))
    np.cumsum(ptr, out=ptr)
    column = np.empty(ptr[-1], np.int32)
    stamp[:] = -1
    _list_columns(*children, fine.ptr, fine.column, stamp, ptr, column)
    pattern = sorted_pattern(ptr, column)
    mirror = np.full(pattern.n_blocks, -1, np.int64)
    _find_mirrors(pattern.ptr, pattern.column, pattern.diagonal, mirror)
    return GalerkinProduct(transfer, pattern, mirror)


@kernel
def _list_columns(
    child_ptr: Longs, child: Ints, parent: Ints, ptr: Longs, column: Ints, stamp: Ints, coarse_ptr: Longs, out: Ints
) -> None:
    """Count the columns of row i in coarse_ptr[i + 1], or, where there is room, list them from coarse_ptr[i] on."""
    counting = len(out) == 0
    for i in range(len(child_ptr) - 1):
        n = 0
        for c in range(child_ptr[i], child_ptr[i + 1]):
            for j in range(ptr[child[c]], ptr[child[c] + 1]):
                for s in range(parent.shape[1]):
                    k = parent[column[j], s]
                    if k >= 0 and stamp[k] != i:
                        stamp[k] = i
                        if not counting:
                            out[coarse_ptr[i] + n] = k
                        n += 1
        if counting:
            coarse_ptr[i + 1] = n


@kernel
def _find_mirrors(ptr: Longs, column: Ints, diagonal: Longs, mirror: Longs) -> None:
    # Columns ascend, so the rows that look for column j come in the order in which row j lists them.
    at = diagonal + 1
    for i in range(len(diagonal)):
        for j in range(ptr[i], diagonal[i]):
            mirror[j] = at[column[j]]
            at[column[j]] += 1


@scalar
def _at(start: np.uint64, q: int) -> np.uint64:
    """Unsigned, which spares a test for negative indices at every access: half of the time."""
    return start + np.uint64(q)


@scalar
def _add(sums: Floats, k: np.uint64, w: float, values: Reals, f: np.uint64) -> None:
    """Add w times a block; all is read before anything is written, so that values move several at once."""
    a, b = sums[k] + w * values[f], sums[_at(k, 1)] + w * values[_at(f, 1)]
    c, d = sums[_at(k, 2)] + w * values[_at(f, 2)], sums[_at(k, 3)] + w * values[_at(f, 3)]
    e, g = sums[_at(k, 4)] + w * values[_at(f, 4)], sums[_at(k, 5)] + w * values[_at(f, 5)]
    h, i = sums[_at(k, 6)] + w * values[_at(f, 6)], sums[_at(k, 7)] + w * values[_at(f, 7)]
    j = sums[_at(k, 8)] + w * values[_at(f, 8)]
    sums[k], sums[_at(k, 1)], sums[_at(k, 2)], sums[_at(k, 3)], sums[_at(k, 4)] = a, b, c, d, e
    sums[_at(k, 5)], sums[_at(k, 6)], sums[_at(k, 7)], sums[_at(k, 8)] = g, h, i, j


@kernel
def _sum_rows(
    start: int,
    stop: int,
    child_ptr: Longs,
    child: Ints,
    child_weight: Reals,
    ptr: Longs,
    column: Ints,
    values: Reals,
    parent: Ints,
    weight: Reals,
    coarse_ptr: Longs,
    coarse_column: Ints,
    longest: int,
    out: Reals,
) -> None:
    """Blocks of coarse rows."""
    place, sums = np.empty(len(child_ptr) - 1, np.int64), np.empty(9 * longest)
    for i in range(start, stop):
        first, last = coarse_ptr[i], coarse_ptr[i + 1]
        for k in range(first, last):
            place[coarse_column[k]] = k - first
        sums[: 9 * (last - first)] = 0.0
        for c in range(child_ptr[i], child_ptr[i + 1]):
            v = child[c]
            for j in range(ptr[v], ptr[v + 1]):
                for s in range(parent.shape[1]):
                    k = parent[column[j], s]
                    if k < 0:
                        break
                    w = np.float64(child_weight[c]) * weight[column[j], s]
                    _add(sums, np.uint64(9 * place[k]), w, values, np.uint64(9 * j))
        for k in range(9 * (last - first)):
            out[9 * first + k] = sums[k]


@kernel
def _mirror_rows(start: int, stop: int, ptr: Longs, diagonal: Longs, mirror: Longs, values: Reals) -> None:
    """Blocks left of the diagonal; the diagonal ones are made symmetric to the last bit."""
    for i in range(start, stop):
        for j in range(ptr[i], diagonal[i]):
            for r in range(3):
                for c in range(3):
                    values[j, 3 * r + c] = values[mirror[j], 3 * c + r]
        d = diagonal[i]
        values[d, 3], values[d, 6], values[d, 7] = values[d, 1], values[d, 2], values[d, 5]
