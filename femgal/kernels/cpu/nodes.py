# SPDX-License-Identifier: BSD-3-Clause
"""Work at nodes and vertices that needs no element: block solves, transfer between layers, sums over vertices.

Kernels write only the rows of their own range; sums go over chunks of a fixed size and are added in order. So the
number of threads changes no bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# Vertices per partial sum.
CHUNK = 4096


@kernel
def solve_blocks(start: int, stop: int, w: float, g: Floats, H: Floats, dx: Floats) -> None:
    """dx[i] = -w H[i]^-1 g[i] by Cramer's rule, which is accurate enough for blocks that the mass keeps regular."""
    for i in range(start, stop):
        a, b, c, d, e, f = H[i, 0], H[i, 1], H[i, 2], H[i, 3], H[i, 4], H[i, 5]
        A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
        D, E, G = a * f - c * c, b * c - a * e, a * d - b * b
        s = -w / (a * A + b * B + c * C)
        dx[i, 0] = s * (A * g[i, 0] + B * g[i, 1] + C * g[i, 2])
        dx[i, 1] = s * (B * g[i, 0] + D * g[i, 1] + E * g[i, 2])
        dx[i, 2] = s * (C * g[i, 0] + E * g[i, 1] + G * g[i, 2])


@kernel
def solve_diagonals(start: int, stop: int, w: float, g: Floats, H: Floats, dx: Floats) -> None:
    """dx[i] = -w diag(H[i])^-1 g[i]: scalar Jacobi."""
    for i in range(start, stop):
        dx[i, 0] = -w * g[i, 0] / H[i, 0]
        dx[i, 1] = -w * g[i, 1] / H[i, 3]
        dx[i, 2] = -w * g[i, 2] / H[i, 5]


@kernel
def prolong(start: int, stop: int, parent: Ints, weight: Floats, dx: Floats, x: Floats) -> None:
    """x[v] += sum_k weight[v, k] dx[parent[v, k]]; a parent of -1 moves nothing."""
    for v in range(start, stop):
        for k in range(parent.shape[1]):
            i = parent[v, k]
            if i >= 0:
                x[v, 0] += weight[v, k] * dx[i, 0]
                x[v, 1] += weight[v, k] * dx[i, 1]
                x[v, 2] += weight[v, k] * dx[i, 2]


@kernel
def restrict(start: int, stop: int, child_ptr: Longs, child: Ints, weight: Floats, f: Floats, out: Floats) -> None:
    """out[i] = sum of weight f over the vertices of node i: the transpose of `prolong`."""
    for i in range(start, stop):
        s0 = s1 = s2 = 0.0
        for j in range(child_ptr[i], child_ptr[i + 1]):
            v = child[j]
            s0 += weight[j] * f[v, 0]
            s1 += weight[j] * f[v, 1]
            s2 += weight[j] * f[v, 2]
        out[i, 0], out[i, 1], out[i, 2] = s0, s1, s2


@kernel
def inertia(
    start: int,
    stop: int,
    child_ptr: Longs,
    child: Ints,
    weight: Floats,
    mass: Floats,
    d: Floats,
    inverse_h2: float,
    out: Floats,
) -> None:
    """Add sum w m d / h^2 over the vertices of every node to out[i]."""
    for i in range(start, stop):
        s0 = s1 = s2 = 0.0
        for j in range(child_ptr[i], child_ptr[i + 1]):
            v = child[j]
            s = weight[j] * mass[v] * inverse_h2
            s0 += s * d[v, 0]
            s1 += s * d[v, 1]
            s2 += s * d[v, 2]
        out[i, 0] += s0
        out[i, 1] += s1
        out[i, 2] += s2


@kernel
def inertia_along(
    start: int, stop: int, mass: Floats, x: Floats, xhat: Floats, d: Floats, inverse_h2: float, out: Floats
) -> None:
    """Row c of the result: coefficients of t and t^2 in |x + t d - xhat|^2_M / (2 h^2), summed over chunk c."""
    for c in range(start, stop):
        s1 = s2 = 0.0
        for v in range(c * CHUNK, min(len(mass), (c + 1) * CHUNK)):
            for a in range(3):
                s1 += mass[v] * d[v, a] * (x[v, a] - xhat[v, a])
                s2 += mass[v] * d[v, a] * d[v, a]
        out[c, 0], out[c, 1] = inverse_h2 * s1, 0.5 * inverse_h2 * s2


@kernel
def add_scaled(start: int, stop: int, x: Floats, t: float, d: Floats) -> None:
    """x += t d."""
    for v in range(start, stop):
        for a in range(3):
            x[v, a] += t * d[v, a]


@kernel
def largest(start: int, stop: int, dx: Floats, out: Floats) -> None:
    """out[c] = largest |component| in chunk c; not finite when one of them is not."""
    for c in range(start, stop):
        most = 0.0
        total = 0.0
        for i in range(c * CHUNK, min(len(dx), (c + 1) * CHUNK)):
            for a in range(3):
                most = max(most, abs(dx[i, a]))
                total += dx[i, a]
        out[c] = most if np.isfinite(total) else np.nan
