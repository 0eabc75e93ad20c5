# SPDX-License-Identifier: BSD-3-Clause
"""3x3 tensor algebra against NumPy.

1. Cofactor: C^T F = det F I for every F, singular ones included; columns are cross products of F's columns.
2. Cofactor increment: exact mixed product, cof(F + G) = cof F + dC[G] + cof G, and symmetric in F and G.
3. Determinant, contraction, transpose, matrix-vector and matrix-matrix products and linear combinations equal NumPy's.
4. `like` gives literals of the same type.
"""

from __future__ import annotations

import numba
import numpy as np
import pytest

from femgal.materials import tensor
from femgal.materials.tensor import (
    apply,
    cofactor,
    cofactor_increment,
    combine,
    contract,
    determinant,
    like,
    multiply,
    transpose,
)
from verify.problems.bodies import rng


@numba.njit
def everything(A, B):
    """All functions at once: one compilation instead of eight."""
    C = cofactor(A)
    increment, product = cofactor_increment(A, B), multiply(A, transpose(B))
    scalars = (determinant(A, C), contract(A, B))
    return C, increment, product, scalars, apply(A, (B[0], B[1], B[2])), combine(2.0, A, -3.0, B)


def tensors(salt: int) -> list[np.ndarray]:
    random = rng(salt).standard_normal((4, 3, 3))
    return [*random, np.eye(3), np.diag([1.0, 0.0, 0.0]), np.outer(random[0, 0], random[1, 1]), np.zeros((3, 3))]


def call(A: np.ndarray, B: np.ndarray):
    return [np.array(result) for result in everything(tuple(A.ravel()), tuple(B.ravel()))]


@pytest.mark.parametrize("A", tensors(50))
@pytest.mark.parametrize("B", tensors(51)[3:6])
def test_against_numpy(A, B):
    C, increment, product, scalars, applied, combined = call(A, B)
    C = C.reshape(3, 3)
    close = {"rtol": 1e-13, "atol": 1e-13}
    np.testing.assert_allclose(C.T @ A, np.linalg.det(A) * np.eye(3), **close)
    np.testing.assert_allclose(C[:, 0], np.cross(A[:, 1], A[:, 2]), **close)
    np.testing.assert_allclose(C[:, 1], np.cross(A[:, 2], A[:, 0]), **close)
    np.testing.assert_allclose(C[:, 2], np.cross(A[:, 0], A[:, 1]), **close)
    np.testing.assert_allclose(C.ravel() + increment + call(B, A)[0], call(A + B, A)[0], **close)
    np.testing.assert_allclose(increment, call(B, A)[1], **close)
    np.testing.assert_allclose(scalars, [np.linalg.det(A), (A * B).sum()], **close)
    np.testing.assert_allclose(product.reshape(3, 3), A @ B.T, **close)
    np.testing.assert_allclose(applied, A @ B[0], **close)
    np.testing.assert_allclose(combined.reshape(3, 3), 2.0 * A - 3.0 * B, **close)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_like(kind):
    assert type(like(kind(3.0), 0.5)) is kind

    @numba.njit
    def literal(x):
        return tensor.like(x, 0.5)

    literal(kind(3.0))
    (signature,) = literal.nopython_signatures
    assert signature.return_type == numba.from_dtype(np.dtype(kind))
