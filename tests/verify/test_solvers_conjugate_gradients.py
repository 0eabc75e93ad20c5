# SPDX-License-Identifier: BSD-3-Clause
"""Conjugate gradients of the baselines.

1. They solve a system to the relative residual asked for, and the residual that they report is the true one.
2. In k dimensions they end after k iterations, with A itself as preconditioner after one.
3. An indefinite matrix is reported, with the iterate before it was noticed.
4. Nothing to solve costs nothing.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.kernels.cpu.backend import CpuBackend
from tests.verify.thrown_beam import body
from verify.problems.bodies import rng
from verify.solvers.conjugate_gradients import conjugate_gradients

BACKEND = CpuBackend(body(), 1)
K = 4


def matrix(*eigenvalues: float) -> np.ndarray:
    """Symmetric matrix with these eigenvalues, and ones for the rest."""
    Q = np.linalg.qr(rng(330).standard_normal((3 * K, 3 * K)))[0]
    values = np.ones(3 * K)
    values[: len(eigenvalues)] = eigenvalues
    return Q @ np.diag(values) @ Q.T


def times(A: np.ndarray):
    """The matrix as a map of rows."""
    return lambda p: (A @ p.ravel()).reshape(-1, 3)


def unchanged(r: np.ndarray) -> np.ndarray:
    """No preconditioner."""
    return r.copy()


B = rng(331).standard_normal((K, 3))


@pytest.mark.parametrize("tolerance", [1e-1, 1e-4, 1e-10])
def test_residual(tolerance):
    A = matrix(*np.geomspace(1.0, 1e3, 3 * K))
    found = conjugate_gradients(BACKEND, times(A), unchanged, B, tolerance, 100)
    true = np.linalg.norm(B - times(A)(found.d)) / np.linalg.norm(B)
    assert found.definite
    assert found.reduction <= tolerance
    assert np.isclose(true, found.reduction, rtol=1e-3, atol=1e-13)


def test_as_many_iterations_as_eigenvalues():
    assert conjugate_gradients(BACKEND, times(matrix(5.0, 50.0)), unchanged, B, 1e-10, 100).iterations == 3
    A = matrix(*np.geomspace(1.0, 1e3, 3 * K))
    assert conjugate_gradients(BACKEND, times(A), times(np.linalg.inv(A)), B, 1e-10, 100).iterations == 1


def test_no_more_than_allowed():
    found = conjugate_gradients(BACKEND, times(matrix(*np.geomspace(1.0, 1e3, 3 * K))), unchanged, B, 1e-10, 2)
    assert found.iterations == 2
    assert found.reduction > 1e-10


def test_indefinite():
    found = conjugate_gradients(BACKEND, times(matrix(-5.0, 50.0)), unchanged, B, 1e-10, 100)
    assert not found.definite
    assert found.iterations < 3
    assert not conjugate_gradients(BACKEND, times(matrix()), times(-matrix()), B, 1e-10, 100).definite


def test_nothing_to_solve():
    found = conjugate_gradients(BACKEND, times(matrix()), unchanged, np.zeros_like(B), 1e-10, 100)
    assert (found.iterations, found.reduction) == (0, 0.0)
    assert not found.d.any()
