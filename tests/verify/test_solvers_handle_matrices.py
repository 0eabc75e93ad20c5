# SPDX-License-Identifier: BSD-3-Clause
"""Galerkin matrices of affine handles.

1. On every level they are P^T A P, and products, dense form and blocks on the diagonal are those of that matrix.
2. Restriction is the transpose of prolongation, and both are those of P.
3. Functions that a flat cluster has not get a positive diagonal and no coupling.
4. The number of threads changes no bit.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.assembly.hessian import HessianAssembly
from femgal.discretisation import discretise
from femgal.kernels.cpu.threads import Workers
from meshes.generators import box
from tests.verify.test_solvers_handles import LEVELS, composed, prolongation
from tests.verify.thrown_beam import body, thrown
from verify.problems.bodies import rng
from verify.solvers import handle_matrices
from verify.solvers.handle_matrices import HandleMatrix
from verify.solvers.handles import build_handles

A = HessianAssembly(body(), "float64", 1).assemble(thrown().xhat, thrown().inverse_h2, definite=False)


def projected(levels, fine=A, workers=None) -> list[HandleMatrix]:
    """Matrices of all levels."""
    found, pattern, transposed = [], fine.pattern, fine.values.reshape(-1, 3, 3).transpose(0, 2, 1)
    for handles in levels:
        matrix = HandleMatrix.of(pattern, handles, workers or Workers(1))
        matrix.project(pattern, transposed, handles)
        found.append(matrix)
        pattern, transposed = matrix.pattern, matrix.values
    return found


MATRICES = projected(LEVELS)


@pytest.mark.parametrize("number", range(len(LEVELS)))
def test_galerkin(number):
    P = np.kron(composed(LEVELS[: number + 1])[0], np.eye(3))
    exact = P.T @ A.to_scipy().toarray() @ P
    matrix, tolerance = MATRICES[number], 1e-12 * np.abs(exact).max()
    empty = np.flatnonzero(np.repeat(LEVELS[number].unused().ravel(), 3))
    assert not exact[empty].any()
    exact[empty, empty] = matrix.dense()[empty, empty]
    assert (exact[empty, empty] > 0.0).all()
    np.testing.assert_allclose(matrix.dense(), exact, atol=tolerance)
    d = rng(370).standard_normal((matrix.pattern.n_rows, 12))
    np.testing.assert_allclose(matrix.product(d).ravel(), exact @ d.ravel(), atol=20 * tolerance)
    inverses = matrix.diagonal_inverses()
    for c in range(matrix.pattern.n_rows):
        block = exact[12 * c : 12 * c + 12, 12 * c : 12 * c + 12]
        np.testing.assert_allclose(inverses[c] @ block, np.eye(12), atol=1e-8)
    np.testing.assert_allclose(
        handle_matrices.multiply_blocks(Workers(1), inverses, d), np.einsum("cij,cj->ci", inverses, d), rtol=1e-9
    )


@pytest.mark.parametrize("number", [0, 1])
def test_transfer(number):
    handles, workers = LEVELS[number], Workers(1)
    P = np.kron(prolongation(handles), np.eye(3))
    k, a, _ = handles.q.shape
    r, d = rng(371).standard_normal((k, 3 * a)), rng(372).standard_normal((handles.n_clusters, 12))
    np.testing.assert_allclose(handle_matrices.restrict(handles, workers, r).ravel(), P.T @ r.ravel(), atol=1e-12)
    x = r.copy()
    handle_matrices.prolong(handles, workers, d, x)
    np.testing.assert_allclose(x.ravel(), r.ravel() + P @ d.ravel(), atol=1e-12)


def test_flat_clusters():
    mesh = box((1.0, 1.0, 0.2), (6, 6, 2))
    disc = discretise(mesh, 1e5, 0.4, 1000.0, np.flatnonzero(np.abs(mesh.points[:, 2] - 0.1) > 0.05))
    fine = HessianAssembly(disc, "float64", 1).assemble(mesh.points, 3600.0, definite=False)
    levels = build_handles(disc, 12, 2, 2)
    for matrix in projected(levels, fine):
        assert np.linalg.eigvalsh(matrix.dense()).min() > 0.0


def test_threads_change_no_bit(monkeypatch):
    monkeypatch.setattr("femgal.kernels.cpu.threads.SMALLEST_SHARE", 1)
    several = projected(LEVELS, workers=Workers(3))
    assert all(np.array_equal(a.values, b.values) for a, b in zip(several, MATRICES, strict=True))
