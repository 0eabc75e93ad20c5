# SPDX-License-Identifier: BSD-3-Clause
"""Chains of lattices.

1. Lattices are nested: over two of them a node moves the vertices by the hat function of its own lattice, and a finer
   node has two parents at most.
2. Positions of the vertices follow from those of the nodes, of the nodes from those of the coarser ones: linear
   functions are reproduced, rotations among them.
3. Weights sum to one on every level, each level has at most 0.7 of the nodes of the finer one, the last has few.
4. Bodies that do not touch stay apart on every level; the chain ends though it cannot reach few nodes.
5. A mesh of few vertices needs no lattice.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from femgal.assembly.lattices import lattice_chain
from femgal.assembly.pattern import vertex_pattern
from femgal.assembly.transfer import LIGHTEST_NODE
from femgal.hierarchy.lattice import LatticeNodes, lattice_nodes
from meshes.connectivity import cell_edges, component_labels
from meshes.types import TetMesh
from verify.problems.bodies import distorted_box, left_end, uniform

MESH = distorted_box((10, 7, 7))
ORIGIN = MESH.points.mean(axis=0)


def sparse(nodes: LatticeNodes) -> sp.csr_matrix:
    row, k = np.nonzero(nodes.parent >= 0)
    shape = (len(nodes.parent), len(nodes.position))
    return sp.csr_matrix((nodes.weight[row, k], (row, nodes.parent[row, k])), shape=shape)


def two_lattices() -> tuple[LatticeNodes, LatticeNodes]:
    """Two lattices that leave no node out, the second over the first."""
    edges = cell_edges(MESH.cells, len(MESH.points))
    fine = lattice_nodes(MESH.points, np.ones(len(MESH.points), bool), edges, 0.2, ORIGIN, 0.0)
    P = sparse(fine)
    G = sp.csr_matrix((np.ones(len(edges)), edges.T), shape=(P.shape[0], P.shape[0]))
    pairs = np.stack((P.T @ G @ P).nonzero(), axis=1).astype(np.int32)
    return fine, lattice_nodes(fine.position, np.ones(P.shape[1], bool), pairs, 0.4, ORIGIN, 0.0)


def test_nested():
    fine, coarse = two_lattices()
    edges = cell_edges(MESH.cells, len(MESH.points))
    direct = lattice_nodes(MESH.points, np.ones(len(MESH.points), bool), edges, 0.4, ORIGIN, 0.0)
    assert (coarse.parent >= 0).sum(axis=1).max() == 2
    # Where two lattices number the same points differently, a place tells which is which.
    order = [np.lexsort(np.round(nodes.position / 0.2).T) for nodes in (coarse, direct)]
    np.testing.assert_allclose(coarse.position[order[0]], direct.position[order[1]], rtol=0, atol=1e-12)
    through = (sparse(fine) @ sparse(coarse)).toarray()[:, order[0]]
    np.testing.assert_allclose(through, sparse(direct).toarray()[:, order[1]], rtol=0, atol=1e-8)


def test_reproduces_linear_functions():
    fine, coarse = two_lattices()
    np.testing.assert_allclose(sparse(fine) @ fine.position, MESH.points, rtol=0, atol=1e-8)
    np.testing.assert_allclose(sparse(coarse) @ coarse.position, fine.position, rtol=0, atol=1e-8)


def test_chain():
    disc = uniform(MESH, left_end(MESH))
    pattern = vertex_pattern(disc)
    chain = lattice_chain(disc, pattern, 20)
    assert len(chain) >= 2
    assert chain[-1].transfer.n_coarse <= 20
    n_fine = pattern.n_rows
    for product in chain:
        t = product.transfer
        assert t.n_fine == n_fine
        assert t.n_coarse == product.pattern.n_rows <= 0.7 * n_fine
        np.testing.assert_allclose(t.weight.sum(axis=1), 1.0, rtol=0, atol=1e-6)
        carried = np.bincount(t.parent[t.parent >= 0], weights=t.weight[t.parent >= 0])
        heaviest = np.isin(np.arange(t.n_coarse), t.parent[:, 0])
        assert (heaviest | (carried >= LIGHTEST_NODE)).all()
        n_fine = t.n_coarse


def test_bodies_stay_apart():
    one = distorted_box((2, 2, 2))
    shifts = 0.5 * np.stack(np.meshgrid(*3 * [np.arange(3.0)]), axis=-1).reshape(-1, 3)
    n = len(one.points)
    points = np.concatenate([one.points + shift for shift in shifts])
    cells = np.concatenate([one.cells + k * n for k in range(len(shifts))])
    disc = uniform(TetMesh(points, cells))
    chain = lattice_chain(disc, vertex_pattern(disc), 10)
    body = component_labels(disc.mesh.cells) // n
    for product in chain:
        t = product.transfer
        owners = [np.unique(body[t.child[t.child_ptr[i] : t.child_ptr[i + 1]]]) for i in range(t.n_coarse)]
        assert {len(own) for own in owners} == {1}
        body = np.concatenate(owners)
    assert chain[-1].transfer.n_coarse >= len(shifts)


def test_few_vertices():
    disc = uniform(distorted_box((2, 1, 1)))
    assert lattice_chain(disc, vertex_pattern(disc), 20) == []
