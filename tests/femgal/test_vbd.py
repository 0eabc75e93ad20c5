# SPDX-License-Identifier: BSD-3-Clause
"""Vertex block descent.

1. A sweep is what a slow one makes that takes each vertex's gradient and block from a pass over all elements.
2. With w = 1 the gradient at a vertex that has just moved is zero; phi never grows for 0 < w < 2, from any state.
3. It converges to the minimiser that Newton's method finds, with Chebyshev acceleration in fewer iterations.
4. As h -> 0 the error of one sweep per step falls with h^4: no share of the elastic force is lost.
5. Constrained vertices stay, the centre of mass of a free body is where its momentum takes it.
6. The adaptive start leaves out gravity where the last step had no acceleration, and is the prediction in flight.
7. Threads do not change a bit; what diverges is reported; a useless relaxation is refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal.gauss_seidel.colours import colour_vertices
from femgal.hierarchy.layer import free_parts
from femgal.kernels.cpu import node_work
from femgal.kernels.cpu.backend import CpuBackend
from femgal.kernels.plain.backend import PlainBackend
from femgal.solvers.chebyshev import Chebyshev
from femgal.solvers.solver import Budget, Outcome, minimise
from femgal.solvers.vbd import VBD
from femgal.timestep.backward_euler import BackwardEuler
from femgal.timestep.potential import IncrementalPotential
from meshes.errors import InputError
from verify.problems.bodies import STATES, Moving, distorted_box, left_end, positions, rng, uniform, varied
from verify.reference.newton import ReferenceNewton

SMALL = distorted_box((3, 2, 2))
MESH = distorted_box((8, 4, 4))
X = MESH.points
DISC = uniform(MESH, left_end(MESH))
FREE = uniform(MESH)
H = 1.0 / 60.0
GRAVITY = np.array([0.0, 0.0, -9.81])


def thrown(h: float) -> np.ndarray:
    """Prediction of a beam that is held at its left end and thrown down, bent enough to need Newton's method."""
    velocity = np.zeros_like(X)
    velocity[:, 2] = -2.0 * X[:, 0]
    return np.where(DISC.free[:, None], X + h * velocity + 0.002 * rng(230).standard_normal(X.shape), X)


PHI = IncrementalPotential(CpuBackend(DISC, 1), thrown(H), H)
MINIMISER = minimise(ReferenceNewton(DISC), PHI, {}).x


def slow_sweep(phi: IncrementalPotential, x: np.ndarray, w: float) -> np.ndarray:
    """Vertex by vertex in the order of the colours."""
    backend, x = phi.backend, x.copy()
    for v in colour_vertices(backend.disc).vertex:
        g, H6 = backend.gradient_and_blocks(backend.vertices, x, phi.xhat, phi.inverse_h2)
        i = backend.vertices.parent[v, 0]
        x[v] -= w * np.linalg.solve(H6[i][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]], g[i])
    return x


@pytest.mark.parametrize("w", [1.0, 0.7])
@pytest.mark.parametrize("state", STATES)
def test_a_sweep_is_that_of_the_passes(state, w):
    disc = varied(SMALL, left_end(SMALL))
    x = np.where(disc.free[:, None], positions(SMALL, state), SMALL.points)
    xhat = np.where(disc.free[:, None], x + 0.01 * rng(231).standard_normal(x.shape), SMALL.points)
    phi = IncrementalPotential(PlainBackend(disc), xhat, 1.0 / 200.0, 1.3)
    expected, found = slow_sweep(phi, x, w), x.copy()
    VBD(phi.backend, w=w).sweep(phi, found)
    np.testing.assert_array_equal(found[~disc.free], x[~disc.free])
    assert np.abs(found - expected).max() <= 1e-10 * np.abs(expected - x).max()


def test_the_last_vertex_is_at_its_minimum():
    phi = replace(PHI, xhat=positions(MESH, "random"))
    solver, x = VBD(phi.backend), positions(MESH, "inverted")
    before = np.abs(phi.gradient(x)).max()
    solver.sweep(phi, x)
    first, _ = solver.colouring.ranges[-1]
    assert np.abs(phi.gradient(x)[solver.colouring.vertex[first:]]).max() <= 1e-11 * before


@pytest.mark.parametrize("w", [0.3, 1.0, 1.9])
@pytest.mark.parametrize("state", STATES)
def test_phi_never_grows(state, w):
    x_n = np.where(DISC.free[:, None], positions(MESH, state), X)
    phi = replace(PHI, xhat=np.where(DISC.free[:, None], x_n + 0.05 * rng(232).standard_normal(X.shape), X))
    solver, x = VBD(phi.backend, w=w), x_n.copy()
    values = [phi.value(x)]
    for _ in range(12):
        solver.sweep(phi, x)
        values.append(phi.value(x))
    assert (np.diff(values) <= 1e-12 * np.abs(values[:-1])).all()
    assert values[-1] < 0.9 * values[0]


@pytest.mark.parametrize(("w", "rho"), [(1.0, None), (1.4, None), (1.0, "auto"), (1.4, "auto"), (1.0, 0.9)])
def test_converges_to_the_minimiser(w, rho):
    solver = VBD(PHI.backend, Budget(600, 1e-12), w=w)
    state = minimise(solver if rho is None else Chebyshev(solver, rho), PHI, {})
    assert state.outcome is Outcome.CONVERGED
    assert np.linalg.norm(state.x - MINIMISER) <= 1e-8 * np.linalg.norm(PHI.xhat - MINIMISER)


def test_chebyshev_saves_iterations():
    phi = IncrementalPotential(CpuBackend(uniform(MESH, left_end(MESH), E=1e6), 1), thrown(H), H)
    solver = VBD(phi.backend, Budget(2000, 1e-9))
    plain, accelerated = minimise(solver, phi, {}), minimise(Chebyshev(solver), phi, {})
    assert plain.outcome is accelerated.outcome is Outcome.CONVERGED
    assert accelerated.iteration < 0.5 * plain.iteration


def test_one_sweep_is_consistent():
    errors = []
    # Long before the elastic force is a small share of the inertia nothing can be said of orders.
    for h in (1e-4, 5e-5, 2.5e-5):
        x_n = positions(MESH, "random")
        phi = IncrementalPotential(CpuBackend(FREE, 1), x_n, h)
        exact = minimise(VBD(phi.backend, Budget(60)), phi, {}).x
        errors.append(np.linalg.norm(minimise(VBD(phi.backend), phi, {}).x - exact))
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert (orders > 3.7).all()
    assert (orders < 4.2).all()


def test_a_free_body_keeps_its_momentum():
    backend, mass = CpuBackend(FREE, 1), FREE.mass[:, None]
    xhat = positions(MESH, "stretched")
    phi = IncrementalPotential(backend, xhat, H)
    centre = (mass * xhat).sum(axis=0)
    with_parts = minimise(VBD(backend, Budget(3), free_parts(FREE)), phi, {}).x
    without = minimise(VBD(backend, Budget(3)), phi, {}).x
    scale = FREE.mass.sum() * np.ptp(xhat, axis=0).max()
    assert np.abs((mass * with_parts).sum(axis=0) - centre).max() <= 1e-12 * scale
    assert np.abs((mass * without).sum(axis=0) - centre).max() > 1e-6 * scale


def test_the_adaptive_start():
    held, h = left_end(MESH), 1.0 / 600.0
    disc, motions = uniform(MESH, held, E=1e7), (Moving(held, X[held]),)
    solver = VBD(CpuBackend(disc, 1), Budget(400, 1e-14), start="adaptive", gravity=GRAVITY)
    slow, quick = (
        BackwardEuler(solver.backend, one, 1, GRAVITY, motions=motions) for one in (ReferenceNewton(disc), solver)
    )
    # A body that hangs still.
    state = slow.init(X, np.zeros_like(X))
    for _ in range(5):
        state = replace(slow.step(state, 0.05), v=np.zeros_like(X))
    still = quick.step(state, h)
    phi = quick.potential(still, h)
    rested = solver.init(phi, still.memory).x
    assert np.abs(rested - still.x).max() < 0.01 * np.abs(phi.xhat - still.x).max()
    np.testing.assert_array_equal(solver.init(phi, {}).x, phi.xhat)
    # In flight every vertex has the acceleration of gravity.
    flying = VBD(CpuBackend(FREE, 1), Budget(1), free_parts(FREE), start="adaptive", gravity=GRAVITY)
    stepper = BackwardEuler(flying.backend, flying, 1, GRAVITY)
    state = stepper.step(stepper.init(X, np.ones_like(X)), H)
    phi = stepper.potential(state, H)
    np.testing.assert_allclose(flying.init(phi, state.memory).x, phi.xhat, rtol=0.0, atol=1e-12)


def test_without_gravity_there_is_nothing_to_adapt():
    solver = VBD(PHI.backend, start="adaptive")
    assert minimise(solver, PHI, {}).memory is None


def test_threads_do_not_change_a_bit(monkeypatch):
    monkeypatch.setattr(node_work, "SMALLEST_COLOUR", 4)
    found = [minimise(VBD(CpuBackend(DISC, n), Budget(3)), PHI, {}) for n in (1, 3)]
    np.testing.assert_array_equal(found[0].x, found[1].x)
    assert found[0].corrections == found[1].corrections


def test_a_sweep_counts_as_a_pass():
    backend = CpuBackend(DISC, 1)
    minimise(VBD(backend, Budget(3)), replace(PHI, backend=backend), {})
    assert backend.passes.gradient_and_blocks == backend.passes.total == 3.0


def test_what_diverges_is_reported():
    phi = replace(PHI, xhat=np.full_like(X, np.nan))
    assert minimise(VBD(phi.backend, Budget(5)), phi, {}).outcome is Outcome.DIVERGED


@pytest.mark.parametrize("w", [0.0, 2.0, -1.0, np.nan])
def test_a_useless_relaxation_is_refused(w):
    with pytest.raises(InputError, match="0 < w < 2"):
        VBD(PHI.backend, w=w)
