# SPDX-License-Identifier: BSD-3-Clause
"""Nodes of a regular lattice of tetrahedra: those of a piecewise-linear layer (Lu et al. 2025, sections 5.1.2, 5.2.2).

A vertex is moved by the corners of the coarse tetrahedron that holds it, with its barycentric coordinates as weights:
the coarse functions are the hat functions of the lattice, restricted to the body. The lattice is infinite, so it
covers the body and no weight is negative. In three things the nodes are not simply its points:

1. A point that moves unconnected parts of the body is a node for each (`femgal.hierarchy.supports`).
2. Constrained vertices have no node, so a part ends at them.
3. Nodes that carry less than one vertex are left out, and what remains at their vertices is scaled to sum to one. They
   come from points just outside the body. Without them block Jacobi may take longer steps, because lambda_max(D^-1 A)
   of the layer is smaller, and no layer has more nodes than vertices however coarse the mesh is in places.

The lattice is body-centred cubic, its tetrahedra all the same, with edges of 1 and sqrt(3)/2 of the cube's: rounder
than those of Kuhn's split of cubes, so one cycle leaves less of the energy gap and elements meet fewer nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.supports import support_parts
from meshes.jit import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# Barycentric coordinates below this are what rounding makes of zero.
NEGLIGIBLE = 1e-9

# Sum of the weights of a node below which it is left out.
LIGHTEST = 1.0

# Three lattice coordinates share 63 bits. They wrap around, which does no harm: numbers of points are only compared
# along edges of the mesh.
_BITS = 21
_WRAP = 1 << _BITS


@dataclass(frozen=True, eq=False)
class LatticeNodes:
    """Nodes and weights; k nodes, n vertices.

    Parameters
    ----------
    parent : Nodes that move each vertex, heaviest first, -1 for none, shape [n, 4].
    weight : Their weights, non-negative; they sum to one at free vertices, and are 0 without a node, shape [n, 4].
    position : Where the nodes stand [m], numbered by the lowest vertex that they move, shape [k, 3].
    """

    parent: Ints
    weight: Floats
    position: Floats


def lattice_nodes(
    X: Floats,
    free: NDArray[np.bool_],
    edges: Ints,
    spacing: float,
    origin: Floats | None = None,
    lightest: float = LIGHTEST,
) -> LatticeNodes:
    """Nodes of the lattice of one spacing.

    Parameters
    ----------
    X : Rest positions [m], shape [n, 3].
    free : Vertices that nodes may move, shape [n].
    edges : Edges of the mesh, shape [n_edges, 2].
    spacing : Edge of the cubes [m]; a cube holds two nodes.
    origin : One of the lattice's points [m], shape [3]; None puts it in the middle of the bounding box. Lattices of
        one origin are nested where the spacing of one is twice that of the other.
    lightest : Nodes that carry less than so many vertices are left out.
    """
    origin = 0.5 * (X.min(axis=0) + X.max(axis=0)) if origin is None else origin
    point, weight = np.empty((len(X), 4), np.int64), np.empty((len(X), 4))
    _interpolate(X, free, origin, spacing, point, weight)
    parent, first = support_parts(edges, point)
    kept = np.zeros(len(first), np.bool_)
    _choose(parent, weight, lightest, kept)
    number = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
    _settle(number, parent, weight)
    first = first[kept]
    return LatticeNodes(parent, weight, _positions(point.ravel()[first], X[first // 4], origin, spacing))


@kernel
def _interpolate(
    X: Floats, free: NDArray[np.bool_], origin: Floats, spacing: float, point: Longs, weight: Floats
) -> None:
    """Points of the lattice around each vertex, -1 where there is none, and barycentric coordinates.

    The coordinates (y + z, z + x, x + y) / spacing map the lattice to the integers and its tetrahedra to Kuhn's: from
    the lower corner c of the unit cube to the upper one, along the axes in the order of falling fractions f. Along that
    path the weights are 1 - f_1, f_1 - f_2, f_2 - f_3, f_3.
    """
    c, f, axis = np.empty(3, np.int64), np.empty(3), np.empty(3, np.int64)
    for v in range(len(X)):
        point[v], weight[v] = -1, 0.0
        if not free[v]:
            continue
        x, y, z = X[v, 0] - origin[0], X[v, 1] - origin[1], X[v, 2] - origin[2]
        f[0], f[1], f[2] = (y + z) / spacing, (z + x) / spacing, (x + y) / spacing
        for d in range(3):
            c[d], axis[d] = np.int64(np.floor(f[d])), d
            f[d] -= c[d]
        for a, b in ((0, 1), (1, 2), (0, 1)):
            if f[axis[a]] < f[axis[b]]:
                axis[a], axis[b] = axis[b], axis[a]
        above = 1.0
        n = 0
        for s in range(4):
            below = f[axis[s]] if s < 3 else 0.0
            if above - below > NEGLIGIBLE:
                point[v, n] = ((c[0] % _WRAP) * _WRAP + c[1] % _WRAP) * _WRAP + c[2] % _WRAP
                weight[v, n] = above - below
                n += 1
            above = below
            if s < 3:
                c[axis[s]] += 1


@kernel
def _choose(parent: Ints, weight: Floats, lightest: float, kept: NDArray[np.bool_]) -> None:
    """Keep the nodes that carry `lightest` or more, and of each vertex at least the one that carries most."""
    total = np.zeros(len(kept))
    for v in range(len(parent)):
        for s in range(4):
            if parent[v, s] >= 0:
                total[parent[v, s]] += weight[v, s]
    for v in range(len(parent)):
        most = 0
        for s in range(1, 4):
            if parent[v, s] >= 0 and total[parent[v, s]] > total[parent[v, most]]:
                most = s
        if parent[v, most] >= 0:
            kept[parent[v, most]] = True
    for i in range(len(kept)):
        if total[i] >= lightest:
            kept[i] = True


@kernel
def _settle(number: Ints, parent: Ints, weight: Floats) -> None:
    """Renumber the nodes; at each vertex drop those without a number, scale the rest and sort it by weight."""
    for v in range(len(parent)):
        n = 0
        total = 0.0
        for s in range(4):
            i, w = parent[v, s], weight[v, s]
            parent[v, s], weight[v, s] = -1, 0.0
            if i < 0 or number[i] < 0:
                continue
            k = n
            while k > 0 and weight[v, k - 1] < w:
                parent[v, k], weight[v, k] = parent[v, k - 1], weight[v, k - 1]
                k -= 1
            parent[v, k], weight[v, k] = number[i], w
            total += w
            n += 1
        for s in range(n):
            weight[v, s] /= total


def _positions(point: Longs, near: Floats, origin: Floats, spacing: float) -> Floats:
    """Positions [m] of points of the lattice, of which a vertex of the same cell is known."""
    x = near - origin
    cell = np.floor((x.sum(axis=1, keepdims=True) - x) / spacing).astype(np.int64)
    wrapped = np.stack([point >> 2 * _BITS, (point >> _BITS) % _WRAP, point % _WRAP], axis=1)
    c = cell + (wrapped - cell + _WRAP // 2) % _WRAP - _WRAP // 2
    return origin + 0.5 * spacing * (c.sum(axis=1, keepdims=True) - 2 * c)
