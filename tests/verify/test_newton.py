# SPDX-License-Identifier: BSD-3-Clause
"""The reference Newton solver.

1. It ends at a stationary point whose Hessian is positive definite, from near and from far.
2. The value falls in every step.
3. solve_definite gives the solution of a definite system, and a descent direction of an indefinite one.
4. backtrack takes the full step where that is good, and a shorter one where it is not; motions so small that rounding
   hides their energy end as well.
5. Nothing that production's potential says of h or of masses reaches the minimiser; no end is an error.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from femgal.timestep.potential import IncrementalPotential
from verify.problems.bodies import distorted_box, left_end, potential_at, rng, varied
from verify.reference.newton import ReferenceNewton, StepMinimiser, backtrack, solve_definite
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

MESH = distorted_box((4, 2, 2))
DISC = varied(MESH, left_end(MESH))


@pytest.mark.parametrize("size", [0.01, 0.3])
def test_minimiser(size):
    xhat = MESH.points + size * DISC.free[:, None] * rng(321).standard_normal(MESH.points.shape)
    phi = potential_at(DISC, xhat, 0.05)
    solver = ReferenceNewton(DISC)
    state = solver.init(phi, {})
    values = [phi.value(state.x)]
    while solver.finished(phi, state) is None:
        state = solver.step(phi, state)
        values.append(phi.value(state.x))
    scale = np.linalg.norm(phi.gradient(xhat))
    assert np.linalg.norm(phi.gradient(state.x)) < 1e-9 * scale
    assert (np.diff(values) <= 1e-12 * abs(values[0])).all()
    for salt in range(20):
        d = DISC.free[:, None] * rng(322 + salt).standard_normal(MESH.points.shape)
        assert (d * phi.hessian_product(state.x, d)).sum() > 0.0


@pytest.mark.parametrize("size", [1e-7, 1e-9, 1e-11])
def test_minimiser_of_a_motion_whose_energy_drowns_in_rounding(size):
    # A stiff body: 1 / h^2 is no help, and terms of 3 mu / 2 cancel in its energy.
    stiff = replace(DISC, mu=1e4 * DISC.mu, lam=1e4 * DISC.lam)
    newton = StepMinimiser(MESH, stiff.mu, stiff.lam, stiff.mass, stiff.free)
    xhat = MESH.points + size * DISC.free[:, None] * rng(323).standard_normal(MESH.points.shape)
    moved = np.abs(newton(xhat, 1.0) - MESH.points).max()
    assert 0.0 < moved < size


def test_solve_definite():
    A = rng(350).standard_normal((12, 12))
    A = A @ A.T + np.eye(12)
    b = rng(351).standard_normal(12)
    np.testing.assert_allclose(solve_definite(sp.csr_matrix(A), b), np.linalg.solve(A, b), rtol=1e-9)
    indefinite = A - 0.5 * np.linalg.eigvalsh(A)[-1] * np.eye(12)
    assert b @ solve_definite(sp.csr_matrix(indefinite), b) > 0.0


def test_backtrack():
    assert backtrack(lambda t: -t + 0.5 * t * t, -1.0) == 1.0
    t = backtrack(lambda t: -t + 50.0 * t * t, -1.0)
    assert 0.0 < t < 0.02


def test_minimiser_of_a_step():
    xhat = MESH.points + 0.05 * DISC.free[:, None] * rng(352).standard_normal(MESH.points.shape)
    newton = StepMinimiser(MESH, DISC.mu, DISC.lam, DISC.mass, DISC.free)
    phi = potential_at(DISC, xhat, 0.05)
    assert np.linalg.norm(phi.gradient(newton(xhat, 0.05))) < 1e-9 * np.linalg.norm(phi.gradient(xhat))
    with pytest.raises(ArithmeticError, match="not converged in 1 steps"):
        replace(newton, iterations=1)(xhat, 0.05)


@pytest.mark.parametrize("row", choose("stepping/one-step[fas,box,long] cycles/fixed-point[jacobi,float64]"), ids=str)
def test_h_in_place_of_h2_is_noticed(monkeypatch, row):
    monkeypatch.setattr(IncrementalPotential, "inverse_h2", property(lambda phi: phi.inertia / phi.h))
    assert run_row(row, Use()).status is Status.FAIL
