# SPDX-License-Identifier: BSD-3-Clause
"""Affine handles.

1. Every free vertex has one cluster on every level; there are about as many as asked for, and few at the bottom.
2. On each cluster, of every level, affine maps of the rest positions are in the space, whatever map each cluster has.
3. The bases are orthonormal; where a cluster is flat they have fewer functions, and zeros in place of the others.
4. Bodies smaller than a cluster get one each.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from femgal.discretisation import discretise
from meshes.generators import box
from tests.verify.thrown_beam import X, body
from verify.problems.bodies import rng
from verify.solvers.handles import Handles, build_handles

DISC = body()
LEVELS = build_handles(DISC, cluster=16, ratio=4, bottom=3)


def prolongation(handles: Handles) -> np.ndarray:
    """P of one level for one component, shape [k a, 4 c]."""
    k, a, _ = handles.q.shape
    blocks = sparse.bsr_matrix((handles.q, handles.label, np.arange(k + 1)), shape=(k * a, 4 * handles.n_clusters))
    return blocks.toarray()


def composed(levels) -> tuple[np.ndarray, np.ndarray]:
    """Prolongation from the last level to the free vertices, and the cluster of each of these."""
    P, label = prolongation(levels[0]), levels[0].label
    for handles in levels[1:]:
        P, label = P @ prolongation(handles), handles.label[label]
    return P, label


def test_clusters():
    n = int(DISC.free.sum())
    assert len(LEVELS) == 3
    assert [level.n_clusters for level in LEVELS] == [level.label.max() + 1 for level in LEVELS]
    assert 0.5 * n / 16 <= LEVELS[0].n_clusters <= 2.0 * n / 16
    assert LEVELS[-1].n_clusters <= 3
    for level in LEVELS:
        assert np.array_equal(np.sort(level.child), np.arange(len(level.label)))
        owner = np.repeat(np.arange(level.n_clusters), np.diff(level.child_ptr))
        assert np.array_equal(level.label[level.child], owner)


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_affine_maps(depth):
    P, label = composed(LEVELS[:depth])
    T = rng(360).standard_normal((label.max() + 1, 4))
    u = (T[label] * np.column_stack([X[DISC.free], np.ones(len(label))])).sum(axis=1)
    assert np.linalg.norm(u - P @ (P.T @ u)) <= 1e-10 * np.linalg.norm(u)


def test_orthonormal():
    for level in LEVELS:
        P = prolongation(level)
        used = ~level.unused().ravel()
        np.testing.assert_allclose(P.T @ P, np.diag(used.astype(float)), atol=1e-10)


def test_flat_clusters():
    # One layer of free vertices between two that are held.
    mesh = box((1.0, 1.0, 0.2), (6, 6, 2))
    disc = discretise(mesh, 1e5, 0.4, 1000.0, np.flatnonzero(np.abs(mesh.points[:, 2] - 0.1) > 0.05))
    first = build_handles(disc, 12, 8, 100)[0]
    assert (first.unused().sum(axis=1) >= 1).all()
    assert not first.unused()[:, 0].any()


def test_small_bodies():
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    levels = build_handles(discretise(mesh, 1e5, 0.4, 1000.0), 64, 8, 100)
    assert [level.n_clusters for level in levels] == [1]
