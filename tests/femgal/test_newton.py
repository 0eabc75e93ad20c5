# SPDX-License-Identifier: BSD-3-Clause
"""Inexact Newton with exchangeable preconditioners.

1. Every preconditioner is symmetric and positive definite, and the sum over layers is the dense formula.
2. Conjugate gradients solve a system to the reduction asked for, and stop at negative curvature with a direction of
   descent.
3. Newton ends at the minimiser of the reference Newton, with every preconditioner, from starts that are far away.
4. The residual left is no larger than the reduction asked for, measured in the norm of the preconditioner.
5. A quadratic potential takes one Newton iteration; nu is zero there and falls with the length of the step elsewhere.
6. Where the Hessian is indefinite the potential still falls at every iteration; a matrix that serves then is made
   anew there, and no element is gone through for its products.
7. A motion goes on from a saved state as if it had not stopped, with the preconditioner of before.
8. A body at rest stays there, and what is not finite is reported.
9. An absolute tolerance is met, however loose the reduction.
10. A step does not start where accelerations turn elements inside out.
11. A preconditioner that wears out in the middle of a step serves it to its end, as its norm compares residuals.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.hierarchy.hierarchy import build_constant_hierarchy, build_linear_hierarchy
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers import pcg
from femgal.solvers.extrapolation import LAST, TIMES
from femgal.solvers.lattice_vcycle import LatticeVCycle
from femgal.solvers.layer_cycle import LayerCycle
from femgal.solvers.newton import Newton, NewtonState, nonlinearity
from femgal.solvers.preconditioner import LayerBlocks
from femgal.solvers.solver import Budget, Outcome, minimise
from femgal.solvers.upkeep import PLACE, WEAR, Upkeep
from femgal.timestep.bdf2 import BDF2
from femgal.timestep.potential import IncrementalPotential, eps18
from verify.problems.bodies import Moving, distorted_box, left_end, rng, uniform
from verify.reference.elasticity import AssembledElasticity
from verify.reference.newton import ReferenceNewton
from verify.reference.transfer import galerkin, mass_matrix, prolongation

MESH = distorted_box((8, 4, 4))
X = MESH.points
DISC = uniform(MESH, left_end(MESH))
BACKEND = CpuBackend(DISC, 1)
CONSTANT = (BACKEND.vertices, *build_constant_hierarchy(DISC, 4).layers[1:3])
LINEAR = (BACKEND.vertices, *build_linear_hierarchy(DISC).layers[1:])
H = 1.0 / 60.0
PRECONDITIONERS = {
    "blocks": lambda: LayerBlocks(CONSTANT[:1]),
    "constant": lambda: LayerBlocks(CONSTANT),
    "linear": lambda: LayerBlocks(LINEAR),
    "cycle": lambda: LayerCycle(CONSTANT),
    "linear-cycle": lambda: LayerCycle(LINEAR),
}


def thrown(speed: float = 2.0, noise: float = 0.002) -> np.ndarray:
    """Prediction of a beam that is held at its left end and thrown down."""
    velocity = np.zeros_like(X)
    velocity[:, 2] = -speed * X[:, 0]
    return np.where(DISC.free[:, None], X + H * velocity + noise * rng(220).standard_normal(X.shape), X)


PHI = IncrementalPotential(BACKEND, thrown(), H, x_n=X)
MINIMISER = minimise(ReferenceNewton(DISC), PHI, {}).x


def gradient_rows(phi: IncrementalPotential, x: np.ndarray) -> np.ndarray:
    return BACKEND.nodal_gradient(BACKEND.vertices, x, phi.xhat, phi.inverse_h2)


def rows(seed: int) -> np.ndarray:
    return rng(seed).standard_normal((BACKEND.vertices.n_nodes, 3))


@pytest.mark.parametrize("name", PRECONDITIONERS)
def test_preconditioners_are_symmetric_and_definite(name):
    made = PRECONDITIONERS[name]()
    made.refresh(PHI, MINIMISER)
    r, s = rows(331), rows(332)
    across, back = BACKEND.dot(r, made.apply(s)), BACKEND.dot(s, made.apply(r))
    assert across == pytest.approx(back, rel=1e-10)
    assert BACKEND.dot(r, made.apply(r)) > 0.0
    np.testing.assert_allclose(made.apply(2.0 * r - s), 2.0 * made.apply(r) - made.apply(s), rtol=1e-9, atol=1e-12)


def test_layer_blocks_are_the_dense_formula():
    made = LayerBlocks(CONSTANT)
    made.refresh(PHI, MINIMISER)
    elasticity = AssembledElasticity(MESH, DISC.mu, DISC.lam)
    A = mass_matrix(PHI.inverse_h2 * DISC.mass) + elasticity.hessian(MINIMISER)
    r, at = rows(334), np.repeat(DISC.free, 3)
    f = np.zeros(3 * DISC.n_vertices)
    f[at] = r.ravel()
    z = np.zeros_like(f)
    for layer in CONSTANT:
        P = prolongation(layer)
        dense = galerkin(P, A).toarray()
        for i in range(layer.n_nodes):
            part = slice(3 * i, 3 * i + 3)
            z += P[:, part] @ np.linalg.solve(dense[part, part], P[:, part].T @ f)
    np.testing.assert_allclose(made.apply(r).ravel(), z[at], rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize("reduction", [0.1, 1e-6])
def test_conjugate_gradients(reduction):
    made = LayerBlocks(CONSTANT)
    made.refresh(PHI, MINIMISER)
    b = rows(336)

    def product(p: np.ndarray) -> np.ndarray:
        d = np.zeros_like(X)
        d[DISC.free] = p
        return BACKEND.nodal_product(BACKEND.vertices, MINIMISER, d, PHI.inverse_h2)

    solution = pcg.solve(BACKEND, product, made.apply, b, reduction, 400)
    left = b - product(solution.d)
    norm = np.sqrt(BACKEND.dot(left, made.apply(left)) / BACKEND.dot(b, made.apply(b)))
    assert norm <= 1.01 * reduction
    assert solution.reduction == pytest.approx(norm, rel=1e-3)
    shorter = pcg.solve(BACKEND, product, made.apply, b, reduction, solution.iterations - 1)
    assert shorter.reduction > reduction


def test_conjugate_gradients_stop_at_negative_curvature():
    signs = np.where(np.arange(BACKEND.vertices.n_nodes) % 3 == 0, -1.0, 1.0)[:, None]
    b = rows(338)
    solution = pcg.solve(BACKEND, lambda p: signs * p, lambda r: r.copy(), b, 1e-6, 50)
    assert not solution.curvature
    assert BACKEND.dot(b, solution.d) > 0.0


@pytest.mark.parametrize("start", ["near", "far"])
@pytest.mark.parametrize("name", PRECONDITIONERS)
def test_converges_to_the_minimiser(name, start):
    solver = Newton(BACKEND, PRECONDITIONERS[name](), reduction=1e-9)
    phi = PHI if start == "near" else IncrementalPotential(BACKEND, thrown(40.0, 0.02), H, x_n=X)
    expected = MINIMISER if start == "near" else minimise(ReferenceNewton(DISC), phi, {}).x
    state = minimise(solver, phi, {})
    assert state.outcome is Outcome.CONVERGED
    assert state.iteration > 1
    np.testing.assert_allclose(state.x, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("reduction", [0.1, 1e-3])
def test_the_residual_left_is_what_was_asked_for(reduction):
    made = LayerBlocks(CONSTANT)
    solver = Newton(BACKEND, made, reduction=reduction)
    first = solver.init(PHI, {})
    norms = []
    for x in (first.x.copy(), minimise(solver, PHI, {}).x):
        made.refresh(PHI, x)
        g = BACKEND.nodal_gradient(BACKEND.vertices, x, PHI.xhat, PHI.inverse_h2)
        norms.append(np.sqrt(BACKEND.dot(g, made.apply(g))))
    assert norms[1] <= 1.2 * reduction * norms[0]


def test_small_motions_take_one_newton_iteration():
    near = np.where(DISC.free[:, None], X + 1e-6 * rng(221).standard_normal(X.shape), X)
    state = minimise(Newton(BACKEND, LayerBlocks(CONSTANT)), IncrementalPotential(BACKEND, near, H, x_n=X), {})
    assert state.iteration == 1
    assert state.outcome is Outcome.CONVERGED


def test_nonlinearity():
    assert nonlinearity(np.array([-2.0, 1.0, 0.0, 0.0, 0.0, 0.0]), 1.0) == 0.0
    assert nonlinearity(np.array([-2.0, 1.0, 0.1, 0.05, 0.0, 0.0]), 1.0) == pytest.approx(0.25)
    assert nonlinearity(np.zeros(6), 1.0) == 0.0


@pytest.mark.parametrize("name", ["constant", "v-cycle"])
def test_the_potential_falls_where_the_hessian_is_indefinite(name, monkeypatch):
    crushed = X * np.array([1.0, 1.0, 0.2]) + 0.02 * rng(223).standard_normal(X.shape)
    x_n = np.where(DISC.free[:, None], crushed, X)
    phi = IncrementalPotential(BACKEND, x_n, 0.2, x_n=x_n)
    preconditioner = LatticeVCycle(BACKEND) if name == "v-cycle" else LayerBlocks(CONSTANT)
    solver, values = Newton(BACKEND, preconditioner, reduction=1e-6), []
    state: NewtonState = solver.init(phi, {})
    definite = []
    product, matrix = solver._product, getattr(preconditioner, "product", None)

    def by_elements(*args, **kind):
        definite.extend(["elements"] * kind["definite"])
        return product(*args, **kind)

    def by_matrix(p):
        definite.append("matrix")
        return matrix(p)

    monkeypatch.setattr(solver, "_product", by_elements)
    if matrix is not None:
        monkeypatch.setattr(preconditioner, "product", by_matrix)
    while solver.finished(phi, state) is None and state.iteration < 40:
        values.append(phi.value(state.x))
        state = solver.step(phi, state)
    assert np.linalg.eigvalsh(AssembledElasticity(MESH, DISC.mu, DISC.lam).hessian(x_n).toarray())[0] < 0.0
    assert set(definite) == {"matrix" if name == "v-cycle" else "elements"}
    assert (np.diff(values) <= 1e-12 * abs(values[0])).all()
    assert state.left <= 1e-6


def test_a_matrix_is_made_anew_where_curvature_turns_out_negative():
    x = np.where(DISC.free[:, None], X * np.array([1.0, 1.0, 0.2]) + 0.02 * rng(223).standard_normal(X.shape), X)
    phi = IncrementalPotential(BACKEND, x, 0.2, x_n=x)
    preconditioner = LatticeVCycle(BACKEND)
    solver, before = Newton(BACKEND, preconditioner), phi.value(x)
    # It was made at rest, and is as good as new.
    memory = Upkeep(preconditioner).make_ready(phi, X, {})
    state = NewtonState(x.copy(), memory=memory)
    state = solver.step(phi, state)
    assert np.array_equal(memory[PLACE], X)
    assert np.array_equal(state.memory[PLACE], x)
    assert phi.value(state.x) < before
    # The reduction holds in the norm of the preconditioner that was made on the way.
    while solver.finished(phi, state) is None:
        state = solver.step(phi, state)
    made = LatticeVCycle(BACKEND)
    made.refresh(phi, state.memory[PLACE])
    size = [float(np.sqrt((g * made.apply(g)).sum())) for g in (gradient_rows(phi, x), gradient_rows(phi, state.x))]
    assert size[1] <= 1.1 * solver.reduction * size[0]


def test_a_preconditioner_serves_a_step_to_its_end(monkeypatch):
    made = LayerBlocks(CONSTANT)
    refresh, places = made.refresh, []
    monkeypatch.setattr(made, "refresh", lambda phi, x: places.append(x.copy()) or refresh(phi, x))
    # It costs nothing, so any loss is too much.
    made.price = 0.0
    solver = Newton(BACKEND, made, reduction=1e-6)
    state = minimise(solver, PHI, {})
    assert state.iteration > 2
    assert len(places) == 1
    minimise(solver, PHI, {WEAR: state.memory[WEAR], PLACE: state.memory[PLACE]})
    assert len(places) == 2


def test_a_motion_goes_on_from_a_saved_state():
    held = left_end(MESH)

    def method() -> BDF2:
        solver = Newton(BACKEND, LayerBlocks(CONSTANT))
        return BDF2(BACKEND, solver, 4, np.array([0.0, 0.0, -9.81]), motions=(Moving(held, X[held]),))

    def frames(stepper: BDF2, state, count: int):
        for _ in range(count):
            state, substeps = stepper.begin_frame(state, 0.05)
            for _ in range(substeps):
                state = stepper.step(state, 0.05 / substeps)
            state, _ = stepper.end_frame(state, 0.05, substeps)
        return state

    whole = method()
    through = frames(whole, whole.init(X, np.zeros_like(X)), 4)
    first = method()
    saved = frames(first, first.init(X, np.zeros_like(X)), 2)
    again = frames(method(), saved, 2)
    assert np.array_equal(through.x, again.x)
    assert np.array_equal(through.v, again.v)


def test_rest_and_lost_positions():
    at_rest = IncrementalPotential(BACKEND, X.copy(), H, x_n=X)
    state = minimise(Newton(BACKEND, LayerBlocks(CONSTANT)), at_rest, {})
    assert state.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(state.x, X, rtol=0, atol=1e-12)
    lost = IncrementalPotential(BACKEND, np.where(DISC.free[:, None], np.nan, X), H, x_n=X)
    assert minimise(Newton(BACKEND, LayerBlocks(CONSTANT)), lost, {}).outcome is Outcome.DIVERGED


def test_the_budget_is_a_limit():
    far = IncrementalPotential(BACKEND, thrown(40.0, 0.02), H, x_n=X)
    state = minimise(Newton(BACKEND, LayerBlocks(CONSTANT), Budget(1), reduction=1e-9), far, {})
    assert state.outcome is Outcome.NOT_CONVERGED
    assert state.iteration == 1


@pytest.mark.parametrize("reduction", [0.05, 0.5])
def test_an_absolute_tolerance_is_met(reduction):
    state = minimise(Newton(BACKEND, LayerBlocks(CONSTANT), Budget(20, 1e-13), reduction), PHI, {})
    assert state.outcome is Outcome.CONVERGED
    assert eps18(PHI.residual(state.x)) <= 1e-13
    np.testing.assert_allclose(state.x, MINIMISER, rtol=0, atol=1e-11)


@pytest.mark.parametrize(("size", "followed"), [(1e-3, True), (-2.0, False)])
def test_accelerations_are_not_followed_through_elements(monkeypatch, size, followed):
    searches = iter([1.0, 0.0, 0.0])
    monkeypatch.setattr("femgal.solvers.newton.first_minimum", lambda coefficients: next(searches))
    offset = np.where(DISC.free[:, None], size * (X - X[left_end(MESH)].mean(axis=0)), 0.0)
    phi = IncrementalPotential(BACKEND, X.copy(), H, x_n=X, time=2.0 * H)
    memory = {TIMES: np.array([H]), LAST: offset / H**2}
    start = Newton(BACKEND, LayerBlocks(CONSTANT)).init(phi, memory).x
    np.testing.assert_allclose(start, X + offset if followed else X, rtol=0, atol=1e-12)
