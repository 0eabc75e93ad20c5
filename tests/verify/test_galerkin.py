# SPDX-License-Identifier: BSD-3-Clause
"""The incremental potential assembled at one state, and the sizes of its terms.

1. Gradient and Hessian agree with differences of the value; parts of the elements add up to the whole.
2. The definite part at rest is the whole, and where the body is inverted it lies above: no negative curvature.
3. Inertia and elasticity weigh the same at the balanced step, on any mesh.
4. u is that of its definition; a term is never below the norm of what it stands for on one element.
5. A mesh too large to assemble is skipped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from verify.problems.bodies import STATES, body, rng
from verify.reference import galerkin
from verify.reference.galerkin import assembled, balanced, layers, shape_gradients, shares, strains, weights
from verify.reference.transfer import diagonal_blocks, mass_matrix
from verify.suite.case import Skip

DISC = body("box")


@pytest.mark.parametrize("state", STATES)
def test_derivatives(state):
    at, t = assembled(DISC, state), 1e-6
    d = rng(401).standard_normal(at.x.shape)
    slope = (at.value(at.x + t * d) - at.value(at.x - t * d)) / (2.0 * t)
    assert slope == pytest.approx(float((at.g * d).sum()), rel=1e-6)
    curvature = (at.value(at.x + 1e-3 * d) - 2.0 * at.value(at.x) + at.value(at.x - 1e-3 * d)) / 1e-6
    assert curvature == pytest.approx(float(d.ravel() @ (at.A @ d.ravel())), rel=1e-2)


@pytest.mark.parametrize("state", STATES)
def test_parts_add_up(state):
    at, some = assembled(DISC, state), rng(402).random(DISC.n_tets) < 0.3
    one, other = at.of_elements(some), at.of_elements(~some)
    inertia = at.inverse_h2 * mass_matrix(DISC.mass)
    assert abs(at.A - one.A - other.A - inertia).max() <= 1e-12 * abs(at.A).max()
    moved = at.inverse_h2 * DISC.mass[:, None] * (at.x - at.xhat)
    np.testing.assert_allclose(one.g + other.g + moved, at.g, atol=1e-12 * np.abs(at.g).max())


def test_definite_part():
    d = rng(403).standard_normal(DISC.mesh.points.shape)
    for state in STATES:
        at = assembled(DISC, state)
        whole = (at.A @ d.ravel()).reshape(-1, 3) - at.inverse_h2 * DISC.mass[:, None] * d
        definite = at.definite_product(d)
        gain = float((d * (definite - whole)).sum()) / float((d * definite).sum())
        assert abs(gain) <= 1e-12 if state == "rest" else gain > 1e-3
    np.testing.assert_allclose(assembled(DISC, "rest").definite_product(d), _elastic("rest", d), atol=1e-6)


def _elastic(state: str, d: np.ndarray) -> np.ndarray:
    at = assembled(DISC, state)
    return (at.A @ d.ravel()).reshape(-1, 3) - at.inverse_h2 * DISC.mass[:, None] * d


@pytest.mark.parametrize("name", ["box", "rabbit"])
def test_balance(name):
    disc = body(name)
    at = assembled(disc, "rest")
    elastic = np.trace(diagonal_blocks(at.A), axis1=1, axis2=2) / 3.0 - at.inverse_h2 * disc.mass
    assert np.median(elastic / (balanced(disc) * disc.mass)) == pytest.approx(1.0, rel=0.05)


def test_strains_and_shares():
    layer = layers(DISC, "lattice")[1]
    u, most, w, grad = strains(DISC, layer), shares(DISC, layer), weights(layer).toarray(), shape_gradients(DISC)
    for e in (0, 100, 575):
        parts = w[DISC.mesh.cells[e]][:, :, None] * grad[e][:, None, :]
        np.testing.assert_allclose(u[e].toarray()[0], np.linalg.norm(parts.sum(axis=0), axis=1), atol=1e-12)
        np.testing.assert_allclose(most[e].toarray()[0], np.linalg.norm(parts, axis=2).sum(axis=0), atol=1e-12)


@pytest.mark.parametrize("state", STATES)
def test_terms_bound_what_one_element_adds(state):
    layer = layers(DISC, "clusters-8")[1]
    whole, d = assembled(DISC, state), rng(404).standard_normal(DISC.mesh.points.shape)
    for e in (3, 300):
        one = whole.of_elements(np.arange(DISC.n_tets) == e)
        assert (np.linalg.norm(one.gradient(layer), axis=1) <= whole.gradient_terms(layer) * (1.0 + 1e-9)).all()
        assert (np.linalg.norm(one.blocks(layer), 2, axis=(1, 2)) <= whole.block_terms(layer) * (1.0 + 1e-9)).all()
        product = np.linalg.norm(one.product(layer, d), axis=1)
        assert (product <= 2.0 * whole.product_terms(layer, d)).all()


def test_too_large(monkeypatch):
    monkeypatch.setattr(galerkin, "MOST_TETS", 100)
    with pytest.raises(Skip, match="576 tetrahedra"):
        assembled(replace(DISC), "rest")
