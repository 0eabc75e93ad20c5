# SPDX-License-Identifier: BSD-3-Clause
"""Domains on every level: connected sets of nodes, each of which is one node of the next level.

Level 0 has the free vertices as nodes. A node of a coarser level moves all vertices of its domain alike, so the spaces
are nested, unlike the clusters of `femgal.hierarchy`, which are built independently for each layer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.clusters import cluster_vertices

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class DomainLevel:
    """Domains of one level; k free vertices, n nodes, d domains.

    Parameters
    ----------
    ptr, node : Nodes of each domain, ascending: node[ptr[i] : ptr[i + 1]], shape [d + 1] and [n].
    domain : Domain of each node, which is its node on the next level, shape [n].
    row_ptr, row : Free vertices that each domain moves, ascending, shape [d + 1] and [k].
    node_of : Node of each free vertex, shape [k].
    place : Place of each node in its domain, shape [n].
    """

    ptr: Longs
    node: Ints
    domain: Ints
    row_ptr: Longs
    row: Ints
    node_of: Ints
    place: Ints

    @property
    def n_domains(self) -> int:
        """Number of domains."""
        return len(self.ptr) - 1

    @property
    def sizes(self) -> Longs:
        """Nodes of each domain, shape [d]."""
        return np.diff(self.ptr)


def build_levels(disc: Discretisation, size: int) -> tuple[DomainLevel, ...]:
    """Levels from fine to coarse, until every connected part of the free vertices is one domain.

    Parameters
    ----------
    disc : The discretised bodies.
    size : Nodes per domain aimed at; the largest have 1.7 times as many, or a few more.
    """
    n_free = int(disc.free.sum())
    row = np.where(disc.free, np.cumsum(disc.free) - 1, -1).astype(np.int32)
    node_of, centres = np.arange(n_free, dtype=np.int32), disc.mesh.points[disc.free]
    levels: list[DomainLevel] = []
    while len(cells := _coarse_cells(row, disc.mesh.cells, node_of)):
        domain, n_domains = cluster_vertices(centres, cells, np.ones(len(centres), np.bool_), size)
        if n_domains == len(centres):
            break
        levels.append(_level(domain, n_domains, node_of))
        count = np.bincount(domain, minlength=n_domains)[:, None]
        sums = [np.bincount(domain, centres[:, c], n_domains) for c in range(3)]
        centres, node_of = np.ascontiguousarray(np.stack(sums, axis=1) / count), domain[node_of]
    return tuple(levels) or (_level(np.arange(n_free, dtype=np.int32), n_free, node_of),)


def _level(domain: Ints, n_domains: int, node_of: Ints) -> DomainLevel:
    ptr, node = _members(domain, n_domains)
    place = np.empty(len(domain), np.int32)
    place[node] = np.arange(len(domain)) - np.repeat(ptr[:-1], np.diff(ptr))
    return DomainLevel(ptr, node, domain, *_members(domain[node_of], n_domains), node_of, place)


def _members(group: Ints, n_groups: int) -> tuple[Longs, Ints]:
    ptr = np.concatenate(([0], np.cumsum(np.bincount(group, minlength=n_groups)))).astype(np.int64)
    return ptr, np.argsort(group, kind="stable").astype(np.int32)


def _coarse_cells(row: Ints, cells: Ints, node_of: Ints) -> Ints:
    """The nodes that each tetrahedron joins, two or more of them, each set once; shape [any, 4]."""
    rows = row[cells]
    # A constrained vertex joins nothing: one of the free vertices stands in for it.
    rows = np.where(rows < 0, rows.max(axis=1, keepdims=True), rows)
    nodes = np.sort(node_of[rows[rows[:, 0] >= 0]], axis=1)
    return np.ascontiguousarray(np.unique(nodes[nodes[:, 0] < nodes[:, 3]], axis=0))
