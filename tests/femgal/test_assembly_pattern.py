# SPDX-License-Identifier: BSD-3-Clause
"""Patterns of assembled matrices.

1. The blocks of a vertex are itself and its free neighbours, ascending, found here edge by edge.
2. The diagonal is where it says.
3. A vertex that no element holds but its own, with all others constrained, has one block.
"""

from __future__ import annotations

import numpy as np

from femgal.assembly.pattern import vertex_pattern
from meshes.connectivity import cell_edges
from verify.problems.bodies import distorted_box, left_end, uniform

MESH = distorted_box((6, 4, 3))


def test_neighbours():
    disc = uniform(MESH, left_end(MESH, 0.15))
    number = np.cumsum(disc.free) - 1
    neighbours = [{i} for i in range(int(disc.free.sum()))]
    for v, w in cell_edges(MESH.cells, disc.n_vertices):
        if disc.free[v] and disc.free[w]:
            neighbours[number[v]].add(int(number[w]))
            neighbours[number[w]].add(int(number[v]))
    pattern = vertex_pattern(disc)
    assert pattern.n_rows == len(neighbours)
    assert pattern.n_blocks == sum(map(len, neighbours))
    for i, own in enumerate(neighbours):
        assert pattern.column[pattern.ptr[i] : pattern.ptr[i + 1]].tolist() == sorted(own)
    np.testing.assert_array_equal(pattern.column[pattern.diagonal], np.arange(pattern.n_rows))


def test_one_free_vertex():
    pattern = vertex_pattern(uniform(MESH, np.arange(1, len(MESH.points))))
    assert (pattern.n_rows, pattern.n_blocks) == (1, 1)
