# SPDX-License-Identifier: BSD-3-Clause
"""Moving values between rows of nodes and rows of lanes.

1. Gathered rows are the coordinates of the indexed points, bit for bit, in both precisions and at any offset.
2. Scattered sums equal additions one lane after the other, bit for bit, where several lanes share a node too.
3. Values beside the ones named are left alone: unused places of a node, rows of the tile before and after.
4. Between flush_tiny and restore products below the normal range are zero on x86, and numbers again afterwards.
5. Asking for data past the end of an array is harmless.
"""

from __future__ import annotations

import platform

import numpy as np
import pytest

from femgal.kernels.cpu.backend import CpuBackend
from femgal.kernels.cpu.simd import (
    POINT,
    TERMS,
    VECTOR,
    W,
    flush_tiny,
    gather_points,
    prefetch,
    restore,
    scatter_terms,
    scatter_vectors,
)
from meshes.jit import kernel
from verify.problems.bodies import distorted_box, rng, uniform

PRECISIONS = ("float32", "float64")


@kernel
def gather(tile, at, index, from_, points):
    gather_points(tile, at, index, from_, points)


@kernel
def vectors(tile, at, index, from_, sums):
    scatter_vectors(tile, at, index, from_, sums)


@kernel
def terms(tile, at, index, from_, sums):
    scatter_terms(tile, at, index, from_, sums)


@kernel
def multiply_flushed(a, b, out):
    before = flush_tiny()
    for i in range(len(a)):
        out[i] = a[i] * b[i]
    restore(before)


@kernel
def multiply(a, b, out):
    for i in range(len(a)):
        out[i] = a[i] * b[i]


@kernel
def touch(array, at):
    prefetch(array, at)


def indices(n: int) -> np.ndarray:
    return rng(200).integers(0, n, 5 + W).astype(np.uint16)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_gather(precision):
    points, index = rng(201).standard_normal(POINT * 300).astype(precision), indices(300)
    tile = np.full(7 + 4 * W, 8.0, precision)
    gather(tile, 7, index, 5, points)
    expected = points.reshape(-1, POINT)[index[5:], :3].T.ravel()
    np.testing.assert_array_equal(tile[7 : 7 + 3 * W], expected)
    assert (tile[:7] == 8.0).all()
    assert (tile[7 + 3 * W :] == 8.0).all()


@pytest.mark.parametrize("n", [300, 6, 1])
@pytest.mark.parametrize(("scatter", "stride", "count"), [(vectors, VECTOR, 3), (terms, TERMS, 9)])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_scatter(precision, scatter, stride, count, n):
    tile, index = rng(202).standard_normal(3 + 10 * W).astype(precision), indices(n)
    sums = rng(203).standard_normal(stride * n).astype(precision)
    expected = sums.reshape(-1, stride).copy()
    for lane in range(W):
        expected[index[5 + lane], :count] += tile[3 + lane : 3 + lane + count * W : W]
    scatter(tile, 3, index, 5, sums)
    np.testing.assert_array_equal(sums.reshape(-1, stride), expected)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_prefetch_past_the_end(precision):
    array = np.ones(3, precision)
    for at in (0, 2, 3, 10**6, 10**12):
        touch(array, at)
    assert (array == 1.0).all()


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64", "i686"), reason="other processors are left alone")
def test_tiny_numbers():
    a, b = np.full(50, 1e-30, np.float32), np.full(50, 1e-10, np.float32)
    out = np.ones(50, np.float32)
    multiply(a, b, out)
    assert (out > 0.0).all()
    multiply_flushed(a, b, out)
    assert (out == 0.0).all()
    multiply_flushed(a, a[::-1].copy() * np.float32(1e25), out)
    np.testing.assert_allclose(out, 1e-35, rtol=1e-6)
    # Restored, for this thread's other work.
    multiply(a, b, out)
    assert (out > 0.0).all()
    assert (a * b > 0.0).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_passes_restore(precision):
    disc = uniform(distorted_box((3, 2, 2)))
    x = disc.mesh.points
    backend = CpuBackend(disc, 1, precision=precision)
    for call in (
        lambda: backend.gradient(x),
        lambda: backend.hessian_product(x, x),
        lambda: backend.correction(backend.vertices, x, x, 1.0),
        lambda: backend.energies(x),
        lambda: backend.energies_along(backend.vertices, x, x),
    ):
        call()
        assert np.float32(1e-30) * np.float32(1e-10) > 0.0
