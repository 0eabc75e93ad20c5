# SPDX-License-Identifier: BSD-3-Clause
"""Element passes over blocks of tiles: gather, arithmetic and scatter as three loops over a small scratch.

A loop that both gathers and stores never becomes vector code, because nothing tells the compiler that the arrays are
apart. So a tile's twelve coordinates are gathered into rows of lanes, the arithmetic runs from rows to rows, and the
results are transposed and added to the nodes of the block. Positions enter as displacements d = x - X relative to
those of the block's first vertex, subtracted in float64: a body that has moved far loses nothing in float32.

Every kernel runs over blocks start to stop - 1 and writes their slots only, VECTOR or TERMS values each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.simd import (
    POINT,
    TERMS,
    VECTOR,
    W,
    flush_tiny,
    gather_points,
    prefetch,
    restore,
    scatter_terms,
    scatter_vectors,
)
from femgal.kernels.cpu.tiles import REST, TILES
from femgal.materials.displacement_form import (
    add_identity,
    energy_along,
    energy_and_volume,
    node_terms,
    stress_and_cofactor,
    stress_increment,
)
from femgal.materials.stable_neo_hookean import stress_increment_definite
from femgal.materials.tensor import Tensor, Vector, apply, multiply
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Shorts = NDArray[np.uint16]

# Lanes of the scratch of a tile.
_POINTS = 12 * W

# Bytes of a cache line.
LINE = 64


@scalar
def _load_displacements(x: Floats, X: Floats, vertex: Ints, first: int, count: int, points: Reals) -> None:
    """points[4 j + c] = displacement of vertex j of a block relative to its first one."""
    o = vertex[first]
    o0, o1, o2 = x[o, 0] - X[o, 0], x[o, 1] - X[o, 1], x[o, 2] - X[o, 2]
    for j in range(count):
        v = vertex[first + j]
        points[POINT * j] = (x[v, 0] - X[v, 0]) - o0
        points[POINT * j + 1] = (x[v, 1] - X[v, 1]) - o1
        points[POINT * j + 2] = (x[v, 2] - X[v, 2]) - o2
        points[POINT * j + 3] = 0.0


@scalar
def _load_direction(d: Floats, vertex: Ints, first: int, count: int, points: Reals) -> None:
    """The same for a direction."""
    o = vertex[first]
    o0, o1, o2 = d[o, 0], d[o, 1], d[o, 2]
    for j in range(count):
        v = vertex[first + j]
        points[POINT * j], points[POINT * j + 1] = d[v, 0] - o0, d[v, 1] - o1
        points[POINT * j + 2], points[POINT * j + 3] = d[v, 2] - o2, 0.0


@scalar
def _gather_corners(tile: Reals, at: int, corner: Shorts, t: int, points: Reals) -> None:
    """Twelve coordinates of each lane of tile t."""
    for k in range(4):
        gather_points(tile, at + 3 * k * W, corner, (4 * t + k) * W, points)


@scalar
def _rest_gradients(rest: Reals, l: int) -> Tensor:  # noqa: E741
    """Dm^-1 of lane l; its rows are grad N_1, grad N_2, grad N_3."""
    return (
        rest[l],
        rest[W + l],
        rest[2 * W + l],
        rest[3 * W + l],
        rest[4 * W + l],
        rest[5 * W + l],
        rest[6 * W + l],
        rest[7 * W + l],
        rest[8 * W + l],
    )


@scalar
def _gradient(tile: Reals, l: int, B: Tensor) -> Tensor:  # noqa: E741
    """sum_k d_k (x) grad N_k of lane l."""
    x, y, z = tile[l], tile[W + l], tile[2 * W + l]
    edges = (
        tile[3 * W + l] - x,
        tile[6 * W + l] - x,
        tile[9 * W + l] - x,
        tile[4 * W + l] - y,
        tile[7 * W + l] - y,
        tile[10 * W + l] - y,
        tile[5 * W + l] - z,
        tile[8 * W + l] - z,
        tile[11 * W + l] - z,
    )
    return multiply(edges, B)


@scalar
def _store_vector(tile: Reals, at: int, v: Vector) -> None:
    tile[at], tile[W + at], tile[2 * W + at] = v[0], v[1], v[2]


@scalar
def _store_nine(tile: Reals, at: int, v: Vector) -> None:
    tile[at], tile[W + at], tile[2 * W + at] = v[0], v[1], v[2]
    tile[3 * W + at], tile[4 * W + at], tile[5 * W + at] = v[3], v[4], v[5]
    tile[6 * W + at], tile[7 * W + at], tile[8 * W + at] = v[6], v[7], v[8]


@scalar
def _corner_gradients(B: Tensor) -> tuple[Vector, Vector, Vector, Vector]:
    """grad N_0 to grad N_3."""
    u0 = (-(B[0] + B[3] + B[6]), -(B[1] + B[4] + B[7]), -(B[2] + B[5] + B[8]))
    return u0, (B[0], B[1], B[2]), (B[3], B[4], B[5]), (B[6], B[7], B[8])


@scalar
def _store_forces(tile: Reals, l: int, P: Tensor, B: Tensor) -> None:  # noqa: E741
    """Forces P grad N_k on the four vertices, which sum to zero."""
    _, u1, u2, u3 = _corner_gradients(B)
    f1, f2, f3 = apply(P, u1), apply(P, u2), apply(P, u3)
    f0 = (-(f1[0] + f2[0] + f3[0]), -(f1[1] + f2[1] + f3[1]), -(f1[2] + f2[2] + f3[2]))
    _store_vector(tile, l, f0)
    _store_vector(tile, 3 * W + l, f1)
    _store_vector(tile, 6 * W + l, f2)
    _store_vector(tile, 9 * W + l, f3)


@scalar
def tile_terms(points: Reals, rest: Reals, terms: Reals) -> None:
    """Gradient and block of all four vertices of each lane: 36 rows from 12 rows of displacements."""
    for l in range(W):  # noqa: E741
        B, mu, lam = _rest_gradients(rest, l), rest[9 * W + l], rest[10 * W + l]
        P, C = stress_and_cofactor(_gradient(points, l, B), mu, lam)
        u0, u1, u2, u3 = _corner_gradients(B)
        _store_nine(terms, l, node_terms(P, C, mu, lam, u0))
        _store_nine(terms, 9 * W + l, node_terms(P, C, mu, lam, u1))
        _store_nine(terms, 18 * W + l, node_terms(P, C, mu, lam, u2))
        _store_nine(terms, 27 * W + l, node_terms(P, C, mu, lam, u3))


@scalar
def tile_forces(points: Reals, rest: Reals, forces: Reals) -> None:
    """Gradient of all four vertices of each lane: 12 rows."""
    for l in range(W):  # noqa: E741
        B, mu, lam = _rest_gradients(rest, l), rest[9 * W + l], rest[10 * W + l]
        P, _ = stress_and_cofactor(_gradient(points, l, B), mu, lam)
        _store_forces(forces, l, P, B)


@scalar
def tile_products(points: Reals, direction: Reals, rest: Reals, forces: Reals) -> None:
    """Hessian times a direction, of all four vertices of each lane: 12 rows."""
    for l in range(W):  # noqa: E741
        B, mu, lam = _rest_gradients(rest, l), rest[9 * W + l], rest[10 * W + l]
        P = stress_increment(_gradient(points, l, B), _gradient(direction, l, B), mu, lam)
        _store_forces(forces, l, P, B)


@scalar
def tile_definite_products(points: Reals, direction: Reals, rest: Reals, forces: Reals) -> None:
    """The same with the positive semi-definite part of each element's Hessian."""
    for l in range(W):  # noqa: E741
        B, mu, lam = _rest_gradients(rest, l), rest[9 * W + l], rest[10 * W + l]
        F = add_identity(_gradient(points, l, B))
        _store_forces(forces, l, stress_increment_definite(F, _gradient(direction, l, B), mu, lam), B)


@scalar
def _tensor(tile: Reals, at: int) -> Tensor:
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
def tile_stresses(points: Reals, rest: Reals, tensors: Reals) -> None:
    """P and C of each lane: 18 rows."""
    for l in range(W):  # noqa: E741
        P, C = stress_and_cofactor(_gradient(points, l, _rest_gradients(rest, l)), rest[9 * W + l], rest[10 * W + l])
        _store_nine(tensors, l, P)
        _store_nine(tensors, 9 * W + l, C)


@scalar
def tile_stress_increments(points: Reals, direction: Reals, rest: Reals, tensors: Reals) -> None:
    """dP of each lane: 9 rows."""
    for l in range(W):  # noqa: E741
        B, mu, lam = _rest_gradients(rest, l), rest[9 * W + l], rest[10 * W + l]
        _store_nine(tensors, l, stress_increment(_gradient(points, l, B), _gradient(direction, l, B), mu, lam))


@scalar
def tile_pair_terms(tensors: Reals, u: Reals, rest: Reals, terms: Reals) -> None:
    """Gradient and block of one node of each lane: 9 rows."""
    for l in range(W):  # noqa: E741
        P, C = _tensor(tensors, l), _tensor(tensors, 9 * W + l)
        _store_nine(terms, l, node_terms(P, C, rest[9 * W + l], rest[10 * W + l], (u[l], u[W + l], u[2 * W + l])))


@scalar
def tile_pair_forces(tensors: Reals, u: Reals, forces: Reals) -> None:
    """Gradient of one node of each lane: 3 rows."""
    for l in range(W):  # noqa: E741
        _store_vector(forces, l, apply(_tensor(tensors, l), (u[l], u[W + l], u[2 * W + l])))


@scalar
def _zero(values: Reals, start: int, stop: int) -> None:
    for k in range(start, stop):
        values[k] = 0.0


@scalar
def _expect(rest: Reals, corner: Shorts, t: int) -> None:
    """Ask for the rest quantities and corners of tile t: the processor's own guess comes too late."""
    for k in range(t * REST * W, (t + 1) * REST * W, LINE // rest.itemsize):
        prefetch(rest, k)
    for k in range(t * 4 * W, (t + 1) * 4 * W, LINE // 2):
        prefetch(corner, k)


@kernel
def vertex_terms(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    out: Reals,
) -> None:
    """Gradient and diagonal block of every vertex of every block; a slot holds g and H."""
    tile, terms = np.empty(_POINTS, rest.dtype), np.empty(36 * W, rest.dtype)
    points = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], points)
        sums = out[TERMS * vertex_ptr[b] : TERMS * vertex_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_terms(tile, rest[t * REST * W : (t + 1) * REST * W], terms)
            for k in range(4):
                scatter_terms(terms, 9 * k * W, corner, (4 * t + k) * W, sums)
    restore(before)


@kernel
def vertex_forces(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    out: Reals,
) -> None:
    """Gradient of every vertex of every block; a slot holds g."""
    tile, forces = np.empty(_POINTS, rest.dtype), np.empty(12 * W, rest.dtype)
    points = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], points)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_forces(tile, rest[t * REST * W : (t + 1) * REST * W], forces)
            for k in range(4):
                scatter_vectors(forces, 3 * k * W, corner, (4 * t + k) * W, sums)
    restore(before)


@kernel
def vertex_products(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    d: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    out: Reals,
) -> None:
    """Hessian times d at every vertex of every block."""
    tile, turned, forces = np.empty(_POINTS, rest.dtype), np.empty(_POINTS, rest.dtype), np.empty(12 * W, rest.dtype)
    points, moves = np.empty(POINT * most, rest.dtype), np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], points)
        _load_direction(d, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], moves)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            _gather_corners(turned, 0, corner, t, moves)
            tile_products(tile, turned, rest[t * REST * W : (t + 1) * REST * W], forces)
            for k in range(4):
                scatter_vectors(forces, 3 * k * W, corner, (4 * t + k) * W, sums)
    restore(before)


@kernel
def vertex_definite_products(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    d: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    out: Reals,
) -> None:
    """The same with the positive semi-definite part of each element's Hessian; a kernel of its own, as few need it."""
    tile, turned, forces = np.empty(_POINTS, rest.dtype), np.empty(_POINTS, rest.dtype), np.empty(12 * W, rest.dtype)
    points, moves = np.empty(POINT * most, rest.dtype), np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], points)
        _load_direction(d, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], moves)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            _gather_corners(turned, 0, corner, t, moves)
            tile_definite_products(tile, turned, rest[t * REST * W : (t + 1) * REST * W], forces)
            for k in range(4):
                scatter_vectors(forces, 3 * k * W, corner, (4 * t + k) * W, sums)
    restore(before)


@kernel
def pair_terms(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    node_ptr: Longs,
    row_ptr: Longs,
    node: Shorts,
    u: Reals,
    most_nodes: int,
    out: Reals,
) -> None:
    """Gradient and diagonal block of every node of every block of a coarse layer; a slot holds g and H."""
    tile, tensors, terms = np.empty(_POINTS, rest.dtype), np.empty(18 * W, rest.dtype), np.empty(9 * W, rest.dtype)
    points = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], points)
        sums = out[TERMS * node_ptr[b] : TERMS * node_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            own = rest[t * REST * W : (t + 1) * REST * W]
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_stresses(tile, own, tensors)
            for row in range(row_ptr[t], row_ptr[t + 1]):
                tile_pair_terms(tensors, u[row * 3 * W : (row + 1) * 3 * W], own, terms)
                scatter_terms(terms, 0, node, row * W, sums)
    restore(before)


@kernel
def pair_forces(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    node_ptr: Longs,
    row_ptr: Longs,
    node: Shorts,
    u: Reals,
    most_nodes: int,
    out: Reals,
) -> None:
    """Gradient of every node of every block of a coarse layer; a slot holds g."""
    tile, tensors, forces = np.empty(_POINTS, rest.dtype), np.empty(18 * W, rest.dtype), np.empty(3 * W, rest.dtype)
    points = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], points)
        sums = out[VECTOR * node_ptr[b] : VECTOR * node_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_stresses(tile, rest[t * REST * W : (t + 1) * REST * W], tensors)
            for row in range(row_ptr[t], row_ptr[t + 1]):
                tile_pair_forces(tensors, u[row * 3 * W : (row + 1) * 3 * W], forces)
                scatter_vectors(forces, 0, node, row * W, sums)
    restore(before)


@kernel
def pair_products(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    d: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    node_ptr: Longs,
    row_ptr: Longs,
    node: Shorts,
    u: Reals,
    most_nodes: int,
    out: Reals,
) -> None:
    """P^T (Hessian times d) at every node of every block of a coarse layer."""
    tile, turned = np.empty(_POINTS, rest.dtype), np.empty(_POINTS, rest.dtype)
    tensors, forces = np.empty(9 * W, rest.dtype), np.empty(3 * W, rest.dtype)
    points, moves = np.empty(POINT * most, rest.dtype), np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        n_vertices = vertex_ptr[b + 1] - vertex_ptr[b]
        _load_displacements(x, X, vertex, vertex_ptr[b], n_vertices, points)
        _load_direction(d, vertex, vertex_ptr[b], n_vertices, moves)
        sums = out[VECTOR * node_ptr[b] : VECTOR * node_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            _gather_corners(turned, 0, corner, t, moves)
            tile_stress_increments(tile, turned, rest[t * REST * W : (t + 1) * REST * W], tensors)
            for row in range(row_ptr[t], row_ptr[t + 1]):
                tile_pair_forces(tensors, u[row * 3 * W : (row + 1) * 3 * W], forces)
                scatter_vectors(forces, 0, node, row * W, sums)
    restore(before)


@scalar
def tile_energies(points: Reals, rest: Reals, out: Reals) -> None:
    """Energy and J - 1 of each lane: 2 rows."""
    for l in range(W):  # noqa: E741
        energy, j = energy_and_volume(_gradient(points, l, _rest_gradients(rest, l)), rest[9 * W + l], rest[10 * W + l])
        out[l], out[W + l] = energy, j


@kernel
def energies(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    element: Ints,
    energy: Floats,
    J: Floats,
) -> None:
    """Elastic energy [J] and volume ratio J of each element."""
    tile, out = np.empty(_POINTS, rest.dtype), np.empty(2 * W, rest.dtype)
    points = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, vertex, vertex_ptr[b], vertex_ptr[b + 1] - vertex_ptr[b], points)
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_energies(tile, rest[t * REST * W : (t + 1) * REST * W], out)
            for l in range(W):  # noqa: E741
                e = element[t * W + l]
                if e >= 0:
                    energy[e], J[e] = out[l], 1.0 + out[W + l]
    restore(before)


@scalar
def tile_energies_along(points: Reals, direction: Reals, rest: Reals, sums: Reals) -> None:
    """Add the six coefficients of each lane to 6 rows."""
    for l in range(W):  # noqa: E741
        B = _rest_gradients(rest, l)
        G, dG = _gradient(points, l, B), _gradient(direction, l, B)
        p = energy_along(G, dG, rest[9 * W + l], rest[10 * W + l])
        sums[l] += p[0]
        sums[W + l] += p[1]
        sums[2 * W + l] += p[2]
        sums[3 * W + l] += p[3]
        sums[4 * W + l] += p[4]
        sums[5 * W + l] += p[5]


@kernel
def energies_along(
    start: int,
    stop: int,
    x: Floats,
    X: Floats,
    d: Floats,
    vertex_ptr: Longs,
    vertex: Ints,
    corner: Shorts,
    rest: Reals,
    most: int,
    out: Floats,
) -> None:
    """Row b of the result: coefficients of t to t^6 in E(x + t d), summed over block b."""
    tile, turned, sums = np.empty(_POINTS, rest.dtype), np.empty(_POINTS, rest.dtype), np.empty(6 * W, rest.dtype)
    points, moves = np.empty(POINT * most, rest.dtype), np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        n_vertices = vertex_ptr[b + 1] - vertex_ptr[b]
        _load_displacements(x, X, vertex, vertex_ptr[b], n_vertices, points)
        _load_direction(d, vertex, vertex_ptr[b], n_vertices, moves)
        _zero(sums, 0, 6 * W)
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            _gather_corners(turned, 0, corner, t, moves)
            tile_energies_along(tile, turned, rest[t * REST * W : (t + 1) * REST * W], sums)
        for k in range(6):
            total = 0.0
            for l in range(W):  # noqa: E741
                total += sums[k * W + l]
            out[b, k] = total
    restore(before)
