# SPDX-License-Identifier: BSD-3-Clause
"""The Hessian of one element in 3x3 blocks, W elements at a time.

With g_a = grad N_a, z_a = C g_a and c = lam (J - 1) - mu the block of two vertices is

    H_ab = V (mu (g_a . g_b) I + lam z_a z_b^T - c [F (g_a x g_b)]_x),   [w]_x v = w x v,

exact at any F; on the diagonal the last term vanishes (Lu et al. 2025, Eq. 15). Without the negative part of the
element's Hessian (Smith, de Goes, Kim 2019) the block is, in the frame of F = U diag(s) V^T and with t_a = V^T g_a,

    H_ab = U K_ab U^T,   K_ii = B_ii t_ai t_bi + sum_{j != i} p_ij t_aj t_bj,   K_ij = B_ij t_ai t_bj + q_ij t_aj t_bi,

B, p + q and p - q being stretch block, flip and twist of `definite_spectrum`. Six blocks are computed, those of the
vertices 1 to 3; shape functions sum to one, so each row of blocks sums to zero, which gives the other four.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.simd import W
from femgal.materials.stable_neo_hookean import definite_spectrum
from femgal.materials.tensor import (
    Tensor,
    Vector,
    add,
    apply,
    cofactor,
    combine,
    determinant,
    like,
    multiply,
    transpose,
)
from femgal.materials.vector import cross, dot
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]

# Rows of lanes that a tile of elements takes: edges of the deformed element (9), Dm^-1 (9), V mu, V lam.
INPUT = 20

# Blocks of a tile in this order, nine rows of lanes each: 11 12 13 22 23 33 01 02 03 00.
BLOCKS = 10


@scalar
def gather_elements(
    element: Ints, first: int, last: int, x: Floats, tets: Ints, B: Floats, Vmu: Floats, Vlam: Floats, tile: Reals
) -> None:
    """Read W elements of a list, the last one again where it ends."""
    for l in range(W):  # noqa: E741
        e = element[min(first + l, last - 1)]
        v0 = tets[e, 0]
        for c in range(3):
            # In float64, so that a body far from the origin loses nothing.
            tile[(3 * c) * W + l] = x[tets[e, 1], c] - x[v0, c]
            tile[(3 * c + 1) * W + l] = x[tets[e, 2], c] - x[v0, c]
            tile[(3 * c + 2) * W + l] = x[tets[e, 3], c] - x[v0, c]
        for q in range(9):
            tile[(9 + q) * W + l] = B[e, q]
        tile[18 * W + l], tile[19 * W + l] = Vmu[e], Vlam[e]


@scalar
def _nine(tile: Reals, at: int) -> Tensor:
    return (
        tile[at],
        tile[W + at],
        tile[2 * W + at],
        tile[3 * W + at],
        tile[4 * W + at],
        tile[5 * W + at],
        tile[6 * W + at],
        tile[7 * W + at],
        tile[8 * W + at],
    )


@scalar
def _store(tile: Reals, at: int, A: Tensor) -> None:
    tile[at], tile[W + at], tile[2 * W + at] = A[0], A[1], A[2]
    tile[3 * W + at], tile[4 * W + at], tile[5 * W + at] = A[3], A[4], A[5]
    tile[6 * W + at], tile[7 * W + at], tile[8 * W + at] = A[6], A[7], A[8]


@scalar
def _store_all(blocks: Reals, l: int, A: Tensor, B: Tensor, C: Tensor, D: Tensor, E: Tensor, G: Tensor) -> None:  # noqa: E741
    """The six blocks 11 12 13 22 23 33 and the four that follow from them."""
    _store(blocks, l, A)
    _store(blocks, 9 * W + l, B)
    _store(blocks, 18 * W + l, C)
    _store(blocks, 27 * W + l, D)
    _store(blocks, 36 * W + l, E)
    _store(blocks, 45 * W + l, G)
    minus = like(A[0], -1)
    p = add(A, add(transpose(B), transpose(C)))
    q = add(B, add(D, transpose(E)))
    r = add(C, add(E, G))
    _store(blocks, 54 * W + l, combine(minus, p, like(A[0], 0), p))
    _store(blocks, 63 * W + l, combine(minus, q, like(A[0], 0), q))
    _store(blocks, 72 * W + l, combine(minus, r, like(A[0], 0), r))
    _store(blocks, 81 * W + l, add(p, add(q, r)))


@scalar
def _exact(F: Tensor, mu: float, lam: float, c: float, g: Vector, y: Vector, h: Vector, z: Vector) -> Tensor:
    """H_ab from g_a, z_a, g_b and z_b."""
    d, w = mu * dot(g, h), apply(F, cross(g, h))
    s = (c * w[0], c * w[1], c * w[2])
    y = (lam * y[0], lam * y[1], lam * y[2])
    return (
        d + y[0] * z[0],
        y[0] * z[1] + s[2],
        y[0] * z[2] - s[1],
        y[1] * z[0] - s[2],
        d + y[1] * z[1],
        y[1] * z[2] + s[0],
        y[2] * z[0] + s[1],
        y[2] * z[1] - s[0],
        d + y[2] * z[2],
    )


@kernel
def exact_blocks(tile: Reals, blocks: Reals) -> None:
    """Blocks of each lane, exact."""
    for l in range(W):  # noqa: E741
        B, mu, lam = _nine(tile, 9 * W + l), tile[18 * W + l], tile[19 * W + l]
        F = multiply(_nine(tile, l), B)
        C = cofactor(F)
        c = lam * (determinant(F, C) - like(mu, 1)) - mu
        g1, g2, g3 = (B[0], B[1], B[2]), (B[3], B[4], B[5]), (B[6], B[7], B[8])
        z1, z2, z3 = apply(C, g1), apply(C, g2), apply(C, g3)
        _store_all(
            blocks,
            l,
            _exact(F, mu, lam, c, g1, z1, g1, z1),
            _exact(F, mu, lam, c, g1, z1, g2, z2),
            _exact(F, mu, lam, c, g1, z1, g3, z3),
            _exact(F, mu, lam, c, g2, z2, g2, z2),
            _exact(F, mu, lam, c, g2, z2, g3, z3),
            _exact(F, mu, lam, c, g3, z3, g3, z3),
        )


@scalar
def _definite(U: Tensor, D: Vector, p: Vector, q: Vector, t: Vector, s: Vector) -> Tensor:
    """U K_ab U^T from t_a and t_b; p and q belong to the pairs yz, zx, xy."""
    x, y, z = t[0] * s[0], t[1] * s[1], t[2] * s[2]
    K = (
        D[0] * x + p[2] * y + p[1] * z,
        D[1] * t[0] * s[1] + q[2] * t[1] * s[0],
        D[2] * t[0] * s[2] + q[1] * t[2] * s[0],
        D[1] * t[1] * s[0] + q[2] * t[0] * s[1],
        D[3] * y + p[0] * z + p[2] * x,
        D[4] * t[1] * s[2] + q[0] * t[2] * s[1],
        D[2] * t[2] * s[0] + q[1] * t[0] * s[2],
        D[4] * t[2] * s[1] + q[0] * t[1] * s[2],
        D[5] * z + p[1] * x + p[0] * y,
    )
    return multiply(multiply(U, K), transpose(U))


@kernel
def definite_blocks(tile: Reals, blocks: Reals) -> None:
    """Blocks of each lane without the negative part of its Hessian."""
    for l in range(W):  # noqa: E741
        B, mu, lam = _nine(tile, 9 * W + l), tile[18 * W + l], tile[19 * W + l]
        U, V, D, flip, twist = definite_spectrum(multiply(_nine(tile, l), B), mu, lam)
        half = like(mu, 0.5)
        p = (half * (flip[0] + twist[0]), half * (flip[1] + twist[1]), half * (flip[2] + twist[2]))
        q = (half * (flip[0] - twist[0]), half * (flip[1] - twist[1]), half * (flip[2] - twist[2]))
        # The rows of B are g_1, g_2, g_3, so those of B V are t_1, t_2, t_3.
        T = multiply(B, V)
        t1, t2, t3 = (T[0], T[1], T[2]), (T[3], T[4], T[5]), (T[6], T[7], T[8])
        _store_all(
            blocks,
            l,
            _definite(U, D, p, q, t1, t1),
            _definite(U, D, p, q, t1, t2),
            _definite(U, D, p, q, t1, t3),
            _definite(U, D, p, q, t2, t2),
            _definite(U, D, p, q, t2, t3),
            _definite(U, D, p, q, t3, t3),
        )
