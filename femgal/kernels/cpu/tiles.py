# SPDX-License-Identifier: BSD-3-Clause
"""Elements of a layer in blocks and tiles, laid out for the vector units.

The active elements of a layer are cut, in their own order, into blocks of BLOCK elements. A block numbers its vertices
(and, on a coarse layer, its nodes) anew, so that all it gathers and sums stays in the first-level cache. Its
elements are spread over tiles of W lanes such that neighbours in the mesh are far apart in their block: the nodes of
one lane are then not the ones that the lane before has just written, and no addition waits for the one before it.
What a block sums for a node is one slot; a node adds its slots in a fixed order. The cut depends on nothing but the
layer, so results have the same bits for any number of threads.

Arrays of a tile are rows of W lanes: quantity q of lane l at place q W + l.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer, element_pairs
from femgal.kernels.backend import Precision
from femgal.kernels.cpu.simd import W
from femgal.materials.vector import cross, dot
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Shorts = NDArray[np.uint16]

# Elements per block: some 300 vertices, whose positions and sums fill a third of a first-level cache.
BLOCK = 1024
TILES = BLOCK // W

# Rest quantities per element: Dm^-1 row by row, V mu, V lam.
REST = 11


@dataclass(frozen=True, eq=False)
class Tiles:
    """Elements of one layer; b blocks of TILES tiles each, those past the last element filled with zeros.

    Parameters
    ----------
    n_elements : Elements, those that fill up the last block left out.
    element : Element in each lane, -1 where there is none, shape [b BLOCK], tile by tile.
    vertex_ptr, vertex : Vertices of each block, shape [b + 1] and [vertices].
    corner : The four vertices of each lane, numbered within the block, shape [tiles 4 W].
    rest : Rest quantities, shape [tiles REST W].
    anchor : Four vertices of each block that span much of it, shape [b, 4].
    anchor_inverse : Inverse of the matrix whose columns are the rest edges from the first anchor to the others [1/m],
        row by row, zero where they span nothing, shape [b, 9]. Both are zero in float64, which needs none.
    """

    n_elements: int
    element: Ints
    vertex_ptr: Longs
    vertex: Ints
    corner: Shorts
    rest: Reals
    anchor: Ints
    anchor_inverse: Floats

    @property
    def n_blocks(self) -> int:
        """Number of blocks."""
        return len(self.vertex_ptr) - 1

    @property
    def most_vertices(self) -> int:
        """Vertices of the block that has most."""
        return int(np.diff(self.vertex_ptr).max(initial=1))


@dataclass(frozen=True, eq=False)
class Slots:
    """Where the blocks leave what they sum for the nodes of a layer.

    Parameters
    ----------
    node_ptr : First slot of each block, shape [b + 1].
    slot_ptr, slot : Slots of each node in the order of the blocks, shape [k + 1] and [slots].
    """

    node_ptr: Longs
    slot_ptr: Longs
    slot: Ints


@dataclass(frozen=True, eq=False)
class Pairs:
    """(element, node) pairs of a coarse layer in the order of its tiles.

    A tile has as many rows of pairs as its busiest lane has nodes; lanes with fewer have u = 0 there, which adds zero.

    Parameters
    ----------
    row_ptr : First row of pairs of each tile, shape [tiles + 1].
    node : Node of each lane, numbered within the block, shape [rows W].
    u : sum_k w_k grad N_k, shape [rows 3 W].
    """

    row_ptr: Longs
    node: Shorts
    u: Reals


def build_tiles(disc: Discretisation, active: Ints, precision: Precision) -> Tiles:
    """Lay out elements in the given order."""
    n_blocks = -(-len(active) // BLOCK)
    element = np.full(n_blocks * BLOCK, -1, np.int32)
    _spread(active, element)
    vertex_ptr, corner = np.zeros(n_blocks + 1, np.int64), np.zeros(4 * len(element), np.uint16)
    _number(disc.mesh.cells, element, np.full(disc.n_vertices, -1, np.int32), vertex_ptr, corner)
    vertex = np.empty(vertex_ptr[-1], np.int32)
    _list(disc.mesh.cells, element, corner, vertex_ptr, vertex)
    rest = np.zeros(REST * len(element), precision)
    _fill_rest(element, disc.B, disc.Vmu, disc.Vlam, rest)
    anchor, anchor_inverse = np.zeros((n_blocks, 4), np.int32), np.zeros((n_blocks, 9))
    if precision == "float32":
        _find_anchors(disc.mesh.points, vertex_ptr, vertex, anchor, anchor_inverse)
    return Tiles(len(active), element, vertex_ptr, vertex, corner, rest, anchor, anchor_inverse)


def vertex_slots(tiles: Tiles, layer: Layer) -> Slots:
    """Slots of the finest layer: one for each vertex of each block; those of constrained vertices belong to nobody."""
    return Slots(tiles.vertex_ptr, *slots_by_node(layer.parent[tiles.vertex, 0], layer.n_nodes))


def build_pairs(disc: Discretisation, layer: Layer, tiles: Tiles, precision: Precision) -> tuple[Pairs, Slots]:
    """Pairs and slots of a coarse layer."""
    arrays = (disc.mesh.cells, disc.B, layer.parent, layer.weight)
    row_ptr = np.zeros(len(tiles.element) // W + 1, np.int64)
    _count_rows(*arrays, tiles.element, row_ptr)
    np.cumsum(row_ptr, out=row_ptr)
    node, u = np.zeros(row_ptr[-1] * W, np.uint16), np.zeros(row_ptr[-1] * 3 * W, precision)
    node_ptr = np.zeros(tiles.n_blocks + 1, np.int64)
    nodes = np.empty(layer.n_pairs, np.int32)
    stamp = np.full(layer.n_nodes, -1, np.int32)
    n_slots = _fill_rows(*arrays, tiles.element, row_ptr, stamp, node_ptr, nodes, node, u)
    return Pairs(row_ptr, node, u), Slots(node_ptr, *slots_by_node(nodes[:n_slots], layer.n_nodes))


def slots_by_node(node: Ints, n_nodes: int) -> tuple[Longs, Ints]:
    """Slots of each node in their order, `slot_ptr, slot`, from the node of each slot; -1 belongs to nobody."""
    slot_ptr = np.zeros(n_nodes + 1, np.int64)
    _count_slots(node, slot_ptr)
    np.cumsum(slot_ptr, out=slot_ptr)
    slot = np.empty(slot_ptr[-1], np.int32)
    _fill_slots(node, slot_ptr[:-1].copy(), slot)
    return slot_ptr, slot


@scalar
def _lane(k: int) -> int:
    """Lane of the k-th active element: the r-th of its block goes to tile r % TILES, lane r // TILES."""
    r = k % BLOCK
    return k - r + (r % TILES) * W + r // TILES


@kernel
def _spread(active: Ints, element: Ints) -> None:
    for k in range(len(active)):
        element[_lane(k)] = active[k]


@kernel
def _number(tets: Ints, element: Ints, local: Ints, vertex_ptr: Longs, corner: Shorts) -> None:
    """Number the vertices of each block in the order in which they appear; vertex_ptr[b + 1] becomes their sum."""
    for b in range(len(vertex_ptr) - 1):
        n = 0
        for r in range(b * BLOCK, (b + 1) * BLOCK):
            # In the order of the mesh, so that positions are read nearly in sequence.
            k = _lane(r)
            e = element[k]
            if e >= 0:
                for c in range(4):
                    v = tets[e, c]
                    if local[v] < 0:
                        local[v] = n
                        n += 1
                    corner[(k // W) * 4 * W + c * W + k % W] = local[v]
        for k in range(b * BLOCK, (b + 1) * BLOCK):
            if element[k] >= 0:
                for c in range(4):
                    local[tets[element[k], c]] = -1
        vertex_ptr[b + 1] = vertex_ptr[b] + n


@kernel
def _list(tets: Ints, element: Ints, corner: Shorts, vertex_ptr: Longs, vertex: Ints) -> None:
    for k in range(len(element)):
        if element[k] >= 0:
            first = vertex_ptr[k // BLOCK]
            for c in range(4):
                vertex[first + corner[(k // W) * 4 * W + c * W + k % W]] = tets[element[k], c]


@kernel
def _find_anchors(X: Floats, vertex_ptr: Longs, vertex: Ints, anchor: Ints, inverse: Floats) -> None:
    """Four vertices of each block: its first, then each the one that spans most length, area and volume with them.

    No vertex is farther than the last from the plane of the others, so the map through the four exaggerates nowhere.
    """
    edges = np.zeros(9)
    for b in range(len(vertex_ptr) - 1):
        own = vertex[vertex_ptr[b] : vertex_ptr[b + 1]]
        o = own[0]
        anchor[b] = o
        edges[:] = 0.0
        det = 0.0
        for k in range(3):
            most = 0.0
            for v in own:
                r = (X[v, 0] - X[o, 0], X[v, 1] - X[o, 1], X[v, 2] - X[o, 2])
                span = r
                if k == 1:
                    span = cross((edges[0], edges[1], edges[2]), r)
                elif k == 2:
                    normal = cross((edges[0], edges[1], edges[2]), (edges[3], edges[4], edges[5]))
                    span = (dot(normal, r), 0.0, 0.0)
                if dot(span, span) > most:
                    most, det = dot(span, span), span[0]
                    anchor[b, k + 1] = v
                    edges[3 * k], edges[3 * k + 1], edges[3 * k + 2] = r
        if most > 0.0:
            e, f, g = (edges[0], edges[1], edges[2]), (edges[3], edges[4], edges[5]), (edges[6], edges[7], edges[8])
            for c in range(3):
                inverse[b, c] = cross(f, g)[c] / det
                inverse[b, 3 + c] = cross(g, e)[c] / det
                inverse[b, 6 + c] = cross(e, f)[c] / det


@kernel
def _fill_rest(element: Ints, B: Floats, Vmu: Floats, Vlam: Floats, rest: Reals) -> None:
    for k in range(len(element)):
        e, at = element[k], (k // W) * REST * W + k % W
        if e >= 0:
            for q in range(9):
                rest[at + q * W] = B[e, q]
            rest[at + 9 * W], rest[at + 10 * W] = Vmu[e], Vlam[e]


@kernel
def _count_rows(tets: Ints, B: Floats, parent: Ints, weight: Floats, element: Ints, rows: Longs) -> None:
    """rows[t + 1] = most nodes of any lane of tile t."""
    nodes = np.empty(4 * parent.shape[1], np.int32)
    u = np.empty((4 * parent.shape[1], 3))
    for k in range(len(element)):
        if element[k] >= 0:
            n = element_pairs(element[k], tets, B, parent, weight, nodes, u)
            rows[k // W + 1] = max(rows[k // W + 1], n)


@kernel
def _fill_rows(
    tets: Ints,
    B: Floats,
    parent: Ints,
    weight: Floats,
    element: Ints,
    row_ptr: Longs,
    local: Ints,
    node_ptr: Longs,
    block_nodes: Ints,
    node: Shorts,
    u_out: Reals,
) -> int:
    """Number the nodes of each block and fill the rows of pairs; returns the number of slots."""
    nodes = np.empty(4 * parent.shape[1], np.int32)
    u = np.empty((4 * parent.shape[1], 3))
    for b in range(len(node_ptr) - 1):
        first = n_block = node_ptr[b]
        for k in range(b * BLOCK, (b + 1) * BLOCK):
            if element[k] < 0:
                continue
            n = element_pairs(element[k], tets, B, parent, weight, nodes, u)
            for p in range(n):
                i = nodes[p]
                if local[i] < 0:
                    local[i] = n_block - first
                    block_nodes[n_block] = i
                    n_block += 1
                row = row_ptr[k // W] + p
                node[row * W + k % W] = local[i]
                for d in range(3):
                    u_out[(row * 3 + d) * W + k % W] = u[p, d]
        for j in range(first, n_block):
            local[block_nodes[j]] = -1
        node_ptr[b + 1] = n_block
    return node_ptr[-1]


@kernel
def _count_slots(node: Ints, count: Longs) -> None:
    """count[i + 1] = slots of node i."""
    for s in range(len(node)):
        if node[s] >= 0:
            count[node[s] + 1] += 1


@kernel
def _fill_slots(node: Ints, at: Longs, slot: Ints) -> None:
    for s in range(len(node)):
        if node[s] >= 0:
            slot[at[node[s]]] = s
            at[node[s]] += 1
