# SPDX-License-Identifier: BSD-3-Clause
"""Work at nodes and vertices that needs no element: block solves, transfer between layers, sums over vertices.

Kernels write only the rows of their own range; sums go over chunks of a fixed size and are added in order. So the
number of threads changes no bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.materials.tensor import Vector
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# Vertices per partial sum.
CHUNK = 4096


@scalar
def scaled_by_block(w: float, g: Vector, H: Vector) -> Vector:
    """-w H^-1 g by Cramer's rule, which is accurate enough for blocks that the mass keeps regular."""
    a, b, c, d, e, f = H
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, G = a * f - c * c, b * c - a * e, a * d - b * b
    s = -w / (a * A + b * B + c * C)
    return (
        s * (A * g[0] + B * g[1] + C * g[2]),
        s * (B * g[0] + D * g[1] + E * g[2]),
        s * (C * g[0] + E * g[1] + G * g[2]),
    )


@scalar
def scaled_by_diagonal(w: float, g: Vector, H: Vector) -> Vector:
    """-w diag(H)^-1 g: scalar Jacobi."""
    return (-w * g[0] / H[0], -w * g[1] / H[3], -w * g[2] / H[5])


@scalar
def _block(H: Floats, i: int) -> Vector:
    return (H[i, 0], H[i, 1], H[i, 2], H[i, 3], H[i, 4], H[i, 5])


@kernel
def solve(start: int, stop: int, w: float, scalar_blocks: bool, g: Floats, H: Floats, dx: Floats) -> None:
    """dx[i] = -w H[i]^-1 g[i], or with the diagonal of H[i] only."""
    for i in range(start, stop):
        f, block = (g[i, 0], g[i, 1], g[i, 2]), _block(H, i)
        s = scaled_by_diagonal(w, f, block) if scalar_blocks else scaled_by_block(w, f, block)
        dx[i, 0], dx[i, 1], dx[i, 2] = s[0], s[1], s[2]


@kernel
def compare_blocks(
    start: int, stop: int, scalar_blocks: bool, g: Floats, old: Floats, H: Floats, stale: Floats, change: Floats
) -> None:
    """Sums over chunk c of (dx' - dx) . H (dx' - dx), and the largest |H' - H|_F over the mean diagonal entry of H."""
    for c in range(start, stop):
        total = most = 0.0
        for i in range(c * CHUNK, min(len(g), (c + 1) * CHUNK)):
            f = (g[i, 0], g[i, 1], g[i, 2])
            h, k = _block(H, i), _block(old, i)
            a = scaled_by_diagonal(1.0, f, h) if scalar_blocks else scaled_by_block(1.0, f, h)
            b = scaled_by_diagonal(1.0, f, k) if scalar_blocks else scaled_by_block(1.0, f, k)
            d0, d1, d2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            total += h[0] * d0 * d0 + h[3] * d1 * d1 + h[5] * d2 * d2
            total += 2.0 * (h[1] * d0 * d1 + h[2] * d0 * d2 + h[4] * d1 * d2)
            square = (h[0] - k[0]) ** 2 + (h[3] - k[3]) ** 2 + (h[5] - k[5]) ** 2
            square += 2.0 * ((h[1] - k[1]) ** 2 + (h[2] - k[2]) ** 2 + (h[4] - k[4]) ** 2)
            most = max(most, 3.0 * np.sqrt(square) / (h[0] + h[3] + h[5]))
        stale[c], change[c] = total, most


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
def difference(start: int, stop: int, scale: float, x: Floats, y: Floats, out: Floats) -> None:
    """out = scale (x - y)."""
    for v in range(start, stop):
        for a in range(3):
            out[v, a] = scale * (x[v, a] - y[v, a])


@kernel
def predict(
    start: int, stop: int, x: Floats, v: Floats, h: float, gravity: Floats, inertia: float, xhat: Floats
) -> None:
    """xhat = x + (h v + h^2 g) / inertia."""
    for i in range(start, stop):
        for a in range(3):
            xhat[i, a] = x[i, a] + (h * v[i, a] + h * h * gravity[a]) / inertia


@kernel
def dot(start: int, stop: int, a: Floats, b: Floats, out: Floats) -> None:
    """out[c] = sum of a * b over chunk c."""
    for c in range(start, stop):
        total = 0.0
        for i in range(c * CHUNK, min(len(a), (c + 1) * CHUNK)):
            total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
        out[c] = total


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
