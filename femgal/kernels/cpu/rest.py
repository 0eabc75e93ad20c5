# SPDX-License-Identifier: BSD-3-Clause
"""Rest geometry and mass of linear tetrahedra, computed once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel

Floats = NDArray[np.float64]


@kernel
def rest_shape(start: int, stop: int, X: Floats, tets: NDArray[np.int32], B: Floats, V: Floats) -> None:
    """B[e] = Dm^-1 and V[e] = det Dm / 6 of elements start to stop - 1."""
    for e in range(start, stop):
        o = X[tets[e, 0]]
        a, b, c = X[tets[e, 1]] - o, X[tets[e, 2]] - o, X[tets[e, 3]] - o
        # The rows of Dm^-1 are b x c, c x a and a x b over det Dm.
        bc0, bc1, bc2 = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
        det = a[0] * bc0 + a[1] * bc1 + a[2] * bc2
        B[e, 0], B[e, 1], B[e, 2] = bc0 / det, bc1 / det, bc2 / det
        B[e, 3] = (c[1] * a[2] - c[2] * a[1]) / det
        B[e, 4] = (c[2] * a[0] - c[0] * a[2]) / det
        B[e, 5] = (c[0] * a[1] - c[1] * a[0]) / det
        B[e, 6] = (a[1] * b[2] - a[2] * b[1]) / det
        B[e, 7] = (a[2] * b[0] - a[0] * b[2]) / det
        B[e, 8] = (a[0] * b[1] - a[1] * b[0]) / det
        V[e] = det / 6.0


@kernel
def lump_mass(tets: NDArray[np.int32], V: Floats, density: Floats, mass: Floats) -> None:
    """Give a quarter of each element's mass to each of its vertices."""
    for e in range(len(tets)):
        for k in range(4):
            mass[tets[e, k]] += 0.25 * density[e] * V[e]
