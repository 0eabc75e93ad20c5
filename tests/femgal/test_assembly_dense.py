# SPDX-License-Identifier: BSD-3-Clause
"""Direct solution of small block matrices.

1. The solution is NumPy's, to the shift and the rounding of the precision; after a refresh that of the new values.
2. A matrix without mass of a free body, six of whose eigenvalues are zero, is solved for a right-hand side in
   equilibrium.
3. A slightly indefinite matrix gets a larger shift; one that is not finite or has a negative diagonal gives what is
   not a number.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg.lapack
from threadpoolctl import threadpool_info, threadpool_limits

from femgal.assembly.dense import SHIFT, DenseSolver
from femgal.assembly.hessian import HessianAssembly, assemble
from verify.problems.bodies import distorted_box, left_end, positions, rng, varied

MESH = distorted_box((4, 3, 3))
DISC = varied(MESH, left_end(MESH))


@pytest.mark.parametrize(("precision", "tolerance"), [("float64", 1e-3), ("float32", 2e-3)])
def test_solution(precision, tolerance):
    assembly = HessianAssembly(DISC, precision, 1)
    A = assembly.matrix()
    solver = DenseSolver(A)
    r = rng(420).standard_normal((A.n_rows, 3)).astype(precision)
    for x in (MESH.points, positions(MESH, "random")):
        assembly.assemble(x, 1e4, out=A)
        solver.refresh()
        assert solver.shift == SHIFT
        expected = np.linalg.solve(A.to_scipy().toarray().astype(np.float64), r.ravel()).reshape(-1, 3)
        np.testing.assert_allclose(solver.solve(r), expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_singular():
    disc = varied(MESH)
    A = assemble(disc, MESH.points, 0.0)
    d = rng(421).standard_normal((A.n_rows, 3))
    solver = DenseSolver(A)
    solver.refresh()
    r = A.product(d)
    np.testing.assert_allclose(A.product(solver.solve(r).copy()), r, rtol=0, atol=1e-3 * np.abs(r).max())


def test_not_definite():
    A = assemble(DISC, MESH.points, 1e4)
    A.values[A.pattern.diagonal[:, None], [0, 4, 8]] *= 0.9
    solver = DenseSolver(A)
    solver.refresh()
    assert solver.shift > SHIFT
    r = np.ones((A.n_rows, 3))
    assert np.isfinite(solver.solve(r)).all()
    for value in (np.nan, -1.0):
        A.values[A.pattern.diagonal[3], 4] = value
        solver.refresh()
        assert np.isnan(solver.solve(r)).any()


def test_one_thread(monkeypatch):
    def threads():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    inside, dpotrf = [], scipy.linalg.lapack.dpotrf
    monkeypatch.setattr("scipy.linalg.lapack.dpotrf", lambda *a, **k: inside.append(threads()) or dpotrf(*a, **k))
    with threadpool_limits(2, user_api="blas"):
        given = threads()
        DenseSolver(assemble(DISC, MESH.points, 1e4)).refresh()
        assert inside == [{1}]
        assert threads() == given
    assert given == {2}
