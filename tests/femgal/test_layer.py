# SPDX-License-Identifier: BSD-3-Clause
"""Layers: the matrix-free blocks and gradients against assembled Galerkin products, and the transfer itself.

1. Blocks of every layer equal the diagonal blocks of P^T (M / h^2 + H) P with scikit-fem's exact Hessian H, to 1e-12 of
   each block's Frobenius norm: ratios 4, 8 and 32, every state, heterogeneous material, with and without constrained
   vertices, constant clusters as well as made-up weights with four nodes per vertex. No projection anywhere.
2. Gradients equal P^T (M (x - xhat) / h^2 + g) to 1e-12 of the largest single term.
3. Blocks are positive definite in every state, inverted ones included.
4. The elements left out of a constant layer are exactly those whose four vertices share one node or have none, so
   1 and 2, which assemble all elements, prove that those contribute nothing.
5. Prolongation equals the assembled matrix, restriction is its transpose, and constrained vertices never move.
6. Partition of unity: equal motion of all nodes moves all free vertices by as much.
7. Children are the transpose of parents; pairs are sorted by node, then by element.
8. u sums to zero over the nodes of an element without constrained vertices.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.hierarchy.layer import Layer, build_pairs
from femgal.kernels.plain.backend import PlainBackend
from verify.problems.bodies import STATES, distorted_box, force_scale, left_end, linear_layer, positions, rng, varied
from verify.reference.elasticity import AssembledElasticity
from verify.reference.transfer import diagonal_blocks, galerkin, mass_matrix, prolongation, unpacked

MESH = distorted_box()
H_STEP = 1.0 / 600.0
LAYERS = ("vertices", "clusters of 4", "clusters of 16", "clusters of 8", "clusters of 32", "made up")
CONSTRAINED = {"free": (), "face": left_end(MESH), "solid": left_end(MESH, 0.25)}


@cache
def body(constrained: str) -> Discretisation:
    return varied(MESH, CONSTRAINED[constrained])


@cache
def layer(constrained: str, name: str) -> Layer:
    if name == "made up":
        return linear_layer(body(constrained))
    ratios = {"vertices": 4, "clusters of 4": 4, "clusters of 16": 4, "clusters of 8": 8, "clusters of 32": 32}
    built = build_constant_hierarchy(body(constrained), ratios[name]).layers
    return next(one for one in built if one.name == name)


@cache
def assembled(state: str):
    elasticity = AssembledElasticity(MESH, body("free").mu, body("free").lam)
    x = positions(MESH, state)
    return elasticity.gradient(x), elasticity.hessian(x)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize("constrained", CONSTRAINED)
def test_blocks_and_gradients_equal_assembled(constrained, name, state):
    disc, one = body(constrained), layer(constrained, name)
    x, (elastic, hessian) = positions(MESH, state), assembled(state)
    xhat = x + 1e-3 * rng(20).standard_normal(x.shape)
    g, H = PlainBackend(disc, 1).gradient_and_blocks(one, x, xhat, 1.0 / H_STEP**2)

    P = prolongation(one)
    blocks = diagonal_blocks(galerkin(P, mass_matrix(disc.mass) / H_STEP**2 + hessian))
    error = np.linalg.norm(unpacked(H) - blocks, axis=(1, 2)) / np.linalg.norm(blocks, axis=(1, 2))
    assert error.max() <= 1e-12
    assert np.linalg.eigvalsh(unpacked(H)).min() > 0.0

    inertia = disc.mass[:, None] * (x - xhat) / H_STEP**2
    expected = (P.T @ (inertia + elastic).ravel()).reshape(-1, 3)
    assert np.abs(g - expected).max() <= 1e-12 * max(force_scale(disc, x), np.abs(inertia).max())


@pytest.mark.parametrize("name", LAYERS[:-1])
@pytest.mark.parametrize("constrained", CONSTRAINED)
def test_skipped_elements(constrained, name):
    one = layer(constrained, name)
    node = one.parent[MESH.cells, 0]
    inside = (node == node[:, :1]).all(axis=1)
    np.testing.assert_array_equal(one.active, np.flatnonzero(~inside))
    if name == "vertices":
        assert inside.any() == (constrained == "solid")
    if name in ("clusters of 16", "clusters of 32"):
        assert inside.mean() >= 0.02


@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize("constrained", CONSTRAINED)
def test_transfer(constrained, name):
    disc, one = body(constrained), layer(constrained, name)
    backend, P = PlainBackend(disc, 1), prolongation(one)
    dx, f = rng(21).standard_normal((one.n_nodes, 3)), rng(22).standard_normal((disc.n_vertices, 3))
    moved = np.zeros_like(f)
    backend.prolong(one, dx, moved)
    np.testing.assert_allclose(moved.ravel(), P @ dx.ravel(), rtol=0, atol=1e-14)
    restricted = backend.restrict(one, f)
    np.testing.assert_allclose(restricted.ravel(), P.T @ f.ravel(), rtol=0, atol=1e-13)
    assert (moved * f).sum() == pytest.approx((dx * restricted).sum(), rel=1e-12)
    assert (moved[~disc.free] == 0.0).all()


@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize("constrained", CONSTRAINED)
def test_partition_of_unity(constrained, name):
    disc, one = body(constrained), layer(constrained, name)
    moved = np.zeros((disc.n_vertices, 3))
    PlainBackend(disc, 1).prolong(one, np.tile([1.0, -2.0, 3.0], (one.n_nodes, 1)), moved)
    np.testing.assert_allclose(moved[disc.free], np.tile([1.0, -2.0, 3.0], (int(disc.free.sum()), 1)), rtol=1e-14)


@pytest.mark.parametrize("name", LAYERS)
def test_structure(name):
    one = layer("face", name)
    vertex, slot = np.nonzero(one.parent >= 0)
    parents = set(zip(one.parent[vertex, slot], vertex, one.weight[vertex, slot], strict=True))
    node = np.repeat(np.arange(one.n_nodes), one.sizes)
    assert parents == set(zip(node, one.child, one.child_weight, strict=True))
    pairs = build_pairs(body("face"), one)
    for i in range(one.n_nodes):
        assert (np.diff(pairs.element[pairs.ptr[i] : pairs.ptr[i + 1]]) > 0).all()
    assert pairs.ptr[-1] == len(pairs.element) == len(pairs.u) == one.n_pairs
    assert set(pairs.element) == set(range(len(one.active)))


@pytest.mark.parametrize("name", LAYERS)
def test_u_of_all_nodes_sums_to_zero(name):
    one = layer("free", name)
    total = np.zeros((len(one.active), 3))
    pairs = build_pairs(body("free"), one)
    np.add.at(total, pairs.element, pairs.u)
    # Gradients of the shape functions are up to 1 / (smallest height), some 30 per metre here.
    assert np.abs(total).max() <= 1e-12
