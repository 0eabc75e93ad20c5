# SPDX-License-Identifier: BSD-3-Clause
"""Element passes over blocks of tiles: gather, arithmetic and scatter as three loops over a small scratch.

A loop that both gathers and stores never becomes vector code, because nothing tells the compiler that the arrays are
apart. So a tile's twelve coordinates are gathered into rows of lanes, the arithmetic runs from rows to rows, and the
results are transposed and added to the nodes of the block. What a block reads first is in `femgal.kernels.cpu.points`.

Every kernel runs over blocks start to stop - 1 and writes their slots only, VECTOR or TERMS values each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.points import expect, gather_corners, load_direction, load_displacements, zero
from femgal.kernels.cpu.simd import (
    POINT,
    TERMS,
    VECTOR,
    W,
    flush_tiny,
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
from meshes.jit import kernel

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Shorts = NDArray[np.uint16]

# Lanes of the scratch of a tile.
_POINTS = 12 * W


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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        sums = out[TERMS * vertex_ptr[b] : TERMS * vertex_ptr[b + 1]]
        zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        load_direction(d, b, vertex_ptr, vertex, moves)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
            gather_corners(turned, 0, corner, t, moves)
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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        load_direction(d, b, vertex_ptr, vertex, moves)
        sums = out[VECTOR * vertex_ptr[b] : VECTOR * vertex_ptr[b + 1]]
        zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
            gather_corners(turned, 0, corner, t, moves)
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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        sums = out[TERMS * node_ptr[b] : TERMS * node_ptr[b + 1]]
        zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            own = rest[t * REST * W : (t + 1) * REST * W]
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        sums = out[VECTOR * node_ptr[b] : VECTOR * node_ptr[b + 1]]
        zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        load_direction(d, b, vertex_ptr, vertex, moves)
        sums = out[VECTOR * node_ptr[b] : VECTOR * node_ptr[b + 1]]
        zero(sums, 0, len(sums))
        for t in range(b * TILES, (b + 1) * TILES):
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
            gather_corners(turned, 0, corner, t, moves)
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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        for t in range(b * TILES, (b + 1) * TILES):
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
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
        load_displacements(x, X, b, vertex_ptr, vertex, anchor, anchor_inverse, points, A)
        load_direction(d, b, vertex_ptr, vertex, moves)
        zero(sums, 0, 6 * W)
        for t in range(b * TILES, (b + 1) * TILES):
            expect(rest, corner, t + 1)
            gather_corners(tile, 0, corner, t, points)
            gather_corners(turned, 0, corner, t, moves)
            tile_energies_along(tile, A, turned, rest[t * REST * W : (t + 1) * REST * W], sums)
        for k in range(6):
            total = 0.0
            for l in range(W):  # noqa: E741
                total += sums[k * W + l]
            out[b, k] = total
    restore(before)
