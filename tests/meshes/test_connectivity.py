# SPDX-License-Identifier: BSD-3-Clause
"""Connectivity of cells.

1. vertex_cells lists the cells around each vertex, ascending, also for vertices without any.
2. component_labels gives the lowest vertex of each component, as a search over the graph does.
3. With groups, vertices hang together only within theirs, and those of a negative group with none.
4. No cells give no vertices, no labels and no edges.
5. cell_edges lists every pair of vertices of a cell once, in ascending order.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from meshes.connectivity import cell_edges, component_labels, vertex_bound, vertex_cells
from meshes.generators import box

SEED = 73_939_133


def reference_labels(cells, group):
    """Lowest vertex of each component of the graph whose edges join vertices of one cell and one group."""
    edges = np.concatenate([cells[:, [i, j]] for i in range(cells.shape[1]) for j in range(i)])
    edges = edges[(group[edges[:, 0]] == group[edges[:, 1]]) & (group[edges[:, 0]] >= 0)]
    n = len(group)
    _, label = connected_components(coo_matrix((np.ones(len(edges)), edges.T), shape=(n, n)), directed=False)
    lowest = np.full(n, n)
    np.minimum.at(lowest, label, np.arange(n))
    return lowest[label]


def test_vertex_cells():
    cells = np.array([[0, 1, 2, 4], [2, 1, 4, 5], [5, 6, 0, 1]], np.int32)
    start, cell = vertex_cells(cells, 8)
    for v in range(8):
        np.testing.assert_array_equal(cell[start[v] : start[v + 1]], np.flatnonzero((cells == v).any(axis=1)))


@pytest.mark.parametrize("width", [2, 3, 4])
def test_component_labels_of_random_cells(width):
    cells = np.random.default_rng(SEED + width).integers(0, 400, (90, width)).astype(np.int32)
    group = np.zeros(int(cells.max()) + 1, np.int32)
    np.testing.assert_array_equal(component_labels(cells), reference_labels(cells, group))


@pytest.mark.parametrize("groups", [1, 2, 7])
def test_groups_do_not_hang_together(groups):
    mesh = box((1.0, 1.0, 1.0), (5, 4, 3))
    group = np.random.default_rng(SEED).integers(-1, groups, len(mesh.points)).astype(np.int32)
    labels = component_labels(mesh.cells, group)
    np.testing.assert_array_equal(labels, reference_labels(mesh.cells, group))
    np.testing.assert_array_equal(labels[group < 0], np.flatnonzero(group < 0))


def test_no_cells():
    none = np.empty((0, 4), np.int32)
    assert vertex_bound(none) == 0
    assert len(component_labels(none)) == 0
    assert cell_edges(none, 5).shape == (0, 2)


@pytest.mark.parametrize("width", [2, 3, 4])
def test_cell_edges(width):
    random = np.random.default_rng(SEED + width)
    cells = np.stack([random.choice(60, width, replace=False) for _ in range(200)]).astype(np.int32)
    pairs = {tuple(sorted((int(c[i]), int(c[j])))) for c in cells for i in range(width) for j in range(i)}
    edges = cell_edges(cells, 60)
    assert edges.dtype == np.int32
    assert {tuple(edge) for edge in edges.tolist()} == pairs
    assert len(edges) == len(pairs)
    assert (np.diff(edges[:, 0]) >= 0).all()
    assert (edges[:, 0] < edges[:, 1]).all()
    assert vertex_bound(np.array([[3, 7, 5, 6]], np.int32)) == 8
