# SPDX-License-Identifier: BSD-3-Clause
"""Sums over the slots of each node with the inertia of its vertices, in a fixed order and in float64.

On the finest layer a node has few slots and one vertex: one thread adds them up. A node of a coarse layer may have
thousands of both. They are cut into chunks of CHUNK; one block of threads adds up a chunk, what it leaves is a slot of
the next round, and rounds are made until every node has few (Lu et al. 2025, appendix D: reduction over the grid,
planned beforehand). Slot s of quantity q is at q n_slots + s.
"""

from __future__ import annotations

from femgal.kernels.cpu.nodes import scaled_by_block, scaled_by_diagonal
from femgal.kernels.cuda.jit import Floats, IntRows, Ints, Longs, Reals, Rows, cuda, float64, inlined, kernel
from femgal.kernels.cuda.shared import add_threads
from femgal.materials.tensor import Vector

# Slots and vertices of a chunk, and threads that add it up.
CHUNK = 256
CHUNK_THREADS = 64


@inlined
def node_inertia(
    i: int, child_ptr: Longs, child: Ints, weight: Floats, mass: Floats, y: Rows, z: Rows, factor: float, share: float
) -> Vector:
    """Sum of w m factor (y - share z), three values, and of w^2 m factor over the vertices of node i."""
    g0 = g1 = g2 = a = 0.0
    for j in range(child_ptr[i], child_ptr[i + 1]):
        v = child[j]
        s = weight[j] * mass[v] * factor
        g0 += s * (y[v, 0] - share * z[v, 0])
        g1 += s * (y[v, 1] - share * z[v, 1])
        g2 += s * (y[v, 2] - share * z[v, 2])
        a += weight[j] * s
    return g0, g1, g2, a


@inlined
def node_terms(i: int, slot_ptr: Longs, slot: Ints, values: Reals, n_slots: int, inertia: Vector) -> Vector:
    """Gradient and block of node i: its inertia and then its slots."""
    g0, g1, g2, a = inertia
    b = c = e = 0.0
    d = f = a
    for j in range(slot_ptr[i], slot_ptr[i + 1]):
        k = slot[j]
        g0 += values[k]
        g1 += values[k + n_slots]
        g2 += values[k + 2 * n_slots]
        a += values[k + 3 * n_slots]
        b += values[k + 4 * n_slots]
        c += values[k + 5 * n_slots]
        d += values[k + 6 * n_slots]
        e += values[k + 7 * n_slots]
        f += values[k + 8 * n_slots]
    return g0, g1, g2, a, b, c, d, e, f


@kernel
def sum_vectors(
    slot_ptr: Longs,
    slot: Ints,
    values: Reals,
    n_slots: int,
    child_ptr: Longs,
    child: Ints,
    weight: Floats,
    mass: Floats,
    y: Rows,
    z: Rows,
    factor: float,
    share: float,
    n_nodes: int,
    at_vertices: bool,
    out: Rows,
) -> None:
    """out[i] = sum of w m factor (y - share z) over the vertices of node i plus its slots; or in its vertex's row."""
    for i in range(cuda.grid(1), n_nodes, cuda.gridsize(1)):
        g0, g1, g2, _ = node_inertia(i, child_ptr, child, weight, mass, y, z, factor, share)
        for j in range(slot_ptr[i], slot_ptr[i + 1]):
            k = slot[j]
            g0 += values[k]
            g1 += values[k + n_slots]
            g2 += values[k + 2 * n_slots]
        row = child[child_ptr[i]] if at_vertices else i
        out[row, 0], out[row, 1], out[row, 2] = g0, g1, g2


@kernel
def sum_terms(
    slot_ptr: Longs,
    slot: Ints,
    values: Reals,
    n_slots: int,
    child_ptr: Longs,
    child: Ints,
    weight: Floats,
    mass: Floats,
    y: Rows,
    z: Rows,
    factor: float,
    g: Rows,
    H: Rows,
) -> None:
    """g[i] and H[i] = gradient and block of node i."""
    for i in range(cuda.grid(1), g.shape[0], cuda.gridsize(1)):
        own = node_inertia(i, child_ptr, child, weight, mass, y, z, factor, 1.0)
        q = node_terms(i, slot_ptr, slot, values, n_slots, own)
        g[i, 0], g[i, 1], g[i, 2] = q[0], q[1], q[2]
        H[i, 0], H[i, 1], H[i, 2], H[i, 3], H[i, 4], H[i, 5] = q[3], q[4], q[5], q[6], q[7], q[8]


@kernel
def sum_and_solve(
    slot_ptr: Longs,
    slot: Ints,
    values: Reals,
    n_slots: int,
    child_ptr: Longs,
    child: Ints,
    weight: Floats,
    mass: Floats,
    y: Rows,
    z: Rows,
    factor: float,
    w: float,
    scalar_blocks: bool,
    dx: Rows,
    slope: Floats,
) -> None:
    """dx[i] = -w H_i^-1 g_i, or with the diagonal of H_i only, and slope[i] = g_i . dx_i."""
    for i in range(cuda.grid(1), dx.shape[0], cuda.gridsize(1)):
        own = node_inertia(i, child_ptr, child, weight, mass, y, z, factor, 1.0)
        q = node_terms(i, slot_ptr, slot, values, n_slots, own)
        g, H = (q[0], q[1], q[2]), (q[3], q[4], q[5], q[6], q[7], q[8])
        s = scaled_by_diagonal(w, g, H) if scalar_blocks else scaled_by_block(w, g, H)
        dx[i, 0], dx[i, 1], dx[i, 2] = s[0], s[1], s[2]
        slope[i] = g[0] * s[0] + g[1] * s[1] + g[2] * s[2]


@kernel
def chunk_sums(
    child_range: IntRows,
    slot_range: IntRows,
    slot: Ints,
    values: Reals,
    n_slots: int,
    width: int,
    child: Ints,
    weight: Floats,
    mass: Floats,
    y: Rows,
    z: Rows,
    factor: float,
    share: float,
    n_chunks: int,
    out: Floats,
) -> None:
    """out[q n_chunks + c] = quantity q of the vertices and slots of chunk c: 3 of a gradient, or 9 with its block."""
    c, t, n = cuda.blockIdx.x, cuda.threadIdx.x, cuda.blockDim.x
    scratch = cuda.shared.array(0, float64)
    for q in range(width):
        scratch[q * n + t] = 0.0
    for j in range(child_range[c, 0] + t, child_range[c, 1], n):
        v = child[j]
        s = weight[j] * mass[v] * factor
        for q in range(3):
            scratch[q * n + t] += s * (y[v, q] - share * z[v, q])
        if width == 9:
            for q in (3, 6, 8):
                scratch[q * n + t] += weight[j] * s
    for j in range(slot_range[c, 0] + t, slot_range[c, 1], n):
        for q in range(width):
            scratch[q * n + t] += values[q * n_slots + slot[j]]
    add_threads(scratch, width)
    for q in range(t, width, n):
        out[q * n_chunks + c] = scratch[q * n]
