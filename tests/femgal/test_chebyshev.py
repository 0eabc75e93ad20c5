# SPDX-License-Identifier: BSD-3-Clause
"""Chebyshev semi-iteration over whole iterations.

1. On a linear model problem with known eigenvalues mu the error after k iterations is T_k(mu / rho) / T_k(1 / rho).
2. So it is for small motions of a beam under Jacobi sweeps, whose eigenvalues are known from the assembled matrices.
3. On a stiff beam it needs at most a share of the iterations of the plain solver, with every kind of step.
4. The bound on rho leaves a third of the error after the iterations it is for.
5. With a line search phi never grows from iteration to iteration; with any steps "auto" goes no higher than the solver.
6. Constrained vertices do not move; the centre of mass of a free body is where its momentum takes it.
7. Without a previous iterate nothing is extrapolated; what diverges is reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.polynomial.chebyshev import Chebyshev as Series

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.hierarchy.layer import free_parts
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.chebyshev import Chebyshev, largest_stable_radius, next_weight
from femgal.solvers.cycle import Cycle
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi
from femgal.solvers.smoother import Relaxation
from femgal.solvers.solver import Budget, Outcome, SolverState, minimise
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from verify.problems.bodies import distorted_box, left_end, positions, rng, uniform
from verify.reference.elasticity import AssembledElasticity
from verify.reference.newton import ReferenceNewton
from verify.reference.transfer import block_diagonal, diagonal_blocks, mass_matrix

MESH = distorted_box((8, 3, 3))
X = MESH.points
HELD = uniform(MESH, left_end(MESH), E=1e6)
LAYERS = build_constant_hierarchy(HELD, 8).layers
H = 1.0 / 100.0


def ready(solver, h: float = H):
    """The solver and the memory that its `prepare` leaves."""
    return solver, solver.prepare(
        MotionState(0.0, X, np.zeros_like(X)), IncrementalPotential(getattr(solver, "solver", solver).backend, X, h)
    ).memory


def polynomial(k: int, rho: float, mu: np.ndarray) -> np.ndarray:
    """T_k(mu / rho) / T_k(1 / rho): factor of the error after k iterations."""
    T = Series.basis(k)
    return T(mu / rho) / T(1.0 / rho)


@dataclass(eq=False)
class Diagonal(Relaxation):
    """The error of component i falls by mu_i in each iteration; the solution is zero."""

    mu: np.ndarray = field(default_factory=lambda: np.empty(0))

    def step(self, potential, state):
        return SolverState(state.x * self.mu, state.iteration + 1, (0.0,))


@pytest.mark.parametrize("rho", [0.5, 0.9, 0.999])
def test_model_problem_has_the_theoretical_rate(rho):
    mu = np.linspace(-rho, rho, X.size).reshape(X.shape)
    backend = CpuBackend(HELD, 1)
    phi = IncrementalPotential(backend, np.ones_like(X), H)
    solver, memory = ready(Chebyshev(Diagonal(backend, LAYERS, (0.5, 0.5), Budget(40), mu=mu), rho))
    state = solver.init(phi, memory)
    for k in range(1, 13):
        state = solver.step(phi, state)
        np.testing.assert_allclose(state.x, polynomial(k, rho, mu), rtol=0.0, atol=1e-13)
    # The worst factor, and the rate that it tends to.
    assert np.abs(state.x).max() == pytest.approx(1.0 / Series.basis(12)(1.0 / rho), rel=1e-9)
    if rho <= 0.9:
        for _ in range(28):
            before, state = np.abs(state.x).max(), solver.step(phi, state)
        assert np.abs(state.x).max() / before == pytest.approx(rho / (1.0 + math.sqrt(1.0 - rho**2)), rel=1e-3)


def small_motion():
    """Eigenvalues and vectors of a Jacobi sweep with w = 1/2 at rest: I - D^-1 A / 2 = V diag(mu) V^-1."""
    free = np.flatnonzero(np.repeat(HELD.free, 3))
    A = mass_matrix(HELD.mass) / H**2 + AssembledElasticity(MESH, HELD.mu, HELD.lam).hessian(X)
    A = A.tocsr()[free][:, free]
    D = block_diagonal(diagonal_blocks(A)).toarray()
    L = np.linalg.cholesky(D)
    inverse = np.linalg.inv(L)
    values, Q = np.linalg.eigh(inverse @ A.toarray() @ inverse.T)
    V = inverse.T @ Q
    return 1.0 - 0.5 * values, V, Q.T @ L.T, free


def test_small_motions_of_a_beam():
    mu, V, inverse, free = small_motion()
    rho = float(mu.max())
    assert 0.9 < rho < 1.0
    assert mu.min() > -rho
    backend = CpuBackend(HELD, 1)
    phi = IncrementalPotential(backend, X.copy(), H)
    solver, memory = ready(Chebyshev(Jacobi(backend, LAYERS[:1], (0.5, 0.5)), rho))
    e = 1e-8 * rng(230).standard_normal(X.shape) * HELD.free[:, None]
    state = solver.init(phi, memory)
    state.x += e
    for k in range(1, 9):
        state = solver.step(phi, state)
        expected = V @ (polynomial(k, rho, mu) * (inverse @ e.ravel()[free]))
        found = (state.x - X).ravel()[free]
        assert np.linalg.norm(found - expected) <= 1e-5 * np.linalg.norm(e), k


@pytest.mark.parametrize("iterations", [1, 2, 5, 20])
def test_the_bound_leaves_a_third(iterations):
    rho = largest_stable_radius(iterations)
    assert polynomial(iterations, rho, np.array([rho]))[0] == pytest.approx(1.0 / 3.0, rel=1e-9)


def bent(disc, h: float) -> IncrementalPotential:
    """Potential of a beam on its way down."""
    velocity = np.zeros_like(X)
    velocity[:, 2] = -2.0 * X[:, 0]
    xhat = np.where(disc.free[:, None], X + h * velocity + 0.001 * rng(231).standard_normal(X.shape), X)
    return IncrementalPotential(CpuBackend(disc, 1), xhat, h)


STIFF = bent(HELD, H)
MINIMISER = minimise(ReferenceNewton(HELD), STIFF, {}).x


def iterations_needed(solver, memory, share: float = 1e-6) -> int:
    """Iterations until the gap of phi has fallen to a share of that at the prediction."""
    lowest = STIFF.value(MINIMISER)
    state = solver.init(STIFF, memory)
    first = STIFF.value(STIFF.xhat) - lowest
    while STIFF.value(state.x) - lowest > share * first:
        state = solver.step(STIFF, state)
        assert state.iteration < 1000
    return state.iteration


@pytest.mark.parametrize(
    ("name", "steps", "rho", "most"),
    [
        ("jacobi", "spectral", "auto", 0.4),
        ("jacobi", "exact", "auto", 0.4),
        ("jacobi", "backtracking", "auto", 0.6),
        ("coarse-to-fine", "spectral", "auto", 0.6),
        ("coarse-to-fine", "exact", "auto", 0.6),
        ("jacobi", "spectral", 0.98, 0.4),
        ("coarse-to-fine", "spectral", 0.93, 0.6),
        ("V", "spectral", "auto", 0.7),
        ("V", "exact", "auto", 0.7),
    ],
)
def test_needs_fewer_iterations_on_a_stiff_beam(name, steps, rho, most):
    def make():
        budget = Budget(200)
        if name == "jacobi":
            return Jacobi(STIFF.backend, LAYERS[:1], steps, budget)
        cycle = Cycle("V", 1, 1) if name == "V" else Cycle()
        return FAS(STIFF.backend, LAYERS, steps, budget, cycle=cycle)

    plain = iterations_needed(*ready(make()))
    accelerated = iterations_needed(*ready(Chebyshev(make(), rho)))
    print(name, steps, plain, accelerated)
    assert accelerated <= most * plain


@pytest.mark.parametrize("rho", ["auto", 0.9])
@pytest.mark.parametrize("steps", ["exact", "backtracking"])
@pytest.mark.parametrize("state", ["random", "stretched", "inverted"])
def test_phi_never_grows_with_a_line_search(state, steps, rho):
    x_n = np.where(HELD.free[:, None], positions(MESH, state), X)
    xhat = np.where(HELD.free[:, None], x_n + 0.05 * rng(232).standard_normal(X.shape), X)
    phi = IncrementalPotential(CpuBackend(HELD, 1), xhat, 0.02, 1.0, x_n)
    solver, memory = ready(Chebyshev(FAS(phi.backend, LAYERS, steps), rho), 0.02)
    now = solver.init(phi, memory)
    values = [phi.value(now.x)]
    for _ in range(12):
        now = solver.step(phi, now)
        values.append(phi.value(now.x))
    assert (np.diff(values) <= 1e-12 * np.abs(values[:-1])).all()
    assert values[-1] < 0.99 * values[0]


@pytest.mark.parametrize("steps", ["spectral", (0.25, 0.5)], ids=str)
def test_auto_goes_no_higher_than_the_solver(steps):
    solver, memory = ready(Chebyshev(FAS(STIFF.backend, LAYERS, steps)))
    state = solver.init(STIFF, memory)
    for _ in range(8):
        alone = solver.solver.step(STIFF, SolverState(state.x.copy(), state.iteration)).x
        state = solver.step(STIFF, state)
        assert STIFF.value(state.x) <= STIFF.value(alone)
        assert (state.iteration == 1) == np.array_equal(state.x, alone)


@pytest.mark.parametrize("steps", ["spectral", "exact"])
def test_constrained_vertices_stay(steps):
    solver, memory = ready(Chebyshev(FAS(STIFF.backend, LAYERS, steps, Budget(7))))
    after = minimise(solver, STIFF, memory)
    assert after.iteration == 7
    np.testing.assert_array_equal(after.x[~HELD.free], X[~HELD.free])


@pytest.mark.parametrize("steps", ["spectral", "exact"])
def test_momentum_of_a_free_body(steps):
    disc = uniform(MESH)
    phi = bent(disc, H)
    # With a line search the first iterate lies on the way from x_n and has another centre of mass.
    phi = IncrementalPotential(phi.backend, phi.xhat, H, 1.0, positions(MESH, "random"))
    layers = build_constant_hierarchy(disc, 8).layers
    solver, memory = ready(Chebyshev(FAS(phi.backend, layers, steps, Budget(4), free_parts(disc))))
    state = minimise(solver, phi, memory)
    np.testing.assert_allclose(disc.mass @ state.x, disc.mass @ phi.xhat, rtol=0.0, atol=1e-12 * disc.mass.sum())


def test_weights():
    assert next_weight(0.9, 0, 7.0) == 1.0
    assert next_weight(0.9, 1, 1.0) == pytest.approx(2.0 / 1.19)
    assert next_weight(0.9, 2, 1.5) == pytest.approx(4.0 / (4.0 - 0.81 * 1.5))
    # They tend to 2 / (1 + sqrt(1 - rho^2)).
    omega = 1.0
    for k in range(60):
        omega = next_weight(0.9, k, omega)
    assert omega == pytest.approx(2.0 / (1.0 + math.sqrt(0.19)), rel=1e-12)


def test_the_first_iteration_is_the_solvers_own():
    inner = FAS(STIFF.backend, LAYERS, "exact")
    solver, memory = ready(Chebyshev(inner))
    first = solver.step(STIFF, solver.init(STIFF, memory))
    np.testing.assert_array_equal(first.x, inner.step(STIFF, inner.init(STIFF, memory)).x)
    assert first.omega == 1.0


def test_divergence_is_an_outcome():
    solver, memory = ready(Chebyshev(Jacobi(STIFF.backend, LAYERS[:1], (40.0, 40.0), Budget(200)), 0.9))
    with np.errstate(all="ignore"):
        assert minimise(solver, STIFF, memory).outcome is Outcome.DIVERGED
