# SPDX-License-Identifier: BSD-3-Clause
"""Hierarchies: how many layers, which, and what is said about them.

1. Layers of ratio, ratio^2, ... as long as they have four nodes or more, and not more than asked for.
2. Layers are independent: built alone or among others, a layer is the same.
3. Complexity is the sum of the pairs over those of the finest layer.
4. `connected` is true for clusters and tells a layer whose nodes are torn apart.
5. print(hierarchy) is a table with one row per layer; its numbers are the layer's own.
6. Linear layers: each lattice is twice as wide as the one before, and in the inside of a body has an eighth of its
   nodes; it has at most 0.7 of those of the layer before, and there are as many layers as of clusters of ratio 8.
7. A linear layer moves every free vertex with weights that sum to one, nodes are connected, and no vertex is left out
   where a mesh is graded, made of separate bodies or smaller than a cell.
8. Two levels, a bent beam and steps much longer than its stable one: a cycle with linear transfer leaves a third of the
   energy gap that one with as many clusters leaves, four cycles leave a tenth, and it gains more for the same passes.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from femgal.hierarchy import hierarchy as module
from femgal.hierarchy.hierarchy import Hierarchy, build_constant_hierarchy, build_linear_hierarchy, coarse_sizes
from femgal.hierarchy.layer import build_layer
from femgal.kernels.plain.backend import PlainBackend
from femgal.solvers.fas import FAS
from femgal.solvers.solver import minimise
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from meshes.generators import box
from meshes.ordering import reorder
from meshes.types import TetMesh
from verify.problems.bodies import distorted_box, left_end, uniform, varied
from verify.reference.newton import ReferenceNewton

MESH = distorted_box((9, 5, 5))  # 360 vertices, 324 of them free
DISC = varied(MESH, left_end(MESH))


@pytest.mark.parametrize(
    ("n_free", "ratio", "layers", "expected"),
    [
        (324, 4, "full", [4, 16, 64]),
        (324, 8, "full", [8, 64]),
        (324, 32, "full", [32]),
        (324, 4, 2, [4, 16]),
        (324, 4, 0, []),
        (324, 32, 5, [32]),
        (127, 32, "full", []),
        (128, 32, "full", [32]),
        (10**6, 32, "full", [32, 1024, 32768]),
    ],
)
def test_coarse_sizes(n_free, ratio, layers, expected):
    assert coarse_sizes(n_free, ratio, layers) == expected


@pytest.mark.parametrize("ratio", [4, 8, 32])
def test_layers(ratio):
    built = build_constant_hierarchy(DISC, ratio)
    sizes = coarse_sizes(324, ratio, "full")
    assert [layer.name for layer in built.layers] == ["vertices", *(f"clusters of {size}" for size in sizes)]
    assert built.layers[0].n_nodes == 324
    for layer, size in zip(built.layers[1:], sizes, strict=True):
        assert 324 / size / 1.5 <= layer.n_nodes <= 1.5 * 324 / size
        assert layer.sizes.sum() == 324
    pairs = [layer.n_pairs for layer in built.layers]
    assert built.complexity == pytest.approx(sum(pairs) / pairs[0])
    assert built.connected == (True,) * len(built.layers)
    assert all(finer > coarser for finer, coarser in pairwise(pairs))


def test_layers_are_independent():
    few, many = build_constant_hierarchy(DISC, 4, 1), build_constant_hierarchy(DISC, 4)
    assert (len(few.layers), len(many.layers)) == (2, 4)
    for one, two in zip(few.layers, many.layers, strict=False):
        np.testing.assert_array_equal(one.parent, two.parent)
        np.testing.assert_array_equal(one.active, two.active)


def test_torn_nodes_are_noticed():
    label = np.where(DISC.free, 0, -1).astype(np.int32)
    X = MESH.points[:, 0]
    label[DISC.free & (X > 0.25)] = 1
    label[DISC.free & (X > 0.65)] = 0
    weight = np.ones((len(X), 1))
    assert not module._connected(DISC, build_layer(DISC, label[:, None].copy(), weight, 2, "torn"))
    label[label == 0] = np.where(X[label == 0] > 0.65, 2, 0)
    assert module._connected(DISC, build_layer(DISC, label[:, None].copy(), weight, 3, "whole"))


def test_table():
    built = build_constant_hierarchy(DISC, 8)
    lines = str(built).splitlines()
    assert lines[0].split()[:2] == ["layer", "nodes"]
    assert len(lines) == 1 + len(built.layers) + 1
    for line, layer in zip(lines[1:], built.layers, strict=False):
        assert layer.name in line
        assert f" {layer.n_nodes} " in line
        assert f" {len(layer.active)} " in line
        assert line.endswith(str(layer.n_pairs))
    assert lines[-1] == f"constant transfer, ratio 8, complexity {built.complexity:.3f}"
    assert " no " in str(replace(built, connected=(True, False, True)))


def spacings(built: Hierarchy) -> list[float]:
    """Edges of the cubes of the coarse layers [m], to the digits of their names."""
    return [float(layer.name.split()[2]) for layer in built.layers[1:]]


def assert_moves_all_free_vertices(disc, built: Hierarchy) -> None:
    assert built.transfer == "linear"
    assert built.ratio == 8
    assert built.connected == (True,) * len(built.layers)
    for finer, layer in pairwise(built.layers):
        assert 4 <= layer.n_nodes <= 0.7 * finer.n_nodes
        np.testing.assert_allclose(layer.weight.sum(axis=1), disc.free, rtol=0, atol=1e-14)
        assert (layer.weight >= 0.0).all()
        assert set(layer.parent.ravel()) - {-1} == set(range(layer.n_nodes))


def test_linear_layers():
    mesh = distorted_box((36, 36, 36))
    disc = varied(mesh, left_end(mesh))
    built = build_linear_hierarchy(disc)
    assert_moves_all_free_vertices(disc, built)
    assert len(built.layers) == 1 + len(coarse_sizes(built.layers[0].n_nodes, 8, "full")) == 5
    for narrow, wide in pairwise(spacings(built)):
        assert wide == pytest.approx(2.0 * narrow, rel=0.01)
    edges = mesh.points[mesh.cells[:, [0, 0, 0, 1, 1, 2]]] - mesh.points[mesh.cells[:, [1, 2, 3, 2, 3, 3]]]
    # The mean here is over the tetrahedra, which counts inner edges more often.
    assert spacings(built)[0] == pytest.approx(2.5 * np.linalg.norm(edges, axis=2).mean(), rel=0.05)
    nodes = [layer.n_nodes for layer in built.layers]
    assert 12 <= nodes[0] / nodes[1] <= 18
    # Layers of fewer nodes have a larger share of them at the surface.
    assert 5.5 <= nodes[1] / nodes[2] <= 8
    carried = [
        np.bincount(layer.parent[disc.free].ravel() + 1, layer.weight[disc.free].ravel()).max()
        for layer in built.layers[1:4]
    ]
    for one, two in pairwise(carried):
        assert two == pytest.approx(8.0 * one, rel=0.1)
    for layer in built.layers[1:]:
        np.testing.assert_array_equal(layer.active, np.flatnonzero(disc.free[mesh.cells].any(axis=1)))


@pytest.mark.parametrize("layers", [0, 1, 2])
def test_linear_layers_are_as_many_as_asked_for(layers):
    built, full = build_linear_hierarchy(DISC, layers), build_linear_hierarchy(DISC)
    assert len(full.layers) == 3
    assert len(built.layers) == 1 + layers
    for one, other in zip(built.layers, full.layers, strict=False):
        np.testing.assert_array_equal(one.parent, other.parent)
        np.testing.assert_array_equal(one.weight, other.weight)
    assert len(build_linear_hierarchy(DISC, 99).layers) == len(full.layers)


def test_linear_layers_of_a_graded_mesh():
    even = box((1.0, 1.0, 1.0), (24, 6, 6))
    # From 0.7 mm at one end to 1 m at the other.
    stretched = np.exp(7.3 * (even.points[:, :1] - 1.0)) * 3.5
    disc = varied(reorder(TetMesh(np.hstack([stretched, 0.3 * even.points[:, 1:]]), even.cells))[0])
    built = build_linear_hierarchy(disc)
    assert_moves_all_free_vertices(disc, built)
    assert len(built.layers) >= 3
    assert built.layers[-1].n_nodes <= 60


def test_linear_layers_of_dust():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.8, 0.8, 0.3]])
    points = (corner + 3.0 * np.arange(30)[:, None, None]).reshape(-1, 3)
    mesh = TetMesh(points, np.arange(120).reshape(30, 4).astype(np.int32))
    disc = varied(mesh, [0, 1, 2, 3, 5])
    built = build_linear_hierarchy(disc)
    assert_moves_all_free_vertices(disc, built)
    body = np.repeat(np.arange(30), 4)
    for layer in built.layers[1:]:
        owners = [set(layer.parent[body == b].ravel()) - {-1} for b in range(1, 30)]
        assert sum(map(len, owners)) == layer.n_nodes
        assert all(owners)


def test_a_mesh_too_small_for_a_lattice():
    mesh = TetMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 1, 2, 3]], np.int32))
    assert len(build_linear_hierarchy(varied(mesh)).layers) == 1


def gaps(layers, potential: IncrementalPotential, lowest: float, cycles: int) -> np.ndarray:
    """phi above its minimum after each cycle with exact steps, over that at the prediction."""
    disc = potential.backend.disc
    solver = FAS(potential.backend, layers, "exact")
    rest = MotionState(0.0, disc.mesh.points, np.zeros_like(disc.mesh.points))
    state = solver.init(potential, solver.prepare(rest, potential).memory)
    values = [potential.value(state.x)]
    for _ in range(cycles):
        state = solver.step(potential, state)
        values.append(potential.value(state.x))
    return (np.array(values[1:]) - lowest) / (values[0] - lowest)


def test_two_levels_linear_against_constant():
    mesh = distorted_box((18, 6, 6))
    disc = uniform(mesh, left_end(mesh), E=1e6)
    X, h = mesh.points, 1.0 / 60.0
    linear = build_linear_hierarchy(disc, 1)
    constant = build_constant_hierarchy(disc, round(linear.layers[0].n_nodes / linear.layers[1].n_nodes), 1)
    assert constant.layers[1].n_nodes == pytest.approx(linear.layers[1].n_nodes, rel=0.1)
    bent = X.copy()
    bent[:, 2] -= 1e-3 * (X[:, 0] / X[:, 0].max()) ** 2
    potential = IncrementalPotential(PlainBackend(disc, 1), bent, h)
    lowest = potential.value(minimise(ReferenceNewton(disc), potential, {}).x)
    of_linear, of_constant = gaps(linear.layers, potential, lowest, 4), gaps(constant.layers, potential, lowest, 8)
    # Measured: 0.19 and 0.020 against 0.71 and 0.31.
    assert of_linear[0] <= of_constant[0] / 3.0
    assert of_linear[3] <= of_constant[3] / 10.0
    assert of_linear[3] <= 0.03
    # Four linear cycles cost 11 passes with blocks, eight constant ones 13.
    assert 4 * linear.complexity < 8 * constant.complexity
    assert of_linear[3] <= of_constant[7] / 4.0
