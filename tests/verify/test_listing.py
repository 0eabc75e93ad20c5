# SPDX-License-Identifier: BSD-3-Clause
"""Cases as a text.

1. Each case of the rows is named once, with kind, tolerance, title, and the values of the rows' axes.
2. Tolerances: of all rows, by precision, none.
"""

from __future__ import annotations

import pytest

from verify.suite.case import Case, Kind
from verify.suite.listing import listing, tolerance_text


def made_up(**changes):
    id = changes.pop("id", "a/b")
    what = {"tolerance": 1e-9, "over": {"mesh": ("box", "bunny"), "precision": ("float64", "float32")}} | changes
    return Case(id, "All is well", "error", "1", Kind.ODE, "f", "s", reason="r", function=None, **what)


def test_listing():
    rows = made_up(quick={"mesh": ("box",)}).rows()
    lines = listing([*rows[:3], *made_up(over={}, id="a/long-name", tolerance=None).rows()])
    assert lines == [
        "a/b          ODE           1e-09",
        "    All is well",
        "    3 rows; mesh box, bunny; precision float64, float32",
        "a/long-name  ODE           not judged",
        "    All is well",
        "    1 row",
        "4 rows of 2 cases, 3 of them quick",
    ]


@pytest.mark.parametrize(
    ("tolerance", "expected"),
    [(None, "not judged"), (0.05, "0.05"), ({"float64": 1e-12, "float32": 2e-5}, "1e-12 (float64), 2e-05 (float32)")],
)
def test_tolerances(tolerance, expected):
    assert tolerance_text(made_up(tolerance=tolerance)) == expected
