# SPDX-License-Identifier: BSD-3-Clause
"""Jacobi, scalar Jacobi and FAS against the direct Newton minimiser, and how a solver stops.

1. The minimiser is a fixed point: one iteration of any solver with any step rule moves it by less than 1e-12 sizes.
2. Iterating converges to the minimiser: error below 1e-8 of the distance from the prediction to it.
3. On nearly quadratic energies one FAS pass is the product of the dense corrections I - w P D^-1 P^T A, coarse to
   fine; Jacobi and scalar Jacobi are the finest factor alone.
4. Line searches never raise phi, from inverted and stretched states at long steps too; spectral steps lower it near
   rest.
5. Budget: converged, out of iterations, diverged; a tolerance that the prediction meets costs no iteration.
6. Step lengths are estimated once, and anew when the step of the motion changes.
7. The corrections reported are the largest moves of each layer, finest first.
8. The reference itself ends at a minimum, with a positive definite Hessian, from where the Hessian is indefinite too.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi, ScalarJacobi
from femgal.solvers.smoother import LU2025_STEPS
from femgal.solvers.solver import Budget, Outcome, SolverState, minimise
from femgal.timestep.potential import IncrementalPotential, eps18
from femgal.timestep.state import MotionState
from verify.problems.bodies import STATES, distorted_box, left_end, positions, rng, uniform
from verify.reference.elasticity import AssembledElasticity
from verify.reference.newton import ReferenceNewton
from verify.reference.transfer import block_diagonal, diagonal_blocks, galerkin, mass_matrix, prolongation

MESH = distorted_box((6, 4, 3))
X = MESH.points
DISC = uniform(MESH, left_end(MESH))
LAYERS = build_constant_hierarchy(DISC, 4).layers
SOLVERS = {"fas": FAS, "jacobi": Jacobi, "scalar-jacobi": ScalarJacobi}
RULES = ("spectral", "exact", "backtracking", LU2025_STEPS)


def potential(xhat: np.ndarray, h: float, x_n: np.ndarray | None = None) -> IncrementalPotential:
    return IncrementalPotential(CpuBackend(DISC, 1), xhat, h, 1.0, x_n)


def ready(name: str, phi: IncrementalPotential, rule="spectral", budget: Budget | None = None):
    """A solver and the memory that its `prepare` leaves."""
    solver = SOLVERS[name](phi.backend, LAYERS, rule, budget or Budget())
    state = solver.prepare(MotionState(0.0, X, np.zeros_like(X)), phi)
    return solver, state.memory


def prediction(h: float) -> np.ndarray:
    """Where a beam held at its left end and thrown downwards would go, bent enough to need Newton."""
    velocity = np.zeros_like(X)
    velocity[:, 2] = -3.0 * X[:, 0]
    return np.where(DISC.free[:, None], X + h * velocity + 0.003 * rng(110).standard_normal(X.shape), X)


H = 1.0 / 100.0
PHI = potential(prediction(H), H)
MINIMISER = minimise(ReferenceNewton(DISC), PHI, {}).x
SIZE = float(np.ptp(X, axis=0).max())


def test_reference_is_a_minimiser():
    assert eps18(PHI.residual(MINIMISER)) <= 1e-14
    assert PHI.value(MINIMISER) < 0.9 * PHI.value(PHI.xhat)


def test_reference_survives_negative_curvature():
    xhat = np.where(DISC.free[:, None], positions(MESH, "random"), X)
    phi = potential(xhat, 0.02)
    newton = ReferenceNewton(DISC)
    first = newton.step(phi, newton.init(phi, {}))
    assert phi.value(first.x) < phi.value(xhat)
    minimiser = minimise(newton, phi, {})
    assert newton.finished(phi, minimiser) is Outcome.CONVERGED
    assert eps18(phi.residual(minimiser.x)) <= 1e-13
    free = np.repeat(DISC.free, 3)
    A = mass_matrix(DISC.mass) * phi.inverse_h2 + newton.elasticity.hessian(minimiser.x)
    start = mass_matrix(DISC.mass) * phi.inverse_h2 + newton.elasticity.hessian(xhat)
    assert np.linalg.eigvalsh(start.toarray()[np.ix_(free, free)])[0] < 0.0
    assert np.linalg.eigvalsh(A.toarray()[np.ix_(free, free)])[0] > 0.0


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("name", SOLVERS)
def test_minimiser_is_a_fixed_point(name, rule):
    solver, memory = ready(name, PHI, rule)
    solver.init(PHI, memory)
    after = solver.step(PHI, SolverState(MINIMISER.copy()))
    assert np.abs(after.x - MINIMISER).max() <= 1e-12 * SIZE


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("name", SOLVERS)
def test_converges_to_the_minimiser(name, rule):
    solver, memory = ready(name, PHI, rule, Budget(iterations=600, tolerance=1e-12))
    state = minimise(solver, PHI, memory)
    distance = np.linalg.norm(PHI.xhat - MINIMISER)
    assert np.linalg.norm(state.x - MINIMISER) <= 1e-8 * distance
    assert solver.finished(PHI, state) is Outcome.CONVERGED


def dense_pass(layers, w, h: float, d: np.ndarray, *, scalar: bool = False) -> np.ndarray:
    """Displacements after smoothing `layers` in the order given; phi is quadratic around rest, d its prediction."""
    M, K = mass_matrix(DISC.mass) / h**2, AssembledElasticity(MESH, DISC.mu, DISC.lam).hessian(X)
    A, u = (M + K).tocsr(), d.copy()
    for layer, step in zip(layers, w, strict=True):
        P = prolongation(layer)
        D = galerkin(P, A)
        D = np.diag(D.diagonal()) if scalar else block_diagonal(diagonal_blocks(D)).toarray()
        u -= step * (P @ np.linalg.solve(D, P.T @ (A @ u - M @ d)))
    return u


@pytest.mark.parametrize("rule", ["spectral", LU2025_STEPS], ids=str)
@pytest.mark.parametrize("name", SOLVERS)
def test_quadratic_limit(name, rule):
    d = 1e-7 * rng(111).standard_normal(X.shape) * DISC.free[:, None]
    phi = potential(X + d, H)
    solver, memory = ready(name, phi, rule)
    after = solver.step(phi, solver.init(phi, memory)).x - X
    layers = LAYERS[::-1] if name == "fas" else LAYERS[:1]
    w = memory["step_lengths"][::-1] if name == "fas" else memory["step_lengths"][:1]
    expected = dense_pass(layers, w, H, d.ravel(), scalar=name == "scalar-jacobi").reshape(-1, 3)
    # Strains are near 1e-6, and so is what the energy departs from its quadratic part.
    assert np.linalg.norm(after - expected) <= 1e-5 * np.linalg.norm(expected - d)
    assert np.linalg.norm(expected - d) >= 0.1 * np.linalg.norm(d)


@pytest.mark.parametrize("rule", ["exact", "backtracking"])
@pytest.mark.parametrize("h", [1e-3, 0.1])
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("name", SOLVERS)
def test_line_searches_never_climb(name, state, h, rule):
    x_n = np.where(DISC.free[:, None], positions(MESH, state), X)
    xhat = np.where(DISC.free[:, None], x_n + 0.05 * rng(112).standard_normal(X.shape), X)
    phi = potential(xhat, h, x_n)
    solver, memory = ready(name, phi, rule)
    now = solver.init(phi, memory)
    values = [phi.value(x_n), phi.value(now.x)]
    for _ in range(5):
        now = solver.step(phi, now)
        values.append(phi.value(now.x))
    assert (np.diff(values) <= 1e-12 * np.abs(values[:-1])).all()
    assert values[-1] < 0.999 * values[0]


@pytest.mark.parametrize("name", SOLVERS)
def test_spectral_steps_lower_the_potential_near_rest(name):
    solver, memory = ready(name, PHI)
    state = solver.init(PHI, memory)
    values = [PHI.value(state.x)]
    for _ in range(10):
        state = solver.step(PHI, state)
        values.append(PHI.value(state.x))
    assert (np.diff(values) < 0.0).all()


def test_budget():
    solver, memory = ready("fas", PHI, budget=Budget(iterations=3))
    state = minimise(solver, PHI, memory)
    assert state.iteration == 3
    assert solver.finished(PHI, state) is Outcome.ITERATIONS
    assert Budget(5).outcome(PHI, state) is None
    assert Budget(5, 1.0).outcome(PHI, state) is Outcome.CONVERGED
    assert Budget(5, 1e-30).outcome(PHI, state) is None
    assert Budget(5).outcome(PHI, SolverState(state.x, 1, (0.1, np.inf))) is Outcome.DIVERGED
    at_minimum = potential(X, H)
    solver, memory = ready("fas", at_minimum, budget=Budget(iterations=7, tolerance=1e-9))
    assert minimise(solver, at_minimum, memory).iteration == 0


def test_divergence_is_an_outcome():
    solver, memory = ready("jacobi", PHI, (40.0, 40.0), Budget(iterations=200))
    with np.errstate(all="ignore"):
        state = minimise(solver, PHI, memory)
        assert solver.finished(PHI, state) is Outcome.DIVERGED
    assert state.iteration < 200


def test_step_lengths_are_remembered():
    solver = FAS(CpuBackend(DISC, 1), LAYERS)
    short, long = (IncrementalPotential(solver.backend, X, h) for h in (1e-3, 1e-2))
    first = solver.prepare(MotionState(0.0, X, np.zeros_like(X)), short)
    spent = solver.backend.passes.total
    assert spent > 0
    assert solver.prepare(first, short).memory["step_lengths"] is first.memory["step_lengths"]
    assert solver.backend.passes.total == spent
    longer = solver.prepare(first, long)
    assert (longer.memory["step_lengths"] < first.memory["step_lengths"]).all()


def test_corrections_are_the_largest_moves():
    solver, memory = ready("fas", PHI, LU2025_STEPS)
    state = solver.init(PHI, memory)
    moves = []
    for number in range(len(LAYERS) - 1, -1, -1):
        alone = FAS(PHI.backend, (LAYERS[number],), LU2025_STEPS if number == 0 else (0.25, 0.25))
        alone.init(PHI, {"step_lengths": np.array([0.5 if number == 0 else 0.25])})
        before = state.x.copy()
        state = alone.step(PHI, SolverState(state.x))
        moves.append(np.abs(state.x - before).max())
    whole = solver.step(PHI, solver.init(PHI, memory))
    np.testing.assert_array_equal(whole.x, state.x)
    np.testing.assert_allclose(whole.corrections, moves[::-1], rtol=1e-10)
