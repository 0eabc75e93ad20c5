# SPDX-License-Identifier: BSD-3-Clause
"""The cases about Newton's method.

1. No quick row fails, with every preconditioner.
2. They notice a method that stops early, and one that always takes the full step.
"""

from __future__ import annotations

import pytest

from femgal.solvers import newton as method
from verify.cases import newton
from verify.cases.preconditioners import PRECONDITIONERS
from verify.suite.case import Row
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

USE = Use()
CASES = {row.case.id.split("/")[1]: row.case for row in choose("newton/*")}


def test_quick_rows():
    results = list(run(choose("newton/*", quick=True), USE))
    assert [f"{r.row}: {r.note}" for r in results if r.status is not Status.PASS] == []
    rows = {str(result.row) for result in results}
    assert {f"newton/minimiser[{name}]" for name in PRECONDITIONERS} <= rows
    assert {"newton/falls[crushed]", "newton/indefinite[everted]"} <= rows


@pytest.mark.parametrize(
    ("name", "values"), [("minimiser", {"preconditioner": "layers"}), ("promise", {"preconditioner": "layers"})]
)
def test_stopping_early_is_noticed(monkeypatch, name, values):
    monkeypatch.setattr(method.Newton, "finished", lambda self, phi, state: method.Outcome.CONVERGED)
    result = run_row(Row(CASES[name], values), USE)
    assert result.status is Status.FAIL
    assert result.measurement is not None


def test_full_steps_are_noticed(monkeypatch):
    monkeypatch.setattr(method, "first_minimum", lambda coefficients: 1.0)
    newton._path.cache_clear()
    result = run_row(Row(CASES["falls"], {"start": "crushed"}), USE)
    newton._path.cache_clear()
    assert result.status is Status.FAIL
    assert result.measurement is not None
