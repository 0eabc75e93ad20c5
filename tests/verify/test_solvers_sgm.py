# SPDX-License-Identifier: BSD-3-Clause
"""Multigrid on affine handles.

1. The cycle is symmetric, positive definite, and the product of its smoothings and coarse correction.
2. With conjugate gradients or cycles alone, Newton's method converges to the reference's minimiser, held or free.
3. On a stiff system it needs far fewer iterations than block Jacobi; cycles alone need more than conjugate gradients.
4. An indefinite Hessian is noticed, on the vertices or on a coarse level, and its definite part taken.
5. One multigrid iteration is one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from femgal.solvers.solver import Outcome
from tests.verify.test_solvers_handles import composed
from tests.verify.thrown_beam import MESH, X, body, distance, minimiser, solved, thrown
from verify.problems.bodies import positions, rng
from verify.reference.transfer import block_diagonal, unpacked
from verify.solvers.newton import Newton
from verify.solvers.sgm import SGM
from verify.solvers.system import AssembledJacobi

PHI, DISC = thrown(), body()


def system(phi=PHI, **settings) -> SGM:
    """Levels small enough for this body to have three."""
    return SGM(phi.backend, **{"cluster": 24, "ratio": 4, **settings})


def rows(salt: int) -> np.ndarray:
    """Random rows of the free vertices."""
    return rng(salt).standard_normal((int(DISC.free.sum()), 3))


@pytest.mark.parametrize("smoothings", [1, 2])
def test_cycle(monkeypatch, smoothings):
    monkeypatch.setattr("verify.solvers.sgm.BOTTOM", 8)
    one = system(smoothings=smoothings)
    one.linearise(PHI, PHI.xhat, definite=False)
    assert len(one._levels) == 2
    r, s = rows(380), rows(381)
    Mr, Ms = one.precondition(r), one.precondition(s)
    assert np.isclose((s * Mr).sum(), (r * Ms).sum(), rtol=1e-10)
    assert (r * Mr).sum() > 0.0


def test_two_levels_as_matrices():
    one = system()
    one.linearise(PHI, PHI.xhat, definite=False)
    A, r = one.matrix.to_scipy().toarray(), rows(382)
    P = np.kron(composed(one._handles)[0], np.eye(3))
    x = one._smoothers[0].first(r).ravel()
    x += P @ np.linalg.solve(P.T @ A @ P, P.T @ (r.ravel() - A @ x))
    x += one._smoothers[0].first((r.ravel() - A @ x).reshape(-1, 3)).ravel()
    np.testing.assert_allclose(one.precondition(r).ravel(), x, atol=1e-10 * np.abs(x).max())


def test_smoothing_step():
    one = system()
    one.linearise(PHI, PHI.xhat, definite=False)
    # Asked again the estimate goes on from the last one, and ends near the largest eigenvalue of D^-1 A.
    for _ in range(20):
        one.linearise(PHI, PHI.xhat, definite=False)
    H = unpacked(one.matrix.diagonal_blocks())
    D, A = block_diagonal(H).toarray(), one.matrix.to_scipy().toarray()
    largest = eigh(A, D, eigvals_only=True, subset_by_index=[len(A) - 1, len(A) - 1])[0]
    assert np.isclose(4.0 / 3.0 / one._smoothers[0]._w, largest, rtol=0.02)


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("accelerate", [True, False])
def test_converges_to_the_minimiser(accelerate, held):
    phi = thrown(held=held)
    state = solved(Newton(phi.backend, system(phi, accelerate=accelerate), tolerance=1e-11), phi)
    assert state.outcome is Outcome.CONVERGED
    assert distance(state.x, phi, minimiser(held=held)) <= 1e-9


def test_iterations_of_a_stiff_system():
    phi = thrown(E=1e7, rho=1.0)
    needed = []
    for one in (system(phi), system(phi, accelerate=False), AssembledJacobi(phi.backend)):
        one.linearise(phi, X, definite=False)
        needed.append(one.solve(rows(383), 1e-6).iterations)
    assert needed[0] < needed[1]
    assert needed[0] < 0.3 * needed[2]


@pytest.mark.parametrize("accelerate", [True, False])
def test_indefinite(accelerate):
    crushed = np.where(DISC.free[:, None], positions(MESH, "random"), X)
    slow = replace(PHI, xhat=crushed, x_n=crushed, h=1.0)
    solver = Newton(slow.backend, system(slow, accelerate=accelerate), iterations=60)
    with pytest.raises(np.linalg.LinAlgError):
        solver.system.linearise(slow, crushed, definite=False)
    assert solved(solver, slow).outcome is Outcome.CONVERGED
    assert solver.effort.definite > 0


def test_cycles_notice_what_no_factor_does():
    # Indefinite on the vertices alone: the coarse matrix is positive definite.
    one = system(accelerate=False)
    one.linearise(PHI, PHI.xhat, definite=False)
    diagonal = one.matrix.pattern.diagonal[7]
    one.matrix.values[diagonal] -= 3.0 * one.matrix.values[diagonal]
    assert not one.solve(rows(384), 1e-6).definite


def test_one_multigrid_iteration():
    solver = Newton(PHI.backend, system(iterations=1, accelerate=False), iterations=1)
    state = solved(solver, PHI)
    assert (solver.effort.newton, solver.effort.linear, state.iteration) == (1, 1, 1)
    assert 0.0 < distance(state.x, PHI, minimiser()) < 0.6
