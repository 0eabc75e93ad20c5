# SPDX-License-Identifier: BSD-3-Clause
"""The error of velocity Verlet and of TR-BDF2 from their accelerations.

1. For a single mode it is the phase error A omega t (omega h)^2 c times |sin| of the method's closed solution, c = 1/24
   or sqrt(1/2) - 2/3, within 20% as long as that is small.
2. A mode whose phase is long lost counts by about its amplitude, not by its third derivative: beside a slow mode, the
   estimate stays within a factor of 4 of the true error.
3. For a bending beam it is 0.7 to 2.5 times the distance from a run with a fifth of the step, at every frame.
4. Of a motion that began with implicit Euler, what that step lost stays, and is there without a slope to look at.
5. Implicit steps that are far too long for a light beam are known to be: its error, a third of the motion and more, is
   estimated as well as a small one.
6. The sample of vertices is as heavy as all free ones, and the frames before it do not matter but for their h^2.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from femgal.kernels.plain.backend import PlainBackend
from femgal.scene.load import load_scene
from femgal.simulation import Simulation
from femgal.timestep import tr_bdf2, velocity_verlet
from femgal.timestep.control import mass_norm
from femgal.timestep.frequency_shift import MOST_STEPS, MOST_VERTICES, FrequencyShift
from femgal.timestep.state import MotionState
from tests.femgal.scenes import hanging_beam
from verify.problems.bodies import distorted_box, left_end, uniform

MESH = distorted_box((5, 3, 3))
DISC = uniform(MESH, left_end(MESH))


def of_verlet():
    return FrequencyShift(PlainBackend(DISC, 1), velocity_verlet.FREQUENCY_SHIFT, fewest=8)


def of_tr_bdf2():
    return FrequencyShift(PlainBackend(DISC, 1), tr_bdf2.FREQUENCY_SHIFT, fewest=1, euler_share=0.3)


def phase_of_tr_bdf2(y):
    """Angle by which a step turns a mode of omega h = y: of the trapezoidal rule, then BDF2, for u' = i y u."""
    g = tr_bdf2.GAMMA
    middle = (1.0 + 0.5j * g * y) / (1.0 - 0.5j * g * y)
    return np.angle((tr_bdf2.A_GAMMA * middle + tr_bdf2.A_0) / (1.0 - 0.5j * g * y))


def accelerations(shift, omega, A, h, steps, start):
    """x'' of A cos(omega t) along x at all sampled vertices, shape [steps, k, 3]."""
    a = np.zeros((steps, len(shift._sample), 3))
    a[:, :, 0] = -(omega**2) * A * np.cos(omega * (start + h * np.arange(steps)))[:, None]
    return a


@pytest.mark.parametrize(
    ("make", "angle"), [(of_verlet, lambda y: 2.0 * math.asin(0.5 * y)), (of_tr_bdf2, phase_of_tr_bdf2)]
)
def test_a_single_mode(make, angle):
    shift, h, omega, A, t = make(), 1e-3, 30.0, 0.01, 2.0
    run_ahead = angle(omega * h) / h
    end = t + h * np.arange(-40, 1)
    true = A * np.sqrt(np.mean((np.cos(run_ahead * end) - np.cos(omega * end)) ** 2) * DISC.mass[DISC.free].sum())
    found = shift.estimate(accelerations(shift, omega, A, h, 41, t - 40 * h), h, h * h * t)
    assert found == pytest.approx(true, rel=0.2)


def test_a_lost_mode_counts_by_its_amplitude():
    shift, h, t = of_verlet(), 1e-3, 5.0
    slow, fast = (20.0, 1e-2), (1800.0, 2e-6)
    a = sum(accelerations(shift, omega, A, h, 65, t - 64 * h) for omega, A in (slow, fast))
    heavy = math.sqrt(DISC.mass[DISC.free].sum())
    true = heavy * math.hypot(slow[1] * slow[0] ** 3 * h * h * t / 24.0 / math.sqrt(2.0), fast[1])
    found = shift.estimate(a, h, h * h * t)
    assert true / 2.0 < found < 4.0 * true
    # Its third derivative alone would give twenty times as much.
    assert heavy * fast[1] * fast[0] ** 3 * h * h * t / 24.0 > 20.0 * true


@pytest.mark.parametrize("solver", ["verlet", "newton-multigrid"])
def test_a_bending_beam(solver):
    def bending(solver, **settings):
        overrides = {f"solver.{key}": value for key, value in settings.items()}
        overrides |= {"solver.name": solver, "solver.threads": 1}
        return Simulation.prepare(load_scene("beam-bend", vertices=300, frames=5, overrides=overrides))

    simulation, reference = bending(solver, accuracy=0.05), bending("verlet", safety=0.18)
    before = 0.0
    for frame, exact in list(zip(simulation.frames(), reference.frames(), strict=True))[1:]:
        sums = frame.state.memory["control/sums"]
        found, before = math.sqrt(sums[0] - before), sums[0]
        ratio = found / mass_norm(simulation.disc.mass, frame.state.x - exact.state.x)
        assert 0.7 < ratio < 2.5


def test_steps_that_are_far_too_long():
    def ringing(solver, **settings):
        overrides = {f"solver.{key}": value for key, value in settings.items()}
        overrides |= {"solver.name": solver, "solver.threads": 1, "bodies.0.rho": 1.0}
        return Simulation.prepare(load_scene("beam-bend", vertices=300, frames=10, overrides=overrides))

    simulation, exact = ringing("newton-multigrid", substeps=1), list(ringing("verlet", safety=0.5).frames())
    shift = FrequencyShift(simulation.backend, tr_bdf2.FREQUENCY_SHIFT, fewest=1, euler_share=0.5 * tr_bdf2.GAMMA)
    T, mass, state = simulation.frame_duration, simulation.disc.mass, simulation.start()
    memory, sums = shift.init(state), np.zeros(3)
    for frame in exact[1:]:
        shift.begin_frame(state, 1)
        state = simulation.stepper.step(state, T)
        shift.observe(state)
        memory, estimated = shift.end_frame(memory, state, T, 1)
        moved = frame.state.x - exact[0].state.x
        sums += (estimated**2, mass_norm(mass, state.x - frame.state.x) ** 2, mass_norm(mass, moved) ** 2)
    assert np.sqrt(sums[1] / sums[2]) > 0.3
    assert 0.7 < np.sqrt(sums[0] / sums[1]) < 2.5


def test_what_the_start_lost():
    shift, T, x = of_tr_bdf2(), 0.1, np.zeros((DISC.n_vertices, 3))
    a = np.zeros_like(x)
    a[:, 1] = -7.0
    state = MotionState(0.0, x, x)
    memory = shift.init(state)
    fallen = 0.5 * (0.3 * T) ** 2 * 7.0 * math.sqrt(DISC.mass[DISC.free].sum())
    for _ in range(2):
        shift.begin_frame(state, 1)
        state = MotionState(state.time + T, x, x, {"acceleration": a})
        shift.observe(state)
        memory, error = shift.end_frame(memory, state, T, 1)
        assert error == pytest.approx(fallen, rel=1e-12)


def test_the_sample():
    shift = of_verlet()
    assert len(shift._sample) == min(MOST_VERTICES, DISC.free.sum())
    assert shift._weights.sum() == pytest.approx(DISC.mass[DISC.free].sum(), rel=1e-12)
    state = Simulation.prepare(hanging_beam(solver="verlet", solver_lines="accuracy = 0.5")).start()
    shift = of_verlet()
    shift._sample = np.arange(3)
    shift.begin_frame(state, 3 * MOST_STEPS)
    for _ in range(3 * MOST_STEPS):
        shift.observe(state)
    assert len(shift._seen) == MOST_STEPS + 1
