# SPDX-License-Identifier: BSD-3-Clause
"""The incremental potential of an implicit step.

1. Gradient and Hessian product are the derivatives of the value: Taylor remainders of order 2 and 3, with damping too.
2. Gradient and Hessian product equal the assembled ones at free vertices and are zero at constrained ones.
3. The residual is h^2 M^-1 times the gradient, which without damping is (x - xhat) + h^2 M^-1 grad E.
4. eps18 is its root mean square over the vertices; 1 m everywhere along one axis gives 1 m.
5. Along a line phi changes by the polynomial whose coefficients `along` gives, also for corrections of a coarse layer.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.timestep.potential import eps18
from verify.problems.bodies import distorted_box, force_scale, left_end, positions, potential_at, rng, slopes, varied
from verify.reference.elasticity import AssembledElasticity

MESH = distorted_box()
DISC = varied(MESH, left_end(MESH, 0.25))
H = 1.0 / 300.0
X = positions(MESH, "random")
XHAT = X + 0.01 * rng(80).standard_normal(X.shape) * DISC.free[:, None]
DIRECTION = 0.02 * rng(81).standard_normal(X.shape) * DISC.free[:, None]


@pytest.mark.parametrize("inertia", [1.0, 1.3])
def test_derivatives(inertia):
    phi = potential_at(DISC, XHAT, H, inertia)
    g, Hd = phi.gradient(X), phi.hessian_product(X, DIRECTION)
    first, second = [], []
    for t in 2.0 ** -np.arange(6.0, 10.0):
        change = phi.value(X + t * DIRECTION) - phi.value(X) - t * (g * DIRECTION).sum()
        first.append(abs(change))
        second.append(abs(change - 0.5 * t * t * (Hd * DIRECTION).sum()))
    np.testing.assert_allclose(slopes(first)[-2:], 2.0, atol=0.1)
    np.testing.assert_allclose(slopes(second)[-2:], 3.0, atol=0.1)


@pytest.mark.parametrize("inertia", [1.0, 1.3])
def test_equals_assembled(inertia):
    phi, elasticity = potential_at(DISC, XHAT, H, inertia), AssembledElasticity(MESH, DISC.mu, DISC.lam)
    weight = inertia / H**2 * DISC.mass[:, None]
    g = weight * (X - XHAT) + elasticity.gradient(X)
    scale = max(force_scale(DISC, X), np.abs(weight * (X - XHAT)).max())
    np.testing.assert_allclose(phi.gradient(X)[DISC.free], g[DISC.free], rtol=0, atol=1e-13 * scale)
    Hd = weight * DIRECTION + (elasticity.hessian(X) @ DIRECTION.ravel()).reshape(-1, 3)
    product = phi.hessian_product(X, DIRECTION)
    np.testing.assert_allclose(product[DISC.free], Hd[DISC.free], rtol=0, atol=1e-13 * np.linalg.norm(Hd))
    for zero in (phi.gradient(X), product):
        assert (zero[~DISC.free] == 0.0).all()
    value = 0.5 * (weight * (X - XHAT) ** 2).sum() + elasticity.energy(X)
    assert phi.value(X) == pytest.approx(value, rel=1e-12)


def test_residual_and_eps18():
    phi, elasticity = potential_at(DISC, XHAT, H), AssembledElasticity(MESH, DISC.mu, DISC.lam)
    residual = phi.residual(X)
    expected = (X - XHAT) + H**2 * elasticity.gradient(X) / DISC.mass[:, None]
    scale = np.abs(expected).max()
    np.testing.assert_allclose(residual[DISC.free], expected[DISC.free], rtol=0, atol=1e-12 * scale)
    assert eps18(residual) == pytest.approx(np.sqrt((residual**2).sum(axis=1).mean()), rel=1e-14)
    assert eps18(np.tile([0.0, 1.0, 0.0], (7, 1))) == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_along_a_line(number):
    phi = potential_at(DISC, XHAT, H, 1.3)
    layer = build_constant_hierarchy(DISC, 4).layers[number]
    d = np.zeros_like(X)
    phi.backend.prolong(layer, 0.03 * rng(82).standard_normal((layer.n_nodes, 3)), d)
    coefficients = phi.along(layer, X, d)
    for t in (-0.5, 1e-2, 1.0, 1.7):
        terms = coefficients * t ** np.arange(1, 7)
        rounding = np.abs(terms).sum() + phi.value(X)
        assert abs(terms.sum() - (phi.value(X + t * d) - phi.value(X))) <= 1e-13 * rounding
    assert coefficients[0] == pytest.approx((phi.gradient(X) * d).sum(), rel=1e-10)
    assert 2.0 * coefficients[1] == pytest.approx((phi.hessian_product(X, d) * d).sum(), rel=1e-10)
