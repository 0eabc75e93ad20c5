# SPDX-License-Identifier: BSD-3-Clause
"""Singular values and eigenvectors at 6,000 gradients, singular ones and equal values among them.

1. F = U diag(s) V^T to 1e-14 of the largest singular value in float64, 3e-6 in float32; nothing is NaN.
2. U and V are rotations to the same precision; the singular values are NumPy's, the last with the sign of det F.
3. A symmetric tensor is Q diag(values) Q^T with a rotation Q and NumPy's eigenvalues, to the same precision.
4. In float32 no float64 arithmetic is done.
"""

from __future__ import annotations

import numba
import numpy as np
import pytest

from femgal.materials.svd import eigenvectors, singular_values
from tests.femgal.gradients import GRADIENTS, LANES, from_tiles, to_tiles

TOLERANCE = {np.float64: 1e-14, np.float32: 3e-6}
OPTIONS = {"fastmath": {"contract"}, "error_model": "numpy"}


@numba.njit(**OPTIONS)
def decompose(S):
    """F in rows 0 to 8; U from row 9 on, s from 18, V from 21."""
    for i in range(LANES):
        F = (S[i], S[LANES + i], S[2 * LANES + i], S[3 * LANES + i], S[4 * LANES + i], S[5 * LANES + i],
             S[6 * LANES + i], S[7 * LANES + i], S[8 * LANES + i])  # fmt: skip
        U, s, V = singular_values(F)
        out = U + s + V
        for j in range(21):
            S[(9 + j) * LANES + i] = out[j]


@numba.njit(**OPTIONS)
def diagonalise(S):
    """F in rows 0 to 8; eigenvalues of F + F^T from row 9 on, Q by columns from 12."""
    for i in range(LANES):
        A = (S[i] + S[i], S[LANES + i] + S[3 * LANES + i], S[2 * LANES + i] + S[6 * LANES + i],
             S[4 * LANES + i] + S[4 * LANES + i], S[5 * LANES + i] + S[7 * LANES + i],
             S[8 * LANES + i] + S[8 * LANES + i])  # fmt: skip
        values, Q = eigenvectors(A)
        out = values + Q[0] + Q[1] + Q[2]
        for j in range(12):
            S[(9 + j) * LANES + i] = out[j]


def in_tiles(loop, F, rows):
    tiles = to_tiles(F, rows=rows)
    for tile in tiles:
        loop(tile)
    return tiles


def assert_rotations(Q, tolerance):
    np.testing.assert_allclose(Q.transpose(0, 2, 1) @ Q, np.broadcast_to(np.eye(3), Q.shape), rtol=0, atol=tolerance)
    assert (np.linalg.det(Q) > 0.5).all()


@pytest.mark.parametrize("precision", TOLERANCE)
@pytest.mark.parametrize("family", GRADIENTS)
def test_singular_values(family, precision):
    F, tolerance = GRADIENTS[family].astype(precision), TOLERANCE[precision]
    tiles = in_tiles(decompose, F, 30)
    U, s, V = from_tiles(tiles, 9), from_tiles(tiles, 18, 3), from_tiles(tiles, 21)
    U, s, V, F = (a.astype(np.float64) for a in (U.reshape(-1, 3, 3), s, V.reshape(-1, 3, 3), F))
    expected = np.linalg.svd(F, compute_uv=False)
    largest = expected[:, :1] + np.finfo(np.float64).tiny
    np.testing.assert_allclose(((U * s[:, None]) @ V.transpose(0, 2, 1) - F) / largest[..., None], 0, atol=tolerance)
    np.testing.assert_allclose(np.abs(s) / largest, expected / largest, rtol=0, atol=tolerance)
    assert_rotations(U, tolerance)
    assert_rotations(V, tolerance)
    assert (s[:, :2] >= -tolerance * largest).all()
    regular = expected[:, 2] > 10 * tolerance * expected[:, 0]
    assert (np.sign(s[:, 2]) == np.sign(np.linalg.det(F)))[regular].all()


@pytest.mark.parametrize("precision", TOLERANCE)
@pytest.mark.parametrize("family", [f for f in GRADIENTS if f != "tiny"])
def test_eigenvectors(family, precision):
    F, tolerance = GRADIENTS[family].astype(precision), TOLERANCE[precision]
    tiles = in_tiles(diagonalise, F, 21)
    values, Q = from_tiles(tiles, 9, 3).astype(np.float64), from_tiles(tiles, 12).astype(np.float64)
    A, Q = (F + F.transpose(0, 2, 1)).astype(np.float64), Q.reshape(-1, 3, 3).transpose(0, 2, 1)
    largest = np.abs(A).max(axis=(1, 2), keepdims=True) + np.finfo(np.float64).tiny
    np.testing.assert_allclose(((Q * values[:, None]) @ Q.transpose(0, 2, 1) - A) / largest, 0, atol=3 * tolerance)
    error = (np.sort(values, axis=1) - np.linalg.eigvalsh(A)) / largest[..., 0]
    np.testing.assert_allclose(error, 0, atol=3 * tolerance)
    assert_rotations(Q, tolerance)


@pytest.mark.parametrize("loop", [decompose, diagonalise])
def test_float32_stays_float32(loop):
    array = numba.types.Array(numba.float32, 1, "C")
    loop.compile((array,))
    arithmetic = [line for line in loop.inspect_llvm((array,)).splitlines() if " = f" in line]
    assert any("float" in line for line in arithmetic)
    assert not any("double" in line for line in arithmetic)
