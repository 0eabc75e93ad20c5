# SPDX-License-Identifier: BSD-3-Clause
"""Sparse transfer operators of the reference.

1. The prolongation moves each vertex by the sum of its weights times its nodes, and nothing that is constrained.
2. diagonal_blocks and block_diagonal are inverse to each other; unpacked agrees with a symmetric matrix by hand.
3. The Galerkin product of the mass matrix with a constant layer holds the masses of its clusters.
"""

from __future__ import annotations

import numpy as np

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from verify.problems.bodies import distorted_box, left_end, linear_layer, rng, varied
from verify.reference.transfer import block_diagonal, diagonal_blocks, galerkin, mass_matrix, prolongation, unpacked

MESH = distorted_box((5, 3, 3))
DISC = varied(MESH, left_end(MESH))


def test_prolongation():
    layer = linear_layer(DISC)
    dx = rng(311).standard_normal((layer.n_nodes, 3))
    moved = (prolongation(layer) @ dx.ravel()).reshape(-1, 3)
    for v in range(DISC.n_vertices):
        pairs = zip(layer.parent[v], layer.weight[v], strict=True)
        expected = sum((w * dx[i] for i, w in pairs if i >= 0), np.zeros(3))
        np.testing.assert_allclose(moved[v], expected, atol=1e-14)
    assert (moved[~DISC.free] == 0.0).all()


def test_blocks():
    blocks = rng(312).standard_normal((4, 3, 3))
    np.testing.assert_array_equal(diagonal_blocks(block_diagonal(blocks)), blocks)
    packed = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]])
    np.testing.assert_array_equal(unpacked(packed)[0], [[1, 2, 3], [2, 4, 5], [3, 5, 6]])


def test_masses_of_clusters():
    layer = build_constant_hierarchy(DISC, 8).layers[1]
    coarse = galerkin(prolongation(layer), mass_matrix(DISC.mass))
    node = layer.parent[:, 0]
    expected = np.bincount(node[node >= 0], DISC.mass[node >= 0], layer.n_nodes)
    np.testing.assert_allclose(coarse.diagonal().reshape(-1, 3), np.tile(expected[:, None], 3), rtol=1e-13)
    assert abs(coarse).sum() == np.float64(abs(coarse.diagonal()).sum())
