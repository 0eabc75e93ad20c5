# SPDX-License-Identifier: BSD-3-Clause
"""What the threads of a block share: displacements of its vertices, terms of its elements, sums over threads.

All of it lies in one dynamic array of shared memory, seen as doubles and as numbers of the passes' precision; offsets
count in the entries of either. Positions enter as displacements x - X in float64 and are subtracted within each element
before they are rounded, so single precision forgets neither a far translation nor a turn of the body: what is rounded
is the displacement gradient of the element itself.
"""

from __future__ import annotations

from typing import Any

from femgal.kernels.cuda.jit import Floats, Ints, Longs, Reals, Rows, Shorts, cuda, inlined
from femgal.materials.displacement_form import node_terms
from femgal.materials.tensor import Tensor, Vector, apply, multiply

# Values per node of a gradient, and of a gradient with its block.
VECTOR, TERMS = 3, 9


@inlined
def load_displacements(x: Rows, X: Rows, b: int, vertex_ptr: Longs, vertex: Ints, points: Floats) -> None:
    """points[3 j + c] = displacement of vertex j of block b."""
    first = vertex_ptr[b]
    for j in range(cuda.threadIdx.x, vertex_ptr[b + 1] - first, cuda.blockDim.x):
        v = vertex[first + j]
        points[3 * j] = x[v, 0] - X[v, 0]
        points[3 * j + 1] = x[v, 1] - X[v, 1]
        points[3 * j + 2] = x[v, 2] - X[v, 2]


@inlined
def load_direction(d: Rows, b: int, vertex_ptr: Longs, vertex: Ints, points: Floats, at: int) -> None:
    """points[at + 3 j + c] = direction of vertex j of block b."""
    first = vertex_ptr[b]
    for j in range(cuda.threadIdx.x, vertex_ptr[b + 1] - first, cuda.blockDim.x):
        v = vertex[first + j]
        points[at + 3 * j], points[at + 3 * j + 1], points[at + 3 * j + 2] = d[v, 0], d[v, 1], d[v, 2]


@inlined
def rest_gradients(rest: Reals, at: int, size: int) -> Tensor:
    """Dm^-1 of an element, whose rows are grad N_1, grad N_2, grad N_3."""
    return (
        rest[at],
        rest[at + size],
        rest[at + 2 * size],
        rest[at + 3 * size],
        rest[at + 4 * size],
        rest[at + 5 * size],
        rest[at + 6 * size],
        rest[at + 7 * size],
        rest[at + 8 * size],
    )


@inlined
def element_gradient(points: Floats, start: int, corner: Shorts, at: int, size: int, B: Tensor, rest: Reals) -> Tensor:
    """sum_k d_k (x) grad N_k of the element whose first corner is corner[at]."""
    real = rest.dtype.type
    o, a = start + 3 * corner[at], start + 3 * corner[at + size]
    b, c = start + 3 * corner[at + 2 * size], start + 3 * corner[at + 3 * size]
    o0, o1, o2 = points[o], points[o + 1], points[o + 2]
    edges = (
        real(points[a] - o0),
        real(points[b] - o0),
        real(points[c] - o0),
        real(points[a + 1] - o1),
        real(points[b + 1] - o1),
        real(points[c + 1] - o1),
        real(points[a + 2] - o2),
        real(points[b + 2] - o2),
        real(points[c + 2] - o2),
    )
    return multiply(edges, B)


@inlined
def store_vector(terms: Reals, at: int, stride: int, v: Vector) -> None:
    """Three values `stride` apart."""
    terms[at], terms[at + stride], terms[at + 2 * stride] = v[0], v[1], v[2]


@inlined
def store_nine(terms: Reals, at: int, stride: int, v: Vector) -> None:
    """Nine values `stride` apart."""
    terms[at], terms[at + stride], terms[at + 2 * stride] = v[0], v[1], v[2]
    terms[at + 3 * stride], terms[at + 4 * stride], terms[at + 5 * stride] = v[3], v[4], v[5]
    terms[at + 6 * stride], terms[at + 7 * stride], terms[at + 8 * stride] = v[6], v[7], v[8]


@inlined
def load_nine(terms: Reals, at: int, stride: int) -> Tensor:
    """Nine values `stride` apart."""
    return (
        terms[at],
        terms[at + stride],
        terms[at + 2 * stride],
        terms[at + 3 * stride],
        terms[at + 4 * stride],
        terms[at + 5 * stride],
        terms[at + 6 * stride],
        terms[at + 7 * stride],
        terms[at + 8 * stride],
    )


@inlined
def store_forces(terms: Reals, at: int, size: int, P: Tensor, B: Tensor) -> None:
    """Forces P grad N_k on the four corners, which sum to zero."""
    f1, f2, f3 = apply(P, (B[0], B[1], B[2])), apply(P, (B[3], B[4], B[5])), apply(P, (B[6], B[7], B[8]))
    f0 = (-(f1[0] + f2[0] + f3[0]), -(f1[1] + f2[1] + f3[1]), -(f1[2] + f2[2] + f3[2]))
    store_vector(terms, at, 4 * size, f0)
    store_vector(terms, at + size, 4 * size, f1)
    store_vector(terms, at + 2 * size, 4 * size, f2)
    store_vector(terms, at + 3 * size, 4 * size, f3)


@inlined
def store_terms(terms: Reals, at: int, size: int, P: Tensor, C: Tensor, mu: Any, lam: Any, B: Tensor) -> None:
    """Gradient and block of the four corners."""
    u0 = (-(B[0] + B[3] + B[6]), -(B[1] + B[4] + B[7]), -(B[2] + B[5] + B[8]))
    store_nine(terms, at, 4 * size, node_terms(P, C, mu, lam, u0))
    store_nine(terms, at + size, 4 * size, node_terms(P, C, mu, lam, (B[0], B[1], B[2])))
    store_nine(terms, at + 2 * size, 4 * size, node_terms(P, C, mu, lam, (B[3], B[4], B[5])))
    store_nine(terms, at + 3 * size, 4 * size, node_terms(P, C, mu, lam, (B[6], B[7], B[8])))


@inlined
def add_vectors(
    b: int,
    vertex_ptr: Longs,
    entry_ptr: Ints,
    entry: Shorts,
    terms: Reals,
    at: int,
    stride: int,
    out: Reals,
    n_slots: int,
) -> None:
    """Slot of each vertex of block b = sum over its corners in their order, three values each."""
    zero = out.dtype.type(0)
    for j in range(vertex_ptr[b] + cuda.threadIdx.x, vertex_ptr[b + 1], cuda.blockDim.x):
        s0 = s1 = s2 = zero
        for k in range(entry_ptr[j], entry_ptr[j + 1]):
            c = at + entry[k]
            s0 += terms[c]
            s1 += terms[c + stride]
            s2 += terms[c + 2 * stride]
        out[j], out[j + n_slots], out[j + 2 * n_slots] = s0, s1, s2


@inlined
def add_terms(
    b: int,
    vertex_ptr: Longs,
    entry_ptr: Ints,
    entry: Shorts,
    terms: Reals,
    at: int,
    stride: int,
    out: Reals,
    n_slots: int,
) -> None:
    """The same for gradient and block, nine values each."""
    zero = out.dtype.type(0)
    for j in range(vertex_ptr[b] + cuda.threadIdx.x, vertex_ptr[b + 1], cuda.blockDim.x):
        s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = zero
        for k in range(entry_ptr[j], entry_ptr[j + 1]):
            v = load_nine(terms, at + entry[k], stride)
            s0 += v[0]
            s1 += v[1]
            s2 += v[2]
            s3 += v[3]
            s4 += v[4]
            s5 += v[5]
            s6 += v[6]
            s7 += v[7]
            s8 += v[8]
        store_nine(out, j, n_slots, (s0, s1, s2, s3, s4, s5, s6, s7, s8))


@inlined
def add_threads(scratch: Floats, width: int) -> None:
    """scratch[q n] = sum of scratch[q n + t] over the n threads of the block, a power of two, in a fixed order."""
    t, n = cuda.threadIdx.x, cuda.blockDim.x
    half = n // 2
    while half > 0:
        cuda.syncthreads()
        if t < half:
            for q in range(width):
                scratch[q * n + t] += scratch[q * n + t + half]
        half //= 2
    cuda.syncthreads()
