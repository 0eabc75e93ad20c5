# SPDX-License-Identifier: BSD-3-Clause
"""Verdicts on claims.

1. "at-most" compares at every scene and level; a level that only one curve reaches is a comparison too, one that
   neither reaches is none, and a curve that was stopped says nothing.
2. "trend" compares the last value of the axis with the first, of scenes that differ in nothing else.
3. "inner-minimum" wants the least seconds between the ends; numbers of substeps that miss the level lie outside.
4. All comparisons: holds; none: does not hold; some: in part; nothing to compare: cannot be judged.
"""

from __future__ import annotations

import pytest

from verify.studies.claims import judge
from verify.studies.definition import Claim, Part

LEVELS = (1e-1, 1e-2)


def part(axis="vertices"):
    grid = {"scenes": ["rabbit-drape"], "solvers": [{"name": "fas"}, {"name": "vbd"}]}
    about = {"id": "p", "title": "t", "source": "s", "about": "a"}
    return Part(**about, kind="motion", grid=grid, levels=LEVELS, targets=LEVELS, axis=axis)


def claim(**keys):
    return Claim(text="t", source="s", part="p", of=("fas",), **keys)


def entry(problem, curve, level, seconds, **keys):
    return {"problem": problem, "curve": curve, "measure": "eps18", "level": level, "seconds": seconds, **keys}


def row(problem, curve, **keys):
    return {"problem": problem, "curve": curve, "status": "done", **keys}


def numbers(entries, sizes=(100, 1000), status="done"):
    problems = [{"id": str(size), "scene": "x", "axes": {"vertices": size, "rho": 1.0}} for size in sizes]
    rows = [row(str(size), curve, status=status) for size in sizes for curve in ("fas", "vbd")]
    return {"problems": problems, "entries": entries, "rows": rows}


def entries(fas, vbd, sizes=(100,)):
    """Seconds of both curves by size and level."""
    both = (("fas", fas), ("vbd", vbd))
    keys = [(str(size), level) for size in sizes for level in LEVELS]
    return [entry(*key[:1], curve, key[1], s) for curve, found in both for key, s in zip(keys, found, strict=True)]


@pytest.mark.parametrize(
    ("fas", "vbd", "factor", "verdict"),
    [
        ([1.0, 2.0], [2.0, 3.0], 1.0, "holds"),
        ([1.0, 2.0], [2.0, 3.0], 0.6, "holds in 1 of 2 comparisons"),
        ([3.0, 4.0], [2.0, 3.0], 1.0, "does not hold"),
        ([1.0, None], [2.0, 3.0], 1.0, "holds in 1 of 2 comparisons"),
        ([1.0, 9.0], [2.0, None], 1.0, "holds"),
        ([1.0, None], [2.0, None], 1.0, "holds"),
        ([None, None], [None, None], 1.0, "cannot be judged here"),
    ],
)
def test_at_most(fas, vbd, factor, verdict):
    found = judge(claim(than=("vbd",), factor=factor), part(), numbers(entries(fas, vbd), sizes=(100,)))
    assert found["verdict"] == verdict
    assert len(found["cases"]) == 2
    assert f"{factor:g} times vbd" in found["rule"]


def test_stopped_runs_are_no_comparison():
    stopped = numbers(entries([1.0, 2.0], [None, None]), sizes=(100,), status="failed")
    assert judge(claim(than=("vbd",)), part(), stopped)["verdict"] == "cannot be judged here"
    for lost in stopped["rows"]:
        lost["failure_kind"] = "solver"
    assert judge(claim(than=("vbd",)), part(), stopped)["verdict"] == "holds"


def test_numbers_of_rows():
    given = numbers([], sizes=(100,))
    for found, eps18 in zip(given["rows"], (1e-3, 4e-3), strict=True):
        found["eps18"] = eps18
    assert judge(claim(than=("vbd",), what="eps18", factor=0.5), part(), given)["verdict"] == "holds"
    assert judge(claim(than=("vbd",), what="eps18", factor=0.2), part(), given)["verdict"] == "does not hold"
    assert judge(claim(what="eps18", factor=2e-3), part(), given)["verdict"] == "holds"
    given["rows"][1]["retakes"] = 3
    assert judge(claim(than=("vbd",), what="eps18"), part(), given)["verdict"] == "cannot be judged here"


def test_trend():
    sizes = (100, 1000)
    given = numbers(entries([1.0, 1.0, 4.0, 40.0], [1.0, 1.0, 8.0, 8.0], sizes), sizes)
    assert judge(claim(rule="trend", least=3.0), part(), given)["verdict"] == "holds"
    assert judge(claim(rule="trend", most=5.0), part(), given)["verdict"] == "holds in 1 of 2 comparisons"
    relative = judge(claim(rule="trend", than=("vbd",), least=1.0), part(), given)
    assert relative["verdict"] == "holds in 1 of 2 comparisons"
    assert "factor 2" in relative["cases"][0]["found"]
    one = numbers(entries([1.0, 1.0], [1.0, 1.0]), sizes=(100,))
    assert judge(claim(rule="trend", least=1.0), part(), one)["verdict"] == "cannot be judged here"


@pytest.mark.parametrize(
    ("seconds", "unconverged", "verdict"),
    [
        ([3.0, 1.0, 2.0], [0, 0, 0], "holds"),
        ([1.0, 2.0, 3.0], [0, 0, 0], "does not hold"),
        ([3.0, 2.0, 1.0], [0, 0, 0], "does not hold"),
        ([0.1, 1.0, 2.0, 3.0], [5, 0, 0, 0], "holds"),
        ([3.0, 1.0, 2.0], [5, 5, 0], "cannot be judged here"),
        ([3.0, 1.0, 2.0], [5, 0, 0], "holds"),
    ],
)
def test_inner_minimum(seconds, unconverged, verdict):
    given = numbers([], sizes=(100,))
    given["rows"] = [
        row("100", "fas", substeps=[10 * k], settings={"substeps": 10 * k}, seconds=s, unconverged=u, retakes=0)
        for k, (s, u) in enumerate(zip(seconds, unconverged, strict=True), start=1)
    ]
    assert judge(claim(rule="inner-minimum"), part(), given)["verdict"] == verdict


def test_claims_about_some_values_only():
    sizes = (100, 1000)
    given = numbers(entries([9.0, 9.0, 1.0, 1.0], [2.0, 2.0, 2.0, 2.0], sizes), sizes)
    assert judge(claim(than=("vbd",), at=(1000,)), part(), given)["verdict"] == "holds"
    assert judge(claim(than=("vbd",), at=(100,)), part(), given)["verdict"] == "does not hold"
