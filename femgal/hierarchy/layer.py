# SPDX-License-Identifier: BSD-3-Clause
"""A layer: nodes that each move some vertices of the finest mesh, and the elements that feel them.

Every layer is connected directly to the finest mesh (Lu et al. 2025, section 5.3.1); the finest layer is the one whose
nodes are the free vertices. A node i moves vertex v by weight w_iv, so the prolongation is x_v += sum_i w_iv dx_i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from meshes.connectivity import component_labels
from meshes.jit import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Layer:
    """Prolongation of one layer and the elements that feel it; k nodes, n vertices.

    Parameters
    ----------
    name : "vertices", or for a coarse layer the kind and the ratio.
    parent, weight : Nodes that move each vertex and their weights, shape [n, p]; -1 for none.
    child_ptr, child, child_weight : The transpose: vertices of each node, ascending.
    active : Elements with at least one node whose motion deforms them, shape [a], ascending.
    n_pairs : Number of (element, node) pairs in which the node deforms the element.
    """

    name: str
    parent: Ints
    weight: Floats
    child_ptr: Longs
    child: Ints
    child_weight: Floats
    active: Ints
    n_pairs: int

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.child_ptr) - 1

    @property
    def sizes(self) -> Longs:
        """Number of vertices that each node moves, shape [n_nodes]."""
        return np.diff(self.child_ptr)


@dataclass(frozen=True, eq=False)
class Pairs:
    """(element, u) pairs of a layer sorted by node, then by element.

    Parameters
    ----------
    ptr : Node i owns the pairs ptr[i] to ptr[i + 1] - 1, shape [k + 1].
    element : Elements that the node deforms, as positions in `Layer.active`, shape [n_pairs].
    u : sum_k w_k grad N_k [1/m] (Lu et al. 2025, Eq. 12), shape [n_pairs, 3].
    """

    ptr: Longs
    element: Ints
    u: Floats


def build_layer(disc: Discretisation, parent: Ints, weight: Floats, n_nodes: int, name: str) -> Layer:
    """Connect coarse nodes directly to the finest mesh; the parents of a vertex are distinct.

    An element none of whose nodes deforms it (all of u zero, such as the interior of a constant cluster) contributes
    nothing to gradient or block and is left out (Lu et al. 2025, section 5.1.1).
    """
    is_active = np.zeros(disc.n_tets, np.bool_)
    n_pairs = _mark_active(disc.mesh.cells, disc.B, parent, weight, is_active)
    active = np.flatnonzero(is_active).astype(np.int32)
    return Layer(name, parent, weight, *transpose(parent, weight, n_nodes), active, int(n_pairs))


def build_pairs(disc: Discretisation, layer: Layer) -> Pairs:
    """The (element, u) pairs of a layer."""
    tets, B, parent, weight = disc.mesh.cells, disc.B, layer.parent, layer.weight
    ptr = np.zeros(layer.n_nodes + 1, np.int64)
    _count_pairs(tets, B, parent, weight, layer.active, ptr)
    np.cumsum(ptr, out=ptr)
    element, u = np.empty(ptr[-1], np.int32), np.empty((ptr[-1], 3))
    _fill_pairs(tets, B, parent, weight, ptr[:-1].copy(), layer.active, element, u)
    return Pairs(ptr, element, u)


def finest_layer(disc: Discretisation) -> Layer:
    """The layer whose nodes are the free vertices."""
    parent = np.full((disc.n_vertices, 1), -1, np.int32)
    n_free = int(disc.free.sum())
    parent[disc.free, 0] = np.arange(n_free, dtype=np.int32)
    return build_layer(disc, parent, np.ones((disc.n_vertices, 1)), n_free, "vertices")


def free_parts(disc: Discretisation) -> Layer | None:
    """The layer whose nodes are the connected parts that no constraint holds; None when all are held.

    Elastic forces on such a part sum to zero, so its block is its mass alone and no element is active: a step of
    length 1 on this layer puts its centre of mass where the equation of motion has it, and so keeps its momentum.
    """
    part = component_labels(disc.mesh.cells)
    held = np.zeros(disc.n_vertices, bool)
    held[part[~disc.free]] = True
    roots = np.unique(part[~held[part]])
    if len(roots) == 0:
        return None
    node = np.full(disc.n_vertices, -1, np.int32)
    node[roots] = np.arange(len(roots), dtype=np.int32)
    return build_layer(disc, node[part][:, None].copy(), np.ones((disc.n_vertices, 1)), len(roots), "free parts")


def transpose(parent: Ints, weight: Floats, n_nodes: int) -> tuple[Longs, Ints, Floats]:
    """Vertices of each node and their weights, from the nodes of each vertex: `child_ptr, child, child_weight`."""
    child_ptr = np.zeros(n_nodes + 1, np.int64)
    _count_children(parent, child_ptr)
    np.cumsum(child_ptr, out=child_ptr)
    child, child_weight = np.empty(child_ptr[-1], np.int32), np.empty(child_ptr[-1])
    _fill_children(parent, weight, child_ptr[:-1].copy(), child, child_weight)
    return child_ptr, child, child_weight


@kernel
def _count_children(parent: Ints, count: Longs) -> None:
    """count[i + 1] = vertices of node i."""
    for v in range(len(parent)):
        for k in range(parent.shape[1]):
            if parent[v, k] >= 0:
                count[parent[v, k] + 1] += 1


@kernel
def _fill_children(parent: Ints, weight: Floats, at: Longs, child: Ints, child_weight: Floats) -> None:
    for v in range(len(parent)):
        for k in range(parent.shape[1]):
            i = parent[v, k]
            if i >= 0:
                child[at[i]], child_weight[at[i]] = v, weight[v, k]
                at[i] += 1


@kernel
def element_pairs(e: int, tets: Ints, B: Floats, parent: Ints, weight: Floats, nodes: Ints, u: Floats) -> int:
    """Distinct nodes of element e with their u, merged over its vertices; returns how many have u != 0."""
    n = 0
    scale = 0.0
    for k in range(4):
        if k == 0:
            g0 = -(B[e, 0] + B[e, 3] + B[e, 6])
            g1 = -(B[e, 1] + B[e, 4] + B[e, 7])
            g2 = -(B[e, 2] + B[e, 5] + B[e, 8])
        else:
            g0, g1, g2 = B[e, 3 * k - 3], B[e, 3 * k - 2], B[e, 3 * k - 1]
        scale = max(scale, abs(g0), abs(g1), abs(g2))
        v = tets[e, k]
        for s in range(parent.shape[1]):
            i = parent[v, s]
            if i < 0:
                continue
            w = weight[v, s]
            p = 0
            while p < n and nodes[p] != i:
                p += 1
            if p == n:
                nodes[n] = i
                u[n, 0] = u[n, 1] = u[n, 2] = 0.0
                n += 1
            u[p, 0] += w * g0
            u[p, 1] += w * g1
            u[p, 2] += w * g2
    # The four gradients sum to zero; what rounding leaves of that sum is not a deformation.
    kept = 0
    for p in range(n):
        if max(abs(u[p, 0]), abs(u[p, 1]), abs(u[p, 2])) > 1e-12 * scale:
            nodes[kept] = nodes[p]
            u[kept, 0], u[kept, 1], u[kept, 2] = u[p, 0], u[p, 1], u[p, 2]
            kept += 1
    return kept


@kernel
def _mark_active(tets: Ints, B: Floats, parent: Ints, weight: Floats, is_active: NDArray[np.bool_]) -> int:
    """Mark the elements that have a pair; returns the number of pairs."""
    nodes = np.empty(4 * parent.shape[1], np.int32)
    u = np.empty((4 * parent.shape[1], 3))
    pairs = 0
    for e in range(len(tets)):
        n = element_pairs(e, tets, B, parent, weight, nodes, u)
        is_active[e] = n > 0
        pairs += n
    return pairs


@kernel
def _count_pairs(tets: Ints, B: Floats, parent: Ints, weight: Floats, active: Ints, count: Longs) -> None:
    """count[i + 1] = pairs of node i."""
    nodes = np.empty(4 * parent.shape[1], np.int32)
    u = np.empty((4 * parent.shape[1], 3))
    for k in range(len(active)):
        n = element_pairs(active[k], tets, B, parent, weight, nodes, u)
        for p in range(n):
            count[nodes[p] + 1] += 1


@kernel
def _fill_pairs(
    tets: Ints,
    B: Floats,
    parent: Ints,
    weight: Floats,
    at: Longs,
    active: Ints,
    element: Ints,
    u_out: Floats,
) -> None:
    nodes = np.empty(4 * parent.shape[1], np.int32)
    u = np.empty((4 * parent.shape[1], 3))
    for k in range(len(active)):
        n = element_pairs(active[k], tets, B, parent, weight, nodes, u)
        for p in range(n):
            j = at[nodes[p]]
            element[j] = k
            u_out[j, 0], u_out[j, 1], u_out[j, 2] = u[p, 0], u[p, 1], u[p, 2]
            at[nodes[p]] = j + 1
