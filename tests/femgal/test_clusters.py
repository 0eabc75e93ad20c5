# SPDX-License-Identifier: BSD-3-Clause
"""Clusters of the constant hierarchy.

1. Every free vertex is in exactly one cluster, constrained vertices are in none, every cluster has a vertex.
2. Every cluster is connected through edges between its own vertices.
3. On a box the mean size is within 25% of the one asked for, and no cluster has more than 2.5 times that.
4. Separate bodies never share a cluster, whichever order their vertices come in, and each has one at least.
5. A cluster never reaches across a wall of constrained vertices.
6. More vertices per cluster than there are vertices gives one cluster per connected part.
7. The same labels in every process.
8. Clusters are compact: on a box their mean radius is at most 1.5 times that of a cube of as many vertices.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from femgal.hierarchy.clusters import cluster_vertices
from meshes.generators import box
from meshes.ordering import reorder
from meshes.types import TetMesh
from verify.problems.bodies import distorted_box, left_end, rng

CUBE = reorder(box(cells=(14, 14, 14), jitter=0.1))[0]  # 3375 vertices
FREE = np.ones(len(CUBE.points), bool)


def n_parts(mesh: TetMesh, label: np.ndarray) -> int:
    """Connected parts of the graph whose edges join vertices of one label >= 0, counting only those vertices."""
    pairs = mesh.cells[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
    inside = (label[pairs[:, 0]] == label[pairs[:, 1]]) & (label[pairs[:, 0]] >= 0)
    i, j = pairs[inside].T
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(len(label), len(label)))
    return connected_components(graph, directed=False)[0] - int((label < 0).sum())


def assert_partition(mesh: TetMesh, free: np.ndarray, label: np.ndarray, n: int) -> None:
    assert label.shape == (len(mesh.points),)
    np.testing.assert_array_equal(label >= 0, free)
    assert (np.bincount(label[free], minlength=n) > 0).all()
    assert label.max() == n - 1
    assert n_parts(mesh, label) == n


@pytest.mark.parametrize("size", [1, 4, 8, 32, 1024])
def test_partition_and_sizes(size):
    label, n = cluster_vertices(CUBE.points, CUBE.cells, FREE, size)
    assert_partition(CUBE, FREE, label, n)
    counts = np.bincount(label)
    assert 0.75 * size <= counts.mean() <= 1.25 * size
    assert counts.max() <= 2.5 * size


@pytest.mark.parametrize("size", [8, 32])
def test_compact(size):
    label, _ = cluster_vertices(CUBE.points, CUBE.cells, FREE, size)
    counts = np.bincount(label)
    centre = np.stack([np.bincount(label, CUBE.points[:, d]) / counts for d in range(3)], axis=1)
    radius = np.sqrt(((CUBE.points - centre[label]) ** 2).sum(axis=1).mean())
    spacing = 1.0 / 14.0
    # k^3 points of unit spacing have the mean square radius (k^2 - 1) / 4.
    assert radius <= 1.5 * spacing * np.sqrt((size ** (2.0 / 3.0) - 1.0) / 4.0)


@pytest.mark.parametrize("size", [4, 8, 32])
def test_constrained_vertices(size):
    mesh = distorted_box((9, 5, 5))
    free = rng(60).random(len(mesh.points)) > 0.25
    label, n = cluster_vertices(mesh.points, mesh.cells, free, size)
    assert_partition(mesh, free, label, n)


@pytest.mark.parametrize("size", [4, 32, 1024])
def test_separate_bodies(size):
    one, two = distorted_box((4, 3, 3)), distorted_box((6, 2, 2))
    # Touching bodies, numbered together along the curve, so that their vertices alternate.
    points = np.concatenate([one.points, two.points + np.array([0.02, 0.03, 0.01])])
    body = np.repeat([0, 1], [len(one.points), len(two.points)])
    joined = TetMesh(points, np.concatenate([one.cells, two.cells + len(one.points)]))
    mesh, order, _ = reorder(joined)
    label, n = cluster_vertices(mesh.points, mesh.cells, np.ones(len(points), bool), size)
    assert_partition(mesh, np.ones(len(points), bool), label, n)
    assert set(label[body[order] == 0]).isdisjoint(label[body[order] == 1])
    if size == 1024:
        assert n == 2


@pytest.mark.parametrize("size", [8, 32, 1024])
def test_wall_of_constrained_vertices(size):
    mesh = distorted_box((9, 4, 4))
    X = mesh.points[:, 0]
    # Two planes of vertices, displaced by jitter, so that no edge crosses.
    free = (X < 0.35) | (X > 0.55)
    label, n = cluster_vertices(mesh.points, mesh.cells, free, size)
    assert_partition(mesh, free, label, n)
    assert set(label[X < 0.35]).isdisjoint(label[X > 0.55])
    if size == 1024:
        assert n == 2


def test_a_part_without_seeds_of_its_own():
    # The numbering puts every start seed into the long body; the single tetrahedra are found all the same.
    long = distorted_box((12, 2, 2))
    corner = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    points = np.concatenate([long.points, corner + 5.0, corner + 7.0])
    cells = np.concatenate([long.cells, len(long.points) + np.arange(8).reshape(2, 4)])
    mesh, free = TetMesh(points, cells), np.ones(len(points), bool)
    for size in (2, 8, 64):
        label, n = cluster_vertices(mesh.points, mesh.cells, free, size)
        assert_partition(mesh, free, label, n)


@pytest.mark.parametrize("seed", range(900_001, 900_021, 2))
def test_dust(seed):
    """Many tiny bodies in random order, some vertices constrained: nothing is empty, lost or shared."""
    random = np.random.default_rng(seed)
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.8, 0.8, 0.3]])
    points = (corner + 3.0 * np.arange(30)[:, None, None] + 0.03 * random.standard_normal((30, 4, 3))).reshape(-1, 3)
    order = random.permutation(len(points))
    cells = np.argsort(order)[np.arange(120).reshape(30, 4)]
    mesh = TetMesh(points[order], cells)
    free = random.random(120) > 0.2
    for size in (1, 2, 5):
        label, n = cluster_vertices(mesh.points, mesh.cells, free, size)
        assert_partition(mesh, free, label, n)


DIGEST = """
import hashlib, numpy as np
from meshes.generators import box
from meshes.ordering import reorder
from femgal.hierarchy.clusters import cluster_vertices
mesh = reorder(box(cells=(14, 14, 14), jitter=0.1))[0]
label, _ = cluster_vertices(mesh.points, mesh.cells, np.ones(len(mesh.points), bool), 32)
print(hashlib.sha256(label.tobytes()).hexdigest())
"""


def test_same_in_every_process():
    other = subprocess.run([sys.executable, "-c", DIGEST], capture_output=True, text=True, check=True).stdout.strip()
    label, _ = cluster_vertices(CUBE.points, CUBE.cells, FREE, 32)
    assert hashlib.sha256(label.tobytes()).hexdigest() == other


def test_all_constrained_but_one():
    mesh = distorted_box((3, 2, 2))
    free = np.zeros(len(mesh.points), bool)
    free[left_end(mesh)[3]] = True
    label, n = cluster_vertices(mesh.points, mesh.cells, free, 32)
    assert n == 1
    np.testing.assert_array_equal(label >= 0, free)
