# SPDX-License-Identifier: BSD-3-Clause
"""Assembled Hessians.

1. The exact Hessian is scikit-fem's, over the free vertices, to 1e-14 of its largest entry in float64 and 1e-6 in
   float32: at rest, deformed, stretched to 20 times, and inverted, with and without constrained vertices.
2. Exact or definite, its product is the backend's matrix-free one.
3. It is symmetric to the last bit; the definite one has no negative eigenvalue where the exact one has.
4. The mass enters with the factor given.
5. On a body of several ranges of rows 1, 2 and 3 threads give the same bits, and a matrix written over is as good as
   a new one.
6. A float32 matrix is its sums rounded once: where the mass is 2^24 times what an element adds, nothing gets lost.
7. A float32 matrix of a body a kilometre away is that of the body at home.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from femgal.assembly.hessian import ROWS, HessianAssembly, assemble
from verify.problems.bodies import STATES, distorted_box, left_end, positions, potential_at, rng, varied
from verify.reference.elasticity import AssembledElasticity

MESH = distorted_box((5, 4, 4))
CONSTRAINED = {"free": (), "held": left_end(MESH, 0.15)}
TOLERANCE = {"float64": 1e-14, "float32": 1e-6}
CASES = [(c, p, s) for c in CONSTRAINED for p in TOLERANCE for s in STATES]


@cache
def body(constrained: str):
    return varied(MESH, CONSTRAINED[constrained])


def exact(constrained: str, state: str) -> np.ndarray:
    disc = body(constrained)
    free = np.repeat(disc.free, 3)
    return AssembledElasticity(MESH, disc.mu, disc.lam).hessian(positions(MESH, state)).toarray()[np.ix_(free, free)]


@pytest.mark.parametrize(("constrained", "precision", "state"), CASES)
def test_exact_hessian(constrained, precision, state):
    A = exact(constrained, state)
    K = assemble(body(constrained), positions(MESH, state), 0.0, definite=False, precision=precision)
    K = K.to_scipy().toarray()
    np.testing.assert_allclose(K, A, rtol=0, atol=TOLERANCE[precision] * np.abs(A).max())
    np.testing.assert_array_equal(K, K.T)


@pytest.mark.parametrize("definite", [False, True])
@pytest.mark.parametrize(("constrained", "precision", "state"), CASES)
def test_equals_matrix_free(constrained, precision, state, definite):
    disc, x = body(constrained), positions(MESH, state)
    d = rng(410).standard_normal(x.shape) * disc.free[:, None]
    expected = potential_at(disc, x, 1.0).backend.hessian_product(x, d, definite=definite)[disc.free]
    K = assemble(disc, x, 0.0, definite=definite, precision=precision)
    # Fixed sweeps of rotations end at another rounding than the exact eigenvectors of either precision.
    tolerance = TOLERANCE[precision] * (100.0 if definite else 10.0)
    np.testing.assert_allclose(K.product(d[disc.free]), expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.parametrize("state", ["random", "inverted"])
def test_definite_part(state):
    A = exact("free", state)
    K = assemble(body("free"), positions(MESH, state), 0.0).to_scipy().toarray()
    np.testing.assert_array_equal(K, K.T)
    size = np.abs(A).max()
    assert np.linalg.eigvalsh(A)[0] < -1e-3 * size
    assert np.linalg.eigvalsh(K)[0] > -1e-13 * size


def test_inertia():
    disc, x = body("held"), positions(MESH, "random")
    light, heavy = (assemble(disc, x, inverse_h2).to_scipy().toarray() for inverse_h2 in (0.0, 3e4))
    expected = 3e4 * np.diag(np.repeat(disc.mass[disc.free], 3))
    np.testing.assert_allclose(heavy - light, expected, rtol=0, atol=1e-13 * np.abs(heavy).max())


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_bit(threads):
    mesh = distorted_box((22, 14, 14))
    disc, x = varied(mesh, left_end(mesh)), positions(mesh, "random")
    assert disc.free.sum() > 2 * ROWS
    one = HessianAssembly(disc, "float32", 1).assemble(x, 1e4)
    several = HessianAssembly(disc, "float32", threads)
    again = several.assemble(mesh.points, 1.0)
    several.assemble(x, 1e4, out=again)
    np.testing.assert_array_equal(again.values, one.values)


def test_far_away():
    disc, x = body("free"), positions(MESH, "random")
    home, away = (assemble(disc, x + shift, 0.0, precision="float32").values for shift in (0.0, 1000.0))
    assert np.abs(away - home).max() <= 1e-6 * np.abs(home).max()


def test_single_precision_rounds_once():
    disc = body("free")
    largest = np.abs(assemble(disc, MESH.points, 0.0).values).max()
    inverse_h2 = 2.0**24 * largest / disc.mass.min()
    single, double = (assemble(disc, MESH.points, inverse_h2, precision=p).values for p in ("float32", "float64"))
    half = 0.5 * np.spacing(np.abs(double).astype(np.float32)).astype(np.float64)
    # What the elements' own rounding adds besides is as small as they are.
    assert (np.abs(single - double) <= half + 1e-5 * largest).all()
