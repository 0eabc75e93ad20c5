# SPDX-License-Identifier: BSD-3-Clause
"""The study of consistency.

1. Its quick rows pass, and they show the published and consistent step lengths, with plots of error and residual; a
   row that judges nothing has the plot of all rules.
2. It can tell them apart: published steps do not pass for consistent ones, nor the other way round, nor does a body
   of its own stiffness pass for the softer one. A residual that is not a number is red.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from verify.cases import consistency
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

USE = Use()


def test_quick_rows():
    results = {str(r.row): r for r in run(choose("consistency/*", quick=True), USE)}
    wrong = [f"{r.row}: {r.note}" for r in results.values() if r.status is not Status.PASS]
    assert wrong == []
    assert "consistency/order[beam,spectral]" in results
    published = results["consistency/published-steps[beam]"].measurement
    assert published is not None
    assert [plot.y for plot in published.plots] == ["trajectory error", "eps18 [m]"]
    (plot,) = consistency.published_against_spectral(USE, mesh="beam").plots
    assert {curve.name for curve in plot.curves} == set(consistency.RULES)


def test_residuals_that_are_no_numbers_are_red(monkeypatch):
    good = consistency.run("beam", "spectral", 10, USE)
    lost = replace(good, residuals=np.full_like(good.residuals, np.nan))
    monkeypatch.setattr(consistency, "run", lambda *_: lost)
    (row,) = choose("consistency/eps18[beam,spectral]")
    assert run_row(row, USE).status is Status.FAIL


def test_an_error_that_stays_has_a_size(monkeypatch):
    (row,) = choose("consistency/published-stiffness[beam]")
    right = consistency.run
    for rule, factor in {"published": 0.9, "spectral": 1.0, "exact": 1.0, "linear-spectral": np.nan}.items():
        found = right("beam", rule, 80, USE)
        wrong = replace(found, displacements=factor * found.displacements)
        stuck = lambda mesh, rule, *of, wrong=wrong: wrong if rule == "published" else right(mesh, rule, *of)  # noqa: E731
        monkeypatch.setattr(consistency, "run", stuck)
        assert run_row(row, USE).status is Status.FAIL


def test_the_rules_are_told_apart():
    published = consistency._order("beam", "published", USE, 1.0)
    assert published.error > 0.5
    spectral = consistency._order("beam", "spectral", USE, 0.0)
    assert spectral.error > 0.5
    own = consistency.order(
        consistency._H, consistency.errors_of("beam", "jacobi-half", USE), 1.0, x="", y="", title=""
    )
    assert own.error > 0.5
