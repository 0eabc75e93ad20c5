# SPDX-License-Identifier: BSD-3-Clause
"""The manufactured solution.

1. First and second derivatives agree with central differences, on either side of a kink.
2. The stress is that of the energy (differences), and the body force is minus its divergence (differences).
3. Weakly: the work of the stress on any virtual displacement is that of body force and interface load, the interface
   between two materials included.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.generators import box
from verify.problems.bodies import rng
from verify.reference.elasticity import scalar_basis
from verify.reference.loads import body_load, surface_load
from verify.reference.manufactured import kinked_field, smooth_field

FIELDS = {"smooth": smooth_field(), "kinked": kinked_field(0.5)}
SOFT, HARD = (3.0, 11.0), (20.0, 47.0)


def points():
    X = rng(441).uniform(0.0, 1.0, (3, 40))
    return X[:, np.abs(X[0] - 0.5) > 0.01]


def differences(function, X, h=1e-5):
    """Central differences along each axis, the new axis before those of the points."""
    steps = h * np.eye(3)[:, :, None]
    return np.stack([(function(X + step) - function(X - step)) / (2.0 * h) for step in steps], axis=-2)


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
def test_derivatives(field):
    X = points()
    np.testing.assert_allclose(field.gradient(X), differences(field.displacement, X), atol=1e-8)
    np.testing.assert_allclose(field.second(X), differences(field.gradient, X), atol=1e-8)


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
def test_stress_and_body_force(field):
    X = points()

    def energy(F):
        J = np.linalg.det(F)
        return 0.5 * SOFT[0] * ((F**2).sum() - 3.0) - SOFT[0] * (J - 1.0) + 0.5 * SOFT[1] * (J - 1.0) ** 2

    P = field.stress(X, *SOFT)
    for k in range(5):
        F = np.eye(3) + field.gradient(X)[:, :, k]
        E = 1e-6 * np.eye(9).reshape(9, 3, 3)
        slope = [(energy(F + e) - energy(F - e)) / 2e-6 for e in E]
        np.testing.assert_allclose(P[:, :, k], np.reshape(slope, (3, 3)), atol=1e-7)
    divergence = np.einsum("ijj...->i...", differences(lambda Y: field.stress(Y, *SOFT), X))
    np.testing.assert_allclose(field.body_force(X, *SOFT), -divergence, atol=1e-6)


def test_weak_balance_across_an_interface():
    mesh, field = box(cells=(8, 8, 8)), FIELDS["kinked"]
    is_hard = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5
    mu, lam = (np.where(is_hard, HARD[k], SOFT[k])[:, None] for k in (0, 1))
    load = body_load(mesh, lambda X, elements: field.body_force(X, mu, lam))
    load += surface_load(mesh, lambda X: np.isclose(X[0], 0.5), lambda X: field.interface_load(X, SOFT, HARD))
    inner = ((mesh.points > 0.0) & (mesh.points < 1.0)).all(axis=1)
    v = rng(442).standard_normal(mesh.points.shape) * inner[:, None]
    basis = scalar_basis(mesh, 1, 4)
    P = field.stress(np.asarray(basis.global_coordinates()), mu, lam)
    grad = np.stack([basis.interpolate(np.ascontiguousarray(one)).grad for one in v.T])
    work = float(((P * grad).sum(axis=(0, 1)) * basis.dx).sum())
    # Sines are not integrated exactly.
    assert (load * v).sum() == pytest.approx(work, abs=1e-4 * np.abs(load * v).sum())
