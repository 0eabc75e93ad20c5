# SPDX-License-Identifier: BSD-3-Clause
"""Energies of a state and the guard against runaway motions.

1. Kinetic, elastic and gravitational energy in closed form for rigid motion, and the elastic one against scikit-fem.
2. The smallest J is that of the worst tetrahedron.
3. The guard is silent about free fall, strong vibration and prescribed stretching, and speaks of runaway and NaN.
4. It costs no element pass where nothing is prescribed to move.
5. Its memory survives JSON.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from femgal.diagnostics import Energies, EnergyGuard, energies_of
from femgal.kernels.cpu.backend import CpuBackend
from femgal.timestep.state import MotionState
from femgal.timestep.velocity_verlet import VelocityVerlet
from verify.problems.bodies import Moving, distorted_box, left_end, positions, uniform, varied
from verify.reference.elasticity import AssembledElasticity

MESH = distorted_box((5, 3, 3))
X = MESH.points
GRAVITY = np.array([1.0, -2.0, -9.81])


def test_rigid_motion():
    disc = varied(MESH)
    v, shift = np.tile([1.0, 2.0, -2.0], (len(X), 1)), np.array([0.5, 0.1, -3.0])
    energies, per_tet, J = energies_of(CpuBackend(disc, 1), MotionState(0.0, X + shift, v), GRAVITY)
    total = disc.mass.sum()
    assert energies.kinetic == pytest.approx(4.5 * total, rel=1e-12)
    assert energies.potential == pytest.approx(-total * shift @ GRAVITY, rel=1e-12)
    assert abs(energies.elastic) <= 1e-12 * disc.Vmu.sum()
    assert energies.total == energies.kinetic + energies.elastic + energies.potential
    assert energies.min_J == pytest.approx(1.0, abs=1e-12)
    assert per_tet.shape == J.shape == (disc.n_tets,)


@pytest.mark.parametrize("state", ["random", "inverted"])
def test_elastic_energy_and_smallest_volume_ratio(state):
    disc, x = varied(MESH), positions(MESH, state)
    energies, _, J = energies_of(CpuBackend(disc, 1), MotionState(0.0, x, 0.0 * x), GRAVITY)
    assert energies.elastic == pytest.approx(AssembledElasticity(MESH, disc.mu, disc.lam).energy(x), rel=1e-12)
    assert energies.min_J == J.min() < 0.0
    assert energies.as_row()["total_energy"] == energies.total


def guarded(stepper: VelocityVerlet, x0: np.ndarray, v0: np.ndarray, duration: float, frames: int) -> list[str]:
    """Complaints over a run."""
    guard = EnergyGuard(stepper.backend, stepper.gravity, stepper.motions)
    state = stepper.init(x0, v0)
    guard.begin(energies_of(stepper.backend, state, stepper.gravity)[0])
    complaints = []
    for _ in range(frames):
        guard.allow_for_motion(state, duration)
        for _ in range(stepper.substeps):
            state = stepper.step(state, duration / stepper.substeps)
        complaints.append(guard.complaint(energies_of(stepper.backend, state, stepper.gravity)[0]))
    return [text for text in complaints if text]


def test_silent_about_lively_motions():
    free = VelocityVerlet(CpuBackend(uniform(MESH), 1), GRAVITY, substeps=20)
    assert guarded(free, X, np.zeros_like(X), 1.0 / 60.0, 60) == []  # falls ten times its own height
    still = VelocityVerlet(CpuBackend(uniform(MESH), 1), 0.0 * GRAVITY, substeps=40)
    assert guarded(still, X * [1.3, 0.9, 0.9], np.zeros_like(X), 1.0 / 60.0, 20) == []


def test_silent_about_prescribed_stretching():
    left = left_end(MESH)
    right = np.flatnonzero(X[:, 0] >= X[:, 0].max() - 1e-9)
    motions = (Moving(left, X[left]), Moving(right, X[right], (2.0, 0.0, 0.0)))
    backend = CpuBackend(uniform(MESH, np.concatenate([left, right])), 1)
    stepper = VelocityVerlet(backend, np.zeros(3), motions=motions, substeps=60)
    assert guarded(stepper, X, np.zeros_like(X), 1.0 / 60.0, 15) == []  # doubles its length


def test_speaks_of_runaway():
    backend = CpuBackend(uniform(MESH), 1)
    guard = EnergyGuard(backend, GRAVITY, ())
    start = energies_of(backend, MotionState(0.0, X, np.ones_like(X)), GRAVITY)[0]
    guard.begin(start)
    assert guard.complaint(start) is None
    assert "runaway" in (guard.complaint(Energies(guard.limit() * 1.01, 0.0, 0.0, 1.0)) or "")
    assert guard.complaint(Energies(guard.limit() * 0.99, 0.0, 0.0, 1.0)) is None
    assert "not finite" in (guard.complaint(Energies(np.nan, 0.0, 0.0, 1.0)) or "")
    # The limit is of the order of what went in: the fall over the body's own size and the speed at the start.
    height = np.ptp(X, axis=0).max()
    weight = backend.disc.mass.sum() * np.linalg.norm(GRAVITY)
    assert guard.limit() <= 12.0 * (start.kinetic + weight * height)


def test_no_passes_where_nothing_moves():
    backend, left = CpuBackend(uniform(MESH, left_end(MESH)), 1), left_end(MESH)
    guard = EnergyGuard(backend, GRAVITY, (Moving(left, X[left]),))
    guard.allow_for_motion(MotionState(0.0, X, 0.0 * X), 1.0)
    assert backend.passes.total == 0.0
    assert guard.injected == 0.0


def test_memory():
    backend = CpuBackend(uniform(MESH), 1)
    one, two = EnergyGuard(backend, GRAVITY, ()), EnergyGuard(backend, GRAVITY, ())
    one.begin(Energies(1.5, 0.25, -3.0, 0.7))
    one.injected = 12.5
    two.restore(json.loads(json.dumps(one.memory())))
    assert two.limit() == one.limit()
    assert two.memory() == one.memory()
