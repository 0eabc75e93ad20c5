# SPDX-License-Identifier: BSD-3-Clause
"""Morton ordering.

1. On a power-of-two lattice the order is that of the interleaved bits, x lowest.
2. The result is a permutation; equal points keep their order; flat, single and empty sets work.
3. Reordering changes numbers only: geometry, orientation and regions follow the returned permutations.
4. Vertices of a tetrahedron come close in memory.
5. A million points take a fraction of a second.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from meshes.generators import cube
from meshes.ordering import morton_order, reorder

SEED = 987654321


def interleaved(i: int, j: int, k: int) -> int:
    return sum(
        (((i >> b) & 1) << 3 * b) | (((j >> b) & 1) << 3 * b + 1) | (((k >> b) & 1) << 3 * b + 2) for b in range(4)
    )


def test_order_on_a_lattice_is_that_of_interleaved_bits():
    grid = np.stack(np.meshgrid(*[np.arange(16)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    expected = sorted(range(len(grid)), key=lambda row: interleaved(*grid[row].tolist()))
    np.testing.assert_array_equal(morton_order(grid + 0.0), expected)


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_order_is_a_permutation_at_any_scale(scale):
    points = scale * (np.random.default_rng(SEED).random((5000, 3)) - 0.5)
    order = morton_order(points)
    np.testing.assert_array_equal(np.sort(order), np.arange(5000))
    np.testing.assert_array_equal(order, morton_order(points / scale))


def test_degenerate_sets():
    assert morton_order(np.empty((0, 3))).shape == (0,)
    np.testing.assert_array_equal(morton_order(np.ones((7, 3))), np.arange(7))
    line = np.zeros((9, 3))
    line[:, 1] = np.arange(9)[::-1]
    np.testing.assert_array_equal(morton_order(line), np.arange(9)[::-1])


def test_reorder_only_renumbers():
    mesh = cube(1000, jitter=0.1)
    shuffle = np.random.default_rng(SEED).permutation(len(mesh.cells))
    mesh = replace(mesh, cells=mesh.cells[shuffle], regions=(np.arange(len(mesh.cells)) % 5).astype(np.int32))
    ordered, vertices, cells = reorder(mesh)
    np.testing.assert_array_equal(ordered.points, mesh.points[vertices])
    np.testing.assert_array_equal(vertices[ordered.cells], mesh.cells[cells])
    np.testing.assert_array_equal(ordered.regions, mesh.regions[cells])
    np.testing.assert_array_equal(ordered.volumes, mesh.volumes[cells])
    assert ordered.origin == mesh.origin
    again, _, _ = reorder(ordered)
    assert again.content_hash == ordered.content_hash


def test_reorder_brings_neighbours_together():
    mesh = cube(20_000)
    shuffle = np.random.default_rng(SEED).permutation(len(mesh.points))
    where = np.argsort(shuffle).astype(np.int32)
    random = replace(mesh, points=mesh.points[shuffle], cells=where[mesh.cells])
    ordered, _, _ = reorder(random)

    def span(cells: np.ndarray) -> float:
        return float(np.median(cells.max(axis=1) - cells.min(axis=1)))

    assert span(random.cells) > 0.4 * len(mesh.points)
    assert span(ordered.cells) < 0.02 * len(mesh.points)
    # Cells as well: consecutive ones share vertices.
    assert np.median(np.abs(np.diff(ordered.cells[:, 0].astype(int)))) < 50


def test_a_million_points_in_a_fraction_of_a_second():
    points = np.random.default_rng(SEED).random((1_000_000, 3))
    morton_order(points[:10])
    start = time.process_time()
    morton_order(points)
    assert time.process_time() - start < 1.0
