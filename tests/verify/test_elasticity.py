# SPDX-License-Identifier: BSD-3-Clause
"""The assembled reference against itself and closed forms: the tests of the core rest on it.

1. The gradient is the derivative of the energy, the Hessian that of the gradient (central differences), at random and
   inverted states.
2. The Hessian is symmetric; at rest of a free body exactly six of its eigenvalues vanish and none is negative.
3. A confined stretch s has the energy V ((mu + lam) / 2 (s - 1)^2).
4. The lumped masses add up to density times volume.
5. cofactor(F)^T F = det F I, and its derivative agrees with differences.
6. All of 1 holds for quadratic shape functions, whose energy of a quadratic field is the integral by hand; their
   consistent mass adds up to the mass, and so does that of linear ones.
7. Young's modulus and Poisson's ratio come back from mu and lam by the formulas of Lame's parameters.
"""

from __future__ import annotations

import numpy as np
import pytest

from verify.problems.bodies import distorted_box, positions, rng
from verify.reference.elasticity import (
    AssembledElasticity,
    cofactor,
    cofactor_derivative,
    consistent_mass,
    lumped_mass,
    material_parameters,
)

MESH = distorted_box((3, 2, 2))
MU, LAM = 3.0, 11.0


@pytest.fixture(scope="module")
def assembled():
    return AssembledElasticity(MESH, MU, LAM)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("state", ["random", "inverted"])
def test_derivatives(degree, state):
    assembled = AssembledElasticity(MESH, MU, LAM, degree)
    x = (
        positions(MESH, state)
        if degree == 1
        else assembled.nodes + 0.03 * rng(303).standard_normal(assembled.nodes.shape)
    )
    if degree == 2 and state == "inverted":
        x = x * [-1.0, 0.9, 1.2]
    d = rng(301).standard_normal(x.shape)
    d /= np.linalg.norm(d)
    h = 1e-5
    slope = (assembled.energy(x + h * d) - assembled.energy(x - h * d)) / (2 * h)
    g, H = assembled.gradient(x), assembled.hessian(x)
    # Differences lose the square root of rounding, relative to the terms that cancel.
    assert slope == pytest.approx((g * d).sum(), abs=1e-6 * np.linalg.norm(g))
    curvature = (assembled.gradient(x + h * d) - assembled.gradient(x - h * d)).ravel() / (2 * h)
    np.testing.assert_allclose(H @ d.ravel(), curvature, atol=1e-6 * np.linalg.norm(curvature))


def test_rest_hessian_has_the_six_rigid_motions(assembled):
    H = assembled.hessian(MESH.points).toarray()
    np.testing.assert_allclose(H, H.T, atol=1e-12 * np.abs(H).max())
    values = np.linalg.eigvalsh(H)
    assert (np.abs(values[:6]) < 1e-10 * values[-1]).all()
    assert values[6] > 1e-6 * values[-1]


@pytest.mark.parametrize("s", [0.5, 1.0, 1.7])
def test_confined_stretch(assembled, s):
    volume = float(MESH.volumes.sum())
    expected = volume * 0.5 * (MU + LAM) * (s - 1.0) ** 2
    assert assembled.energy(MESH.points * [s, 1.0, 1.0]) == pytest.approx(expected, rel=1e-12, abs=1e-13 * volume * MU)


def test_lumped_mass():
    rho = 2.0 + np.arange(len(MESH.cells))
    assert lumped_mass(MESH, rho).sum() == pytest.approx(float((rho * MESH.volumes).sum()), rel=1e-13)


def test_cofactor():
    F, G = rng(302).standard_normal((2, 3, 3, 5))
    C = cofactor(F)
    for k in range(5):
        np.testing.assert_allclose(C[..., k].T @ F[..., k], np.linalg.det(F[..., k]) * np.eye(3), atol=1e-12)
    h = 1e-6
    difference = (cofactor(F + h * G) - cofactor(F - h * G)) / (2 * h)
    np.testing.assert_allclose(cofactor_derivative(F, G), difference, atol=1e-8)


def test_quadratic_energy():
    # u1 = a x^2 without other components: F11 = 1 + 2 a x, and the energy density is (mu + lam) / 2 (F11 - 1)^2.
    elasticity, a = AssembledElasticity(MESH, MU, LAM, degree=2), 0.3
    length, width, height = np.ptp(MESH.points, axis=0)
    x = elasticity.nodes + a * elasticity.nodes[:, :1] ** 2 * [1.0, 0.0, 0.0]
    expected = 0.5 * (MU + LAM) * 4.0 * a**2 * length**3 / 3.0 * width * height
    assert elasticity.energy(x) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("degree", [1, 2])
def test_consistent_mass(degree):
    rho = 2.0 + np.arange(len(MESH.cells))
    M = consistent_mass(MESH, rho, degree)
    assert M.sum() == pytest.approx(float((rho * MESH.volumes).sum()), rel=1e-13)
    # The integral of x^2 over a box is exact from quadratic functions on.
    if degree == 2:
        x = AssembledElasticity(MESH, MU, LAM, 2).nodes[:, 0]
        length, width, height = np.ptp(MESH.points, axis=0)
        exact = length**3 / 3.0 * width * height
        assert x @ consistent_mass(MESH, 1.0, 2) @ x == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("nu", [-0.3, 0.0, 0.3, 0.49])
def test_material_parameters(nu):
    mu, lam = material_parameters(7e4, nu)
    lame = lam - mu
    assert mu * (3.0 * lame + 2.0 * mu) / (lame + mu) == pytest.approx(7e4, rel=1e-13)
    assert lame / (2.0 * (lame + mu)) == pytest.approx(nu, abs=1e-14)
