# SPDX-License-Identifier: BSD-3-Clause
"""Blocks of elements for a GPU, and the plan of the sums over their slots.

1. Every element is in one place, its corners are its vertices, its rest quantities its own; what fills up is zero.
2. Each corner of each element is in the list of its vertex once, in the order of the elements.
3. Each (element, node) pair of a coarse layer is in a part of its node, with its u; parts hold PART pairs at most.
4. Slots and vertices are added up once each, whatever the number of rounds, in chunks of CHUNK at most.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from femgal.hierarchy.layer import build_layer, build_pairs, finest_layer
from femgal.kernels.cuda.layout import PART, REST, build_blocks, build_entries, build_parts
from tests.femgal.kernels_cuda.simulated import needs_numba_cuda
from verify.problems.bodies import distorted_box, left_end, linear_layer, varied

MESH = distorted_box((5, 4, 4))


@cache
def body():
    return varied(MESH, left_end(MESH, 0.25))


@pytest.mark.parametrize("size", [16, 64, 512])
def test_blocks(size):
    disc, layer = body(), finest_layer(body())
    blocks = build_blocks(disc, layer.active, "float32", size)
    np.testing.assert_array_equal(blocks.element[blocks.element >= 0], layer.active)
    rest = blocks.rest.reshape(blocks.n_blocks, REST, size).transpose(0, 2, 1).reshape(-1, REST)
    corner = blocks.corner.reshape(blocks.n_blocks, 4, size).transpose(0, 2, 1).reshape(-1, 4)
    for place, e in enumerate(blocks.element):
        own = blocks.vertex[blocks.vertex_ptr[place // size] : blocks.vertex_ptr[place // size + 1]]
        assert (np.diff(own) > 0).all()
        if e < 0:
            assert not rest[place].any()
        else:
            np.testing.assert_array_equal(own[corner[place]], disc.mesh.cells[e])
            expected = np.concatenate([disc.B[e], disc.Vmu[e : e + 1], disc.Vlam[e : e + 1]])
            np.testing.assert_array_equal(rest[place], expected.astype(np.float32))


@pytest.mark.parametrize("size", [16, 64, 512])
def test_entries(size):
    layer = finest_layer(body())
    blocks = build_blocks(body(), layer.active, "float64", size)
    entries = build_entries(blocks, layer)
    corner = blocks.corner.reshape(blocks.n_blocks, 4, size)
    listed = 0
    for b in range(blocks.n_blocks):
        for j in range(blocks.vertex_ptr[b], blocks.vertex_ptr[b + 1]):
            k, l = divmod(entries.entry[entries.ptr[j] : entries.ptr[j + 1]].astype(int), size)  # noqa: E741
            assert (np.diff(l) > 0).all()
            assert (corner[b, k, l] == j - blocks.vertex_ptr[b]).all()
            listed += len(k)
    assert listed == 4 * len(layer.active)


@pytest.mark.parametrize("size", [16, 128])
def test_parts(size):
    disc, layer = body(), linear_layer(body())
    blocks = build_blocks(disc, layer.active, "float64", size)
    parts, pairs = build_parts(disc, layer, blocks), build_pairs(disc, layer)
    node_of_slot = np.empty(parts.node_ptr[-1], int)
    node_of_slot[parts.slot] = np.repeat(np.arange(layer.n_nodes), np.diff(parts.slot_ptr))
    found: dict[tuple[int, int], np.ndarray] = {}
    for b in range(blocks.n_blocks):
        n, first = parts.part_ptr[b + 1] - parts.part_ptr[b], PART * parts.part_ptr[b]
        pair = parts.pair[first : first + PART * n].reshape(PART, n)
        u = parts.u[3 * first : 3 * (first + PART * n)].reshape(PART, 3, n)
        for j in range(parts.node_ptr[b], parts.node_ptr[b + 1]):
            for p in range(parts.node_part[j + b], parts.node_part[j + b + 1]):
                for k in np.flatnonzero(np.abs(u[:, :, p]).sum(axis=1)):
                    found[int(node_of_slot[j]), int(blocks.element[b * size + pair[k, p]])] = u[k, :, p]
    assert len(found) == layer.n_pairs
    node = np.repeat(np.arange(layer.n_nodes), np.diff(pairs.ptr))
    for i, k, u in zip(node, pairs.element, pairs.u, strict=True):
        np.testing.assert_array_equal(found[int(i), int(layer.active[k])], u)


def by_node(values: np.ndarray, ptr: np.ndarray) -> np.ndarray:
    return np.array([values[a:b].sum() for a, b in pairwise(ptr)])


@pytest.mark.parametrize(("nodes", "slots"), [(1, 200_000), (3, 5000), (40, 300), (75, 150)])
def test_sums(nodes, slots):
    needs_numba_cuda()
    from femgal.kernels.cuda.rounds import plan_sums
    from femgal.kernels.cuda.sums import CHUNK

    disc = body()
    parent = np.where(disc.free, np.arange(disc.n_vertices) % nodes, -1).astype(np.int32)[:, None]
    layer = build_layer(disc, parent, np.ones((disc.n_vertices, 1)), nodes, "made up")
    node = np.sort(np.arange(slots) % nodes)
    slot_ptr = np.concatenate(([0], np.cumsum(np.bincount(node, minlength=nodes)))).astype(np.int64)
    slot = np.argsort(np.arange(slots) * 7919 % slots, kind="stable").astype(np.int32)
    values, weights = np.arange(slots) + 1.0, np.arange(disc.n_vertices) + 0.5
    expected = by_node(values[slot], slot_ptr) + by_node(weights[layer.child], layer.child_ptr)
    sums = plan_sums(layer, slot_ptr, slot)
    for number, one in enumerate(sums.rounds):
        assert max(np.diff(one.child_range).max(), np.diff(one.slot_range).max()) <= CHUNK
        children = [weights[layer.child[a:b]].sum() if number == 0 else 0.0 for a, b in one.child_range]
        values = np.array([values[one.slot[a:b]].sum() for a, b in one.slot_range]) + children
    found = by_node(values[sums.slot], sums.slot_ptr) + by_node(weights[layer.child], sums.child_ptr)
    np.testing.assert_allclose(found, expected, rtol=1e-13)
    assert np.diff(sums.slot_ptr).max() <= CHUNK
