# SPDX-License-Identifier: BSD-3-Clause
"""Sums over the slots of each node, in the order of the blocks and in float64, with the inertia of its vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.nodes import scaled_by_block, scaled_by_diagonal
from femgal.kernels.cpu.simd import TERMS, VECTOR
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@kernel
def sum_vectors(start: int, stop: int, slot_ptr: Longs, slot: Ints, values: Reals, out: Floats) -> None:
    """out[i] = sum of the slots of node i, three values each."""
    for i in range(start, stop):
        s0 = s1 = s2 = 0.0
        for j in range(slot_ptr[i], slot_ptr[i + 1]):
            s = VECTOR * slot[j]
            s0 += values[s]
            s1 += values[s + 1]
            s2 += values[s + 2]
        out[i, 0], out[i, 1], out[i, 2] = s0, s1, s2


@kernel
def sum_gradients(
    start: int,
    stop: int,
    slot_ptr: Longs,
    slot: Ints,
    values: Reals,
    child_ptr: Longs,
    child: Ints,
    weight: Floats,
    mass: Floats,
    x: Floats,
    xhat: Floats,
    inverse_h2: float,
    g: Floats,
) -> None:
    """g[i] = sum w m (x - xhat) / h^2 over the vertices of node i plus its slots."""
    for i in range(start, stop):
        g0 = g1 = g2 = 0.0
        for j in range(child_ptr[i], child_ptr[i + 1]):
            v = child[j]
            s = weight[j] * mass[v] * inverse_h2
            g0 += s * (x[v, 0] - xhat[v, 0])
            g1 += s * (x[v, 1] - xhat[v, 1])
            g2 += s * (x[v, 2] - xhat[v, 2])
        for j in range(slot_ptr[i], slot_ptr[i + 1]):
            k = VECTOR * slot[j]
            g0 += values[k]
            g1 += values[k + 1]
            g2 += values[k + 2]
        g[i, 0], g[i, 1], g[i, 2] = g0, g1, g2


@scalar
def _terms(
    i: int,
    slot_ptr: Longs,
    slot: Ints,
    values: Reals,
    child_ptr: Longs,
    child: Ints,
    weight: Floats,
    mass: Floats,
    x: Floats,
    xhat: Floats,
    inverse_h2: float,
) -> tuple[float, ...]:
    """Gradient and block of node i: its slots plus sum w m (x - xhat) / h^2 and sum w^2 m / h^2 I of its vertices."""
    g0 = g1 = g2 = a = 0.0
    for j in range(child_ptr[i], child_ptr[i + 1]):
        v = child[j]
        s = weight[j] * mass[v] * inverse_h2
        g0 += s * (x[v, 0] - xhat[v, 0])
        g1 += s * (x[v, 1] - xhat[v, 1])
        g2 += s * (x[v, 2] - xhat[v, 2])
        a += weight[j] * s
    b = c = e = 0.0
    d = f = a
    for j in range(slot_ptr[i], slot_ptr[i + 1]):
        k = TERMS * slot[j]
        g0 += values[k]
        g1 += values[k + 1]
        g2 += values[k + 2]
        a += values[k + 3]
        b += values[k + 4]
        c += values[k + 5]
        d += values[k + 6]
        e += values[k + 7]
        f += values[k + 8]
    return g0, g1, g2, a, b, c, d, e, f


@kernel
def sum_terms(
    start: int,
    stop: int,
    slot_ptr: Longs,
    slot: Ints,
    values: Reals,
    child_ptr: Longs,
    child: Ints,
    weight: Floats,
    mass: Floats,
    x: Floats,
    xhat: Floats,
    inverse_h2: float,
    g: Floats,
    H: Floats,
) -> None:
    """g[i] and H[i] = gradient and block of node i."""
    for i in range(start, stop):
        q = _terms(i, slot_ptr, slot, values, child_ptr, child, weight, mass, x, xhat, inverse_h2)
        g[i, 0], g[i, 1], g[i, 2] = q[0], q[1], q[2]
        H[i, 0], H[i, 1], H[i, 2], H[i, 3], H[i, 4], H[i, 5] = q[3], q[4], q[5], q[6], q[7], q[8]


@kernel
def sum_and_solve(
    start: int,
    stop: int,
    slot_ptr: Longs,
    slot: Ints,
    values: Reals,
    child_ptr: Longs,
    child: Ints,
    weight: Floats,
    mass: Floats,
    x: Floats,
    xhat: Floats,
    inverse_h2: float,
    w: float,
    scalar_blocks: bool,
    dx: Floats,
    slope: Floats,
) -> None:
    """dx[i] = -w H_i^-1 g_i, or with the diagonal of H_i only, and slope[i] = g_i . dx_i."""
    for i in range(start, stop):
        q = _terms(i, slot_ptr, slot, values, child_ptr, child, weight, mass, x, xhat, inverse_h2)
        g, H = (q[0], q[1], q[2]), (q[3], q[4], q[5], q[6], q[7], q[8])
        s = scaled_by_diagonal(w, g, H) if scalar_blocks else scaled_by_block(w, g, H)
        dx[i, 0], dx[i, 1], dx[i, 2] = s[0], s[1], s[2]
        slope[i] = g[0] * s[0] + g[1] * s[1] + g[2] * s[2]
