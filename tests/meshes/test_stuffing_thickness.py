# SPDX-License-Identifier: BSD-3-Clause
"""Thin parts of a body.

1. On a plate of known thickness all inside points are found, no thicker than the plate's shortest lattice chord.
2. A thick ball has next to none.
3. The spacing that should suffice resolves the plate, and falls with the square root of the loss for a smooth body.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.generators import box, icosphere
from meshes.stuffing.lattice import Lattice
from meshes.stuffing.signs import sample
from meshes.stuffing.thickness import WALL_NEEDS, share_below, sufficient_spacing
from meshes.surface import boundary
from meshes.types import TriMesh


def plate(thickness: float) -> TriMesh:
    mesh = box((2.0, 2.0, thickness), (4, 4, 1))
    return TriMesh(mesh.points, boundary(mesh.cells))


def test_plate():
    surface = plate(0.06)
    found = sample(surface, Lattice.around(surface.points, 0.1))
    assert share_below(found.thin, found.inside, 0.601) > 0.95
    assert share_below(found.thin, found.inside, 0.5) < 0.1
    # 60% of the spacing: the lattice must become finer by 1.4 / 0.6.
    assert sufficient_spacing(found.thin, found.inside, 0.5) == pytest.approx(0.6 / WALL_NEEDS, rel=0.2)


def test_ball():
    ball = icosphere(4, radius=1.0)
    found = sample(ball, Lattice.around(ball.points, 0.1))
    assert share_below(found.thin, found.inside, 0.75) < 0.005
    assert sufficient_spacing(found.thin, found.inside, 0.04) == pytest.approx(0.5, rel=1e-12)
    assert (np.diff(found.thin) >= 0).all()
