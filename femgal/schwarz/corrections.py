# SPDX-License-Identifier: BSD-3-Clause
"""The correction of every domain, and what goes to the next level and comes back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@kernel
def correct(
    start: int, stop: int, ptr: Longs, node: Ints, at: Longs, inverse: Reals, r: Floats, z: Floats, coarse: Floats
) -> None:
    """z = A_d^-1 r at the nodes of domains d = start to stop - 1; coarse[d] becomes the sum of r over domain d.

    The inverse is symmetric, so its rows are taken for its columns, those of one node at a time.
    """
    most = 0
    for d in range(start, stop):
        most = max(most, 3 * (ptr[d + 1] - ptr[d]))
    buffer = np.empty(most)
    for d in range(start, stop):
        s, first = buffer[: 3 * (ptr[d + 1] - ptr[d])], at[d]
        s[:] = 0.0
        c0 = c1 = c2 = 0.0
        for k in range(ptr[d], ptr[d + 1]):
            r0, r1, r2 = r[node[k], 0], r[node[k], 1], r[node[k], 2]
            c0 += r0
            c1 += r1
            c2 += r2
            n = len(s)
            x, y, w = (
                inverse[first : first + n],
                inverse[first + n : first + 2 * n],
                inverse[first + 2 * n : first + 3 * n],
            )
            for j in range(n):
                s[j] += r0 * x[j] + r1 * y[j] + r2 * w[j]
            first += 3 * n
        coarse[d, 0], coarse[d, 1], coarse[d, 2] = c0, c1, c2
        for k in range(ptr[d], ptr[d + 1]):
            j = 3 * (k - ptr[d])
            z[node[k], 0], z[node[k], 1], z[node[k], 2] = s[j], s[j + 1], s[j + 2]


@kernel
def add_coarse(start: int, stop: int, domain: Ints, coarse: Floats, z: Floats) -> None:
    """z[i] += coarse[domain[i]]."""
    for i in range(start, stop):
        for c in range(3):
            z[i, c] += coarse[domain[i], c]
