# SPDX-License-Identifier: BSD-3-Clause
"""The surface of a tetrahedral mesh, for pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Counter-clockwise seen from outside a positively oriented tetrahedron.
_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def boundary_triangles(cells: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the faces that belong to one tetrahedron only.

    Parameters
    ----------
    cells : Vertex indices, shape [n_tets, 4], positively oriented.

    Returns
    -------
    triangles : Vertex indices, shape [n_triangles, 3], counter-clockwise seen from outside.
    owners : Tetrahedron of each triangle, shape [n_triangles].
    """
    faces = cells[:, _FACES].reshape(-1, 3)
    keys = np.sort(faces, axis=1)
    order = np.lexsort(keys.T[::-1])
    same = (keys[order[1:]] == keys[order[:-1]]).all(axis=1)
    shared = np.zeros(len(faces), bool)
    shared[order[1:][same]] = True
    shared[order[:-1][same]] = True
    single = np.flatnonzero(~shared)
    return faces[single], single // 4


def vertex_average(values: NDArray, cells: NDArray[np.int32], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted mean over the tetrahedra around each vertex, shape [n_vertices]; for smooth colours."""
    n_vertices = int(cells.max()) + 1
    flat = cells.ravel()
    total = np.bincount(flat, np.repeat(weights, 4), n_vertices)
    return np.bincount(flat, np.repeat(weights * values, 4), n_vertices) / np.maximum(total, np.finfo(float).tiny)
