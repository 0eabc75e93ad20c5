# SPDX-License-Identifier: BSD-3-Clause
"""Element passes on the finest layer: one block of threads per block of elements, one element per thread.

[L] (Lu et al. 2025, appendix D) sorts elements along a Morton curve, gathers within a block of threads and writes once
per block and point. Here a block first writes the terms of its elements to shared memory; then one thread per vertex of
the block adds those of its corners in a fixed order and writes them to the block's own slot. Slots are added up by
another kernel (`femgal.kernels.cuda.sums`). So there are no atomics, and every run gives the same bits.

Names and arguments are those of `femgal.kernels.cpu.passes` where the meaning is the same. `size` is the number of
elements of a block, `most` that of the vertices of the block that has most.
"""

from __future__ import annotations

from femgal.kernels.cuda.jit import Floats, Ints, Longs, Reals, Rows, Shorts, cuda, float64, kernel
from femgal.kernels.cuda.layout import REST
from femgal.kernels.cuda.shared import (
    add_terms,
    add_threads,
    add_vectors,
    element_gradient,
    load_direction,
    load_displacements,
    rest_gradients,
    store_forces,
    store_terms,
)
from femgal.kernels.plain.elements import von_mises
from femgal.materials.displacement_form import (
    add_identity,
    energy_along,
    energy_and_volume,
    stress_and_cofactor,
    stress_increment,
)
from femgal.materials.stable_neo_hookean import stress_increment_definite
from femgal.materials.tensor import cofactor, determinant, like


@kernel
def vertex_terms(
    x: Rows,
    X: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    most: int,
    entry_ptr: Ints,
    entry: Shorts,
    n_slots: int,
    out: Reals,
) -> None:
    """Gradient and diagonal block of every vertex of every block; nine values per slot, n_slots apart."""
    b = cuda.blockIdx.x
    points, terms = cuda.shared.array(0, float64), cuda.shared.array(0, rest.dtype)
    at = 24 * most // rest.itemsize
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    cuda.syncthreads()
    for l in range(cuda.threadIdx.x, size, cuda.blockDim.x):  # noqa: E741
        k = REST * b * size + l
        B, mu, lam = rest_gradients(rest, k, size), rest[k + 9 * size], rest[k + 10 * size]
        P, C = stress_and_cofactor(element_gradient(points, 0, corner, 4 * b * size + l, size, B, rest), mu, lam)
        store_terms(terms, at + l, size, P, C, mu, lam, B)
    cuda.syncthreads()
    add_terms(b, vertex_ptr, entry_ptr, entry, terms, at, 4 * size, out, n_slots)


@kernel
def vertex_forces(
    x: Rows,
    X: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    most: int,
    entry_ptr: Ints,
    entry: Shorts,
    n_slots: int,
    out: Reals,
) -> None:
    """Gradient of every vertex of every block; three values per slot."""
    b = cuda.blockIdx.x
    points, terms = cuda.shared.array(0, float64), cuda.shared.array(0, rest.dtype)
    at = 24 * most // rest.itemsize
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    cuda.syncthreads()
    for l in range(cuda.threadIdx.x, size, cuda.blockDim.x):  # noqa: E741
        k = REST * b * size + l
        B, mu, lam = rest_gradients(rest, k, size), rest[k + 9 * size], rest[k + 10 * size]
        P, _ = stress_and_cofactor(element_gradient(points, 0, corner, 4 * b * size + l, size, B, rest), mu, lam)
        store_forces(terms, at + l, size, P, B)
    cuda.syncthreads()
    add_vectors(b, vertex_ptr, entry_ptr, entry, terms, at, 4 * size, out, n_slots)


@kernel
def vertex_products(
    x: Rows,
    X: Rows,
    d: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    most: int,
    entry_ptr: Ints,
    entry: Shorts,
    n_slots: int,
    out: Reals,
) -> None:
    """Hessian times d at every vertex of every block."""
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
        store_forces(terms, at + l, size, P, B)
    cuda.syncthreads()
    add_vectors(b, vertex_ptr, entry_ptr, entry, terms, at, 4 * size, out, n_slots)


@kernel
def vertex_definite_products(
    x: Rows,
    X: Rows,
    d: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    most: int,
    entry_ptr: Ints,
    entry: Shorts,
    n_slots: int,
    out: Reals,
) -> None:
    """The same with the positive semi-definite part of each element's Hessian."""
    b = cuda.blockIdx.x
    points, terms = cuda.shared.array(0, float64), cuda.shared.array(0, rest.dtype)
    at = 48 * most // rest.itemsize
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    load_direction(d, b, vertex_ptr, vertex, points, 3 * most)
    cuda.syncthreads()
    for l in range(cuda.threadIdx.x, size, cuda.blockDim.x):  # noqa: E741
        k, c = REST * b * size + l, 4 * b * size + l
        B, mu, lam = rest_gradients(rest, k, size), rest[k + 9 * size], rest[k + 10 * size]
        F = add_identity(element_gradient(points, 0, corner, c, size, B, rest))
        P = stress_increment_definite(F, element_gradient(points, 3 * most, corner, c, size, B, rest), mu, lam)
        store_forces(terms, at + l, size, P, B)
    cuda.syncthreads()
    add_vectors(b, vertex_ptr, entry_ptr, entry, terms, at, 4 * size, out, n_slots)


@kernel
def energies(
    x: Rows,
    X: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    element: Ints,
    energy: Floats,
    J: Floats,
) -> None:
    """Elastic energy [J] and volume ratio J of each element."""
    b = cuda.blockIdx.x
    points = cuda.shared.array(0, float64)
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    cuda.syncthreads()
    for l in range(cuda.threadIdx.x, size, cuda.blockDim.x):  # noqa: E741
        k, e = REST * b * size + l, element[b * size + l]
        if e >= 0:
            G = element_gradient(points, 0, corner, 4 * b * size + l, size, rest_gradients(rest, k, size), rest)
            psi, j = energy_and_volume(G, rest[k + 9 * size], rest[k + 10 * size])
            energy[e], J[e] = psi, 1.0 + j


@kernel
def energies_along(
    x: Rows,
    X: Rows,
    d: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    most: int,
    n_blocks: int,
    out: Floats,
) -> None:
    """out[n_blocks q + b] = coefficient of t^(q + 1) in E(x + t d), summed over block b in float64."""
    b, t, n = cuda.blockIdx.x, cuda.threadIdx.x, cuda.blockDim.x
    points = cuda.shared.array(0, float64)
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    load_direction(d, b, vertex_ptr, vertex, points, 3 * most)
    cuda.syncthreads()
    s0 = s1 = s2 = s3 = s4 = s5 = 0.0
    for l in range(t, size, n):  # noqa: E741
        k, c = REST * b * size + l, 4 * b * size + l
        B, mu, lam = rest_gradients(rest, k, size), rest[k + 9 * size], rest[k + 10 * size]
        G = element_gradient(points, 0, corner, c, size, B, rest)
        p = energy_along(G, element_gradient(points, 3 * most, corner, c, size, B, rest), mu, lam)
        s0 += p[0]
        s1 += p[1]
        s2 += p[2]
        s3 += p[3]
        s4 += p[4]
        s5 += p[5]
    cuda.syncthreads()
    points[t], points[n + t], points[2 * n + t] = s0, s1, s2
    points[3 * n + t], points[4 * n + t], points[5 * n + t] = s3, s4, s5
    add_threads(points, 6)
    if t == 0:
        for q in range(6):
            out[q * n_blocks + b] = points[q * n]


@kernel
def von_mises_stresses(
    x: Rows,
    X: Rows,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    size: int,
    element: Ints,
    out: Floats,
) -> None:
    """Von Mises Cauchy stress [Pa] of each element; mu = 6 V mu det Dm^-1."""
    b = cuda.blockIdx.x
    points = cuda.shared.array(0, float64)
    load_displacements(x, X, b, vertex_ptr, vertex, points)
    cuda.syncthreads()
    for l in range(cuda.threadIdx.x, size, cuda.blockDim.x):  # noqa: E741
        k, e = REST * b * size + l, element[b * size + l]
        if e >= 0:
            B = rest_gradients(rest, k, size)
            F = add_identity(element_gradient(points, 0, corner, 4 * b * size + l, size, B, rest))
            mu = rest[k + 9 * size] * like(B[0], 6) * determinant(B, cofactor(B))
            out[e] = von_mises(F, mu)
