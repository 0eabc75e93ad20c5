# SPDX-License-Identifier: BSD-3-Clause
"""The error of an implicit method from the same motion with half the substeps.

1. The companion is the run with half the substeps, bit for bit, and the estimate its distance; the motion itself is
   what it would be without a companion.
2. Where the steps resolve the motion, the estimate is 1 to 5 times the distance from a run with far shorter ones.
"""

from __future__ import annotations

import numpy as np

from femgal.simulation import Simulation
from femgal.timestep.companion import Companion
from femgal.timestep.control import mass_norm
from tests.femgal.scenes import hanging_beam

FRAMES, SUBSTEPS = 3, 6


def newton(substeps):
    lines = f"substeps = {substeps}\nreduction = 1e-3"
    return Simulation.prepare(hanging_beam(solver="newton-multigrid", solver_lines=lines))


def states(simulation, substeps, companion=None):
    """States of some frames with fixed substeps, and the companion's distances."""
    method, T = simulation.stepper, simulation.frame_duration
    state, out, distances = simulation.start(), [], []
    memory = companion.init(state) if companion else {}
    for _ in range(FRAMES):
        state, _ = method.begin_frame(state, T, substeps)
        for _ in range(substeps):
            state = method.step(state, T / substeps)
        out.append(state)
        if companion:
            memory, distance = companion.end_frame(memory, state, T, substeps)
            distances.append(distance)
    return out, distances


def test_it_is_the_run_with_half_the_substeps():
    fine, coarse = newton(SUBSTEPS), newton(SUBSTEPS // 2)
    companion = Companion(newton(SUBSTEPS // 2).stepper, fine.disc.mass)
    found, distances = states(fine, SUBSTEPS, companion)
    alone, _ = states(newton(SUBSTEPS), SUBSTEPS)
    halved, _ = states(coarse, SUBSTEPS // 2)
    for state, same, other, distance in zip(found, alone, halved, distances, strict=True):
        np.testing.assert_array_equal(state.x, same.x)
        assert distance == mass_norm(fine.disc.mass, state.x - other.x) > 0.0


def test_the_estimate_is_cautious():
    simulation = newton(SUBSTEPS)
    found, distances = states(simulation, SUBSTEPS, Companion(newton(1).stepper, simulation.disc.mass))
    exact, _ = states(newton(16 * SUBSTEPS), 16 * SUBSTEPS)
    for state, truth, distance in zip(found, exact, distances, strict=True):
        assert 1.0 < distance / mass_norm(simulation.disc.mass, state.x - truth.x) < 5.0
