# SPDX-License-Identifier: BSD-3-Clause
"""TR-BDF2: its formula, its order, and its stability.

1. A small vibration in an eigenmode follows the Runge-Kutta scheme of the published tableau, damping included.
2. A free fall is exact but for the first step of backward Euler, of length h_e, which falls h_e^2 g / 2 too far.
3. Second order in time against velocity Verlet at a small step, with steps of one length and of alternating lengths,
   and with vertices that are driven; better than BDF2 with the same number of solves.
4. A state is all that a motion needs to go on.
5. One sweep per solve with spectral step lengths is stable: small disturbances do not grow, at steps up to 1/10 s; the
   bound on the response of the stiffest modes is sharp.
6. The stiffest modes are damped within a step.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.fas import FAS
from femgal.solvers.solver import Budget
from femgal.timestep.bdf2 import BDF2
from femgal.timestep.state import MotionState
from femgal.timestep.tr_bdf2 import A_0, A_GAMMA, GAMMA, TRBDF2
from femgal.timestep.velocity_verlet import VelocityVerlet
from tests.femgal.test_bdf2 import Driven, throw
from verify.problems.bodies import Moving, distorted_box, left_end, rng, slopes, uniform
from verify.reference.elasticity import AssembledElasticity

MESH = distorted_box((4, 2, 2))
X = MESH.points
GRAVITY = np.array([0.5, 0.0, -9.81])
CONVERGED = Budget(3000, 1e-13)


def method(disc, budget=CONVERGED, gravity=GRAVITY, damping=0.0, motions=(), kind=TRBDF2, layers=None):
    layers = build_constant_hierarchy(disc, 4).layers[:layers]
    backend = CpuBackend(disc, 1, layers[0])
    return kind(backend, FAS(backend, layers, "spectral", budget), 1, gravity, damping, motions)


def run(stepper, x0: np.ndarray, v0: np.ndarray, steps: list[float]) -> MotionState:
    """The state after steps of these lengths."""
    state = stepper.init(x0, v0)
    for h in steps:
        state, _ = stepper.begin_frame(state, h)
        state = stepper.step(state, h)
    return state


def tableau_step(A: np.ndarray, y: np.ndarray, h: float) -> np.ndarray:
    """One step of y' = A y by the three stages of Hosea & Shampine 1996, table 1."""
    w, d, identity = np.sqrt(2.0) / 4.0, GAMMA / 2.0, np.eye(len(y))
    k1 = A @ y
    k2 = np.linalg.solve(identity - h * d * A, A @ (y + h * d * k1))
    k3 = np.linalg.solve(identity - h * d * A, A @ (y + h * w * (k1 + k2)))
    return y + h * (w * k1 + w * k2 + d * k3)


@pytest.mark.parametrize("damping", [0.0, 40.0])
def test_vibrations_follow_the_tableau(damping):
    disc = uniform(MESH, left_end(MESH))
    at = np.repeat(disc.free, 3)
    K = AssembledElasticity(MESH, disc.mu, disc.lam).hessian(X).toarray()[np.ix_(at, at)]
    squared, modes = scipy.linalg.eigh(K, np.diag(np.repeat(disc.mass, 3)[at]))
    omega2, size = squared[2], 1e-7
    mode = np.zeros(3 * disc.n_vertices)
    mode[at] = modes[:, 2]
    mode = mode.reshape(-1, 3)
    held = left_end(MESH)
    stepper = method(disc, gravity=np.zeros(3), damping=damping, motions=(Moving(held, X[held]),))
    h = 0.7 / np.sqrt(omega2)
    start = {"acceleration": -omega2 * size * mode}
    state, y = replace(stepper.init(X + size * mode, np.zeros_like(X)), memory=start), np.array([size, 0.0])
    A = np.array([[0.0, 1.0], [-omega2, -damping]])
    for _ in range(8):
        state, _ = stepper.begin_frame(state, h)
        state, y = stepper.step(state, h), tableau_step(A, y, h)
        q = float((disc.mass[:, None] * mode * (state.x - X)).sum())
        # Strains of 1e-6 make the energy depart from its quadratic part by more than as much.
        assert q == pytest.approx(y[0], abs=1e-4 * size)


def test_free_fall():
    h, n, v0 = 1.0 / 120.0, 12, np.array([1.0, -2.0, 3.0])
    stepper = method(uniform(MESH))
    state = run(stepper, X, np.tile(v0, (len(X), 1)), [h] * n)
    t, first = n * h, stepper.effective_step(h)
    np.testing.assert_allclose(state.x, X + t * v0 + 0.5 * (t**2 + first**2) * GRAVITY, rtol=0, atol=1e-10)
    np.testing.assert_allclose(state.v, np.tile(v0 + t * GRAVITY, (len(X), 1)), rtol=0, atol=1e-8)


@pytest.mark.parametrize("pattern", [(1.0,), (0.6, 1.4)], ids=["equal", "alternating"])
@pytest.mark.parametrize("driven", [False, True], ids=["held", "driven"])
def test_second_order(pattern, driven):
    held, T = left_end(MESH), 0.04
    disc = uniform(MESH, held, E=2e4)
    motions = (Driven(held) if driven else Moving(held, X[held]),)
    v0 = throw(1.0)
    v0[held] = 0.0
    explicit = VelocityVerlet(CpuBackend(disc, 1), GRAVITY, motions=motions, substeps=4000)
    reference = explicit.init(X, v0)
    for _ in range(4000):
        reference = explicit.step(reference, T / 4000)

    def error(kind, n: int) -> float:
        steps = [T / n * pattern[k % len(pattern)] for k in range(n)]
        return float(np.linalg.norm(run(method(disc, motions=motions, kind=kind), X, v0, steps).x - reference.x))

    errors = [error(TRBDF2, n) for n in (16, 32, 64)]
    assert errors[0] < 0.05 * float(np.linalg.norm(reference.x - X))
    assert slopes(errors)[-1] == pytest.approx(2.0, abs=0.25)
    assert errors[2] < error(BDF2, 128)


def test_a_state_is_all_it_needs():
    disc, v0 = uniform(MESH), throw(1.0)
    whole = run(method(disc), X, v0, [1e-3] * 6)
    half, stepper = run(method(disc), X, v0, [1e-3] * 3), method(disc)
    for _ in range(3):
        half, _ = stepper.begin_frame(half, 1e-3)
        half = stepper.step(half, 1e-3)
    assert np.array_equal(half.x, whole.x)
    assert np.array_equal(half.v, whole.v)


@pytest.mark.parametrize("h", [1e-3, 1.0 / 60.0, 0.1])
def test_one_pass_is_stable(h):
    held = left_end(MESH)
    disc = uniform(MESH, held, E=1e9)
    motions = (Moving(held, X[held]),)
    stepper = method(disc, Budget(1), gravity=np.zeros(3), motions=motions, layers=1)
    x0 = np.where(disc.free[:, None], X + 1e-7 * rng(611).standard_normal(X.shape), X)
    state = run(stepper, x0, np.zeros_like(X), [h] * 400)
    assert np.abs(state.x - X).max() < 2e-6


def responding(T: float) -> np.ndarray:
    """The map from one (x, v, h_e a) to the next in units of h_e = 1, where every solve ends at T xhat."""
    columns = []
    for x, v, a in np.eye(3):
        y, w = x + v, v + a
        middle = T * (y + w)
        slope = middle - y
        y, w = A_GAMMA * middle + A_0 * x, A_GAMMA * slope + A_0 * v
        end = T * (y + w)
        columns.append((end, end - y, end - y - w))
    return np.array(columns).T


def radius(T: float) -> float:
    return float(np.abs(np.linalg.eigvals(responding(T))).max())


def test_the_bound_on_the_response_is_sharp():
    assert all(radius(T) <= 1.0 + 1e-7 for T in np.linspace(TRBDF2.least_response, 1.0, 200))
    assert radius(1.01 * TRBDF2.least_response) > 1.0


def test_stiffest_modes_are_damped():
    assert radius(0.0) < 1e-6
    assert radius(1e-3) < 0.1
