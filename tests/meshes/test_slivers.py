# SPDX-License-Identifier: BSD-3-Clause
"""Planted slivers.

1. One vertex in a hundred has tetrahedra of the angle that was asked for, and none has a smaller one; all volumes are
   positive and add up to the same, and the surface stays where it is.
2. The same mesh every time, and vertices without slivers stay.
3. A mesh without vertices inside, and one that is worse already, are refused.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.errors import InputError
from meshes.generators import beam, cube
from meshes.make import make_tets
from meshes.quality import shapes
from meshes.slivers import SHARE, with_slivers
from meshes.surface import boundary


@pytest.mark.parametrize("degrees", [5.0, 0.5, 0.01])
@pytest.mark.parametrize("make", [lambda: cube(1000), lambda: make_tets("rabbit", 1500).mesh], ids=["cube", "rabbit"])
def test_angles(make, degrees):
    mesh = make()
    bad = with_slivers(mesh, degrees)
    moved = np.flatnonzero((bad.points != mesh.points).any(axis=1))
    assert len(moved) == round(SHARE * len(mesh.points))
    smallest, _, volume = shapes(bad.points, bad.cells)
    assert (volume > 0.0).all()
    assert volume.sum(dtype=float) == pytest.approx(shapes(mesh.points, mesh.cells)[2].sum(dtype=float), rel=1e-5)
    for v in moved:
        star = (mesh.cells == v).any(axis=1)
        assert smallest[star].min() == pytest.approx(degrees, rel=1e-3)
    rest = ~np.isin(mesh.cells, moved).any(axis=1)
    assert (bad.points[mesh.cells[rest]] == mesh.points[mesh.cells[rest]]).all()
    assert not np.isin(moved, boundary(mesh.cells)).any()


def test_the_same_every_time():
    mesh = cube(500)
    np.testing.assert_array_equal(with_slivers(mesh, 1.0).points, with_slivers(mesh, 1.0).points)
    assert with_slivers(mesh, 1.0).content_hash != with_slivers(mesh, 2.0).content_hash


def test_refused():
    with pytest.raises(InputError, match="no vertex inside"):
        with_slivers(beam((3, 1, 1)), 1.0)
    mesh = cube(500)
    with pytest.raises(InputError, match="asked for"):
        with_slivers(mesh, 80.0)
