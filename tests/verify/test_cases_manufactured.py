# SPDX-License-Identifier: BSD-3-Clause
"""Cases of manufactured solutions.

1. Every quick row passes, and both norms, both materials and both precisions are among them.
2. A force with lam_Lame in place of lam, soft spots of one element in ten, and a forgotten interface
   load are noticed.
3. All rows pass, those of sixteen cells too (slow).
4. Forces five per cent too large, which belong to no energy, turn orders and errors red.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.verify.wrong_forces import StrongUse
from verify.cases import manufactured
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

ROWS = choose("manufactured/", quick=True)
USE = Use(threads=1)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_quick_rows(row):
    result = run_row(row, USE)
    assert result.status is Status.PASS, result


@pytest.mark.slow
@pytest.mark.parametrize("row", [row for row in choose("manufactured/") if not row.is_quick], ids=str)
def test_other_rows(row):
    result = run_row(row, USE)
    assert result.status is Status.PASS, result


def test_quick_rows_are_there():
    names = {str(row) for row in ROWS}
    assert {
        "manufactured/l2-order-coarse[uniform,8]",
        "manufactured/h1-order[jump,8]",
        "manufactured/error[l2,jump,8]",
        "manufactured/single-precision[uniform]",
    } <= names


class SpottedUse(Use):
    """Makes passes for a body with soft elements."""

    def backend(self, disc, precision="float64"):
        soft = np.where(np.arange(disc.n_tets) % 10 == 0, 0.5, 1.0)
        return super().backend(replace(disc, Vmu=soft * disc.Vmu, mu=soft * disc.mu), precision)


def test_soft_spots_are_noticed():
    # Their error is smaller on these meshes, where linear elements are too stiff, but it does not converge.
    assert manufactured.l2_order_coarse(SpottedUse(threads=1), material="uniform", finest=8).error > 0.2


class LamUse(Use):
    """Makes passes for lam = lam_Lame."""

    def backend(self, disc, precision="float64"):
        lam = disc.lam - disc.mu
        return super().backend(replace(disc, Vlam=disc.V * lam, lam=lam), precision)


def test_lam_of_lame_is_noticed():
    assert manufactured.l2_order_coarse(LamUse(threads=1), material="uniform", finest=8).error > 0.5


def test_forgotten_interface_load_is_noticed(monkeypatch):
    monkeypatch.setattr(manufactured, "surface_load", lambda *arguments: 0.0)
    manufactured.solve.cache_clear()
    found = manufactured.error(USE, norm="l2", material="jump", finest=8)
    manufactured.solve.cache_clear()
    assert found.error > 0.0


@pytest.mark.parametrize("row", [row for row in ROWS if "single" not in str(row)], ids=str)
def test_too_large_forces_are_noticed(row):
    assert run_row(row, StrongUse(threads=1)).status is Status.FAIL
