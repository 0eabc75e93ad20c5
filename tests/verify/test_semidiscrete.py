# SPDX-License-Identifier: BSD-3-Clause
"""The reference motion of the semi-discrete body.

1. Its forces are scikit-fem's.
2. It keeps energy and momenta far better than any time stepping.
3. Modes are orthonormal in the mass, and a small vibration in one of them follows its cosine.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from verify.integrators.under_test import Material, State
from verify.problems.bodies import left_end, mesh
from verify.problems.moving_body import MovingBody, held_and_loaded, tumbling
from verify.reference.elasticity import AssembledElasticity
from verify.reference.semidiscrete import element_forces, exact_motion, modes


def test_forces():
    body = held_and_loaded()
    expected = AssembledElasticity(body.mesh, body.material.mu, body.material.lam).gradient(body.start.x)
    found = element_forces(body.mesh, body.material)(body.start.x)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_what_is_kept():
    body = tumbling()
    end = exact_motion(body.mesh, body.material, body.start, 2e-3)
    assert body.energy(end) == pytest.approx(body.energy(body.start), rel=1e-9)
    np.testing.assert_allclose(body.momentum(end), body.momentum(body.start), rtol=1e-11)
    np.testing.assert_allclose(body.angular_momentum(end), body.angular_momentum(body.start), rtol=1e-9)


def test_modes():
    tets = mesh("box")
    material, held = Material.of(tets, 1e5, 0.3, 1000.0), left_end(tets)
    omega, phi = modes(tets, material, held)
    body = MovingBody(tets, material, State(tets.points.copy(), np.zeros_like(tets.points), held))
    products = np.einsum("knc,n,lnc->kl", phi[:6], body.mass, phi[:6])
    np.testing.assert_allclose(products, np.eye(6), atol=1e-12)
    a, t = 1e-5, 0.02
    start = replace(body.start, x=tets.points + a * phi[0])
    end = exact_motion(tets, material, start, t)
    np.testing.assert_allclose(end.x - tets.points, a * np.cos(omega[0] * t) * phi[0], atol=1e-9)
