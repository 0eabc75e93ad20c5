# SPDX-License-Identifier: BSD-3-Clause
"""Smoothing kernels against dense matrices.

1. The polynomial of degree k is the scaled Chebyshev polynomial: on the interval its error is bounded by 1 / T_k.
2. Inverse blocks, the fused step, residual, restriction and prolongation are what their formulas say.
3. The power iteration finds lambda_max(D^-1 A) to 10% from below in 15 steps.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from femgal.assembly import smoothing
from femgal.assembly.hessian import assemble
from verify.problems.bodies import distorted_box, left_end, positions, rng, varied

MESH = distorted_box((6, 4, 4))
DISC = varied(MESH, left_end(MESH))
A = assemble(DISC, positions(MESH, "random"), 1e4)
FULL = A.to_scipy().toarray()
N = A.n_rows


def inverse_blocks() -> np.ndarray:
    inverse = np.empty((N, 6))
    smoothing.invert_blocks(0, N, A.pattern.diagonal, A.values, inverse)
    return inverse


def block_diagonal() -> np.ndarray:
    return scipy.linalg.block_diag(*(FULL[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(N)))


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_chebyshev(degree):
    lowest, highest = 0.3, 2.0
    t = np.linspace(lowest, highest, 400)
    x, d = np.zeros_like(t), np.zeros_like(t)
    for a, b in smoothing.chebyshev_coefficients(lowest, highest, degree):
        d = a * d + b * (1.0 - t * x)
        x = x + d
    bound = 1.0 / np.cosh(degree * np.arccosh((highest + lowest) / (highest - lowest)))
    assert np.abs(1.0 - t * x).max() == pytest.approx(bound, rel=1e-10)


def test_steps():
    r, x, before = rng(430).standard_normal((3, N, 3))
    inverse = np.linalg.inv(block_diagonal())
    expected = r.ravel() - FULL @ x.ravel()
    out, d = np.empty_like(r), np.empty_like(r)
    smoothing.subtract_product(0, N, A.pattern.ptr, A.pattern.column, A.values, x, r, out)
    np.testing.assert_allclose(out.ravel(), expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    smoothing.scale_blocks(0, N, inverse_blocks(), 0.7, r, out)
    np.testing.assert_allclose(out.ravel(), 0.7 * inverse @ r.ravel(), rtol=1e-9, atol=1e-20)
    matrix = (A.pattern.ptr, A.pattern.column, A.values, inverse_blocks())
    smoothing.smooth(0, N, *matrix, 0.4, 0.7, r, x, before, d, out)
    step = 0.4 * before.ravel() + 0.7 * inverse @ expected
    np.testing.assert_allclose(d.ravel(), step, rtol=0, atol=1e-12 * np.abs(step).max())
    np.testing.assert_allclose(out, x + d, rtol=0, atol=1e-15 * np.abs(out).max())


def test_transfer():
    parent = np.array([[0, 1], [1, -1], [2, 0]], np.int32)
    weight = np.array([[0.75, 0.25], [1.0, 0.0], [0.5, 0.5]])
    P = np.array([[0.75, 0.25, 0.0], [0.0, 1.0, 0.0], [0.5, 0.0, 0.5]])
    e, x, out = np.arange(9.0).reshape(3, 3), np.ones((3, 3)), np.empty((3, 3))
    smoothing.prolong(0, 3, parent, weight, e, x)
    np.testing.assert_allclose(x, 1.0 + P @ e)
    child_ptr, child = np.array([0, 2, 4, 5]), np.array([0, 2, 0, 1, 2], np.int32)
    smoothing.restrict(0, 3, child_ptr, child, np.array([0.75, 0.5, 0.25, 1.0, 0.5]), e, out)
    np.testing.assert_allclose(out, P.T @ e)


def test_largest_eigenvalue():
    exact = scipy.linalg.eigh(FULL, block_diagonal(), eigvals_only=True)[-1]
    v = rng(431).standard_normal((N, 3))
    estimate = smoothing.largest_eigenvalue(A, inverse_blocks(), v, 15)
    assert 0.9 * exact <= estimate <= (1.0 + 1e-12) * exact
    again = smoothing.largest_eigenvalue(A, inverse_blocks(), v, 100)
    assert again == pytest.approx(exact, rel=1e-2)
