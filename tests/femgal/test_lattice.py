# SPDX-License-Identifier: BSD-3-Clause
"""Nodes of a lattice: where they stand, what they move, and the passes over a layer of them.

1. Weights are non-negative, heaviest first, and sum to one at free vertices; constrained ones have no node. Every node
   moves a vertex and carries at least the weight of one.
2. Nodes stand on a body-centred cubic lattice; those of a vertex are corners of one of its tetrahedra, as far as they
   are kept, and the vertex is their weighted mean: linear functions are exact. So at every vertex at least one cube
   from the surface, and at nine of ten in all where a cube has two mean edges or more.
3. Constants are prolonged exactly everywhere.
4. The support of every node is connected through free vertices. Bodies that are closer than a cell, the arms of a U
   and the two sides of a wall of constrained vertices share no node, and have some at the same places; a body without
   a gap has no two nodes at one place.
5. Blocks and gradients of the matrix-free pass equal the diagonal blocks of P^T (M / h^2 + H) P and P^T of the
   gradient, with scikit-fem's H, to 1e-12: every state, several spacings, constrained or not, and a real bunny.
6. The same bits for 1, 2 and 3 threads, and the same nodes in every process.
7. Scaling body and spacing by a power of two changes no node; bodies 1e7 cells apart do not disturb each other.
8. A lattice finer than the mesh makes as many nodes as there are vertices at most.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from femgal.discretisation import Discretisation
from femgal.hierarchy.lattice import LIGHTEST, LatticeNodes, lattice_nodes
from femgal.hierarchy.layer import Layer, build_layer
from femgal.kernels.plain.backend import PlainBackend
from meshes.connectivity import cell_edges
from meshes.generators import box
from meshes.ordering import reorder
from meshes.types import TetMesh
from verify.problems.bodies import STATES, distorted_box, force_scale, left_end, positions, rng, uniform, varied
from verify.reference.elasticity import AssembledElasticity
from verify.reference.transfer import diagonal_blocks, galerkin, mass_matrix, prolongation, unpacked

MESH = distorted_box()
CONSTRAINED = {"free": (), "face": left_end(MESH), "solid": left_end(MESH, 0.25)}
SPACINGS = (0.2, 0.35, 0.7)  # [m], 1.5 to 5 mean edges
H_STEP = 1.0 / 600.0


def nodes_of(mesh: TetMesh, spacing: float, constrained=()) -> tuple[LatticeNodes, np.ndarray]:
    """Nodes of one lattice, and which vertices are free."""
    free = np.ones(len(mesh.points), bool)
    free[np.asarray(constrained, np.int64)] = False
    return lattice_nodes(mesh.points, free, cell_edges(mesh.cells, len(mesh.points)), spacing), free


def lattice_layer(disc: Discretisation, spacing: float) -> Layer:
    edges = cell_edges(disc.mesh.cells, disc.n_vertices)
    nodes = lattice_nodes(disc.mesh.points, disc.free, edges, spacing)
    return build_layer(disc, nodes.parent, nodes.weight, len(nodes.position), "lattice")


def carried(nodes: LatticeNodes) -> np.ndarray:
    """Sum of the weights of each node."""
    has = nodes.parent >= 0
    return np.bincount(nodes.parent[has], nodes.weight[has], minlength=len(nodes.position))


def n_support_parts(mesh: TetMesh, nodes: LatticeNodes) -> np.ndarray:
    """Connected parts of the support of each node, one search per node."""
    i, j = cell_edges(mesh.cells, len(mesh.points)).T
    counts = []
    for node in range(len(nodes.position)):
        moved = (nodes.parent == node).any(axis=1)
        inside = moved[i] & moved[j]
        graph = coo_matrix((np.ones(inside.sum()), (i[inside], j[inside])), shape=(len(moved), len(moved)))
        counts.append(connected_components(graph, directed=False)[0] - int((~moved).sum()))
    return np.array(counts)


def n_shared_places(nodes: LatticeNodes) -> int:
    """Nodes that stand where another one does."""
    return len(nodes.position) - len(np.unique(np.round(nodes.position, 9), axis=0))


@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize("constrained", CONSTRAINED)
def test_weights(constrained, spacing):
    nodes, free = nodes_of(MESH, spacing, CONSTRAINED[constrained])
    assert (nodes.weight >= 0.0).all()
    assert (np.diff(nodes.weight, axis=1) <= 0.0).all()
    np.testing.assert_array_equal(nodes.weight > 0.0, nodes.parent >= 0)
    np.testing.assert_allclose(nodes.weight.sum(axis=1)[free], 1.0, rtol=0, atol=1e-15 * 4)
    assert (nodes.parent[~free] == -1).all()
    assert (carried(nodes) >= LIGHTEST).all()
    sorted_parents = np.sort(nodes.parent, axis=1)
    assert ((np.diff(sorted_parents, axis=1) > 0) | (sorted_parents[:, 1:] < 0)).all()


@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize("constrained", CONSTRAINED)
def test_constants_are_prolonged_exactly(constrained, spacing):
    disc = varied(MESH, CONSTRAINED[constrained])
    layer = lattice_layer(disc, spacing)
    moved = np.zeros((disc.n_vertices, 3))
    PlainBackend(disc, 1).prolong(layer, np.tile([1.0, -2.0, 3.0], (layer.n_nodes, 1)), moved)
    np.testing.assert_allclose(moved[disc.free], np.tile([1.0, -2.0, 3.0], (int(disc.free.sum()), 1)), rtol=1e-15)
    assert (moved[~disc.free] == 0.0).all()


@pytest.mark.parametrize(("spacing", "share"), [(0.11, 0.7), (0.2, 0.9), (0.45, 0.95)])
def test_linear_functions(spacing, share):
    mesh = reorder(box((1.3, 1.0, 1.1), (20, 16, 17), jitter=0.12))[0]
    X = mesh.points
    nodes, free = nodes_of(mesh, spacing, left_end(mesh))
    mean = (nodes.weight[:, :, None] * nodes.position[nodes.parent]).sum(axis=1)
    error = np.linalg.norm(mean - X, axis=1)[free]
    depth = np.minimum(X, [1.3, 1.0, 1.1] - X).min(axis=1)[free]
    inner = depth >= spacing
    assert inner.any()
    assert error[inner].max() <= 1e-14
    assert share <= (error <= 1e-14).mean() < 1.0
    # Where light nodes are left out, what remains are corners of the same tetrahedron.
    assert error.max() <= spacing


@pytest.mark.parametrize("spacing", SPACINGS)
def test_nodes_are_corners_of_one_tetrahedron(spacing):
    nodes, _ = nodes_of(MESH, spacing)
    middle = 0.5 * (MESH.points.min(axis=0) + MESH.points.max(axis=0))
    c = 2.0 * (nodes.position - middle) / spacing
    np.testing.assert_allclose(c, np.round(c), rtol=0, atol=1e-12)
    assert (np.round(c).astype(int) % 2 == np.round(c[:, :1]).astype(int) % 2).all()
    for s in range(4):
        for t in range(s):
            both = nodes.parent[:, s] >= 0
            between = nodes.position[nodes.parent[both, s]] - nodes.position[nodes.parent[both, t]]
            length = np.linalg.norm(between, axis=1) / spacing
            assert np.minimum(abs(length - 1.0), abs(length - np.sqrt(0.75))).max() <= 1e-12
    reach = np.linalg.norm(nodes.position[nodes.parent] - MESH.points[:, None], axis=2)
    assert reach[nodes.parent >= 0].max() <= spacing


def u_shape(gap: float) -> TetMesh:
    """Two arms along x, 0.3 m thick and `gap` apart in y, joined by a base at x < 0.3."""
    solid = box((1.5, 0.6 + gap, 0.4), (15, 9, 4))
    width = (0.6 + gap) / 9.0
    low, high = 4 * width, 5 * width
    centre = solid.points[solid.cells].mean(axis=1)
    kept = solid.cells[(centre[:, 0] < 0.3) | (centre[:, 1] < low) | (centre[:, 1] > high)]
    used, cells = np.unique(kept, return_inverse=True)
    return reorder(TetMesh(solid.points[used], cells.reshape(-1, 4).astype(np.int32)))[0]


def two_boxes(gap: float) -> tuple[TetMesh, np.ndarray]:
    """Two boxes side by side, numbered together along the curve, and the body of each vertex."""
    one = box((0.8, 0.3, 0.3), (8, 3, 3), jitter=0.1)
    points = np.concatenate([one.points, one.points + np.array([0.0, 0.3 + gap, 0.0])])
    mesh, order, _ = reorder(TetMesh(points, np.concatenate([one.cells, one.cells + len(one.points)])))
    return mesh, (order >= len(one.points)).astype(int)


@pytest.mark.parametrize("spacing", [0.2, 0.4, 1.0])
def test_separate_bodies_share_no_node(spacing):
    mesh, body = two_boxes(0.03)
    nodes, _ = nodes_of(mesh, spacing)
    owners = [set(nodes.parent[body == b].ravel()) - {-1} for b in (0, 1)]
    assert owners[0].isdisjoint(owners[1])
    assert len(owners[0]) + len(owners[1]) == len(nodes.position)
    assert n_shared_places(nodes) > 0
    assert (n_support_parts(mesh, nodes) == 1).all()


@pytest.mark.parametrize("spacing", [0.25, 0.5])
def test_arms_of_a_u_share_nodes_only_at_its_base(spacing):
    mesh = u_shape(0.05)
    X = mesh.points
    nodes, _ = nodes_of(mesh, spacing)
    middle = 0.5 * (X[:, 1].min() + X[:, 1].max())
    beyond = X[:, 0] > 0.3 + 2.0 * spacing
    one, two = (set(nodes.parent[beyond & side].ravel()) - {-1} for side in (X[:, 1] < middle, X[:, 1] > middle))
    assert len(one) > 0
    assert len(two) > 0
    assert one.isdisjoint(two)
    assert n_shared_places(nodes) > 0
    assert (n_support_parts(mesh, nodes) == 1).all()
    solid = distorted_box((15, 7, 4))
    assert n_shared_places(nodes_of(solid, spacing)[0]) == 0


def test_wall_of_constrained_vertices():
    mesh = distorted_box((9, 4, 4))
    X = mesh.points[:, 0]
    nodes, free = nodes_of(mesh, 0.6, np.flatnonzero((X >= 0.35) & (X <= 0.55)))
    assert set(nodes.parent[free & (X < 0.45)].ravel()).isdisjoint(set(nodes.parent[free & (X > 0.45)].ravel()) - {-1})
    assert n_shared_places(nodes) > 0
    assert (n_support_parts(mesh, nodes) == 1).all()


@cache
def assembled(state: str):
    elasticity = AssembledElasticity(MESH, varied(MESH).mu, varied(MESH).lam)
    x = positions(MESH, state)
    return elasticity.gradient(x), elasticity.hessian(x)


def assert_pass_equals_assembled(disc, layer, x, elastic, hessian, salt):
    """Blocks to 1e-12 of each block's norm, gradients to 1e-12 of the largest single term."""
    xhat = x + 1e-3 * rng(salt).standard_normal(x.shape)
    g, H = PlainBackend(disc, 1).gradient_and_blocks(layer, x, xhat, 1.0 / H_STEP**2)
    P = prolongation(layer)
    blocks = diagonal_blocks(galerkin(P, mass_matrix(disc.mass) / H_STEP**2 + hessian))
    error = np.linalg.norm(unpacked(H) - blocks, axis=(1, 2)) / np.linalg.norm(blocks, axis=(1, 2))
    assert error.max() <= 1e-12
    assert np.linalg.eigvalsh(unpacked(H)).min() > 0.0
    inertia = disc.mass[:, None] * (x - xhat) / H_STEP**2
    expected = (P.T @ (inertia + elastic).ravel()).reshape(-1, 3)
    assert np.abs(g - expected).max() <= 1e-12 * max(force_scale(disc, x), np.abs(inertia).max())


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize("constrained", CONSTRAINED)
def test_blocks_and_gradients_equal_assembled(constrained, spacing, state):
    disc = varied(MESH, CONSTRAINED[constrained])
    assert_pass_equals_assembled(disc, lattice_layer(disc, spacing), positions(MESH, state), *assembled(state), 310)


def test_blocks_and_gradients_of_a_real_bunny(real_surface):
    from meshes.make import make_tets

    mesh = make_tets(real_surface("bunny"), 1500).mesh
    length = float(np.ptp(mesh.points, axis=0).max())
    disc = varied(mesh, np.flatnonzero(mesh.points[:, 1] >= mesh.points[:, 1].max() - 0.1 * length))
    x = mesh.points + 0.005 * length * rng(311).standard_normal(mesh.points.shape)
    elasticity = AssembledElasticity(mesh, disc.mu, disc.lam)
    layer = lattice_layer(disc, 0.2 * length)
    assert layer.n_nodes >= 30
    assert_pass_equals_assembled(disc, layer, x, elasticity.gradient(x), elasticity.hessian(x), 312)


def test_same_bits_for_any_thread_count():
    mesh = box(cells=(10, 9, 9), jitter=0.1)
    disc = varied(mesh, left_end(mesh))
    layer = lattice_layer(disc, 0.3)
    x = mesh.points + 0.02 * rng(313).standard_normal(mesh.points.shape)
    results = []
    for threads in (1, 2, 3):
        backend = PlainBackend(disc, threads)
        g, H = backend.gradient_and_blocks(layer, x, mesh.points, 1e4)
        moved = x.copy()
        backend.prolong(layer, backend.solve(g, H, 0.7), moved)
        results.append([g, H, moved, backend.restrict(layer, x)])
    for other in results[1:]:
        for a, b in zip(results[0], other, strict=True):
            assert a.tobytes() == b.tobytes()


DIGEST = """
import hashlib, numpy as np
from meshes.connectivity import cell_edges
from meshes.generators import box
from meshes.ordering import reorder
from femgal.hierarchy.lattice import lattice_nodes
mesh = reorder(box(cells=(14, 14, 14), jitter=0.1))[0]
free = np.ones(len(mesh.points), bool)
nodes = lattice_nodes(mesh.points, free, cell_edges(mesh.cells, len(free)), 0.2)
print(hashlib.sha256(nodes.parent.tobytes() + nodes.weight.tobytes() + nodes.position.tobytes()).hexdigest())
"""


def test_same_in_every_process():
    digests = {
        subprocess.run([sys.executable, "-c", DIGEST], capture_output=True, text=True, check=True).stdout.strip()
        for _ in range(2)
    }
    nodes, _ = nodes_of(reorder(box(cells=(14, 14, 14), jitter=0.1))[0], 0.2)
    here = hashlib.sha256(nodes.parent.tobytes() + nodes.weight.tobytes() + nodes.position.tobytes()).hexdigest()
    assert digests == {here}


def test_scale():
    nodes, _ = nodes_of(MESH, 0.3)
    small, _ = nodes_of(TetMesh(MESH.points * 2.0**-10, MESH.cells), 0.3 * 2.0**-10)
    np.testing.assert_array_equal(small.parent, nodes.parent)
    np.testing.assert_array_equal(small.weight, nodes.weight)
    np.testing.assert_array_equal(small.position, nodes.position * 2.0**-10)


def test_far_apart():
    # Lattice coordinates reach 2e7, ten times what the 21 bits of one hold.
    mesh = TetMesh(
        np.concatenate([MESH.points, MESH.points + np.array([0.0, 4e6, 0.0])]),
        np.concatenate([MESH.cells, MESH.cells + len(MESH.points)]),
    )
    nodes, _ = nodes_of(mesh, 0.2)
    body = np.repeat([0, 1], len(MESH.points))
    assert set(nodes.parent[body == 0].ravel()).isdisjoint(set(nodes.parent[body == 1].ravel()) - {-1})
    mean = (nodes.weight[:, :, None] * nodes.position[nodes.parent]).sum(axis=1)
    assert np.linalg.norm(mean - mesh.points, axis=1).max() <= 0.2
    np.testing.assert_allclose(nodes.weight.sum(axis=1), 1.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("spacing", [0.01, 0.05, 0.1])
def test_a_lattice_finer_than_the_mesh(spacing):
    nodes, _ = nodes_of(MESH, spacing)
    assert len(nodes.position) <= len(MESH.points)
    np.testing.assert_allclose(nodes.weight.sum(axis=1), 1.0, rtol=0, atol=1e-14)
    if spacing == 0.01:
        np.testing.assert_array_equal(nodes.weight, np.tile([1.0, 0.0, 0.0, 0.0], (len(MESH.points), 1)))


def test_a_uniform_motion_is_one_that_no_element_feels():
    """u sums to zero over the nodes of an element, so a layer sees no force in a translation."""
    disc = uniform(MESH)
    layer = lattice_layer(disc, 0.3)
    x = MESH.points + np.array([1.0, 2.0, -3.0])
    g, _ = PlainBackend(disc, 1).gradient_and_blocks(layer, x, MESH.points, 0.0)
    assert np.abs(g).max() <= 1e-12 * force_scale(disc, MESH.points)
