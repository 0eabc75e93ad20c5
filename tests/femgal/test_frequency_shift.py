# SPDX-License-Identifier: BSD-3-Clause
"""The error of velocity Verlet from its accelerations.

1. For a single mode it is the phase error A omega t (omega h)^2 / 24 times |sin| of velocity Verlet's closed solution,
   within 20% as long as that is small.
2. A mode whose phase is long lost counts by about its amplitude, not by its third derivative: beside a slow mode, the
   estimate stays within a factor of 4 of the true error.
3. For a bending beam it is 0.7 to 2.5 times the distance from a run with a fifth of the step, at every frame.
4. The sample of vertices is as heavy as all free ones, and the frames before it do not matter but for their h^2.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from femgal.scene.load import load_scene
from femgal.simulation import Simulation
from femgal.timestep.control import mass_norm
from femgal.timestep.frequency_shift import MOST_STEPS, MOST_VERTICES, FrequencyShift
from tests.femgal.scenes import hanging_beam
from verify.problems.bodies import distorted_box, left_end, uniform

MESH = distorted_box((5, 3, 3))
DISC = uniform(MESH, left_end(MESH))


def accelerations(shift, omega, A, h, steps, start):
    """x'' of A cos(omega t) along x at all sampled vertices, shape [steps, k, 3]."""
    a = np.zeros((steps, len(shift._sample), 3))
    a[:, :, 0] = -(omega**2) * A * np.cos(omega * (start + h * np.arange(steps)))[:, None]
    return a


def test_a_single_mode():
    shift, h, omega, A, t = FrequencyShift(DISC), 1e-3, 30.0, 0.01, 2.0
    run_ahead = 2.0 / h * math.asin(0.5 * omega * h)
    end = t + h * np.arange(-40, 1)
    true = A * np.sqrt(np.mean((np.cos(run_ahead * end) - np.cos(omega * end)) ** 2) * DISC.mass[DISC.free].sum())
    found = shift.estimate(accelerations(shift, omega, A, h, 41, t - 40 * h), h, h * h * t)
    assert found == pytest.approx(true, rel=0.2)


def test_a_lost_mode_counts_by_its_amplitude():
    shift, h, t = FrequencyShift(DISC), 1e-3, 5.0
    slow, fast = (20.0, 1e-2), (1800.0, 2e-6)
    a = sum(accelerations(shift, omega, A, h, 65, t - 64 * h) for omega, A in (slow, fast))
    heavy = math.sqrt(DISC.mass[DISC.free].sum())
    true = heavy * math.hypot(slow[1] * slow[0] ** 3 * h * h * t / 24.0 / math.sqrt(2.0), fast[1])
    found = shift.estimate(a, h, h * h * t)
    assert true / 2.0 < found < 4.0 * true
    # Its third derivative alone would give twenty times as much.
    assert heavy * fast[1] * fast[0] ** 3 * h * h * t / 24.0 > 20.0 * true


def test_a_bending_beam():
    scene = load_scene("beam-bend", vertices=300, frames=5, overrides={"solver.name": "verlet", "solver.accuracy": 0.5})
    finer = scene.solver.model_copy(update={"safety": 0.18, "accuracy": None})
    simulation = Simulation.prepare(scene)
    reference = Simulation.prepare(scene.model_copy(update={"solver": finer}))
    before = 0.0
    for frame, exact in list(zip(simulation.frames(), reference.frames(), strict=True))[1:]:
        sums = frame.state.memory["control/sums"]
        found, before = math.sqrt(sums[0] - before), sums[0]
        ratio = found / mass_norm(simulation.disc.mass, frame.state.x - exact.state.x)
        assert 0.7 < ratio < 2.5


def test_the_sample():
    shift = FrequencyShift(DISC)
    assert len(shift._sample) == min(MOST_VERTICES, DISC.free.sum())
    assert shift._weights.sum() == pytest.approx(DISC.mass[DISC.free].sum(), rel=1e-12)
    state = Simulation.prepare(hanging_beam(solver="verlet", solver_lines="accuracy = 0.5")).start()
    shift = FrequencyShift(DISC)
    shift._sample = np.arange(3)
    shift.begin_frame(state, 3 * MOST_STEPS)
    for _ in range(3 * MOST_STEPS):
        shift.observe(state)
    assert len(shift._seen) == MOST_STEPS + 1
