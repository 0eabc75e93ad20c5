# SPDX-License-Identifier: BSD-3-Clause
"""Cases about rotations, translations, numbering and units, and the scales that they share with others.

1. Every quick row passes.
2. A backend that sees where a body stands, one that forgets a turn, and one that drops a corner's force are noticed.
3. At rest the terms of an element are what a hand computes; every term is at least the quantity itself.
4. A relative error of the positions of u changes energies, forces and products by less than u times their terms, at
   every state, slivers included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from meshes.generators import box
from meshes.types import TetMesh
from verify.problems.bodies import STATES, body, distorted_box, positions, released, rng, uniform, varied
from verify.problems.scales import at_vertices, product_terms, terms
from verify.reference.elasticity import AssembledElasticity
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use


def test_quick_rows_pass():
    rows = choose("invariance/*", quick=True)
    assert len(rows) >= 20
    assert [str(one.row) for one in run(rows, Use()) if one.status is not Status.PASS] == []


class Faulty:
    """Production passes with a fault in the gradient."""

    def __init__(self, backend, fault) -> None:
        self.backend, self.fault = backend, fault

    def __getattr__(self, name):
        return getattr(self.backend, name)

    def gradient(self, x):
        return self.fault(x, self.backend.gradient(x))


@dataclass(frozen=True)
class FaultyUse(Use):
    """The suite with a fault in production."""

    fault: object = None

    def backend(self, disc, precision="float64"):
        return Faulty(super().backend(disc, precision), self.fault)


def blurred(x, g):
    """Errors that grow with the distance four times as fast as those of float32."""
    return g + 1e-4 * np.abs(x).max() * np.abs(g).max()


def anisotropic(x, g):
    return g * [1.0, 1.0, 1.0002]


def attracted(x, g):
    return g + 1e-3 * np.abs(g).max() * x


def without_last(x, g):
    return g * (np.arange(len(g)) != len(g) // 2)[:, None]


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (anisotropic, "invariance/forces[float32,rabbit,random]"),
        (anisotropic, "invariance/sum-of-moments[float32,rabbit]"),
        (attracted, "invariance/far-away[float32,rabbit]"),
        (blurred, "invariance/parted-bodies[float32,10m]"),
        (without_last, "invariance/sum-of-forces[float32,rabbit]"),
    ],
)
def test_faults_are_noticed(fault, name):
    (row,) = choose(name)
    assert run_row(row, FaultyUse(fault=fault)).status is Status.FAIL


def test_terms_at_rest():
    X = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    disc = uniform(TetMesh(X, np.array([[0, 1, 2, 3]])), E=2.6, nu=0.3)
    mu, lam = 1.0, 2.5
    f = (2.0 * np.sqrt(3.0) + 1.0) * np.sqrt(3.0)
    found = terms(disc, X)
    size = 1.0 + np.sqrt(3.0)
    P = 2.0 * mu * size
    assert terms(disc, X).stress == pytest.approx(np.sqrt(3.0) * P / 6.0)
    H = mu + size**2 * lam + size * mu
    assert found.energy == pytest.approx((0.5 * mu * size**2 + P * f) / 6.0)
    assert found.curvature == pytest.approx(3.0 * H / 6.0)
    assert found.force == pytest.approx(np.sqrt(3.0) * f * H / 6.0)
    assert found.stiffness == pytest.approx(3.0 * (H + f * (size**2 * lam + mu)) / 6.0)
    assert at_vertices(disc, np.array([2.0])).tolist() == [[2.0]] * 4
    assert terms(disc, X, "float32").energy == pytest.approx((0.5 * mu * size**2 + P * 6.0) / 6.0)


def needles() -> TetMesh:
    """Tetrahedra a thousand times as long as thick."""
    return box((1.0, 1e-3, 1e-3), (3, 2, 2), jitter=0.1)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("mesh", [distorted_box((3, 2, 2)), needles()], ids=["box", "needles"])
def test_terms_bound_the_rounding_of_positions(mesh, state):
    disc, u = varied(mesh), 1e-8
    x, d = positions(mesh, state), rng(621).standard_normal(mesh.points.shape)
    y = x * (1.0 + u * rng(622).uniform(-1.0, 1.0, x.shape))
    reference, scale = AssembledElasticity(mesh, disc.mu, disc.lam), terms(disc, x)
    assert abs(reference.energy(y) - reference.energy(x)) <= 2.0 * u * scale.energy.sum()
    forces = np.abs(reference.gradient(y) - reference.gradient(x)) / at_vertices(disc, scale.force)
    assert forces.max() <= 2.0 * u
    products = ((reference.hessian(y) - reference.hessian(x)) @ d.ravel()).reshape(-1, 3)
    assert (np.abs(products) / product_terms(disc, x, d)).max() <= 4.0 * u


def test_released():
    disc = body("rabbit")
    assert not disc.free.all()
    assert released(disc).free.all()
    assert released(disc).mesh is disc.mesh
