# SPDX-License-Identifier: BSD-3-Clause
"""Smoothed aggregation as preconditioner.

1. The cycle is symmetric and positive definite.
2. With it Newton's method converges to the reference's minimiser, held or free, with and without rotations.
3. Where masses rule and most vertices stand alone, so that the coarsest matrix is singular, it does so too.
4. On a stiff system it needs fewer iterations with rigid body modes than without, and fewer than block Jacobi.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal.solvers.solver import Outcome
from tests.verify.thrown_beam import X, distance, minimiser, solved, thrown
from verify.problems.bodies import rng
from verify.reference.newton import ReferenceNewton
from verify.solvers.amg import SmoothedAggregation
from verify.solvers.newton import Newton
from verify.solvers.system import AssembledJacobi


def rows(phi, salt: int) -> np.ndarray:
    """Random rows of the free vertices."""
    return rng(salt).standard_normal((int(phi.backend.disc.free.sum()), 3))


@pytest.mark.parametrize("rigid_modes", [True, False])
def test_symmetric_and_definite(rigid_modes):
    phi = thrown()
    system = SmoothedAggregation(phi.backend, rigid_modes=rigid_modes)
    system.linearise(phi, phi.xhat, definite=False)
    r, s = rows(phi, 350), rows(phi, 351)
    Mr, Ms = system.precondition(r), system.precondition(s)
    assert np.isclose((s * Mr).sum(), (r * Ms).sum(), rtol=1e-9)
    assert (r * Mr).sum() > 0.0


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("rigid_modes", [True, False])
def test_converges_to_the_minimiser(rigid_modes, held):
    phi = thrown(held=held)
    solver = Newton(phi.backend, SmoothedAggregation(phi.backend, rigid_modes=rigid_modes), tolerance=1e-11)
    state = solved(solver, phi)
    assert state.outcome is Outcome.CONVERGED
    assert distance(state.x, phi, minimiser(held=held)) <= 1e-9


def test_where_masses_rule():
    phi = replace(thrown(), h=1e-3)
    solver = Newton(phi.backend, SmoothedAggregation(phi.backend), tolerance=1e-11)
    state = solved(solver, phi)
    assert state.outcome is Outcome.CONVERGED
    assert solver.effort.definite == 0
    assert distance(state.x, phi, solved(ReferenceNewton(phi.backend.disc), phi).x) <= 1e-9


def test_iterations_of_a_stiff_system():
    phi = thrown(E=1e7, rho=1.0)
    systems = (
        SmoothedAggregation(phi.backend),
        SmoothedAggregation(phi.backend, rigid_modes=False),
        AssembledJacobi(phi.backend),
    )
    needed = []
    for system in systems:
        system.linearise(phi, X, definite=False)
        needed.append(system.solve(rows(phi, 352), 1e-6).iterations)
    assert needed[0] < 0.8 * needed[1]
    assert needed[1] < 0.5 * needed[2]
