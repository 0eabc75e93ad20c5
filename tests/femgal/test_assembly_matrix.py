# SPDX-License-Identifier: BSD-3-Clause
"""Block matrices.

1. The product is that of the dense matrix, in both precisions and with a float64 vector times float32 values.
2. Diagonal blocks and the matrix for SciPy hold the values.
3. The same bits for 1, 2 and 3 threads.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.assembly.matrix import BlockMatrix
from femgal.assembly.pattern import vertex_pattern
from femgal.kernels.cpu.threads import Workers
from verify.problems.bodies import distorted_box, left_end, rng, uniform

MESH = distorted_box((8, 6, 6))
PATTERN = vertex_pattern(uniform(MESH, left_end(MESH)))
VALUES = rng(400).standard_normal((PATTERN.n_blocks, 9))
D = rng(401).standard_normal((PATTERN.n_rows, 3))


def dense() -> np.ndarray:
    A = np.zeros((3 * PATTERN.n_rows, 3 * PATTERN.n_rows))
    for i in range(PATTERN.n_rows):
        for j in range(PATTERN.ptr[i], PATTERN.ptr[i + 1]):
            k = PATTERN.column[j]
            A[3 * i : 3 * i + 3, 3 * k : 3 * k + 3] = VALUES[j].reshape(3, 3)
    return A


@pytest.mark.parametrize(
    ("precision", "of_d", "tolerance"),
    [("float64", "float64", 1e-14), ("float32", "float32", 1e-6), ("float32", "float64", 1e-6)],
)
def test_product(precision, of_d, tolerance):
    A = BlockMatrix(PATTERN, VALUES.astype(precision), Workers(1))
    expected = (dense() @ D.ravel()).reshape(-1, 3)
    product = A.product(D.astype(of_d))
    assert product.dtype == of_d
    np.testing.assert_allclose(product, expected, rtol=0, atol=tolerance * np.abs(expected).max())
    np.testing.assert_allclose(A.to_scipy().toarray(), dense(), rtol=0, atol=1e-6)


def test_diagonal_blocks():
    A = BlockMatrix(PATTERN, VALUES, Workers(1))
    full = dense().reshape(PATTERN.n_rows, 3, PATTERN.n_rows, 3)
    i, j = np.triu_indices(3)
    expected = [full[k, i, k, j] for k in range(PATTERN.n_rows)]
    np.testing.assert_array_equal(A.diagonal_blocks(), expected)


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_bit(threads):
    one = BlockMatrix(PATTERN, VALUES, Workers(1)).product(D)
    np.testing.assert_array_equal(BlockMatrix(PATTERN, VALUES, Workers(threads)).product(D), one)
