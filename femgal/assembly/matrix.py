# SPDX-License-Identifier: BSD-3-Clause
"""Symmetric matrices of 3x3 blocks in compressed rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.pattern import Pattern
from femgal.assembly.row_product import row_product
from femgal.kernels.cpu.threads import Workers
from meshes.jit import kernel

if TYPE_CHECKING:
    import scipy.sparse

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BlockMatrix:
    """A symmetric matrix A, of n rows of 3x3 blocks.

    Parameters
    ----------
    pattern : Which blocks there are.
    values : Blocks in the order of the pattern, row by row, float32 or float64, shape [blocks, 9].
    workers : Threads that share the rows of a product; their number changes no bit.
    """

    pattern: Pattern
    values: Reals
    workers: Workers

    @property
    def n_rows(self) -> int:
        """Number of block rows."""
        return self.pattern.n_rows

    @property
    def nbytes(self) -> int:
        """Memory that values and pattern take."""
        return int(self.values.nbytes + sum(array.nbytes for array in vars(self.pattern).values()))

    def product(self, d: Reals, out: Reals | None = None) -> Reals:
        """A d, both of shape [n, 3], computed in the precision of d and A together; out is another array than d."""
        out = np.empty_like(d) if out is None else out
        self.workers.run_ragged(multiply, self.pattern.ptr, self.pattern.ptr, self.pattern.column, self.values, d, out)
        return out

    def diagonal_blocks(self) -> Reals:
        """Blocks on the diagonal as xx xy xz yy yz zz, shape [n, 6]."""
        return self.values[self.pattern.diagonal][:, [0, 1, 2, 4, 5, 8]]

    def to_scipy(self) -> scipy.sparse.bsr_matrix:
        """The same matrix for SciPy, which shares the values."""
        from scipy.sparse import bsr_matrix

        size = 3 * self.n_rows
        blocks = self.values.reshape(-1, 3, 3)
        return bsr_matrix((blocks, self.pattern.column, self.pattern.ptr), shape=(size, size))


@kernel
def multiply(start: int, stop: int, ptr: Longs, column: Ints, values: Reals, d: Reals, out: Reals) -> None:
    """Rows of A d."""
    for i in range(start, stop):
        s0, s1, s2 = row_product(values, column, d, ptr[i], ptr[i + 1])
        out[i, 0], out[i, 1], out[i, 2] = s0, s1, s2
