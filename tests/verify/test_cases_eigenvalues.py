# SPDX-License-Identifier: BSD-3-Clause
"""Cases about the eigenvalues of element Hessians.

1. Every quick row passes.
2. Analytic eigenvalues: those of a 9x9 matrix of central differences of a stress written with NumPy's inverse; at rest
   0 (3), 2 mu (5) and 3 lam - mu (1).
3. The 9x9 Hessians are taken out of products correctly: those of a quadratic energy mu |F|^2 / 2 are mu I.
4. An unsigned singular value, and a filter that clamps the wrong sign, are noticed.
"""

from __future__ import annotations

import numpy as np
import pytest

from verify.cases import eigenvalues
from verify.cases.collapse import laplacian
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

MU, LAM = np.array([1.3]), np.array([4.1])


def test_quick_rows_pass():
    rows = choose("eigenvalues/*", quick=True)
    assert len(rows) >= 20
    assert [str(one.row) for one in run(rows, Use()) if one.status is not Status.PASS] == []


def stress(F):
    J = np.linalg.det(F)
    return MU * F + (LAM * (J - 1.0) - MU) * J * np.linalg.inv(F).T


@pytest.mark.parametrize("name", ["random", "inverted"])
def test_analytic_eigenvalues(name):
    for F in eigenvalues.gradients(name)[:10]:
        H = [(stress(F + 1e-5 * G) - stress(F - 1e-5 * G)).ravel() / 2e-5 for G in np.eye(9).reshape(9, 3, 3)]
        values = np.linalg.eigvalsh(0.5 * (np.array(H) + np.array(H).T))
        np.testing.assert_allclose(eigenvalues.analytic_eigenvalues(F[None], MU, LAM)[0], values, atol=1e-6)


def test_rest():
    expected = [0.0] * 3 + [2.0 * 1.3] * 5 + [3.0 * 4.1 - 1.3]
    found = eigenvalues.analytic_eigenvalues(np.eye(3)[None], MU, LAM)[0]
    np.testing.assert_allclose(found, expected, atol=1e-14)


def test_element_hessians():
    disc = eigenvalues.separate_elements()
    L = laplacian(disc)
    expected = disc.mu[:, None, None] * np.eye(9)
    np.testing.assert_allclose(eigenvalues.element_hessians(lambda d: L @ d), expected, rtol=0, atol=1e-12 * 1e6)


def status(name):
    (row,) = choose(name)
    return run_row(row, Use()).status


def test_faults_are_noticed(monkeypatch):
    found, hessians = eigenvalues.analytic_eigenvalues, eigenvalues.assembled_hessians
    monkeypatch.setattr(eigenvalues, "analytic_eigenvalues", lambda F, mu, lam: found(F, mu, lam - mu))
    assert status("eigenvalues/production[float32,inverted]") is Status.FAIL
    monkeypatch.setattr(eigenvalues, "assembled_hessians", lambda name: -hessians(name))
    assert status("eigenvalues/definite-part[float32,random]") is Status.FAIL
