# SPDX-License-Identifier: BSD-3-Clause
"""Chebyshev iterations with block Jacobi, fused with the product, and transfer between levels.

Kernels write only the rows of their own range and sum each row in a fixed order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.matrix import BlockMatrix
from femgal.assembly.row_product import row_product
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


def chebyshev_coefficients(lowest: float, highest: float, degree: int) -> list[tuple[float, float]]:
    """Coefficients (a, b) of d = a d + b D^-1 (r - A x), x = x + d, for eigenvalues of D^-1 A in [lowest, highest].

    Saad, Iterative methods for sparse linear systems, 2nd edition, algorithm 12.1. The first a is zero.
    """
    theta, delta = 0.5 * (highest + lowest), 0.5 * (highest - lowest)
    sigma = theta / delta
    rho = 1.0 / sigma
    coefficients = [(0.0, 1.0 / theta)]
    for _ in range(degree - 1):
        before, rho = rho, 1.0 / (2.0 * sigma - rho)
        coefficients.append((rho * before, 2.0 * rho / delta))
    return coefficients


def largest_eigenvalue(A: BlockMatrix, inverse: Reals, v: Reals, iterations: int) -> float:
    """Estimate of lambda_max(D^-1 A) by power iteration; never above it but for rounding.

    With w = D^-1 A v the quotient is (w . A v) / (v . A v): the Rayleigh quotient of A^1/2 v, whose error is that of
    the vector squared.

    Parameters
    ----------
    inverse : Inverse diagonal blocks as `invert_blocks` leaves them, shape [n, 6].
    v : First vector, overwritten by the last, shape [n, 3].
    """
    value = 1.0
    u, one = np.empty_like(v), v.dtype.type(1.0)
    for _ in range(iterations):
        A.product(v, u)
        below = np.einsum("ij,ij->", v, u, dtype=np.float64)
        A.workers.run(scale_blocks, len(v), inverse, one, u, v)
        value = float(np.einsum("ij,ij->", v, u, dtype=np.float64) / below)
        v *= one / v.max()
    # The blocks D^-1 A_ii are identities, so the eigenvalues average 1 and the largest is no less.
    return max(1.0, value)


@kernel
def invert_blocks(start: int, stop: int, diagonal: Longs, values: Reals, inverse: Reals) -> None:
    """inverse[i] = xx xy xz yy yz zz of the inverse of a diagonal block, by Cramer's rule in float64."""
    for i in range(start, stop):
        d = diagonal[i]
        a, b, c = np.float64(values[d, 0]), np.float64(values[d, 1]), np.float64(values[d, 2])
        e, f, g = np.float64(values[d, 4]), np.float64(values[d, 5]), np.float64(values[d, 8])
        A, B, C = e * g - f * f, c * f - b * g, b * f - c * e
        s = 1.0 / (a * A + b * B + c * C)
        inverse[i, 0], inverse[i, 1], inverse[i, 2] = s * A, s * B, s * C
        inverse[i, 3], inverse[i, 4], inverse[i, 5] = s * (a * g - c * c), s * (b * c - a * f), s * (a * e - b * b)


@scalar
def _minus_product(i: int, ptr: Longs, column: Ints, values: Reals, x: Reals, r: Reals) -> tuple[float, float, float]:
    """Row i of r - A x."""
    s0, s1, s2 = row_product(values, column, x, ptr[i], ptr[i + 1])
    return r[i, 0] - s0, r[i, 1] - s1, r[i, 2] - s2


@kernel
def scale_blocks(start: int, stop: int, inverse: Reals, b: float, r: Reals, x: Reals) -> None:
    """x = b D^-1 r."""
    for i in range(start, stop):
        p, q, s = b * r[i, 0], b * r[i, 1], b * r[i, 2]
        x[i, 0] = inverse[i, 0] * p + inverse[i, 1] * q + inverse[i, 2] * s
        x[i, 1] = inverse[i, 1] * p + inverse[i, 3] * q + inverse[i, 4] * s
        x[i, 2] = inverse[i, 2] * p + inverse[i, 4] * q + inverse[i, 5] * s


@kernel
def smooth(
    start: int,
    stop: int,
    ptr: Longs,
    column: Ints,
    values: Reals,
    inverse: Reals,
    a: float,
    b: float,
    r: Reals,
    x: Reals,
    before: Reals,
    d: Reals,
    out: Reals,
) -> None:
    """d = a before + b D^-1 (r - A x) and out = x + d; d may be `before`, out is another array than x."""
    for i in range(start, stop):
        p, q, s = _minus_product(i, ptr, column, values, x, r)
        p, q, s = b * p, b * q, b * s
        d0 = a * before[i, 0] + (inverse[i, 0] * p + inverse[i, 1] * q + inverse[i, 2] * s)
        d1 = a * before[i, 1] + (inverse[i, 1] * p + inverse[i, 3] * q + inverse[i, 4] * s)
        d2 = a * before[i, 2] + (inverse[i, 2] * p + inverse[i, 4] * q + inverse[i, 5] * s)
        d[i, 0], d[i, 1], d[i, 2] = d0, d1, d2
        out[i, 0], out[i, 1], out[i, 2] = x[i, 0] + d0, x[i, 1] + d1, x[i, 2] + d2


@kernel
def subtract_product(
    start: int, stop: int, ptr: Longs, column: Ints, values: Reals, x: Reals, r: Reals, out: Reals
) -> None:
    """out = r - A x."""
    for i in range(start, stop):
        s = _minus_product(i, ptr, column, values, x, r)
        out[i, 0], out[i, 1], out[i, 2] = s[0], s[1], s[2]


@kernel
def restrict(start: int, stop: int, child_ptr: Longs, child: Ints, weight: Reals, r: Reals, out: Reals) -> None:
    """out = P^T r."""
    zero = r.dtype.type(0)
    for i in range(start, stop):
        s0 = s1 = s2 = zero
        for j in range(child_ptr[i], child_ptr[i + 1]):
            v, w = child[j], weight[j]
            s0 += w * r[v, 0]
            s1 += w * r[v, 1]
            s2 += w * r[v, 2]
        out[i, 0], out[i, 1], out[i, 2] = s0, s1, s2


@kernel
def prolong(start: int, stop: int, parent: Ints, weight: Reals, e: Reals, x: Reals) -> None:
    """x += P e."""
    for v in range(start, stop):
        for s in range(parent.shape[1]):
            i, w = parent[v, s], weight[v, s]
            if i >= 0:
                x[v, 0] += w * e[i, 0]
                x[v, 1] += w * e[i, 1]
                x[v, 2] += w * e[i, 2]
