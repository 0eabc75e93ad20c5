# SPDX-License-Identifier: BSD-3-Clause
"""Smoothers of the assembled system.

1. A sweep of either kind is what dense matrices make of it, in both precisions.
2. Both converge to the minimiser that Newton's method finds when systems are made anew, and to Newton's first step
   when they are not.
3. On nearly quadratic energies they are the matrix-free smoothers.
4. A free body keeps its momentum, constrained vertices stay, threads do not change a bit.
5. Bad settings are refused; what diverges is reported.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal.gauss_seidel.colours import colour_vertices
from femgal.hierarchy.layer import free_parts
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers import explicit_vbd
from femgal.solvers.explicit_jacobi import ExplicitJacobi
from femgal.solvers.explicit_vbd import ExplicitVBD
from femgal.solvers.jacobi import Jacobi
from femgal.solvers.solver import Budget, Outcome, minimise
from femgal.solvers.vbd import VBD
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from meshes.errors import InputError
from verify.problems.bodies import distorted_box, left_end, positions, rng, uniform
from verify.reference.elasticity import AssembledElasticity
from verify.reference.newton import ReferenceNewton
from verify.reference.transfer import block_diagonal, diagonal_blocks, mass_matrix

MESH = distorted_box((6, 3, 3))
X = MESH.points
DISC = uniform(MESH, left_end(MESH))
FREE = uniform(MESH)
H = 1.0 / 100.0
KINDS = (ExplicitVBD, ExplicitJacobi)


def thrown(h: float) -> np.ndarray:
    """Prediction of a beam that is held at its left end and thrown down."""
    velocity = np.zeros_like(X)
    velocity[:, 2] = -2.0 * X[:, 0]
    return np.where(DISC.free[:, None], X + h * velocity + 0.002 * rng(250).standard_normal(X.shape), X)


PHI = IncrementalPotential(CpuBackend(DISC, 1), thrown(H), H)
NEWTON = ReferenceNewton(DISC)
MINIMISER = minimise(NEWTON, PHI, {}).x


def memory_of(solver, phi: IncrementalPotential) -> dict:
    """What `prepare` leaves."""
    return solver.prepare(MotionState(0.0, X, np.zeros_like(X)), phi).memory


def dense_system(phi: IncrementalPotential, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and -grad phi over the free vertices."""
    disc = phi.backend.disc
    at = np.flatnonzero(np.repeat(disc.free, 3))
    A = mass_matrix(disc.mass * phi.inverse_h2) + AssembledElasticity(MESH, disc.mu, disc.lam).hessian(x)
    return A.tocsr()[at][:, at].toarray(), -phi.gradient(x).ravel()[at]


@pytest.mark.parametrize(("precision", "tolerance"), [("float64", 1e-10), ("float32", 1e-5)])
def test_a_sweep_is_that_of_dense_matrices(precision, tolerance):
    # Stretched a little, where no element is indefinite.
    x = np.where(DISC.free[:, None], X * [1.03, 1.0, 1.01], X)
    phi = IncrementalPotential(CpuBackend(DISC, 1, precision=precision), x, H)
    A, b = dense_system(replace(phi, backend=CpuBackend(DISC, 1)), x)
    D = block_diagonal(diagonal_blocks(A)).toarray()
    rows = DISC.free.cumsum()[colour_vertices(DISC).vertex] - 1
    jacobi, vbd = ExplicitJacobi(phi.backend, steps=(0.3, 0.4)), ExplicitVBD(phi.backend, w=0.9)
    jacobi.init(phi, memory_of(jacobi, phi))
    d = 1e-3 * rng(251).standard_normal((len(rows), 3))
    expected = d.ravel().copy()
    for i in rows:
        own = slice(3 * i, 3 * i + 3)
        expected[own] += 0.9 * np.linalg.solve(A[own, own], (b - A @ expected)[own])
    for solver, change in ((vbd, expected - d.ravel()), (jacobi, 0.4 * np.linalg.solve(D, b - A @ d.ravel()))):
        solver.linearise(phi, x)
        assert np.abs(solver.sweep(d.copy()).ravel() - change).max() <= tolerance * np.abs(change).max()


@pytest.mark.parametrize("kind", KINDS)
def test_converges_to_the_minimiser(kind):
    solver = kind(PHI.backend, Budget(3000, 1e-12))
    state = minimise(solver, PHI, memory_of(solver, PHI))
    assert state.outcome is Outcome.CONVERGED
    assert np.linalg.norm(state.x - MINIMISER) <= 1e-8 * np.linalg.norm(PHI.xhat - MINIMISER)


@pytest.mark.parametrize("kind", KINDS)
def test_one_system_leads_to_newtons_step(kind):
    # Stretched a little, where no element is indefinite.
    phi = replace(PHI, xhat=np.where(DISC.free[:, None], X * [1.03, 1.0, 1.01], X))
    solver = kind(phi.backend, Budget(2000), sweeps=2000)
    A, b = dense_system(phi, phi.xhat)
    d = np.zeros_like(X)
    d[DISC.free] = np.linalg.solve(A, b).reshape(-1, 3)
    found = minimise(solver, phi, memory_of(solver, phi)).x - phi.xhat
    assert np.linalg.norm(found - d) <= 1e-8 * np.linalg.norm(d)


@pytest.mark.parametrize(("kind", "free"), [(ExplicitVBD, VBD), (ExplicitJacobi, Jacobi)])
def test_small_motions_are_those_of_matrix_free_smoothers(kind, free):
    phi = replace(PHI, xhat=X + 1e-6 * (PHI.xhat - X))
    explicit = kind(phi.backend, Budget(5))
    other = (
        Jacobi(phi.backend, (phi.backend.vertices,), budget=Budget(5))
        if free is Jacobi
        else VBD(phi.backend, Budget(5))
    )
    one, two = (minimise(solver, phi, memory_of(solver, phi)).x for solver in (explicit, other))
    assert np.linalg.norm(one - two) <= 1e-5 * np.linalg.norm(one - phi.xhat)


@pytest.mark.parametrize("kind", KINDS)
def test_a_free_body_keeps_its_momentum(kind):
    backend, mass, xhat = CpuBackend(FREE, 1), FREE.mass[:, None], X * [1.3, 0.9, 1.0]
    phi = IncrementalPotential(backend, xhat, H)
    solver = kind(backend, Budget(3), free_parts(FREE))
    x = minimise(solver, phi, memory_of(solver, phi)).x
    scale = FREE.mass.sum() * np.ptp(xhat, axis=0).max()
    assert np.abs((mass * (x - xhat)).sum(axis=0)).max() <= 1e-12 * scale


@pytest.mark.parametrize("kind", KINDS)
def test_constrained_vertices_stay_and_threads_do_not_matter(kind, monkeypatch):
    monkeypatch.setattr(explicit_vbd, "SMALLEST_COLOUR", 4)
    found = []
    for threads in (1, 3):
        solver = kind(CpuBackend(DISC, threads), Budget(5), sweeps=2)
        found.append(minimise(solver, PHI, memory_of(solver, PHI)).x)
    np.testing.assert_array_equal(found[0][~DISC.free], PHI.xhat[~DISC.free])
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("kind", KINDS)
def test_what_diverges_is_reported(kind):
    solver = kind(PHI.backend, Budget(5))
    phi = replace(PHI, xhat=positions(MESH, "random") * np.nan)
    assert minimise(solver, phi, memory_of(solver, PHI)).outcome is Outcome.DIVERGED


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match="one sweep"):
        ExplicitVBD(PHI.backend, sweeps=0)
    with pytest.raises(InputError, match="0 < w < 2"):
        ExplicitVBD(PHI.backend, w=2.5)
    with pytest.raises(InputError, match="searched"):
        ExplicitJacobi(PHI.backend, steps="exact")
