# SPDX-License-Identifier: BSD-3-Clause
"""BDF2: its formula, its order, and what it needs to go on.

1. A step is that of the reference BDF2, which is written down apart from it; the first one is backward Euler's.
2. A free fall is exact from the second step on: the formula differentiates a parabola exactly.
3. Damping: v' = -alpha v is integrated with second order.
4. Second order in time against velocity Verlet at a small step, with steps of one length and of alternating lengths,
   and with vertices that are driven.
5. A step that is far longer than the one before it starts afresh; one that is a little longer does not.
6. A state is all that a motion needs to go on.
7. One pass per step with spectral step lengths is stable: small disturbances do not grow, at steps up to 1/10 s; the
   bound on the response of the stiffest modes is sharp.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.fas import FAS
from femgal.solvers.solver import Budget
from femgal.timestep.bdf2 import BDF2
from femgal.timestep.state import MotionState
from femgal.timestep.velocity_verlet import VelocityVerlet
from verify.integrators.under_test import Material, State
from verify.problems.bodies import Moving, distorted_box, left_end, rng, slopes, uniform
from verify.reference.stepping import newton_bdf2

MESH = distorted_box((4, 2, 2))
X = MESH.points
GRAVITY = np.array([0.5, 0.0, -9.81])
CONVERGED = Budget(3000, 1e-13)


class Driven:
    """Vertices that swing, with their rest positions at time zero."""

    is_fixed = False

    def __init__(self, vertices: np.ndarray) -> None:
        self.vertices = vertices

    def positions(self, time: float) -> np.ndarray:
        return X[self.vertices] + 0.02 * np.sin(30.0 * time) ** 2 * np.array([0.0, 1.0, 2.0])


def bdf2(disc, budget=CONVERGED, rule="spectral", gravity=GRAVITY, damping=0.0, motions=()) -> BDF2:
    layers = build_constant_hierarchy(disc, 4).layers
    backend = CpuBackend(disc, 1, layers[0])
    return BDF2(backend, FAS(backend, layers, rule, budget), 1, gravity, damping, motions)


def run(stepper: BDF2, x0: np.ndarray, v0: np.ndarray, steps: list[float]) -> MotionState:
    """The state after steps of these lengths."""
    state = stepper.init(x0, v0)
    for h in steps:
        state, _ = stepper.begin_frame(state, h)
        state = stepper.step(state, h)
    return state


def throw(speed: float) -> np.ndarray:
    velocity = np.zeros_like(X)
    velocity[:, 2] = -speed * X[:, 0]
    return velocity


def test_steps_are_those_of_the_reference():
    held, h = left_end(MESH), 1.0 / 200.0
    E, nu, rho = (np.full(len(MESH.cells), value) for value in (1e5, 0.4, 1000.0))
    disc, material = uniform(MESH, held, E=1e5, nu=0.4), Material.of(MESH, E, nu, rho)
    stepper, reference = bdf2(disc, motions=(Moving(held, X[held]),)), newton_bdf2()
    state, expected = stepper.init(X, throw(2.0)), State(X, throw(2.0), held, GRAVITY)
    expected.v[held] = state.v[held] = 0.0
    for _ in range(4):
        state, _ = stepper.begin_frame(state, h)
        state = stepper.step(state, h)
        expected = reference.step(MESH, material, expected, h)
        np.testing.assert_allclose(state.x, expected.x, rtol=0, atol=1e-11)
        np.testing.assert_allclose(state.v, expected.v, rtol=0, atol=1e-8)


def test_free_fall():
    h, n, v0 = 1.0 / 120.0, 12, np.array([1.0, -2.0, 3.0])
    stepper = bdf2(uniform(MESH))
    first = run(stepper, X, np.tile(v0, (len(X), 1)), [h])
    last = run(stepper, X, np.tile(v0, (len(X), 1)), [h] * n)
    np.testing.assert_allclose(first.x, X + h * v0 + h**2 * GRAVITY, rtol=0, atol=1e-12)
    np.testing.assert_allclose(last.v, np.tile(v0 + n * h * GRAVITY, (len(X), 1)), rtol=0, atol=1e-9)


def test_damping_is_second_order():
    alpha, T = 3.0, 0.2
    stepper = bdf2(uniform(MESH), gravity=np.zeros(3), damping=alpha)
    errors = []
    for n in (16, 32, 64):
        v = run(stepper, X, np.ones_like(X), [T / n] * n).v
        errors.append(abs(v.mean() - np.exp(-alpha * T)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.2)


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
    counts, errors = (32, 64, 128), []
    for n in counts:
        steps = [T / n * pattern[k % len(pattern)] for k in range(n)]
        x = run(bdf2(disc, motions=motions), X, v0, steps).x
        errors.append(float(np.linalg.norm(x - reference.x)))
    assert errors[0] < 0.05 * float(np.linalg.norm(reference.x - X))
    orders = slopes(errors)
    assert orders[-1] == pytest.approx(2.0, abs=0.25)


def test_far_longer_steps_start_afresh():
    stepper = bdf2(uniform(MESH))
    state = run(stepper, X, throw(1.0), [1e-3, 1e-3])
    assert stepper.past(state, 2.4e-3).y is not state.x
    afresh = stepper.past(state, 2.5e-3)
    assert afresh.y is state.x
    assert afresh.h_e == 2.5e-3
    assert stepper.past(state, 1e-3).h_e == pytest.approx(stepper.effective_step(1e-3), rel=1e-15)


def test_a_state_is_all_it_needs():
    disc, v0 = uniform(MESH), throw(1.0)
    whole = run(bdf2(disc), X, v0, [1e-3] * 6)
    half, stepper = run(bdf2(disc), X, v0, [1e-3] * 3), bdf2(disc)
    for _ in range(3):
        half, _ = stepper.begin_frame(half, 1e-3)
        half = stepper.step(half, 1e-3)
    assert np.array_equal(half.x, whole.x)
    assert np.array_equal(half.v, whole.v)


@pytest.mark.parametrize("h", [1e-3, 1.0 / 60.0, 0.1])
def test_one_pass_is_stable(h):
    disc = uniform(MESH, left_end(MESH), E=1e9)
    stepper = bdf2(disc, Budget(1), gravity=np.zeros(3), motions=(Moving(left_end(MESH), X[left_end(MESH)]),))
    x0 = np.where(disc.free[:, None], X + 1e-7 * rng(611).standard_normal(X.shape), X)
    state = run(stepper, x0, np.zeros_like(X), [h] * 400)
    assert np.abs(state.x - X).max() < 2e-6


@pytest.mark.parametrize(("share", "bounded"), [(0.999, True), (1.01, False)])
def test_the_bound_on_the_response_is_sharp(share, bounded):
    """Positions of one mode that every solve maps to x = T xhat."""
    T, h = share * BDF2.least_response, 1.0
    stepper = bdf2(uniform(MESH))
    state = MotionState(0.0, np.full((1, 3), 1.0), np.zeros((1, 3)))
    for _ in range(3000):
        past = stepper.past(state, h)
        x = T * (past.y + past.h_e * past.w)
        after = MotionState(0.0, x, (x - past.y) / past.h_e, stepper.memory(state, h))
        state = replace(after, time=state.time + h)
    assert (np.abs(state.x).max() < 1.0) == bounded
