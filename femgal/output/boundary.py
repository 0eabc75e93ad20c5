# SPDX-License-Identifier: BSD-3-Clause
"""Values on the surface of a tetrahedral mesh, for pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def vertex_average(values: NDArray, cells: NDArray[np.int32], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted mean over the tetrahedra around each vertex, shape [n_vertices]; for smooth colours."""
    n_vertices = int(cells.max()) + 1
    flat = cells.ravel()
    total = np.bincount(flat, np.repeat(weights, 4), n_vertices)
    return np.bincount(flat, np.repeat(weights * values, 4), n_vertices) / np.maximum(total, np.finfo(float).tiny)
