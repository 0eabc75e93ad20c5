# SPDX-License-Identifier: BSD-3-Clause
"""Hierarchies: how many layers, which, and what is said about them.

1. Layers of ratio, ratio^2, ... as long as they have four nodes or more, and not more than asked for.
2. Layers are independent: built alone or among others, a layer is the same.
3. Complexity is the sum of the pairs over those of the finest layer.
4. `connected` is true for clusters and tells a layer whose nodes are torn apart.
5. print(hierarchy) is a table with one row per layer; its numbers are the layer's own.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from femgal.hierarchy import hierarchy as module
from femgal.hierarchy.hierarchy import build_constant_hierarchy, coarse_sizes
from femgal.hierarchy.layer import build_layer
from tests.femgal.problems import distorted_box, left_end, varied

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
