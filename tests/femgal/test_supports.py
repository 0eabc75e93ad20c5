# SPDX-License-Identifier: BSD-3-Clause
"""Connected parts of the supports of nodes.

1. Two (vertex, node) incidences have one part exactly when a path within the node's support joins them, as a search
   over the graph of incidences finds; random graphs, several nodes per vertex, gaps between the slots.
2. Parts are numbered by the lowest vertex that they move, and `first` names the place where that is.
3. A slot without a node has no part; the numbers of nodes may be large and far apart.
4. Nodes that are connected already are renamed, no more.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from femgal.hierarchy.supports import support_parts
from meshes.connectivity import cell_edges
from meshes.generators import box
from verify.problems.bodies import rng


def reference_labels(edges: np.ndarray, node: np.ndarray) -> np.ndarray:
    """Number of the component of each incidence p v + s in the graph that joins equal nodes along edges."""
    n, p = node.shape
    joined = []
    for s in range(p):
        for t in range(p):
            same = (node[edges[:, 0], s] == node[edges[:, 1], t]) & (node[edges[:, 0], s] >= 0)
            joined.append(edges[same].astype(np.int64) * p + [s, t])
    i, j = np.concatenate(joined).T
    return connected_components(coo_matrix((np.ones(len(i)), (i, j)), shape=(n * p, n * p)), directed=False)[1]


@pytest.mark.parametrize("p", [1, 2, 4])
@pytest.mark.parametrize("n_nodes", [1, 7, 60])
def test_random_graphs(n_nodes, p):
    random = rng(300 + 10 * p + n_nodes)
    n = 300
    edges = np.sort(random.integers(0, n, (500, 2)).astype(np.int32), axis=1)
    edges = edges[edges[:, 0] < edges[:, 1]]
    names = random.choice(2**62, n_nodes + p, replace=False)
    node = np.stack([random.choice(names, p, replace=False) for _ in range(n)])
    node[random.random((n, p)) < 0.2] = -1
    part, first = support_parts(edges, node)

    held = node.ravel() >= 0
    np.testing.assert_array_equal(part.ravel() < 0, ~held)
    _, first_met, label = np.unique(reference_labels(edges, node)[held], return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first_met))
    np.testing.assert_array_equal(part.ravel()[held], rank[label])
    np.testing.assert_array_equal(first, np.flatnonzero(held)[np.sort(first_met)])


def test_connected_nodes_keep_their_vertices():
    mesh = box(cells=(6, 2, 2))
    node = (mesh.points[:, :1] > 0.5).astype(np.int32)
    part, first = support_parts(cell_edges(mesh.cells, len(mesh.points)), node)
    assert len(first) == 2
    assert len(np.unique(part[node == 0])) == len(np.unique(part[node == 1])) == 1
