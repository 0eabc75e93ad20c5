# SPDX-License-Identifier: BSD-3-Clause
"""Node phase: each node of a layer sums over its own elements and vertices in a fixed order.

A node owns the row range ptr[i] to ptr[i + 1] of (element, u) pairs and child_ptr[i] to child_ptr[i + 1] of
(vertex, weight) pairs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.plain.elements import load
from femgal.materials.stable_neo_hookean import node_block, node_gradient
from femgal.materials.tensor import apply, cofactor
from meshes.jit import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@kernel
def gather_stress(start: int, stop: int, ptr: Longs, element: Ints, u: Floats, P: Floats, g: Floats) -> None:
    """g[i] = sum over the elements of node i of P u; [N] when P[k] is V times the stress of active[k].

    As in the other kernels here, element[j] counts in the list of active elements.
    """
    for i in range(start, stop):
        g0 = g1 = g2 = 0.0
        for j in range(ptr[i], ptr[i + 1]):
            f = apply(load(P, element[j]), (u[j, 0], u[j, 1], u[j, 2]))
            g0 += f[0]
            g1 += f[1]
            g2 += f[2]
        g[i, 0], g[i, 1], g[i, 2] = g0, g1, g2


@kernel
def gather_gradient_and_blocks(
    start: int,
    stop: int,
    ptr: Longs,
    element: Ints,
    u: Floats,
    active: Ints,
    F: Floats,
    Vmu: Floats,
    Vlam: Floats,
    g: Floats,
    H: Floats,
) -> None:
    """Add the elastic gradient g[i] and diagonal block H[i] of every node (Lu et al. 2025, Eq. 15 and 16).

    F[k] is the deformation gradient of element active[k]; element[j] counts in the active list.
    """
    for i in range(start, stop):
        g0, g1, g2 = g[i, 0], g[i, 1], g[i, 2]
        h0, h1, h2, h3, h4, h5 = H[i, 0], H[i, 1], H[i, 2], H[i, 3], H[i, 4], H[i, 5]
        for j in range(ptr[i], ptr[i + 1]):
            k = element[j]
            e = active[k]
            Fk = load(F, k)
            C = cofactor(Fk)
            uj = (u[j, 0], u[j, 1], u[j, 2])
            f = node_gradient(Fk, C, Vmu[e], Vlam[e], uj)
            b = node_block(C, Vmu[e], Vlam[e], uj)
            g0 += f[0]
            g1 += f[1]
            g2 += f[2]
            h0 += b[0]
            h1 += b[1]
            h2 += b[2]
            h3 += b[3]
            h4 += b[4]
            h5 += b[5]
        g[i, 0], g[i, 1], g[i, 2] = g0, g1, g2
        H[i, 0], H[i, 1], H[i, 2], H[i, 3], H[i, 4], H[i, 5] = h0, h1, h2, h3, h4, h5


@kernel
def inertia_gradient_and_blocks(
    start: int,
    stop: int,
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
    """Set g[i] = sum w m (x - xhat) / h^2 and H[i] = sum w^2 m / h^2 I over the vertices of every node."""
    for i in range(start, stop):
        g0 = g1 = g2 = d = 0.0
        for j in range(child_ptr[i], child_ptr[i + 1]):
            v = child[j]
            s = weight[j] * mass[v] * inverse_h2
            g0 += s * (x[v, 0] - xhat[v, 0])
            g1 += s * (x[v, 1] - xhat[v, 1])
            g2 += s * (x[v, 2] - xhat[v, 2])
            d += weight[j] * s
        g[i, 0], g[i, 1], g[i, 2] = g0, g1, g2
        H[i, 0], H[i, 1], H[i, 2], H[i, 3], H[i, 4], H[i, 5] = d, 0.0, 0.0, d, 0.0, d
