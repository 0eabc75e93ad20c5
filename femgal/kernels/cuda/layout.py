# SPDX-License-Identifier: BSD-3-Clause
"""Elements of a layer in blocks, laid out for blocks of threads.

Meshes come in Morton order, so consecutive elements share vertices: the active elements of a layer are cut, in their
own order, into blocks of `size`. Quantity q of element l of block b is at (b Q + q) size + l, so that neighbouring
threads read neighbouring numbers. A block numbers its vertices anew, ascending: the threads that gather them read
nearly in sequence, and so do those that later add up the slots of consecutive nodes.

Everything here depends on nothing but the layer and the precision, and so do the sums.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer, element_pairs
from femgal.kernels.backend import Precision
from femgal.kernels.cpu.tiles import slots_by_node
from meshes.jit import kernel

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Shorts = NDArray[np.uint16]

# Rest quantities per element: Dm^-1 row by row, V mu, V lam; and pairs that one thread adds up.
REST = 11
PART = 8

# Elements per block. The 36 terms of each are in shared memory at once: 36 KiB in either precision, which leaves room
# for six blocks on a multiprocessor of Hopper.
SIZES: dict[Precision, int] = {"float32": 256, "float64": 128}

# Bytes of shared memory that a block may have without asking for more.
SHARED = 48 * 1024


@dataclass(frozen=True, eq=False)
class Blocks:
    """Elements of one layer; b blocks of `size`, the last one filled up with zeros.

    Parameters
    ----------
    size : Elements of a block.
    n_elements : Elements, those that fill up the last block left out.
    element : Element at each place, -1 where there is none, shape [b size].
    vertex_ptr, vertex : Vertices of each block, ascending, shape [b + 1] and [vertices].
    corner : The four vertices of each element, numbered within the block, shape [b 4 size].
    rest : Rest quantities, shape [b REST size].
    """

    size: int
    n_elements: int
    element: Ints
    vertex_ptr: Longs
    vertex: Ints
    corner: Shorts
    rest: Reals

    @property
    def n_blocks(self) -> int:
        """Number of blocks."""
        return len(self.vertex_ptr) - 1

    @property
    def most_vertices(self) -> int:
        """Vertices of the block that has most."""
        return int(np.diff(self.vertex_ptr).max(initial=1))


@dataclass(frozen=True, eq=False)
class Entries:
    """The corners at each vertex of each block, in the order of the elements.

    Parameters
    ----------
    ptr : First corner of each vertex of each block, shape [vertices + 1].
    entry : k size + l for corner k of element l, shape [corners].
    slot_ptr, slot : Slots of each node in the order of the blocks; a slot is a vertex of a block.
    """

    ptr: Ints
    entry: Shorts
    slot_ptr: Longs
    slot: Ints


@dataclass(frozen=True, eq=False)
class Parts:
    """(element, node) pairs of a coarse layer, sorted by node within each block and cut into parts of PART.

    Pair k of part p of a block with n parts that follow `first` others is at PART first + k n + p, its u at three times
    PART first, then 3 k n + p and n apart. Pairs that fill up a part have u = 0.

    Parameters
    ----------
    node_ptr : First slot of each block; a slot is a node of a block, shape [b + 1].
    node_part : First part of each slot, counted within its block; the last of a block is in a row of its own, so slot j
        of block b is at j + b, shape [slots + b].
    part_ptr : First part of each block, shape [b + 1].
    pair : Element of each pair, numbered within the block, shape [PART parts].
    u : sum_k w_k grad N_k, shape [3 PART parts].
    slot_ptr, slot : Slots of each node in the order of the blocks.
    """

    node_ptr: Longs
    node_part: Ints
    part_ptr: Longs
    pair: Shorts
    u: Reals
    slot_ptr: Longs
    slot: Ints

    @property
    def most_parts(self) -> int:
        """Parts of the block that has most."""
        return int(np.diff(self.part_ptr).max(initial=1))


def build_blocks(disc: Discretisation, active: Ints, precision: Precision, size: int | None = None) -> Blocks:
    """Lay out elements in the given order."""
    size = size or SIZES[precision]
    n_blocks = -(-len(active) // size)
    element = np.full(n_blocks * size, -1, np.int32)
    element[: len(active)] = active
    vertex_ptr, vertex = np.zeros(n_blocks + 1, np.int64), np.empty(4 * len(active), np.int32)
    corner = np.zeros(4 * len(element), np.uint16)
    _number(disc.mesh.cells, element, size, vertex_ptr, vertex, corner)
    rest = np.zeros(REST * len(element), precision)
    _fill_rest(element, size, disc.B, disc.Vmu, disc.Vlam, rest)
    return Blocks(size, len(active), element, vertex_ptr, vertex[: vertex_ptr[-1]].copy(), corner, rest)


def build_entries(blocks: Blocks, layer: Layer) -> Entries:
    """Entries of the finest layer; the slots of constrained vertices belong to nobody."""
    ptr = np.zeros(len(blocks.vertex) + 1, np.int32)
    entry = np.empty(4 * blocks.n_elements, np.uint16)
    _sort_corners(blocks.size, blocks.element, blocks.vertex_ptr, blocks.corner, ptr, entry)
    return Entries(ptr, entry, *slots_by_node(layer.parent[blocks.vertex, 0], layer.n_nodes))


def build_parts(disc: Discretisation, layer: Layer, blocks: Blocks) -> Parts:
    """Pairs of a coarse layer."""
    arrays = (disc.mesh.cells, disc.B, layer.parent, layer.weight)
    node_ptr, part_ptr = np.zeros(blocks.n_blocks + 1, np.int64), np.zeros(blocks.n_blocks + 1, np.int64)
    nodes, counts = np.empty(layer.n_pairs, np.int32), np.empty(layer.n_pairs, np.int32)
    stamp = np.full(layer.n_nodes, -1, np.int32)
    _count_pairs(*arrays, blocks.size, blocks.element, stamp, node_ptr, part_ptr, nodes, counts)
    nodes, counts = nodes[: node_ptr[-1]].copy(), counts[: node_ptr[-1]].copy()
    node_part = np.zeros(len(nodes) + blocks.n_blocks, np.int32)
    pair, u = np.zeros(PART * part_ptr[-1], np.uint16), np.zeros(3 * PART * part_ptr[-1], blocks.rest.dtype)
    _fill_parts(*arrays, blocks.size, blocks.element, stamp, node_ptr, part_ptr, nodes, counts, node_part, pair, u)
    return Parts(node_ptr, node_part, part_ptr, pair, u, *slots_by_node(nodes, layer.n_nodes))


@kernel
def _number(tets: Ints, element: Ints, size: int, vertex_ptr: Longs, vertex: Ints, corner: Shorts) -> None:
    for b in range(len(vertex_ptr) - 1):
        own = np.empty(4 * size, np.int32)
        n = 0
        for k in range(b * size, (b + 1) * size):
            if element[k] >= 0:
                for c in range(4):
                    own[n] = tets[element[k], c]
                    n += 1
        own = np.unique(own[:n])
        first = vertex_ptr[b]
        vertex[first : first + len(own)] = own
        vertex_ptr[b + 1] = first + len(own)
        for k in range(b * size, (b + 1) * size):
            if element[k] >= 0:
                for c in range(4):
                    at = 4 * b * size + c * size + k - b * size
                    corner[at] = np.searchsorted(own, tets[element[k], c])


@kernel
def _fill_rest(element: Ints, size: int, B: Floats, Vmu: Floats, Vlam: Floats, rest: Reals) -> None:
    for k in range(len(element)):
        e, at = element[k], (k // size) * REST * size + k % size
        if e >= 0:
            for q in range(9):
                rest[at + q * size] = B[e, q]
            rest[at + 9 * size], rest[at + 10 * size] = Vmu[e], Vlam[e]


@kernel
def _sort_corners(size: int, element: Ints, vertex_ptr: Longs, corner: Shorts, ptr: Ints, entry: Shorts) -> None:
    """Counting sort of the corners of each block by vertex."""
    for b in range(len(vertex_ptr) - 1):
        first, last = vertex_ptr[b], vertex_ptr[b + 1]
        begin = ptr[first]
        for k in range(b * size, (b + 1) * size):
            for c in range(4):
                if element[k] >= 0:
                    ptr[first + corner[4 * b * size + c * size + k - b * size] + 1] += 1
        for j in range(first, last):
            ptr[j + 1] += ptr[j]
        for k in range(b * size, (b + 1) * size):
            for c in range(4):
                if element[k] >= 0:
                    j = first + corner[4 * b * size + c * size + k - b * size]
                    entry[ptr[j]] = c * size + k - b * size
                    ptr[j] += 1
        # Filling has moved every beginning to where the next one was.
        for j in range(last - 1, first, -1):
            ptr[j] = ptr[j - 1]
        ptr[first] = begin


@kernel
def _count_pairs(
    tets: Ints,
    B: Floats,
    parent: Ints,
    weight: Floats,
    size: int,
    element: Ints,
    stamp: Ints,
    node_ptr: Longs,
    part_ptr: Longs,
    block_nodes: Ints,
    counts: Ints,
) -> None:
    """Nodes of each block, in the order in which they appear, and their pairs."""
    nodes, u = np.empty(4 * parent.shape[1], np.int32), np.empty((4 * parent.shape[1], 3))
    for b in range(len(node_ptr) - 1):
        first = end = node_ptr[b]
        for k in range(b * size, (b + 1) * size):
            if element[k] < 0:
                continue
            for p in range(element_pairs(element[k], tets, B, parent, weight, nodes, u)):
                i = nodes[p]
                if stamp[i] < 0:
                    stamp[i] = end
                    block_nodes[end], counts[end] = i, 0
                    end += 1
                counts[stamp[i]] += 1
        parts = 0
        for j in range(first, end):
            stamp[block_nodes[j]] = -1
            parts += (counts[j] + PART - 1) // PART
        node_ptr[b + 1], part_ptr[b + 1] = end, part_ptr[b] + parts


@kernel
def _fill_parts(
    tets: Ints,
    B: Floats,
    parent: Ints,
    weight: Floats,
    size: int,
    element: Ints,
    stamp: Ints,
    node_ptr: Longs,
    part_ptr: Longs,
    block_nodes: Ints,
    counts: Ints,
    node_part: Ints,
    pair: Shorts,
    u_out: Reals,
) -> None:
    nodes, u = np.empty(4 * parent.shape[1], np.int32), np.empty((4 * parent.shape[1], 3))
    filled = np.zeros(len(block_nodes), np.int32)
    for b in range(len(node_ptr) - 1):
        n, start = part_ptr[b + 1] - part_ptr[b], PART * part_ptr[b]
        parts = 0
        for j in range(node_ptr[b], node_ptr[b + 1]):
            stamp[block_nodes[j]] = j
            node_part[j + b] = parts
            parts += (counts[j] + PART - 1) // PART
        node_part[node_ptr[b + 1] + b] = parts
        for k in range(b * size, (b + 1) * size):
            if element[k] < 0:
                continue
            for p in range(element_pairs(element[k], tets, B, parent, weight, nodes, u)):
                j = stamp[nodes[p]]
                part, place = node_part[j + b] + filled[j] // PART, filled[j] % PART
                filled[j] += 1
                pair[start + place * n + part] = k - b * size
                for c in range(3):
                    u_out[3 * start + (3 * place + c) * n + part] = u[p, c]
        for j in range(node_ptr[b], node_ptr[b + 1]):
            stamp[block_nodes[j]] = -1
