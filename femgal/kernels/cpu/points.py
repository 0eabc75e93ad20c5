# SPDX-License-Identifier: BSD-3-Clause
"""What a block reads before its arithmetic: the displacements of its vertices, their copies for the lanes of a tile.

Positions enter as displacements d = x - X relative to that of one vertex of the block, subtracted in float64: in
float32 a body that has moved far loses nothing. For one that has turned far, displacements would still be of the size
of the block, some ten edges, and their rounding would be noise in the stress. So in float32 the affine map A (X - X_0)
through four vertices of the block, its anchors, is taken off as well, also in float64, and G gets A back: what is left
to round are the differences between the elements of a block, and the noise is that of F itself
(tests/femgal/test_cpu_backend.py, item 5). Where a block holds two bodies, the distance by which they have moved apart
is left to round too (row invariance/parted-bodies of the suite).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.simd import POINT, W, gather_points, prefetch
from femgal.kernels.cpu.tiles import REST
from meshes.jit import scalar

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Shorts = NDArray[np.uint16]

# Bytes of a cache line.
LINE = 64


@scalar
def load_displacements(
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
def load_direction(d: Floats, b: int, vertex_ptr: Longs, vertex: Ints, points: Reals) -> None:
    """points[4 j + c] = direction of vertex j of block b, relative to that of the first vertex."""
    first = vertex_ptr[b]
    o = vertex[first]
    o0, o1, o2 = d[o, 0], d[o, 1], d[o, 2]
    for j in range(vertex_ptr[b + 1] - first):
        v = vertex[first + j]
        points[POINT * j], points[POINT * j + 1] = d[v, 0] - o0, d[v, 1] - o1
        points[POINT * j + 2], points[POINT * j + 3] = d[v, 2] - o2, 0.0


@scalar
def gather_corners(tile: Reals, at: int, corner: Shorts, t: int, points: Reals) -> None:
    """Twelve coordinates of each lane of tile t."""
    for k in range(4):
        gather_points(tile, at + 3 * k * W, corner, (4 * t + k) * W, points)


@scalar
def zero(values: Reals, start: int, stop: int) -> None:
    """values[start:stop] = 0."""
    for k in range(start, stop):
        values[k] = 0.0


@scalar
def expect(rest: Reals, corner: Shorts, t: int) -> None:
    """Ask for the rest quantities and corners of tile t: the processor's own guess comes too late."""
    for k in range(t * REST * W, (t + 1) * REST * W, LINE // rest.itemsize):
        prefetch(rest, k)
    for k in range(t * 4 * W, (t + 1) * 4 * W, LINE // 2):
        prefetch(corner, k)
