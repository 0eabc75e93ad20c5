# SPDX-License-Identifier: BSD-3-Clause
"""Rollers.

1. Forces, products and corrections have no component but the one that is left, which is that of the backend below.
2. A correction descends, and its slope is g . dx.
3. The linear system that block Jacobi solves is that of the one component: its blocks are numbers.
"""

from __future__ import annotations

import numpy as np

from femgal.kernels.cpu.backend import CpuBackend
from verify.problems.bodies import body, positions, rng
from verify.problems.rollers import on_rollers

DISC = body("box")
BELOW = CpuBackend(DISC, 1)
BACKEND = on_rollers(BELOW, 1)
X = positions(DISC.mesh, "random")


def test_one_component_is_left():
    d = rng(421).standard_normal(X.shape)
    layer = BACKEND.vertices
    results = [
        (BACKEND.gradient(X), BELOW.gradient(X)),
        (BACKEND.hessian_product(X, d), BELOW.hessian_product(X, d)),
        (BACKEND.nodal_gradient(layer, X, X, 3.0), BELOW.nodal_gradient(layer, X, X, 3.0)),
        (BACKEND.nodal_product(layer, X, d, 3.0), BELOW.nodal_product(layer, X, d, 3.0)),
    ]
    for held, whole in results:
        np.testing.assert_array_equal(held[:, 1], whole[:, 1])
        assert (held[:, [0, 2]] == 0.0).all()


def test_correction():
    layer, xhat = BACKEND.vertices, X + 0.01
    g, H = BACKEND.gradient_and_blocks(layer, X, xhat, 1e4)
    dx, slope = BACKEND.correction(layer, X, xhat, 1e4, 0.7)
    np.testing.assert_allclose(dx[:, 1], -0.7 * g[:, 1] / H[:, 3], rtol=1e-13)
    assert (dx[:, [0, 2]] == 0.0).all()
    np.testing.assert_allclose(slope, float((g * dx).sum()), rtol=1e-12)
    assert slope < 0.0


def test_the_rest_is_the_backend_below():
    assert BACKEND.disc is DISC
    assert BACKEND.threads == 1
    assert BACKEND.precision == "float64"
