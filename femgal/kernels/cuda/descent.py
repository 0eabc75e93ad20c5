# SPDX-License-Identifier: BSD-3-Clause
"""Vertex block descent on the device: one colour at a time, one thread per vertex, in float64.

The counterpart of `femgal.gauss_seidel.sweep`; what a star is stands in `femgal.gauss_seidel.stars`.
"""

from __future__ import annotations

from femgal.kernels.cpu.nodes import scaled_by_block
from femgal.kernels.cuda.jit import Floats, IntRows, Ints, Longs, Rows, cuda, inlined, kernel
from femgal.materials.tensor import Vector
from femgal.materials.vector import cross, dot


@inlined
def edge(x: Rows, v: int, o: Vector) -> Vector:
    """x_v - o."""
    return (x[v, 0] - o[0], x[v, 1] - o[1], x[v, 2] - o[2])


@kernel
def descend(
    first: int,
    count: int,
    vertex: Ints,
    edge_ptr: Longs,
    neighbour: Ints,
    laplacian: Floats,
    face_ptr: Longs,
    face: IntRows,
    stiffness: Rows,
    diagonal: Floats,
    mass: Floats,
    inverse_h2: float,
    xhat: Rows,
    w: float,
    x: Rows,
    dx: Rows,
) -> None:
    """x_i -= w H_i^-1 g_i of the stars first to first + count - 1, in place; dx[s] becomes what its vertex moved."""
    for s in range(first + cuda.grid(1), first + count, cuda.gridsize(1)):
        v = vertex[s]
        i, m = (x[v, 0], x[v, 1], x[v, 2]), inverse_h2 * mass[v]
        g0, g1, g2 = m * (i[0] - xhat[v, 0]), m * (i[1] - xhat[v, 1]), m * (i[2] - xhat[v, 2])
        for j in range(edge_ptr[s], edge_ptr[s + 1]):
            d = edge(x, neighbour[j], i)
            g0 += laplacian[j] * d[0]
            g1 += laplacian[j] * d[1]
            g2 += laplacian[j] * d[2]
        h0 = h3 = h5 = m + diagonal[s]
        h1 = h2 = h4 = 0.0
        for j in range(face_ptr[s], face_ptr[s + 1]):
            a = (x[face[j, 0], 0], x[face[j, 0], 1], x[face[j, 0], 2])
            n = cross(edge(x, face[j, 1], a), edge(x, face[j, 2], a))
            p = stiffness[j, 0]
            t = p * dot(n, (i[0] - a[0], i[1] - a[1], i[2] - a[2])) - stiffness[j, 1]
            g0 += t * n[0]
            g1 += t * n[1]
            g2 += t * n[2]
            h0 += p * n[0] * n[0]
            h1 += p * n[0] * n[1]
            h2 += p * n[0] * n[2]
            h3 += p * n[1] * n[1]
            h4 += p * n[1] * n[2]
            h5 += p * n[2] * n[2]
        d = scaled_by_block(w, (g0, g1, g2), (h0, h1, h2, h3, h4, h5))
        for c in range(3):
            x[v, c] += d[c]
            dx[s, c] = d[c]


@kernel
def take_off_fall(share: Rows, fall_x: float, fall_y: float, fall_z: float, x: Rows) -> None:
    """x -= (1 - share) fall."""
    for i in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        s = 1.0 - share[i, 0]
        x[i, 0] -= s * fall_x
        x[i, 1] -= s * fall_y
        x[i, 2] -= s * fall_z


@kernel
def share_of_gravity(x: Rows, xhat: Rows, gravity: Floats, inverse_h2: float, share: Rows) -> None:
    """Part of gravity in the acceleration of a step, from none to all of it."""
    square = gravity[0] * gravity[0] + gravity[1] * gravity[1] + gravity[2] * gravity[2]
    for i in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        along = 0.0
        for c in range(3):
            along += (x[i, c] - xhat[i, c]) * gravity[c]
        share[i, 0] = min(max(1.0 + along * inverse_h2 / square, 0.0), 1.0)
