# SPDX-License-Identifier: BSD-3-Clause
"""Cases of smoothers.

1. Every quick row passes.
2. Steps a third too long, a search that always takes the full step, and an eigenvalue too large turn rows red.
3. So do steps of one layer and potentials that are not numbers.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.solvers import smoother
from verify.cases import smoothers
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

ROWS = choose("smoothers/", quick=True)
USE = Use(threads=1)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_quick_rows(row):
    result = run_row(row, USE)
    assert result.status is Status.PASS, result


def test_long_steps_are_noticed(monkeypatch):
    right = smoother.step_lengths
    monkeypatch.setattr(smoothers, "step_lengths", lambda *args, **kwargs: 4.0 / 3.0 * right(*args, **kwargs))
    assert smoothers.stable_steps(USE, mesh="box").error > 0.1
    assert smoothers.consistent_steps(USE, hierarchy="clusters-8").error == 0.0
    monkeypatch.setattr(smoothers, "step_lengths", lambda *args, **kwargs: 0.99 * right(*args, **kwargs))
    assert smoothers.consistent_steps(USE, hierarchy="clusters-8").error > 1.0


def test_steps_that_are_no_numbers_are_noticed(monkeypatch):
    right = smoother.step_lengths
    lost = lambda *args, **kwargs: right(*args, **kwargs) * [1.0, *[np.nan] * (len(args[2]) - 1)]  # noqa: E731
    monkeypatch.setattr(smoothers, "step_lengths", lost)
    for row in choose("smoothers/stable-steps[box] smoothers/consistent-steps[clusters-8]"):
        assert run_row(row, USE).status is Status.FAIL


def test_full_steps_are_noticed(monkeypatch):
    monkeypatch.setitem(smoother.LINE_SEARCHES, "exact", lambda coefficients: 1.0)
    assert smoothers.potential_never_grows(USE, solver="v-clusters", precision="float64").error > 1e-14
    monkeypatch.setattr(smoothers, "first_minimum", lambda coefficients: 1.0)
    assert smoothers.exact_steps(USE, mesh="box", precision="float64").error > 1e-3


@pytest.mark.parametrize("factor", [0.85, 1.02])
def test_wrong_eigenvalues_are_noticed(monkeypatch, factor):
    right = smoothers.largest_block_jacobi_eigenvalue
    monkeypatch.setattr(smoothers, "largest_block_jacobi_eigenvalue", lambda *a, **k: factor * right(*a, **k))
    error = smoothers.largest_eigenvalue(USE, hierarchy="clusters-32", mesh="box").error
    assert error > 0.1
    assert np.isfinite(error) == (factor < 1.0)
