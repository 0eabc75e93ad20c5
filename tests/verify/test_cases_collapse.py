# SPDX-License-Identifier: BSD-3-Clause
"""Cases about a body crushed to a point.

1. Every quick row passes.
2. The weighted Laplacian leaves constants alone, is symmetric, and gives a linear field its energy.
3. All vertices of the crushed body are at one place.
"""

from __future__ import annotations

import numpy as np
import pytest

from verify.cases.collapse import crushed, laplacian
from verify.problems.bodies import body
from verify.suite.run import Status, choose, run
from verify.suite.use import Use


def test_quick_rows_pass():
    rows = choose("collapse/*", quick=True)
    assert len(rows) >= 8
    assert [str(one.row) for one in run(rows, Use()) if one.status is not Status.PASS] == []


def test_laplacian():
    disc = body("rabbit")
    L, X = laplacian(disc), disc.mesh.points
    assert np.abs(L @ np.ones(len(X))).max() <= 1e-12 * np.abs(L).max()
    assert np.abs(L - L.T).max() <= 1e-14 * np.abs(L).max()
    assert X[:, 0] @ L @ X[:, 0] == pytest.approx(float(disc.Vmu.sum()), rel=1e-11)


def test_crushed():
    assert np.ptp(crushed(body("rabbit")), axis=0).tolist() == [0.0, 0.0, 0.0]
