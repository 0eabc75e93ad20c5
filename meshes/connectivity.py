# SPDX-License-Identifier: BSD-3-Clause
"""Which cells meet at a vertex, and which vertices hang together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel

Indices = NDArray[np.int32]


def vertex_bound(cells: Indices) -> int:
    """Highest vertex index plus one; 0 for no cells."""
    return int(cells.max(initial=-1)) + 1


@kernel
def vertex_cells(cells: Indices, n_vertices: int) -> tuple[NDArray[np.int64], Indices]:
    """Cells around each vertex in compressed rows: those of vertex v are cell[start[v]:start[v+1]], ascending."""
    start = np.zeros(n_vertices + 1, np.int64)
    for e in range(cells.shape[0]):
        for k in range(cells.shape[1]):
            start[cells[e, k] + 1] += 1
    for v in range(n_vertices):
        start[v + 1] += start[v]
    cell = np.empty(start[n_vertices], np.int32)
    cursor = start.copy()
    for e in range(cells.shape[0]):
        for k in range(cells.shape[1]):
            v = cells[e, k]
            cell[cursor[v]] = e
            cursor[v] += 1
    return start, cell


def cell_edges(cells: Indices, n_vertices: int) -> Indices:
    """Edges between vertices of a cell, each once: lower vertex first and ascending, shape [n_edges, 2]."""
    start, cell = vertex_cells(cells, n_vertices)
    edges = np.empty((_find_edges(cells, start, cell, np.empty((0, 2), np.int32)), 2), np.int32)
    _find_edges(cells, start, cell, edges)
    return edges


@kernel
def _find_edges(cells: Indices, start: NDArray[np.int64], cell: Indices, edges: Indices) -> int:
    """Number of edges, written to `edges` as far as there is room."""
    n_vertices = len(start) - 1
    last = np.full(n_vertices, -1, np.int32)
    n = 0
    for v in range(n_vertices):
        for j in range(start[v], start[v + 1]):
            for k in range(cells.shape[1]):
                w = cells[cell[j], k]
                if w > v and last[w] != v:
                    last[w] = v
                    if n < len(edges):
                        edges[n, 0], edges[n, 1] = v, w
                    n += 1
    return n


def component_labels(cells: Indices, group: Indices | None = None) -> Indices:
    """Lowest vertex of the component that each vertex belongs to.

    Parameters
    ----------
    cells : Vertex indices, any number per cell, shape [n_cells, k].
    group : Vertices hang together only within their group, shape [n_vertices]; those of a negative group with none.
        None puts all in one group.

    Returns
    -------
    Label of each vertex, shape [n_vertices], or [`vertex_bound`] without groups.
    """
    if group is None:
        group = np.zeros(vertex_bound(cells), np.int32)
    parent = np.arange(len(group), dtype=np.int32)
    _component_labels(cells, group, parent)
    return parent


@kernel
def _component_labels(cells: Indices, group: Indices, parent: Indices) -> None:
    for e in range(cells.shape[0]):
        for i in range(1, cells.shape[1]):
            for j in range(i):
                a, b = cells[e, i], cells[e, j]
                if group[a] != group[b] or group[a] < 0:
                    continue
                while parent[a] != a:
                    parent[a] = parent[parent[a]]
                    a = parent[a]
                while parent[b] != b:
                    parent[b] = parent[parent[b]]
                    b = parent[b]
                parent[max(a, b)] = min(a, b)
    # A parent is never above its child, so one ascending sweep leads every vertex to its root.
    for v in range(len(parent)):
        parent[v] = parent[parent[v]]
