# SPDX-License-Identifier: BSD-3-Clause
"""Algebra of vectors of three scalars against NumPy.

1. Products, sums, negative and unit vector equal NumPy's.
2. `normal` is orthogonal and at least |u| / sqrt(2) long, along the axes too.
3. `select` takes the first where its condition holds.
4. All keep the precision of their arguments, compiled and not.
"""

from __future__ import annotations

import numba
import numpy as np
import pytest

from femgal.materials.vector import add_scaled, cross, dot, negative, normal, select, unit
from verify.problems.bodies import rng


@numba.njit
def everything(u, v):
    a = dot(u, v)
    return a, cross(u, v), add_scaled(u, a, v), negative(u), unit(u), normal(u), select(a < a - a, u, v)


VECTORS = [*rng(430).standard_normal((4, 3)), *np.eye(3), np.array([1.0, -1.0, 0.0]), np.array([0.0, 2.0, -2.0])]


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_against_numpy(compiled, precision):
    close = {"rtol": 0, "atol": 20 * np.finfo(precision).eps}
    for u in np.array(VECTORS, precision):
        for v in np.array(VECTORS[:3], precision):
            function = everything if compiled else everything.py_func
            a, crossed, added, minus, one, across, chosen = function(tuple(u), tuple(v))
            np.testing.assert_allclose(a, u @ v, **close)
            np.testing.assert_allclose(crossed, np.cross(u, v), **close)
            np.testing.assert_allclose(added, u + (u @ v) * v, **close)
            np.testing.assert_array_equal(minus, -u)
            np.testing.assert_allclose(one, u / np.linalg.norm(u), **close)
            np.testing.assert_allclose(u @ np.array(across), 0.0, **close)
            assert np.linalg.norm(across) >= 0.7 * np.linalg.norm(u)
            np.testing.assert_array_equal(chosen, u if a < 0 else v)
            if compiled:
                types = {str(signature.dtype) for signature, _ in function.signatures}
                assert np.dtype(precision).name in types
