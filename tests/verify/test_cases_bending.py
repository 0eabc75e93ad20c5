# SPDX-License-Identifier: BSD-3-Clause
"""Cases of bending.

1. No quick row fails; locking is reported for three Poisson's ratios without a verdict.
2. lam_Lame in place of lam, and forces that are a hundredth too soft, are noticed.
3. No other row fails (slow).
4. Forces five per cent too large, which belong to no energy, turn rows red.
5. Conjugate gradients that stop too early turn the row of the linear solvers red.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.verify.wrong_forces import StrongUse
from verify.cases import bending
from verify.reference import statics
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

ROWS = choose("bending/", quick=True)
USE = Use(threads=1)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_quick_rows(row):
    result = run_row(row, USE)
    assert result.status is (Status.INFO if row.case.id == "bending/locking" else Status.PASS), result


@pytest.mark.slow
@pytest.mark.parametrize("row", [row for row in choose("bending/") if not row.is_quick], ids=str)
def test_other_rows(row):
    assert run_row(row, USE).status in (Status.PASS, Status.INFO)


def test_quick_rows_are_there():
    names = {str(row) for row in ROWS}
    assert {"bending/same-elements[cook,float32]", "bending/cook-literature"} <= names
    assert {"bending/locking[0.3,8]", "bending/locking[0.499,8]", "bending/committed[1]"} <= names


class LamUse(Use):
    """Makes passes for lam = lam_Lame."""

    def backend(self, disc, precision="float64"):
        lam = disc.lam - disc.mu
        return super().backend(replace(disc, Vlam=disc.V * lam, lam=lam), precision)


class SoftUse(Use):
    """Makes passes for a body a hundredth too soft."""

    def backend(self, disc, precision="float64"):
        return super().backend(replace(disc, Vmu=0.99 * disc.Vmu, Vlam=0.99 * disc.Vlam), precision)


@pytest.mark.parametrize("wrong", [LamUse(threads=1), SoftUse(threads=1)], ids=lambda use: type(use).__name__)
def test_wrong_forces_are_noticed(wrong):
    assert bending.same_elements(wrong, body="cantilever", precision="float64").error > 1e-3


@pytest.mark.parametrize("row", choose("bending/same-elements"), ids=str)
def test_too_large_forces_are_noticed(row):
    assert run_row(row, StrongUse(threads=1)).status is Status.FAIL


def test_loose_conjugate_gradients_are_noticed(monkeypatch):
    monkeypatch.setattr(statics, "_CG_TOLERANCE", 1e-6)
    assert bending.linear_solvers(USE, body="cantilever", state="rest").error > 1e-9
    assert bending.linear_solvers(USE, body="cook", state="bent").error > 1e-9
