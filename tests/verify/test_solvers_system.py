# SPDX-License-Identifier: BSD-3-Clause
"""Newton's linear systems with block Jacobi.

1. With and without a matrix they make the same products, exact and definite alike, and the same corrections.
2. A solution satisfies scikit-fem's matrix to the residual that is reported.
3. An indefinite Hessian is reported; its definite part can be solved with.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.verify.thrown_beam import MESH, X, body, thrown
from verify.problems.bodies import positions, rng
from verify.reference.elasticity import AssembledElasticity
from verify.reference.transfer import mass_matrix
from verify.solvers.system import AssembledJacobi, MatrixFreeJacobi

PHI, DISC = thrown(), body()
CRUSHED = np.where(DISC.free[:, None], positions(MESH, "random"), X)


def forces(salt: int) -> np.ndarray:
    """Random forces at the free vertices."""
    return rng(salt).standard_normal((int(DISC.free.sum()), 3))


@pytest.mark.parametrize("definite", [False, True])
def test_with_and_without_a_matrix(definite):
    systems = AssembledJacobi(PHI.backend), MatrixFreeJacobi(PHI.backend)
    for system in systems:
        system.linearise(PHI, CRUSHED, definite=definite)
    # Without a matrix the blocks are the exact ones, definite as they are.
    for of in ("product",) if definite else ("product", "precondition"):
        one, other = (getattr(system, of)(forces(340)) for system in systems)
        assert np.allclose(one, other, rtol=1e-11, atol=1e-12 * np.abs(one).max())


@pytest.mark.parametrize("system", [AssembledJacobi, MatrixFreeJacobi])
def test_solution(system):
    one = system(PHI.backend)
    one.linearise(PHI, PHI.xhat, definite=False)
    b = forces(341)
    found = one.solve(b, 1e-6)
    whole = AssembledElasticity(MESH, DISC.mu, DISC.lam).hessian(PHI.xhat) + PHI.inverse_h2 * mass_matrix(DISC.mass)
    at = np.repeat(DISC.free, 3)
    left = b.ravel() - whole.tocsr()[at][:, at] @ found.d.ravel()
    assert found.definite
    assert np.isclose(np.linalg.norm(left) / np.linalg.norm(b), found.reduction, rtol=1e-4)


@pytest.mark.parametrize("system", [AssembledJacobi, MatrixFreeJacobi])
def test_indefinite(system):
    slow = replace(PHI, h=1.0)
    one = system(slow.backend)
    one.linearise(slow, CRUSHED, definite=False)
    assert not one.solve(forces(342), 1e-6).definite
    one.linearise(slow, CRUSHED, definite=True)
    assert one.solve(forces(342), 1e-6).definite
