# SPDX-License-Identifier: BSD-3-Clause
"""Element passes over blocks of tiles: gather, arithmetic and scatter as three loops over a small scratch.

A loop that both gathers and stores never becomes vector code, because nothing tells the compiler that the arrays are
apart. So a tile's twelve coordinates are gathered into rows of lanes, the arithmetic runs from rows to rows, and the
results are transposed and added to the nodes of the block. Positions enter as displacements d = x - X relative to
that of one vertex of the block, subtracted in float64: in float32 a body that has moved far loses nothing. For one
that has turned far, displacements would still be of the size of the block, some ten edges, and their rounding would be
noise in the stress. So in float32 the affine map A (X - X_0) through four vertices of the block, its anchors, is taken
off as well, also in float64, and G gets A back: what is left to round are the differences between the elements of a
block, and the noise is that of F itself (tests/femgal/test_cpu_backend.py, item 5). Where a block holds two bodies, the
distance by which they have moved apart is left to round too.

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
from femgal.kernels.cpu.tile_arithmetic import (
    tile_definite_products,
    tile_energies,
    tile_energies_along,
    tile_forces,
    tile_pair_forces,
    tile_pair_terms,
    tile_products,
    tile_stress_increments,
    tile_stresses,
    tile_terms,
)
from femgal.kernels.cpu.tiles import REST, TILES
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
def _load_displacements(
    x: Floats,
    X: Floats,
    b: int,
    vertex_ptr: Longs,
    vertex: Ints,
    anchor: Ints,
    anchor_inverse: Floats,
    points: Reals,
    A: Reals,
) -> None:
    """points[4 j + c] = displacement of vertex j of block b relative to its first anchor, less A times its rest place.

    A (X - X_0) goes through the displacements of the block's four anchors. It is zero in float64.
    """
    o = anchor[b, 0]
    X0, X1, X2 = X[o, 0], X[o, 1], X[o, 2]
    o0, o1, o2 = x[o, 0] - X0, x[o, 1] - X1, x[o, 2] - X2
    if points.itemsize == 4:
        for c in range(3):
            p, q, r = anchor[b, 1], anchor[b, 2], anchor[b, 3]
            o_c = x[o, c] - X[o, c]
            e0, e1, e2 = (x[p, c] - X[p, c]) - o_c, (x[q, c] - X[q, c]) - o_c, (x[r, c] - X[r, c]) - o_c
            for k in range(3):
                inverse = anchor_inverse[b, k], anchor_inverse[b, 3 + k], anchor_inverse[b, 6 + k]
                A[3 * c + k] = e0 * inverse[0] + e1 * inverse[1] + e2 * inverse[2]
    # A as rounded to float32, in float64: what is taken off here is exactly what the tile adds to G.
    A0, A1, A2 = np.float64(A[0]), np.float64(A[1]), np.float64(A[2])
    A3, A4, A5 = np.float64(A[3]), np.float64(A[4]), np.float64(A[5])
    A6, A7, A8 = np.float64(A[6]), np.float64(A[7]), np.float64(A[8])
    first = vertex_ptr[b]
    for j in range(vertex_ptr[b + 1] - first):
        v = vertex[first + j]
        d0, d1, d2 = (x[v, 0] - X[v, 0]) - o0, (x[v, 1] - X[v, 1]) - o1, (x[v, 2] - X[v, 2]) - o2
        if points.itemsize == 4:
            r0, r1, r2 = X[v, 0] - X0, X[v, 1] - X1, X[v, 2] - X2
            d0 -= A0 * r0 + A1 * r1 + A2 * r2
            d1 -= A3 * r0 + A4 * r1 + A5 * r2
            d2 -= A6 * r0 + A7 * r1 + A8 * r2
        points[POINT * j], points[POINT * j + 1], points[POINT * j + 2] = d0, d1, d2
        points[POINT * j + 3] = 0.0


@scalar
def _load_direction(d: Floats, b: int, vertex_ptr: Longs, vertex: Ints, points: Reals) -> None:
    """points[4 j + c] = direction of vertex j of block b, relative to that of the first vertex."""
    first = vertex_ptr[b]
    o = vertex[first]
    o0, o1, o2 = d[o, 0], d[o, 1], d[o, 2]
    for j in range(vertex_ptr[b + 1] - first):
        v = vertex[first + j]
        points[POINT * j], points[POINT * j + 1] = d[v, 0] - o0, d[v, 1] - o1
        points[POINT * j + 2], points[POINT * j + 3] = d[v, 2] - o2, 0.0


@scalar
def _gather_corners(tile: Reals, at: int, corner: Shorts, t: int, points: Reals) -> None:
    """Twelve coordinates of each lane of tile t."""
    for k in range(4):
        gather_points(tile, at + 3 * k * W, corner, (4 * t + k) * W, points)


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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    out: Reals,
) -> None:
    """Gradient and diagonal block of every vertex of every block; a slot holds g and H."""
    tile, terms = np.empty(_POINTS, rest.dtype), np.empty(36 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        sums = out[TERMS * vertex_ptr[b] : TERMS * vertex_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_terms(tile, A, rest[t * REST * W : (t + 1) * REST * W], terms)
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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    out: Reals,
) -> None:
    """Gradient of every vertex of every block; a slot holds g."""
    tile, forces = np.empty(_POINTS, rest.dtype), np.empty(12 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_forces(tile, A, rest[t * REST * W : (t + 1) * REST * W], forces)
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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    out: Reals,
) -> None:
    """Hessian times d at every vertex of every block."""
    tile, turned, forces = np.empty(_POINTS, rest.dtype), np.empty(_POINTS, rest.dtype), np.empty(12 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    moves = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        _load_direction(d, b, vertex_ptr, vertex, moves)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            _gather_corners(turned, 0, corner, t, moves)
            tile_products(tile, A, turned, rest[t * REST * W : (t + 1) * REST * W], forces)
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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    out: Reals,
) -> None:
    """The same with the positive semi-definite part of each element's Hessian; a kernel of its own, as few need it."""
    tile, turned, forces = np.empty(_POINTS, rest.dtype), np.empty(_POINTS, rest.dtype), np.empty(12 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    moves = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        _load_direction(d, b, vertex_ptr, vertex, moves)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            _gather_corners(turned, 0, corner, t, moves)
            tile_definite_products(tile, A, turned, rest[t * REST * W : (t + 1) * REST * W], forces)
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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    node_ptr: Longs,
    row_ptr: Longs,
    node: Shorts,
    u: Reals,
    out: Reals,
) -> None:
    """Gradient and diagonal block of every node of every block of a coarse layer; a slot holds g and H."""
    tile, tensors, terms = np.empty(_POINTS, rest.dtype), np.empty(18 * W, rest.dtype), np.empty(9 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        sums = out[TERMS * node_ptr[b] : TERMS * node_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            own = rest[t * REST * W : (t + 1) * REST * W]
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_stresses(tile, A, own, tensors)
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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    node_ptr: Longs,
    row_ptr: Longs,
    node: Shorts,
    u: Reals,
    out: Reals,
) -> None:
    """Gradient of every node of every block of a coarse layer; a slot holds g."""
    tile, tensors, forces = np.empty(_POINTS, rest.dtype), np.empty(18 * W, rest.dtype), np.empty(3 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        sums = out[VECTOR * node_ptr[b] : VECTOR * node_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_stresses(tile, A, rest[t * REST * W : (t + 1) * REST * W], tensors)
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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    node_ptr: Longs,
    row_ptr: Longs,
    node: Shorts,
    u: Reals,
    out: Reals,
) -> None:
    """P^T (Hessian times d) at every node of every block of a coarse layer."""
    tile, turned = np.empty(_POINTS, rest.dtype), np.empty(_POINTS, rest.dtype)
    tensors, forces = np.empty(9 * W, rest.dtype), np.empty(3 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    moves = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        _load_direction(d, b, vertex_ptr, vertex, moves)
        sums = out[VECTOR * node_ptr[b] : VECTOR * node_ptr[b + 1]]
        _zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            _gather_corners(turned, 0, corner, t, moves)
            tile_stress_increments(tile, A, turned, rest[t * REST * W : (t + 1) * REST * W], tensors)
            for row in range(row_ptr[t], row_ptr[t + 1]):
                tile_pair_forces(tensors, u[row * 3 * W : (row + 1) * 3 * W], forces)
                scatter_vectors(forces, 0, node, row * W, sums)
    restore(before)


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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    element: Ints,
    energy: Floats,
    J: Floats,
) -> None:
    """Elastic energy [J] and volume ratio J of each element."""
    tile, out = np.empty(_POINTS, rest.dtype), np.empty(2 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            tile_energies(tile, A, rest[t * REST * W : (t + 1) * REST * W], out)
            for l in range(W):  # noqa: E741
                e = element[t * W + l]
                if e >= 0:
                    energy[e], J[e] = out[l], 1.0 + out[W + l]
    restore(before)


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
    anchor: Ints,
    anchor_inverse: Floats,
    most: int,
    out: Floats,
) -> None:
    """Row b of the result: coefficients of t to t^6 in E(x + t d), summed over block b."""
    tile, turned, sums = np.empty(_POINTS, rest.dtype), np.empty(_POINTS, rest.dtype), np.empty(6 * W, rest.dtype)
    points, A = np.empty(POINT * most, rest.dtype), np.zeros(9, rest.dtype)
    moves = np.empty(POINT * most, rest.dtype)
    before = flush_tiny()
    for b in range(start, stop):
        _load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        _load_direction(d, b, vertex_ptr, vertex, moves)
        _zero(sums, 0, 6 * W)
        for t in range(b * TILES, (b + 1) * TILES):
            _expect(rest, corner, t + 1)
            _gather_corners(tile, 0, corner, t, points)
            _gather_corners(turned, 0, corner, t, moves)
            tile_energies_along(tile, A, turned, rest[t * REST * W : (t + 1) * REST * W], sums)
        for k in range(6):
            total = 0.0
            for l in range(W):  # noqa: E741
                total += sums[k * W + l]
            out[b, k] = total
    restore(before)
