# SPDX-License-Identifier: BSD-3-Clause
"""Element passes on a coarse layer: few nodes, each felt by many elements of a block.

A block of threads first computes the stresses of its elements. The (element, node) pairs of the block are sorted by
node and cut into parts of PART pairs; one thread adds up a part, and one thread per node the parts of its node, all in
a fixed order. So a node of hundreds of pairs keeps many threads busy (Lu et al. 2025, appendix D, reduce within the
block first). Names and arguments as in `femgal.kernels.cuda.vertex_passes`; `most_parts` is the number of parts of the
block that has most.
"""

from __future__ import annotations

from femgal.kernels.cuda.jit import Ints, Longs, Reals, Rows, Shorts, cuda, float64, inlined, kernel
from femgal.kernels.cuda.layout import PART, REST
from femgal.kernels.cuda.shared import (
    element_gradient,
    load_direction,
    load_displacements,
    load_nine,
    rest_gradients,
    store_nine,
    store_vector,
)
from femgal.materials.displacement_form import node_terms, stress_and_cofactor, stress_increment
from femgal.materials.tensor import apply


@inlined
def add_parts(
    b: int, node_ptr: Longs, node_part: Ints, partial: Reals, at: int, stride: int, width: int, out: Reals, n_slots: int
) -> None:
    """Slot of each node of block b = sum over its parts in their order, `width` values each."""
    for j in range(node_ptr[b] + cuda.threadIdx.x, node_ptr[b + 1], cuda.blockDim.x):
        for q in range(width):
            s = out.dtype.type(0)
            for p in range(node_part[j + b], node_part[j + b + 1]):
                s += partial[at + q * stride + p]
            out[q * n_slots + j] = s


@inlined
def add_pair_forces(
    b: int, part_ptr: Longs, pair: Shorts, u: Reals, terms: Reals, at: int, size: int, stride: int
) -> None:
    """Sum of P u over the pairs of each part of block b, behind the nine values of P of its elements."""
    first = part_ptr[b]
    n, pairs = part_ptr[b + 1] - first, first * PART
    for p in range(cuda.threadIdx.x, n, cuda.blockDim.x):
        s0 = s1 = s2 = terms.dtype.type(0)
        for k in range(PART):
            c = 3 * pairs + 3 * k * n + p
            f = apply(load_nine(terms, at + pair[pairs + k * n + p], size), (u[c], u[c + n], u[c + 2 * n]))
            s0 += f[0]
            s1 += f[1]
            s2 += f[2]
        store_vector(terms, at + 9 * size + p, stride, (s0, s1, s2))


@kernel
def pair_terms(
    x: Rows,
    X: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    most: int,
    node_ptr: Longs,
    node_part: Ints,
    part_ptr: Longs,
    pair: Shorts,
    u: Reals,
    most_parts: int,
    n_slots: int,
    out: Reals,
) -> None:
    """Gradient and diagonal block of every node of every block; nine values per slot, n_slots apart."""
    b = cuda.blockIdx.x
    points, terms = cuda.shared.array(0, float64), cuda.shared.array(0, rest.dtype)
    at = 24 * most // rest.itemsize
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    cuda.syncthreads()
    for l in range(cuda.threadIdx.x, size, cuda.blockDim.x):  # noqa: E741
        k = REST * b * size + l
        B, mu, lam = rest_gradients(rest, k, size), rest[k + 9 * size], rest[k + 10 * size]
        P, C = stress_and_cofactor(element_gradient(points, 0, corner, 4 * b * size + l, size, B, rest), mu, lam)
        store_nine(terms, at + l, size, P)
        store_nine(terms, at + 9 * size + l, size, C)
        terms[at + 18 * size + l], terms[at + 19 * size + l] = mu, lam
    cuda.syncthreads()
    first, zero = part_ptr[b], rest.dtype.type(0)
    n, pairs = part_ptr[b + 1] - first, first * PART
    for p in range(cuda.threadIdx.x, n, cuda.blockDim.x):
        s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = zero
        for k in range(PART):
            c, e = 3 * pairs + 3 * k * n + p, at + pair[pairs + k * n + p]
            P, C = load_nine(terms, e, size), load_nine(terms, e + 9 * size, size)
            v = node_terms(P, C, terms[e + 18 * size], terms[e + 19 * size], (u[c], u[c + n], u[c + 2 * n]))
            s0 += v[0]
            s1 += v[1]
            s2 += v[2]
            s3 += v[3]
            s4 += v[4]
            s5 += v[5]
            s6 += v[6]
            s7 += v[7]
            s8 += v[8]
        store_nine(terms, at + 20 * size + p, most_parts, (s0, s1, s2, s3, s4, s5, s6, s7, s8))
    cuda.syncthreads()
    add_parts(b, node_ptr, node_part, terms, at + 20 * size, most_parts, 9, out, n_slots)


@kernel
def pair_forces(
    x: Rows,
    X: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    most: int,
    node_ptr: Longs,
    node_part: Ints,
    part_ptr: Longs,
    pair: Shorts,
    u: Reals,
    most_parts: int,
    n_slots: int,
    out: Reals,
) -> None:
    """Gradient of every node of every block; three values per slot."""
    b = cuda.blockIdx.x
    points, terms = cuda.shared.array(0, float64), cuda.shared.array(0, rest.dtype)
    at = 24 * most // rest.itemsize
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    cuda.syncthreads()
    for l in range(cuda.threadIdx.x, size, cuda.blockDim.x):  # noqa: E741
        k = REST * b * size + l
        B, mu, lam = rest_gradients(rest, k, size), rest[k + 9 * size], rest[k + 10 * size]
        P, _ = stress_and_cofactor(element_gradient(points, 0, corner, 4 * b * size + l, size, B, rest), mu, lam)
        store_nine(terms, at + l, size, P)
    cuda.syncthreads()
    add_pair_forces(b, part_ptr, pair, u, terms, at, size, most_parts)
    cuda.syncthreads()
    add_parts(b, node_ptr, node_part, terms, at + 9 * size, most_parts, 3, out, n_slots)


@kernel
def pair_products(
    x: Rows,
    X: Rows,
    d: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    most: int,
    node_ptr: Longs,
    node_part: Ints,
    part_ptr: Longs,
    pair: Shorts,
    u: Reals,
    most_parts: int,
    n_slots: int,
    out: Reals,
) -> None:
    """P^T (Hessian times d) at every node of every block."""
    b = cuda.blockIdx.x
    points, terms = cuda.shared.array(0, float64), cuda.shared.array(0, rest.dtype)
    at = 48 * most // rest.itemsize
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    load_direction(d, b, vertex_ptr, vertex, points, 3 * most)
    cuda.syncthreads()
    for l in range(cuda.threadIdx.x, size, cuda.blockDim.x):  # noqa: E741
        k, c = REST * b * size + l, 4 * b * size + l
        B, mu, lam = rest_gradients(rest, k, size), rest[k + 9 * size], rest[k + 10 * size]
        G = element_gradient(points, 0, corner, c, size, B, rest)
        P = stress_increment(G, element_gradient(points, 3 * most, corner, c, size, B, rest), mu, lam)
        store_nine(terms, at + l, size, P)
    cuda.syncthreads()
    add_pair_forces(b, part_ptr, pair, u, terms, at, size, most_parts)
    cuda.syncthreads()
    add_parts(b, node_ptr, node_part, terms, at + 9 * size, most_parts, 3, out, n_slots)
