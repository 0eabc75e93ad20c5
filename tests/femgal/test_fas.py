# SPDX-License-Identifier: BSD-3-Clause
"""Multigrid cycles on whole problems.

1. On nearly quadratic energies a cycle is the product of dense corrections in the order of its schedule.
2. Every cycle, with both transfers and every kind of step, converges to the minimiser that Newton's method finds.
3. With a line search phi never grows, within a cycle neither, with elements in single precision too.
4. V(1, 1) reduces the error of one iteration more than coarse-to-fine does, W at least as much as V.
5. With one layer every cycle is that many Jacobi sweeps, bit for bit.
6. A sequence that visits a layer twice reports the larger move; what is not a number is not lost.
7. Threads do not change a bit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal.hierarchy.hierarchy import build_constant_hierarchy, build_linear_hierarchy
from femgal.kernels.cpu import threads
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.chebyshev import Chebyshev
from femgal.solvers.cycle import Cycle
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi
from femgal.solvers.solver import Budget, Outcome, SolverState, minimise
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from verify.problems.bodies import STATES, distorted_box, left_end, positions, rng, uniform
from verify.reference.elasticity import AssembledElasticity
from verify.reference.newton import ReferenceNewton
from verify.reference.transfer import block_diagonal, diagonal_blocks, galerkin, mass_matrix, prolongation

MESH = distorted_box((8, 4, 4))
X = MESH.points
DISC = uniform(MESH, left_end(MESH))
LAYERS = {"constant": build_constant_hierarchy(DISC, 4).layers[:3], "linear": build_linear_hierarchy(DISC).layers}
CYCLES = (Cycle(), Cycle("V", 1, 1), Cycle("F", 1, 1), Cycle("W", 1, 1), Cycle("V", 0, 2), Cycle("W", 2, 0))
H = 1.0 / 60.0


def thrown(h: float) -> np.ndarray:
    """Prediction of a beam that is held at its left end and thrown down, bent enough to need Newton's method."""
    velocity = np.zeros_like(X)
    velocity[:, 2] = -2.0 * X[:, 0]
    return np.where(DISC.free[:, None], X + h * velocity + 0.002 * rng(220).standard_normal(X.shape), X)


PHI = IncrementalPotential(CpuBackend(DISC, 1), thrown(H), H)
MINIMISER = minimise(ReferenceNewton(DISC), PHI, {}).x


def ready(solver, phi: IncrementalPotential):
    """The solver and the memory that its `prepare` leaves."""
    return solver, solver.prepare(MotionState(0.0, X, np.zeros_like(X)), phi).memory


def error(x: np.ndarray) -> float:
    """Distance from the minimiser in the energy norm of phi there, squared [J]."""
    d = x - MINIMISER
    return float((d * PHI.hessian_product(MINIMISER, d)).sum())


def test_there_are_coarse_layers():
    assert [len(layers) for layers in LAYERS.values()] == [3, 2]


@pytest.mark.parametrize("cycle", CYCLES, ids=str)
@pytest.mark.parametrize("transfer", LAYERS)
def test_a_cycle_is_the_product_of_its_corrections(transfer, cycle):
    layers = LAYERS[transfer]
    d = 1e-7 * rng(221).standard_normal(X.shape) * DISC.free[:, None]
    phi = IncrementalPotential(CpuBackend(DISC, 1), X + d, H)
    solver, memory = ready(FAS(phi.backend, layers, "spectral", cycle=cycle), phi)
    after = solver.step(phi, solver.init(phi, memory)).x - X
    M = mass_matrix(DISC.mass) / H**2
    A = (M + AssembledElasticity(MESH, DISC.mu, DISC.lam).hessian(X)).tocsr()
    u = d.ravel().copy()
    for number in cycle.schedule(len(layers)):
        P = prolongation(layers[number])
        D = block_diagonal(diagonal_blocks(galerkin(P, A))).toarray()
        u -= memory["step_lengths"][number] * (P @ np.linalg.solve(D, P.T @ (A @ u - M @ d.ravel())))
    # Strains are near 1e-6, and so is what the energy departs from its quadratic part.
    assert np.linalg.norm(after.ravel() - u) <= 1e-5 * np.linalg.norm(u - d.ravel())


@pytest.mark.parametrize("steps", ["spectral", "exact", "backtracking"])
@pytest.mark.parametrize("cycle", CYCLES, ids=str)
@pytest.mark.parametrize("transfer", LAYERS)
def test_converges_to_the_minimiser(transfer, cycle, steps):
    budget = Budget(iterations=400, tolerance=1e-12)
    solver, memory = ready(FAS(PHI.backend, LAYERS[transfer], steps, budget, cycle=cycle), PHI)
    state = minimise(solver, PHI, memory)
    assert state.outcome is Outcome.CONVERGED
    assert np.linalg.norm(state.x - MINIMISER) <= 1e-8 * np.linalg.norm(PHI.xhat - MINIMISER)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("steps", ["exact", "backtracking"])
@pytest.mark.parametrize("state", STATES)
def test_phi_never_grows(state, steps, precision):
    x_n = np.where(DISC.free[:, None], positions(MESH, state), X)
    xhat = np.where(DISC.free[:, None], x_n + 0.05 * rng(222).standard_normal(X.shape), X)
    phi = IncrementalPotential(CpuBackend(DISC, 1, precision=precision), xhat, H, 1.0, x_n)
    exact = replace(phi, backend=CpuBackend(DISC, 1))
    solver, memory = ready(FAS(phi.backend, LAYERS["constant"], steps), phi)
    x = solver.init(phi, memory).x
    values = [exact.value(x_n), exact.value(x)]
    for number in 12 * Cycle("V", 1, 1).schedule(3):
        solver.smooth_layer(phi, x, number)
        values.append(exact.value(x))
    # float32: a gradient is rounded by about 1e-7 of the stress, and the energy moves by the square of that.
    allowed = 1e-12 if precision == "float64" else 1e-11
    assert (np.diff(values) <= allowed * np.abs(values[:-1])).all()
    assert values[-1] < 0.9 * values[0]


def reduction(transfer: str, cycle: Cycle, steps: str, cycles: int = 6) -> float:
    """Mean factor of the error in one iteration."""
    solver, memory = ready(FAS(PHI.backend, LAYERS[transfer], steps, cycle=cycle), PHI)
    state = solver.init(PHI, memory)
    before = error(state.x)
    for _ in range(cycles):
        state = solver.step(PHI, state)
    return (error(state.x) / before) ** (0.5 / cycles)


@pytest.mark.parametrize("steps", ["spectral", "exact"])
@pytest.mark.parametrize("transfer", LAYERS)
def test_v_reduces_the_error_more_than_coarse_to_fine(transfer, steps):
    once, v, w = (reduction(transfer, cycle, steps) for cycle in (Cycle(), Cycle("V", 1, 1), Cycle("W", 1, 1)))
    assert v < 0.9 * once < 0.9
    assert w <= v * (1.0 + 1e-12)


@pytest.mark.parametrize(("cycle", "sweeps"), [(Cycle(), 1), (Cycle("V", 1, 1), 1), (Cycle("F", 2, 3), 3)])
def test_one_layer_is_jacobi(cycle, sweeps):
    layers = (PHI.backend.vertices,)
    solver, memory = ready(FAS(PHI.backend, layers, "spectral", cycle=cycle), PHI)
    jacobi, of_jacobi = ready(Jacobi(PHI.backend, layers, "spectral", Budget(sweeps)), PHI)
    one = minimise(solver, PHI, memory)
    np.testing.assert_array_equal(one.x, minimise(jacobi, PHI, of_jacobi).x)


def test_the_largest_move_of_a_layer_is_reported(monkeypatch):
    moves = iter([0.1, 0.4, 0.2, np.nan, 0.3])
    solver = FAS(PHI.backend, LAYERS["constant"], cycle=Cycle("V", 1, 1))
    monkeypatch.setattr(FAS, "smooth_layer", lambda *_: next(moves))
    # Layers 0 1 2 1 0.
    np.testing.assert_array_equal(solver.step(PHI, SolverState(X.copy())).corrections, (0.3, np.nan, 0.2))


def test_threads_do_not_change_a_bit(monkeypatch):
    monkeypatch.setattr(threads, "SMALLEST_SHARE", 16)
    found = []
    for n in (1, 3):
        backend = CpuBackend(DISC, n)
        phi = replace(PHI, backend=backend)
        inner = FAS(backend, LAYERS["linear"], "exact", Budget(3), cycle=Cycle("V", 1, 1))
        solver, memory = ready(Chebyshev(inner), phi)
        found.append(minimise(solver, phi, memory).x)
    np.testing.assert_array_equal(*found)
