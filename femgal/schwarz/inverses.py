# SPDX-License-Identifier: BSD-3-Clause
"""The matrix of every domain, inverted.

Inverses are kept whole: a product then runs along rows, with no sum across the lanes of the vector units, and takes
half the time or less of one with triangular factors, which are half as large.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.nodes import scaled_by_block
from femgal.schwarz.domains import DomainLevel
from meshes.jit import kernel

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# The diagonal grows by this share, so that rounding leaves no pivot negative where stiffness is 10^10 times inertia.
SHIFT = 1e-11


def inverse_offsets(level: DomainLevel) -> Longs:
    """Where the inverse of each domain begins, shape [n_domains + 1]."""
    return np.concatenate(([0], np.cumsum(9 * level.sizes**2))).astype(np.int64)


@kernel
def invert(
    start: int,
    stop: int,
    ptr: Longs,
    row_ptr: Longs,
    row: Ints,
    node_of: Ints,
    domain: Ints,
    place: Ints,
    matrix_ptr: Longs,
    column: Ints,
    values: Reals,
    at: Longs,
    out: Reals,
) -> None:
    """Inverses for domains start to stop - 1 of the matrix P^T A P of their nodes; A in compressed rows of blocks."""
    most = 0
    for d in range(start, stop):
        most = max(most, 3 * (ptr[d + 1] - ptr[d]))
    A, v, u = np.empty((most, most)), np.empty((3, most)), np.empty((3, most))
    for d in range(start, stop):
        n = 3 * (ptr[d + 1] - ptr[d])
        A[:n, :n] = 0.0
        for k in range(row_ptr[d], row_ptr[d + 1]):
            i = 3 * place[node_of[row[k]]]
            for e in range(matrix_ptr[row[k]], matrix_ptr[row[k] + 1]):
                node = node_of[column[e]]
                j = 3 * place[node]
                # The upper half is enough.
                if domain[node] == d and j >= i:
                    for a in range(3):
                        for b in range(3):
                            A[i + a, j + b] += values[e, 3 * a + b]
        for i in range(n):
            A[i, i] *= 1.0 + SHIFT
        _sweep(A, n, v, u)
        _keep(A, n, out[at[d] : at[d + 1]])


@kernel
def _sweep(A: Floats, n: int, v: Floats, u: Floats) -> None:
    """The upper half of A becomes that of -A^-1, by Gauss-Jordan elimination with 3x3 pivots.

    With V the columns of a pivot K: A -= V A_KK^-1 V^T elsewhere, A_iK = V A_KK^-1, A_KK = -A_KK^-1.
    """
    for k in range(0, n, 3):
        for a in range(3):
            for j in range(k + a):
                v[a, j] = A[j, k + a]
            for j in range(k + a, n):
                v[a, j] = A[k + a, j]
        H = (v[0, k], v[0, k + 1], v[0, k + 2], v[1, k + 1], v[1, k + 2], v[2, k + 2])
        d0, d1 = scaled_by_block(-1.0, (1.0, 0.0, 0.0), H), scaled_by_block(-1.0, (0.0, 1.0, 0.0), H)
        d2 = scaled_by_block(-1.0, (0.0, 0.0, 1.0), H)
        for j in range(n):
            a0, a1, a2 = v[0, j], v[1, j], v[2, j]
            u[0, j] = d0[0] * a0 + d0[1] * a1 + d0[2] * a2
            u[1, j] = d1[0] * a0 + d1[1] * a1 + d1[2] * a2
            u[2, j] = d2[0] * a0 + d2[1] * a1 + d2[2] * a2
        for i in range(n):
            # Not a function of its own: a call with so many arrays takes four times as long as the loop.
            c0, c1, c2, target = u[0, i], u[1, i], u[2, i], A[i, i:n]
            x, y, z = v[0, i:n], v[1, i:n], v[2, i:n]
            for j in range(len(target)):
                target[j] -= c0 * x[j] + c1 * y[j] + c2 * z[j]
        for a in range(3):
            for j in range(k):
                A[j, k + a] = u[a, j]
            for j in range(k + 3, n):
                A[k + a, j] = u[a, j]
            A[k, k + a], A[k + 1, k + a], A[k + 2, k + a] = -d0[a], -d1[a], -d2[a]


@kernel
def _keep(A: Floats, n: int, out: Reals) -> None:
    """Both halves of -A, which holds the inverse.

    Rounding changes an entry by a share eps, so the matrix by no more than eps times its Frobenius norm: added to the
    diagonal, that keeps it positive definite in any precision.
    """
    square = 0.0
    for i in range(n):
        for j in range(i, n):
            square += A[i, j] * A[i, j]
    least = 0.5 * np.finfo(out.dtype).eps * np.sqrt(2.0 * square)
    for i in range(n):
        for j in range(i, n):
            out[n * i + j] = out[n * j + i] = -A[i, j]
        out[n * i + i] = least - A[i, i]
