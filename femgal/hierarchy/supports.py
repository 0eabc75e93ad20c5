# SPDX-License-Identifier: BSD-3-Clause
"""The connected parts of what each node moves.

A lattice knows nothing of the body: one of its nodes may reach into both ears of a bunny. Moved as one, the ears would
hang together on that layer. So each connected part of a node's support becomes a node of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel

Ints = NDArray[np.int32]


def support_parts(edges: Ints, node: NDArray[np.integer]) -> tuple[Ints, NDArray[np.int64]]:
    """Number the connected parts of all supports.

    Two vertices of one node's support hang together when a path of edges leads from one to the other within it.

    Parameters
    ----------
    edges : Edges of the mesh, shape [n_edges, 2].
    node : Nodes that move each vertex, shape [n, p]; any non-negative numbers, negative for none. Numbers are only
        compared along edges.

    Returns
    -------
    part : Part instead of node, numbered by the lowest vertex it moves, shape [n, p]; -1 for none.
    first : Position in node.ravel() at which each part is met first, ascending, shape [n_parts].
    """
    part = np.arange(node.size, dtype=np.int32).reshape(node.shape)
    _join(edges, node, part.reshape(-1))
    part[node < 0] = -1
    first = np.flatnonzero(part.ravel() == np.arange(node.size))
    _renumber(part.reshape(-1))
    return part, first


@kernel
def _join(edges: Ints, node: NDArray[np.integer], parent: Ints) -> None:
    """Union-find over the (vertex, node) incidences p v + s; afterwards parent is the lowest of each part."""
    p = node.shape[1]
    for e in range(len(edges)):
        v, w = np.int64(edges[e, 0]), np.int64(edges[e, 1])
        for s in range(p):
            for t in range(p):
                if node[v, s] != node[w, t] or node[v, s] < 0:
                    continue
                a, b = p * v + s, p * w + t
                while parent[a] != a:
                    parent[a] = parent[parent[a]]
                    a = np.int64(parent[a])
                while parent[b] != b:
                    parent[b] = parent[parent[b]]
                    b = np.int64(parent[b])
                parent[max(a, b)] = min(a, b)
    # A parent is never above its child, so one ascending sweep leads every incidence to its root.
    for i in range(len(parent)):
        parent[i] = parent[parent[i]]


@kernel
def _renumber(part: Ints) -> None:
    """Replace each root by its rank among the roots, in place: a root is met before all that lead to it."""
    n = 0
    for i in range(len(part)):
        if part[i] == i:
            part[i] = n
            n += 1
        elif part[i] >= 0:
            part[i] = part[part[i]]
