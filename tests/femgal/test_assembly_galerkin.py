# SPDX-License-Identifier: BSD-3-Clause
"""Galerkin products.

1. P^T A P is that of sparse matrices, on every level, to rounding of the precision of A; bitwise symmetric.
2. The number of threads changes no bit.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp

from femgal.assembly.galerkin import GalerkinProduct
from femgal.assembly.hessian import HessianAssembly
from femgal.assembly.lattices import lattice_chain
from femgal.assembly.matrix import BlockMatrix
from femgal.assembly.transfer import Transfer
from femgal.kernels.cpu.threads import Workers
from verify.problems.bodies import distorted_box, left_end, positions, varied

MESH = distorted_box((14, 9, 9))
DISC = varied(MESH, left_end(MESH))


@cache
def hessian(precision: str) -> BlockMatrix:
    return HessianAssembly(DISC, precision, 1).assemble(positions(MESH, "random"), 1e4)


@cache
def chain() -> list[GalerkinProduct]:
    return lattice_chain(DISC, hessian("float64").pattern, 10, "float64")


def sparse(t: Transfer) -> sp.csr_matrix:
    row, k = np.nonzero(t.parent >= 0)
    return sp.csr_matrix((t.weight[row, k], (row, t.parent[row, k])), shape=(t.n_fine, t.n_coarse))


@pytest.mark.parametrize(("precision", "tolerance"), [("float64", 1e-13), ("float32", 1e-6)])
def test_product(precision, tolerance):
    A = hessian(precision)
    assert len(chain()) >= 3
    for product in chain():
        coarse, P = product.matrix(A), sp.kron(sparse(product.transfer), sp.eye(3))
        product.coarsen(A, coarse)
        full = coarse.to_scipy().toarray()
        expected = (P.T @ A.to_scipy().astype(np.float64) @ P).toarray()
        np.testing.assert_allclose(full, expected, rtol=0, atol=tolerance * np.abs(expected).max())
        np.testing.assert_array_equal(full, full.T)
        A = coarse


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_bit(threads):
    A = hessian("float32")
    one, several = (chain()[0].matrix(A) for _ in range(2))
    chain()[0].coarsen(A, one)
    chain()[0].coarsen(BlockMatrix(A.pattern, A.values, Workers(threads)), several)
    np.testing.assert_array_equal(several.values, one.values)
