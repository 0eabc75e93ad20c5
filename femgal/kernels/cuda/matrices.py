# SPDX-License-Identifier: BSD-3-Clause
"""Assembled matrices of 3x3 blocks on the device: products, Chebyshev smoothing with block Jacobi, a dense inverse.

The counterparts of `femgal.assembly.matrix` and `femgal.assembly.smoothing`. Matrices are in single precision, vectors
and arithmetic in double: matrices are what a cycle reads most of, and residuals of all sizes fit as they are.
"""

from __future__ import annotations

from femgal.kernels.cuda.jit import Floats, IntRows, Ints, Longs, Rows, Singles, cuda, float64, inlined, kernel
from femgal.kernels.cuda.shared import add_threads
from femgal.materials.tensor import Vector


@inlined
def minus_product(i: int, ptr: Longs, column: Ints, values: Singles, x: Rows, r: Rows) -> Vector:
    """Row i of r - A x."""
    s0, s1, s2 = r[i, 0], r[i, 1], r[i, 2]
    for j in range(ptr[i], ptr[i + 1]):
        k = column[j]
        a, b, c = x[k, 0], x[k, 1], x[k, 2]
        s0 -= values[j, 0] * a + values[j, 1] * b + values[j, 2] * c
        s1 -= values[j, 3] * a + values[j, 4] * b + values[j, 5] * c
        s2 -= values[j, 6] * a + values[j, 7] * b + values[j, 8] * c
    return s0, s1, s2


@inlined
def scaled(inverse: Singles, i: int, b: float, s: Vector) -> Vector:
    """b D_i^-1 s."""
    p, q, r = b * s[0], b * s[1], b * s[2]
    return (
        inverse[i, 0] * p + inverse[i, 1] * q + inverse[i, 2] * r,
        inverse[i, 1] * p + inverse[i, 3] * q + inverse[i, 4] * r,
        inverse[i, 2] * p + inverse[i, 4] * q + inverse[i, 5] * r,
    )


@kernel
def scale_blocks(inverse: Singles, b: float, r: Rows, x: Rows) -> None:
    """x = b D^-1 r."""
    for i in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        s = scaled(inverse, i, b, (r[i, 0], r[i, 1], r[i, 2]))
        x[i, 0], x[i, 1], x[i, 2] = s[0], s[1], s[2]


@kernel
def smooth_rows(
    ptr: Longs,
    column: Ints,
    values: Singles,
    inverse: Singles,
    a: float,
    b: float,
    r: Rows,
    x: Rows,
    before: Rows,
    d: Rows,
    out: Rows,
) -> None:
    """d = a before + b D^-1 (r - A x) and out = x + d; d may be `before`, out is another array than x."""
    for i in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        s = scaled(inverse, i, b, minus_product(i, ptr, column, values, x, r))
        for c in range(3):
            change = a * before[i, c] + s[c]
            d[i, c] = change
            out[i, c] = x[i, c] + change


@kernel
def subtract_product(ptr: Longs, column: Ints, values: Singles, x: Rows, r: Rows, out: Rows) -> None:
    """out = r - A x."""
    for i in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        s = minus_product(i, ptr, column, values, x, r)
        out[i, 0], out[i, 1], out[i, 2] = s[0], s[1], s[2]


@kernel
def restrict_rows(child_ptr: Longs, child: Ints, weight: Floats, r: Rows, out: Rows) -> None:
    """out = P^T r, P between neighbouring levels, whose nodes have few children."""
    for i in range(cuda.grid(1), out.shape[0], cuda.gridsize(1)):
        s0 = s1 = s2 = 0.0
        for j in range(child_ptr[i], child_ptr[i + 1]):
            v = child[j]
            s0 += weight[j] * r[v, 0]
            s1 += weight[j] * r[v, 1]
            s2 += weight[j] * r[v, 2]
        out[i, 0], out[i, 1], out[i, 2] = s0, s1, s2


@kernel
def prolong_rows(parent: IntRows, weight: Rows, e: Rows, x: Rows) -> None:
    """x += P e."""
    for v in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        for s in range(parent.shape[1]):
            i = parent[v, s]
            if i >= 0:
                for c in range(3):
                    x[v, c] += weight[v, s] * e[i, c]


@kernel
def multiply_dense(A: Rows, r: Rows, x: Rows) -> None:
    """x = A r for a square matrix of 3 k rows; one block of threads per row."""
    p, t = cuda.blockIdx.x, cuda.threadIdx.x
    scratch, total = cuda.shared.array(0, float64), 0.0
    for q in range(t, A.shape[1], cuda.blockDim.x):
        total += A[p, q] * r[q // 3, q % 3]
    scratch[t] = total
    add_threads(scratch, 1)
    if t == 0:
        x[p // 3, p % 3] = scratch[0]
