# SPDX-License-Identifier: BSD-3-Clause
"""Corrections of layers as matrices.

1. A sequence acts on the error as its propagation matrix says, and leaves the solution alone.
2. Exact steps: the residual is orthogonal to the direction after each.
3. A scalar correction of the finest layer is Jacobi's, by hand.
4. The sequences written down are those of the production cycles.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.solvers.cycle import Cycle
from verify.problems.bodies import body, rng
from verify.reference.corrections import SEQUENCES, corrections_at
from verify.reference.galerkin import layers

DISC = body("box", "uniform")
EXACT = corrections_at(DISC, layers(DISC, "clusters-8"), DISC.mesh.points, 3600.0)
B = rng(410).standard_normal(EXACT.A.shape[0])
SOLUTION = EXACT.solution(B)


def test_propagation():
    e, w = rng(411).standard_normal(len(B)), np.array([0.6, 0.8])
    after = EXACT.run((0, 1, 0), w, B, SOLUTION + e)
    np.testing.assert_allclose(after - SOLUTION, EXACT.propagation((0, 1, 0), w) @ e, atol=1e-10)
    np.testing.assert_allclose(EXACT.run((1, 0), w, B, SOLUTION), SOLUTION, atol=1e-12 * np.abs(SOLUTION).max())


@pytest.mark.parametrize("layer", [0, 1])
def test_exact_steps(layer):
    u = rng(412).standard_normal(len(B))
    before = EXACT.direction(layer, EXACT.A @ u - B)
    after = EXACT.A @ EXACT.run((layer,), None, B, u) - B
    assert abs(before @ after) <= 1e-10 * np.linalg.norm(before) * np.linalg.norm(after)


def test_scalar():
    exact = corrections_at(DISC, layers(DISC, "clusters-8")[:1], DISC.mesh.points, 3600.0, scalar=True)
    np.testing.assert_allclose(exact.C[0].toarray(), np.diag(1.0 / exact.A.diagonal()), rtol=1e-12)


@pytest.mark.parametrize(("name", "n"), SEQUENCES)
def test_sequences(name, n):
    cycle = Cycle() if name == "fas" else Cycle(name.upper(), 1, 1)
    assert cycle.schedule(n) == SEQUENCES[name, n]
