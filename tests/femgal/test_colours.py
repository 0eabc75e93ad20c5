# SPDX-License-Identifier: BSD-3-Clause
"""Colours of vertices.

1. Every free vertex has one colour, no constrained one has any, and no tetrahedron holds a colour twice.
2. Within a colour vertices ascend; the colours of a row of beads are two; a body held everywhere has none.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.gauss_seidel.colours import colour_vertices
from meshes.connectivity import cell_edges
from verify.problems.bodies import body, distorted_box, left_end, uniform

MESH = distorted_box((5, 4, 3))


@pytest.mark.parametrize(
    "disc", [uniform(MESH), uniform(MESH, left_end(MESH)), body("rabbit")], ids=["free", "held", "rabbit"]
)
def test_no_tetrahedron_holds_a_colour_twice(disc):
    colouring = colour_vertices(disc)
    np.testing.assert_array_equal(np.sort(colouring.vertex), np.flatnonzero(disc.free))
    colour = np.full(disc.n_vertices, -1)
    for c, (first, count) in enumerate(colouring.ranges):
        own = colouring.vertex[first : first + count]
        assert count > 0
        assert (np.diff(own) > 0).all()
        colour[own] = c
    i, j = cell_edges(disc.mesh.cells, disc.n_vertices).T
    both = disc.free[i] & disc.free[j]
    assert (colour[i] != colour[j])[both].all()
    assert 4 <= colouring.n_colours <= 16


def test_nothing_free():
    assert colour_vertices(uniform(MESH, np.arange(len(MESH.points)))).ranges == ()
