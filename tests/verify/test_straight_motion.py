# SPDX-License-Identifier: BSD-3-Clause
"""Closed forms of straight motions.

1. The stiffness is the block of scikit-fem's Hessian along the direction, at rest and far from it.
2. The lattice frequency is that of a dense eigensolver, and tends to the continuum's as (k d)^2 / 24.
3. The factor of backward Euler and the angle of Verlet are those of one step of each method on a harmonic.
4. The modes are mass-orthonormal and hold still what is held.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from verify.problems.bodies import body
from verify.problems.waves import standing_wave, straight_line_state
from verify.reference.elasticity import AssembledElasticity
from verify.reference.straight_motion import (
    backward_euler_factor,
    lattice_frequency,
    modes,
    straight_stiffness,
    verlet_angle,
)

DISC = body("box")


@pytest.mark.parametrize("direction", [0, 2])
def test_stiffness(direction):
    x = DISC.mesh.points.copy()
    x[:, direction] += (straight_line_state(DISC) - DISC.mesh.points)[:, 0]
    H = AssembledElasticity(DISC.mesh, DISC.mu, DISC.lam).hessian(x)[direction::3][:, direction::3]
    K = straight_stiffness(DISC, direction)
    assert abs(H - K).max() < 1e-12 * abs(K).max()


@pytest.mark.parametrize("kind", ["longitudinal", "shear"])
def test_lattice_frequency(kind):
    wave = standing_wave(kind)
    assert float(np.abs(modes(wave.disc)[0] - wave.omega).min()) < 1e-10 * wave.omega
    k, d = math.pi, 1.0 / 200
    assert lattice_frequency(1.0, 1.0, 200) / k - 1.0 == pytest.approx(-((k * d) ** 2) / 24.0, rel=1e-3)


def test_steps_of_a_harmonic():
    omega, h, x, v = 3.0, 0.1, 1.0, 0.0
    for n in range(1, 6):
        v = (v - h * omega**2 * x) / (1.0 + (omega * h) ** 2)
        x += h * v
        assert x == pytest.approx(float(np.real(backward_euler_factor(omega, h) ** n)), rel=1e-12)
    before, now = 1.0, 1.0 - 0.5 * (omega * h) ** 2
    for n in range(1, 6):
        assert now == pytest.approx(math.cos(n * verlet_angle(omega, h)), rel=1e-12)
        before, now = now, 2.0 * now - before - (omega * h) ** 2 * now


def test_modes():
    omega, shapes = modes(DISC)
    np.testing.assert_allclose(shapes.T @ (DISC.mass[:, None] * shapes), np.eye(len(omega)), atol=1e-11)
    assert (shapes[~DISC.free] == 0.0).all()
    assert (omega > 0.0).all()
