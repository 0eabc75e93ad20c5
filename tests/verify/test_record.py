# SPDX-License-Identifier: BSD-3-Clause
"""Results of the suite as plain data.

1. A record is JSON: numbers that are none become words, in results and in plots; nothing else is lost.
2. Rows carry all that a stranger needs; counts are those of the rows; what was not run is said.
"""

from __future__ import annotations

import json
import math

import pytest

from verify.suite.case import Case, Curve, Kind, Measurement, Plot, Skip
from verify.suite.record import SCHEMA, as_row, record
from verify.suite.run import run
from verify.suite.use import SEED, Use


def made_up(function, **changes):
    what = {"tolerance": 1e-9, "reason": "rounding", "over": {"precision": ("float64",)}} | changes
    return Case("a/b", "All is well", "error", "m", Kind.ODE, "x' = x", "a book", function=function, **what).rows()


def passes(use, precision):
    curves = (Curve("one", (1.0, 2.0), (math.nan, 0.5)),)
    return Measurement(1.0, 1.0, 0.0, "exactly", (Plot("title", "h [m]", "error", curves, (2.0,)),))


def fails(use, precision):
    return Measurement(math.inf, 1.0, math.nan)


def skips(use, precision):
    raise Skip("not today")


def raises(use, precision):
    raise ZeroDivisionError("by design")


@pytest.fixture
def made():
    rows = [row for function in (passes, fails, skips, raises) for row in made_up(function)]
    results = list(run([*rows, *made_up(passes, tolerance=None)], Use()))
    return record(results, Use(), "femgal verify", wall_seconds=2.5, not_run={"cuda": "none here"})


def test_json_and_back(made):
    assert json.loads(json.dumps(made, allow_nan=False)) == made
    assert made["schema"] == SCHEMA


def test_counts(made):
    summary = made["summary"]
    assert summary["status"] == {"PASS": 1, "FAIL": 2, "SKIP": 1, "INFO": 1}
    assert summary["kinds"] == {kind.value: 5 * (kind is Kind.ODE) for kind in Kind}
    assert (summary["rows"], summary["cases"], summary["wall_seconds"]) == (5, 1, 2.5)
    assert summary["not_run"] == {"cuda": "none here"}
    assert summary["cpu_seconds"] == pytest.approx(sum(row["seconds"] for row in made["rows"]))


def test_rows(made):
    good, bad, skipped, raised, _ = made["rows"]
    assert (good["id"], good["case"], good["values"]) == ("a/b[float64]", "a/b", {"precision": "float64"})
    assert (good["kind"], good["formula"], good["source"], good["reason"]) == ("ODE", "x' = x", "a book", "rounding")
    curve = {"name": "one", "x": [1.0, 2.0], "y": ["nan", 0.5]}
    assert good["plots"] == [{"title": "title", "x": "h [m]", "y": "error", "curves": [curve], "slopes": [2.0]}]
    assert (bad["computed"], bad["error"], bad["status"]) == ("inf", "nan", "FAIL")
    assert (skipped["error"], skipped["note"]) == (None, "not today")
    assert "ZeroDivisionError: by design (raises, line" in raised["note"]


def test_header(made):
    header = made["header"]
    assert (header["command"], header["device"], header["seed"]) == ("femgal verify", "cpu", SEED)
    assert header["devices"]["cpu"] == "available"
    assert {"python", "numpy", "scikit-fem", "cpu", "date", "threads"} <= set(header)


def test_row_alone():
    (result,) = run(made_up(passes), Use())
    assert as_row(result)["error"] == 0.0
