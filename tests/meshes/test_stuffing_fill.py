# SPDX-License-Identifier: BSD-3-Clause
"""Warping and filling.

1. For random signs and random cuts on every edge (rougher than any surface) the filling is conforming, positive, has
   the counted number of vertices, each used, and keeps the angle bound.
2. Every moved point sits within ALPHA of its place, and no cut closer than ALPHA to a kept point remains.
3. Warping outside points first leaves no violated point.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.quality import dihedrals
from meshes.stuffing.fill import INTERIOR, Filling, fill
from meshes.stuffing.lattice import Lattice
from meshes.stuffing.signs import Sample
from meshes.stuffing.stencils import ALPHA
from meshes.stuffing.warp import Warped, warp
from meshes.types import signed_volumes

SHAPE = (12, 11, 10)


def random_sample(seed: int, inside: float, focus: float) -> Sample:
    """Signs and cuts without any surface behind them; the larger the focus, the nearer the middle are the cuts."""
    rng = np.random.default_rng(seed)
    lattice = Lattice(np.zeros(3), 1.0, SHAPE)
    i, j, k = np.unravel_index(np.arange(lattice.size) >> 1, SHAPE)
    inner = np.all([(x >= 2) & (x < n - 3) for x, n in zip((i, j, k), SHAPE, strict=True)], axis=0)
    sign = np.where(inner & (rng.random(lattice.size) < inside), 1, -1).astype(np.int8)
    near = np.flatnonzero(np.all([(x >= 1) & (x < n - 1) for x, n in zip((i, j, k), SHAPE, strict=True)], axis=0))
    slot = np.full(lattice.size, -1, np.int32)
    slot[near] = np.arange(len(near))
    cut = rng.beta(focus, focus, (len(near), 7))
    face = np.zeros((len(near), 7), np.int32)
    thin = np.empty(0, np.float32)
    return Sample(lattice, sign, near.astype(np.int32), slot, cut, face, int((sign > 0).sum()), thin, 0.0, 0, 0)


def filled(seed: int, inside: float, focus: float) -> tuple[Sample, Warped, Filling]:
    found = random_sample(seed, inside, focus)
    warped = warp(found)
    return found, warped, fill(found, warped)


@pytest.mark.parametrize(
    ("seed", "inside", "focus"), [(30_011, 0.1, 100), (30_013, 0.5, 20), (30_029, 0.5, 100), (30_059, 0.9, 1)]
)
def test_random_fillings_are_sound(seed, inside, focus):
    _, warped, filling = filled(seed, inside, focus)
    assert len(filling.cells) > 200
    assert signed_volumes(filling.points, filling.cells).min() > 0
    assert len(np.unique(filling.cells)) == len(filling.points) == warped.vertices
    found = dihedrals(filling.points, filling.cells)
    assert found.minimum > 9.2
    assert found.maximum < 161.7
    faces = np.sort(filling.cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    unique, counts = np.unique(faces, axis=0, return_counts=True)
    assert counts.max() == 2
    assert (filling.face[unique[counts == 1]] != INTERIOR).all()


def test_no_violated_point_remains():
    found, warped, _ = filled(30_047, 0.5, 4)
    p = found.near
    q = p[:, None] + found.lattice.steps[p & 1, :7]
    between = found.sign[p][:, None] * found.sign[q] < 0
    least, cut = np.broadcast_to(ALPHA, between.shape)[between], found.cut[between]
    assert len(cut) > 20
    assert (cut >= least).all()
    assert (1.0 - cut >= least).all()
    assert ((warped.way >= 0) == (found.sign[p] == 0)).all()
    assert (warped.way >= 0).sum() > 100
