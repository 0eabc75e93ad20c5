# SPDX-License-Identifier: BSD-3-Clause
"""Fused vector work of an explicit step.

1. Kick and drift, and acceleration and kick, equal the formulas written with whole arrays.
2. Vertices that are not free have no acceleration, whatever their gradient, and keep their velocity but for damping.
3. The same bits for any partition of the rows, so for any number of threads.
4. Arrays that are only read stay as they are.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from femgal.kernels.cpu.motion import accelerate_kick, kick_drift
from verify.problems.bodies import rng

N = 1003
MASS = 10.0 ** rng(300).uniform(-3.0, 3.0, N)
FREE = rng(301).random(N) < 0.7
GRAVITY = np.array([0.5, -1.5, -9.81])
X, V, A, G = (rng(302 + k).standard_normal((N, 3)) for k in range(4))
H, DECAY, GROWTH = 3e-2, 0.9, 0.95
PARTITIONS = {"one": (0, N), "halves": (0, N // 2, N), "odd": (0, 1, 6, 7, 64, 501, 1002, N)}


def kicked_and_drifted(bounds=(0, N)) -> tuple[np.ndarray, np.ndarray]:
    x, v = np.full_like(X, np.nan), np.full_like(V, np.nan)
    for start, stop in pairwise(bounds):
        kick_drift(3 * start, 3 * stop, X.ravel(), V.ravel(), A.ravel(), H, DECAY, x.ravel(), v.ravel())
    return x, v


def accelerated(bounds=(0, N)) -> tuple[np.ndarray, np.ndarray]:
    g, v = G.copy(), V.copy()
    for start, stop in pairwise(bounds):
        accelerate_kick(start, stop, MASS, FREE, GRAVITY, H, GROWTH, g, v)
    return g, v


def test_kick_drift():
    before = [array.copy() for array in (X, V, A)]
    x, v = kicked_and_drifted()
    expected = DECAY * V + 0.5 * H * A
    np.testing.assert_allclose(v, expected, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(x, X + H * expected, rtol=1e-14, atol=1e-15)
    for array, kept in zip((X, V, A), before, strict=True):
        np.testing.assert_array_equal(array, kept)


def test_accelerate_kick():
    a, v = accelerated()
    expected = np.where(FREE[:, None], GRAVITY - G / MASS[:, None], 0.0)
    np.testing.assert_allclose(a, expected, rtol=1e-14, atol=1e-13)
    np.testing.assert_allclose(v, GROWTH * (V + 0.5 * H * expected), rtol=1e-13, atol=1e-13)


def test_held_vertices():
    a, v = accelerated()
    assert (a[~FREE] == 0.0).all()
    np.testing.assert_array_equal(v[~FREE], GROWTH * V[~FREE])
    assert (a[FREE] != 0.0).all()


@pytest.mark.parametrize("partition", ["halves", "odd"])
@pytest.mark.parametrize("work", [kicked_and_drifted, accelerated])
def test_same_bits_for_any_partition(work, partition):
    for one, other in zip(work(), work(PARTITIONS[partition]), strict=True):
        assert one.tobytes() == other.tobytes()
