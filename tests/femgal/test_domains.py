# SPDX-License-Identifier: BSD-3-Clause
"""Domains of an additive Schwarz preconditioner.

1. On every level each node is in one domain, and the domains are the nodes of the next; maps agree with each other.
2. Domains are connected through free vertices and have about the size asked for.
3. Levels end where every connected part is one domain: one for a body, one for each of two bodies, and a body that the
   constraint cuts in two counts as two.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from femgal.schwarz.domains import build_levels
from meshes.connectivity import component_labels
from meshes.types import TetMesh
from verify.problems.bodies import distorted_box, left_end, uniform

MESH = distorted_box((10, 5, 5))
X = MESH.points
HELD = uniform(MESH, left_end(MESH))
CUT = uniform(MESH, np.flatnonzero(np.abs(X[:, 0] - 0.5) < 0.08))
TWO = uniform(TetMesh(np.concatenate((X, X + 5.0)), np.concatenate((MESH.cells, MESH.cells + len(X)))))
SMALL = uniform(distorted_box((1, 1, 1)))


@pytest.mark.parametrize("size", [8, 32])
@pytest.mark.parametrize("disc", [HELD, CUT, TWO], ids=["held", "cut", "two"])
def test_levels_are_nested(disc, size):
    levels = build_levels(disc, size)
    n_free = int(disc.free.sum())
    np.testing.assert_array_equal(levels[0].node_of, np.arange(n_free))
    for level in levels:
        np.testing.assert_array_equal(np.sort(level.node), np.arange(len(level.domain)))
        np.testing.assert_array_equal(np.sort(level.row), np.arange(n_free))
        for d in range(level.n_domains):
            nodes = level.node[level.ptr[d] : level.ptr[d + 1]]
            assert (np.diff(nodes) > 0).all()
            assert (level.domain[nodes] == d).all()
            np.testing.assert_array_equal(level.place[nodes], np.arange(len(nodes)))
            rows = level.row[level.row_ptr[d] : level.row_ptr[d + 1]]
            assert (level.domain[level.node_of[rows]] == d).all()
    for fine, coarse in pairwise(levels):
        assert len(coarse.domain) == fine.n_domains
        np.testing.assert_array_equal(coarse.node_of, fine.domain[fine.node_of])


@pytest.mark.parametrize("disc", [HELD, CUT, TWO], ids=["held", "cut", "two"])
def test_domains_are_connected_and_of_even_size(disc):
    levels = build_levels(disc, 8)
    assert 6.0 < levels[0].sizes.mean() < 10.0
    for level in levels:
        assert level.sizes.max() <= 18
        group = np.full(disc.n_vertices, -1, np.int32)
        group[disc.free] = level.domain[level.node_of]
        roots = component_labels(disc.mesh.cells, group)[disc.free]
        assert len(np.unique(roots)) == level.n_domains


@pytest.mark.parametrize(
    ("disc", "parts"), [(HELD, 1), (CUT, 2), (TWO, 2), (SMALL, 1)], ids=["held", "cut", "two", "small"]
)
def test_levels_end_with_the_parts(disc, parts):
    levels = build_levels(disc, 8)
    assert levels[-1].n_domains == parts
    assert [level.n_domains for level in levels] == sorted({level.n_domains for level in levels}, reverse=True)


def test_vertices_that_nothing_joins():
    # One free vertex in a body that is held everywhere else.
    (level,) = build_levels(uniform(MESH, np.arange(1, len(X))), 32)
    assert level.n_domains == 1
