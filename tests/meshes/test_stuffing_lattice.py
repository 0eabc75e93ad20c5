# SPDX-License-Identifier: BSD-3-Clause
"""The body-centred cubic lattice.

1. Steps lead from a point to the point one direction further, and back, on both sublattices.
2. The twelve tetrahedra of each centre tile space: each has volume h^3 / 12, and with their translates every face of
   an inner cell belongs to two.
3. A block covers its surface with a margin; one too large for 32-bit numbers is refused.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.errors import MeshError
from meshes.stuffing.lattice import CELL, DIRECTIONS, EDGES, Lattice

LATTICE = Lattice(np.zeros(3), 0.5, (5, 6, 7))


def half_steps(number: int) -> np.ndarray:
    _, ny, nz = LATTICE.shape
    s, column = number & 1, number >> 1
    return 2 * np.array([column // nz // ny, column // nz % ny, column % nz]) + s


@pytest.mark.parametrize("start", [2 * ((2 * 6 + 3) * 7 + 3), 2 * ((2 * 6 + 3) * 7 + 3) + 1])
def test_steps_follow_directions(start):
    for way, direction in enumerate(np.vstack([DIRECTIONS, -DIRECTIONS])):
        neighbour = start + LATTICE.steps[start & 1, way]
        np.testing.assert_array_equal(half_steps(neighbour) - half_steps(start), direction)
        assert neighbour + LATTICE.steps[neighbour & 1, (way + 7) % 14] == start


def test_numbers_of_tetrahedra_are_their_places():
    centre = 2 * ((2 * 6 + 3) * 7 + 3) + 1
    for numbers, places in zip(LATTICE.tetrahedra, CELL, strict=True):
        for number, place in zip(numbers, places, strict=True):
            np.testing.assert_array_equal(half_steps(centre + number) - half_steps(centre), place)


def test_long_edges_come_first_and_ascend():
    for cell in CELL:
        lengths = [np.linalg.norm(cell[q] - cell[p]) for p, q in EDGES]
        np.testing.assert_allclose(lengths, [2, 3**0.5, 3**0.5, 3**0.5, 3**0.5, 2])
        assert (cell[1] - cell[0]).sum() == (cell[3] - cell[2]).sum() == 2


def test_tetrahedra_tile_space():
    volumes = [abs(np.linalg.det(cell[1:] - cell[0])) / 6 for cell in CELL]
    np.testing.assert_allclose(volumes, 8 / 12)
    shifts = 2 * np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 1, 1, 3)
    tets = (CELL[None] + shifts).reshape(-1, 4, 3) + 8
    keys = tets @ np.array([10000, 100, 1])
    faces = np.sort(keys[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    unique, counts = np.unique(faces, axis=0, return_counts=True)
    assert counts.max() == 2
    x = np.stack([unique // 10000, unique // 100 % 100, unique % 100], -1)
    inner = ((x >= 10) & (x <= 12)).all(axis=(1, 2))
    assert inner.sum() >= 12
    assert (counts[inner] == 2).all()


def test_block_has_a_margin():
    points = np.random.default_rng(77_003).normal(size=(50, 3))
    for attempt in range(3):
        lattice = Lattice.around(points, 0.3, attempt)
        cells = (points - lattice.origin) / lattice.spacing
        assert cells.min() >= 2
        assert (np.array(lattice.shape) - cells.max(axis=0)).min() >= 3
    assert lattice.size == 2 * np.prod(lattice.shape)


def test_too_large_a_block_is_refused():
    with pytest.raises(MeshError, match="too many lattice points"):
        Lattice.around(np.array([[0, 0, 0], [1, 1, 1]], float), 1e-4)
