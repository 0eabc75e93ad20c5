# SPDX-License-Identifier: BSD-3-Clause
"""One colour of a Gauss-Seidel sweep on an assembled matrix of 3x3 blocks.

A row is written by one row of the range alone, and those that it reads have other colours: the number of threads
changes no bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.nodes import scaled_by_block
from meshes.jit import kernel

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@kernel
def relax(
    start: int,
    stop: int,
    first: int,
    row: Ints,
    ptr: Longs,
    column: Ints,
    diagonal: Longs,
    values: Reals,
    b: Floats,
    w: float,
    d: Floats,
    change: Floats,
) -> None:
    """d_i += w A_ii^-1 (b - A d)_i in the rows row[first + start] to row[first + stop - 1], in place.

    change[i] becomes what d_i changed by [m].
    """
    for k in range(first + start, first + stop):
        i = row[k]
        g0, g1, g2 = -b[i, 0], -b[i, 1], -b[i, 2]
        for j in range(ptr[i], ptr[i + 1]):
            c = column[j]
            x, y, z = d[c, 0], d[c, 1], d[c, 2]
            g0 += values[j, 0] * x + values[j, 1] * y + values[j, 2] * z
            g1 += values[j, 3] * x + values[j, 4] * y + values[j, 5] * z
            g2 += values[j, 6] * x + values[j, 7] * y + values[j, 8] * z
        D = values[diagonal[i]]
        # In float64 from here on, whatever the precision of the matrix.
        H = (1.0 * D[0], 1.0 * D[1], 1.0 * D[2], 1.0 * D[4], 1.0 * D[5], 1.0 * D[8])
        s = scaled_by_block(w, (g0, g1, g2), H)
        change[i, 0], change[i, 1], change[i, 2] = s[0], s[1], s[2]
        d[i, 0] += s[0]
        d[i, 1] += s[1]
        d[i, 2] += s[2]
