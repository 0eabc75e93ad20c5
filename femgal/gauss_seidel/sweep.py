# SPDX-License-Identifier: BSD-3-Clause
"""One colour of a Gauss-Seidel sweep on the incremental potential, each vertex from its star.

A vertex is read and written by one row of the range alone, and its neighbours have other colours: the number of
threads changes no bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.nodes import scaled_by_block
from femgal.materials.tensor import Vector
from femgal.materials.vector import cross, dot
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@scalar
def _edge(x: Floats, v: int, o: Vector) -> Vector:
    """x_v - o."""
    return (x[v, 0] - o[0], x[v, 1] - o[1], x[v, 2] - o[2])


@scalar
def _face_terms(x: Floats, i: Vector, face: Ints, p: float, q: float) -> Vector:
    """(p n . (x_i - x_a) - q) n and p n n^T of one tetrahedron: three and six values."""
    a = (x[face[0], 0], x[face[0], 1], x[face[0], 2])
    n = cross(_edge(x, face[1], a), _edge(x, face[2], a))
    s = p * dot(n, (i[0] - a[0], i[1] - a[1], i[2] - a[2])) - q
    y = (p * n[0], p * n[1], p * n[2])
    return (
        s * n[0],
        s * n[1],
        s * n[2],
        y[0] * n[0],
        y[0] * n[1],
        y[0] * n[2],
        y[1] * n[1],
        y[1] * n[2],
        y[2] * n[2],
    )


@kernel
def descend(
    start: int,
    stop: int,
    first: int,
    vertex: Ints,
    edge_ptr: Longs,
    neighbour: Ints,
    laplacian: Floats,
    face_ptr: Longs,
    face: Ints,
    stiffness: Floats,
    diagonal: Floats,
    mass: Floats,
    inverse_h2: float,
    xhat: Floats,
    w: float,
    x: Floats,
    dx: Floats,
) -> None:
    """x_i -= w H_i^-1 g_i of the stars first + start to first + stop - 1, in place (Chen et al. 2024).

    dx[s] becomes what the vertex of star s moved [m].
    """
    for s in range(first + start, first + stop):
        v = vertex[s]
        i, m = (x[v, 0], x[v, 1], x[v, 2]), inverse_h2 * mass[v]
        g0, g1, g2 = m * (i[0] - xhat[v, 0]), m * (i[1] - xhat[v, 1]), m * (i[2] - xhat[v, 2])
        for j in range(edge_ptr[s], edge_ptr[s + 1]):
            d = _edge(x, neighbour[j], i)
            g0 += laplacian[j] * d[0]
            g1 += laplacian[j] * d[1]
            g2 += laplacian[j] * d[2]
        h0 = h3 = h5 = m + diagonal[s]
        h1 = h2 = h4 = 0.0
        for j in range(face_ptr[s], face_ptr[s + 1]):
            t = _face_terms(x, i, face[j], stiffness[j, 0], stiffness[j, 1])
            g0 += t[0]
            g1 += t[1]
            g2 += t[2]
            h0 += t[3]
            h1 += t[4]
            h2 += t[5]
            h3 += t[6]
            h4 += t[7]
            h5 += t[8]
        d = scaled_by_block(w, (g0, g1, g2), (h0, h1, h2, h3, h4, h5))
        x[v, 0] += d[0]
        x[v, 1] += d[1]
        x[v, 2] += d[2]
        dx[s, 0], dx[s, 1], dx[s, 2] = d[0], d[1], d[2]
