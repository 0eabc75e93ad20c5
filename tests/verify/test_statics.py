# SPDX-License-Identifier: BSD-3-Clause
"""The reference solver for statics.

1. It ends where forces and load balance, with steps that shrink quadratically.
2. Algebraic multigrid and the sparse factorisation lead to the same positions.
3. Production's forces lead to the positions of scikit-fem's.
4. Quadratic elements on rollers give the hanging bar, a parabola, to rounding at finite strain.
5. Rigid body modes are the null space of the stiffness at rest.
6. Multigrid says when it has no solution: a body that nothing holds, pushed.
7. Forces that are no gradient of the energy are solved for all the same: it ends where they balance the load.
8. Steps are shortened where a whole one goes too far, and an end that is none is an error.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from femgal.kernels.cpu.backend import CpuBackend
from tests.verify.wrong_forces import FACTOR, StrongBackend
from verify.problems.bodies import distorted_box, left_end, uniform, varied
from verify.reference.elasticity import AssembledElasticity, consistent_mass
from verify.reference.statics import ProductionElasticity, equilibrium, rigid_body_modes, solve_by_multigrid

MESH = distorted_box((6, 3, 3))
DISC = varied(MESH, left_end(MESH))
REFERENCE = AssembledElasticity(MESH, DISC.mu, DISC.lam)
LOAD = DISC.mass[:, None] * np.array([0.0, 0.0, -10.0])
FREE = np.repeat(DISC.free[:, None], 3, axis=1)


def hanging(elasticity=REFERENCE, linear="direct"):
    return equilibrium(elasticity, LOAD, FREE, MESH.points, linear=linear)


def test_equilibrium():
    result = hanging()
    residual = (REFERENCE.gradient(result.x) - LOAD)[DISC.free]
    assert np.abs(residual).max() < 1e-9 * np.abs(LOAD).max()
    assert result.steps[-1] < result.steps[-2] ** 1.5
    assert np.abs(result.x - MESH.points).max() > 1e-3


def test_linear_solvers_agree():
    np.testing.assert_allclose(hanging(linear="multigrid").x, hanging().x, atol=1e-11)


def test_production_forces():
    np.testing.assert_allclose(hanging(ProductionElasticity.of(CpuBackend(DISC, 1))).x, hanging().x, atol=1e-11)


def test_quadratic_elements_hang_in_a_parabola():
    disc = uniform(MESH)
    elasticity = AssembledElasticity(MESH, disc.mu, disc.lam, degree=2)
    X, length = elasticity.nodes, float(np.ptp(MESH.points[:, 0]))
    rho = 0.4 * (disc.mu[0] + disc.lam[0]) / (10.0 * length)
    load = consistent_mass(MESH, rho, 2) @ np.ones((len(X), 1)) * [10.0, 0.0, 0.0]
    free = np.zeros(X.shape, bool)
    free[X[:, 0] > 0.0, 0] = True
    result = equilibrium(elasticity, load, free, X)
    exact = rho * 10.0 * (length * X[:, 0] - 0.5 * X[:, 0] ** 2) / (disc.mu[0] + disc.lam[0])
    np.testing.assert_allclose(result.x[:, 0] - X[:, 0], exact, atol=1e-12)


@pytest.mark.parametrize("degree", [1, 2])
def test_rigid_body_modes(degree):
    elasticity = AssembledElasticity(MESH, DISC.mu, DISC.lam, degree)
    K, modes = elasticity.hessian(elasticity.nodes), rigid_body_modes(elasticity.nodes)
    assert np.linalg.matrix_rank(modes) == 6
    assert np.abs(K @ modes).max() < 1e-9 * abs(K).max()


def test_multigrid_says_when_it_fails():
    pushed = np.ones(3 * DISC.n_vertices)
    with pytest.raises(ArithmeticError, match="unknowns"):
        solve_by_multigrid(REFERENCE.hessian(MESH.points), pushed, rigid_body_modes(MESH.points))


def test_forces_alone_decide():
    production = ProductionElasticity.of(StrongBackend(CpuBackend(DISC, 1)))
    x = equilibrium(production, LOAD, FREE, MESH.points).x
    assert np.abs(FACTOR * REFERENCE.gradient(x) - LOAD)[DISC.free].max() < 1e-9 * np.abs(LOAD).max()
    assert np.abs(x - hanging().x).max() > 0.01 * np.abs(x - MESH.points).max()


class Arctan:
    """Forces that level off: whole steps from beyond 1.39 end ever farther away (Dennis and Schnabel 1983)."""

    def gradient(self, x):
        return np.arctan(x)

    def hessian(self, x):
        return sp.diags(1.0 / (1.0 + x.ravel() ** 2)).tocsr()


def test_shortened_steps():
    start = np.array([[3.0, -3.0, 2.0], [-2.0, 3.0, 2.5]])
    x = equilibrium(Arctan(), np.zeros((2, 3)), np.ones((2, 3), bool), start).x
    np.testing.assert_allclose(x, 0.0, atol=1e-11)


def test_no_end_is_an_error():
    with pytest.raises(ArithmeticError, match="not converged in 2 steps"):
        equilibrium(REFERENCE, LOAD, FREE, MESH.points, iterations=2)
