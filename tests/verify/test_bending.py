# SPDX-License-Identifier: BSD-3-Clause
"""Bending problems of the reference.

1. Cook's membrane has the corners that it is known for, and positive volumes; its load adds up to traction times area.
2. The cantilever's load adds up to its weight, with linear and quadratic elements.
3. `refined` keeps the values of the nodes, and on a straight grid reproduces linear fields.
4. A slender beam at small load bends as Timoshenko's, on quadratic elements.
5. The committed answers hold every problem, with values that converge and what an answer is said to hold.
"""

from __future__ import annotations

import numpy as np
import pytest

from verify.problems.bodies import rng
from verify.reference.bending import PROBLEMS, Bending, answers, quadratic, refined
from verify.reference.elasticity import AssembledElasticity
from verify.reference.richardson import extrapolate

COOK, CANTILEVER = Bending("cook", 0.3), Bending("cantilever", 0.3)


def test_cook():
    mesh = COOK.mesh(4)
    X = mesh.points
    for corner in ((0.0, 0.0), (0.0, 44.0), (48.0, 44.0), (48.0, 60.0)):
        assert np.isclose(X[:, :2], corner).all(axis=1).any()
    assert mesh.volumes.sum() == pytest.approx(48.0 * 30.0 * 12.0)
    load = COOK.forces(mesh, 1)
    np.testing.assert_allclose(load.sum(axis=0), [0.0, 0.0375 * 1e5 * 16.0 * 12.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("degree", [1, 2])
def test_weight(degree):
    load = CANTILEVER.forces(CANTILEVER.mesh(4), degree)
    np.testing.assert_allclose(load.sum(axis=0), [0.0, 0.0, -1000.0 * 0.25 * 10.0], atol=1e-9)


# Midpoints of edges do not lie on the tapered grid: there the start is an estimate.
@pytest.mark.parametrize(("problem", "degree"), [(COOK, 1), (CANTILEVER, 1), (CANTILEVER, 2)])
def test_refined(problem, degree):
    nodes = AssembledElasticity(problem.mesh(4), 1.0, 2.0, degree).nodes
    onto = AssembledElasticity(problem.mesh(8), 1.0, 2.0, degree).nodes
    A = rng(451).standard_normal((3, 3))
    if problem is CANTILEVER:
        np.testing.assert_allclose(refined(problem, nodes @ A, nodes, onto, 4, degree), onto @ A, atol=1e-12)
    np.testing.assert_allclose(refined(problem, nodes @ A, nodes, nodes, 4, degree), nodes @ A, atol=1e-12)


def test_small_deflection():
    problem = Bending("cantilever", 0.0, load=1e-6)
    # q = rho g h^2, I = h^4 / 12, shear area 5/6 h^2 with G = E / 2.
    q, E, h = 1000.0 * 10.0 * 0.25, problem.young, 0.5
    expected = q / (8.0 * E * h**4 / 12.0) + 0.5 * q / (5.0 / 6.0 * 0.5 * E * h**2)
    # A beam twice as long as high is not slender: theory and body differ by some per cent at the clamp.
    assert quadratic(problem, 8) == pytest.approx(expected, rel=0.03)


def test_answers():
    assert list(answers()) == [problem.key for problem in PROBLEMS]
    for problem in PROBLEMS:
        answer = answers()[problem.key]
        values = [row["deflection_m"] for row in answer["sequence"]]
        limit = extrapolate(values)
        assert (answer["value"], answer["order"], answer["gci"]) == (limit.value, limit.order, limit.gci)
        assert answer["problem"]["name"] == problem.name
