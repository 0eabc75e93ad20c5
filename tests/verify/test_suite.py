# SPDX-License-Identifier: BSD-3-Clause
"""The suite itself: cases, measurements, choice of rows, verdicts.

1. A row passes when its error is a number from zero to the tolerance; NaN, infinity and negative errors fail.
2. A case that is described wrongly is refused where it is written: id, axes, tolerances, quick, two of one name.
3. What a case raises, an exit included, and what it returns instead of a measurement, is a failure of its row only;
   Skip skips with its reason; without a tolerance nothing is judged.
4. Rows are chosen by parts of ids and titles, by patterns in which brackets are brackets, by axes, by quick.
5. Measurements: the worst entry counts, NaN before all; no scale or bound that makes every error small.
6. Topics come from the parts to the whole, ids are unique, every case says formula, source and reason.
"""

from __future__ import annotations

import math

import pytest

from meshes.errors import InputError
from verify.suite.case import Case, Kind, Measurement, Skip, case
from verify.suite.measure import at_most, compare, observed_orders, order, vanishes, worst
from verify.suite.run import TOPICS, Status, cases, choose, run_all, run_row
from verify.suite.use import Use

USE = Use(threads=1)
WHAT = {
    "title": "Two is two",
    "quantity": "length",
    "unit": "m",
    "kind": Kind.IDENTITY,
    "formula": "2 = 2",
    "source": "arithmetic",
    "tolerance": 1e-6,
    "reason": "rounding",
}


def made(function, **other) -> Case:
    return Case("made-up/case", function=function, **{**WHAT, **other})


def verdict(function, **other):
    return run_row(made(function, **other).rows()[0], USE)


@pytest.mark.parametrize("error", [math.nan, math.inf, -1.0, -1e-300, 1.1e-6])
def test_errors_that_fail(error):
    assert verdict(lambda use: Measurement(1.0, 1.0, error)).status is Status.FAIL


@pytest.mark.parametrize("error", [0.0, 1e-6])
def test_errors_that_pass(error):
    assert verdict(lambda use: Measurement(1.0, 1.0, error)).status is Status.PASS
    assert verdict(lambda use: Measurement(1.0, 1.0, error), tolerance=None).status is Status.INFO


def _raise(error):
    raise error


@pytest.mark.parametrize("error", [ValueError("no"), SystemExit(0), ZeroDivisionError()])
def test_what_a_case_raises_is_its_failure(error):
    result = verdict(lambda use: _raise(error))
    assert result.status is Status.FAIL
    assert type(error).__name__ in result.note


def test_skip_and_no_measurement():
    result = verdict(lambda use: _raise(Skip("no such mesh")))
    assert (result.status, result.note) == (Status.SKIP, "no such mesh")
    result = verdict(lambda use: None)
    assert result.status is Status.FAIL
    assert "returns a Measurement, not NoneType" in result.note


def test_a_failure_does_not_end_the_others():
    rows = [made(lambda use: _raise(SystemExit(0))).rows()[0], made(lambda use: compare(2.0, 2.0)).rows()[0]]
    told: list[object] = []
    results = run_all(rows, USE, told.append, told.append)
    assert [result.status for result in results] == [Status.FAIL, Status.PASS]
    assert told == [rows[0], results[0], rows[1], results[1]]


@pytest.mark.parametrize(
    ("id", "other", "message"),
    [
        ("Made-up/case", {}, "lower case"),
        ("case", {}, "topic/name"),
        ("made-up/a b", {}, "topic/name"),
        ("made-up/case", {"over": {"mesh": ("two words",)}}, "without blanks"),
        ("made-up/case", {"over": {"mesh": ("a,b",)}}, "commas"),
        ("made-up/case", {"tolerance": {"float64": 1e-12}}, "precision axis"),
        ("made-up/case", {"tolerance": {"float64": 1.0}, "over": {"precision": ("float32",)}}, "same values"),
        ("made-up/case", {"tolerance": math.nan}, "not a number"),
        ("made-up/case", {"tolerance": -1.0}, "not a number"),
        ("made-up/case", {"quick": {"mesh": ("box",)}}, "not in over"),
    ],
)
def test_wrong_descriptions_are_refused(id, other, message):
    with pytest.raises(ValueError, match=message):
        Case(id, function=lambda use: None, **{**WHAT, **other})


def test_two_cases_of_one_name(monkeypatch):
    monkeypatch.setattr("verify.suite.case._CASES", {})

    def first(use):
        return compare(1.0, 1.0)

    def second(use):
        return compare(1.0, 1.0)

    case("made-up/case", **WHAT)(first)
    case("made-up/case", **WHAT)(first)
    with pytest.raises(ValueError, match="two cases"):
        case("made-up/case", **WHAT)(second)


def test_choice():
    one = choose("transfer/translation[rabbit,linear]")
    assert [str(row) for row in one] == ["transfer/translation[rabbit,linear]"]
    assert [str(row) for row in choose("TRANSFER/transl*[rabbit,linear]")] == ["transfer/translation[rabbit,linear]"]
    both = {str(row).split("/")[0] for row in choose("transfer/ collapse/")}
    assert both == {"transfer", "collapse"}
    assert len(choose(quick=True)) < len(choose())
    box = choose("transfer/translation", axes={"mesh": ("box",)})
    assert {row.values["mesh"] for row in box} == {"box"}
    with pytest.raises(InputError, match="no case fits"):
        choose("qqq")
    with pytest.raises(InputError, match="foo"):
        choose(axes={"foo": (1,)})


def test_compare():
    found = compare([1.0, 2.0, 3.5], [1.0, 2.0, 3.0])
    assert (found.computed, found.reference, found.error) == (3.5, 3.0, pytest.approx(0.5 / 3.0))
    assert compare([1.0, 2.0], [1.0, 1.0], scale=4.0).error == 0.25
    assert math.isnan(compare([math.nan, 5.0], [1.0, 1.0]).error)
    assert vanishes([0.0, -2.0], 4.0).error == 0.5
    for scale in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(ValueError, match="relative"):
            compare([1.0], [2.0], scale)
    with pytest.raises(ValueError, match="scale"):
        compare([1.0], [0.0])
    with pytest.raises(ValueError, match="shapes"):
        compare([1.0], [[1.0]])


def test_bounds_and_the_worst():
    assert at_most(1.0, 2.0).error == 0.0
    assert at_most(3.0, 2.0).error == 0.5
    assert at_most(math.nan, 2.0).error == math.inf
    with pytest.raises(ValueError, match="bound"):
        at_most(1.0, math.inf)
    several = {"a": Measurement(1.0, 1.0, 0.5), "b": Measurement(1.0, 1.0, math.nan), "c": Measurement(1.0, 1.0, 9.0)}
    assert worst(several).note.startswith("worst of 3: b")


def test_orders():
    h = [0.4, 0.2, 0.1]
    assert observed_orders(h, [3.0 * one**2 for one in h]) == pytest.approx([2.0, 2.0])
    found = order(h, [3.0 * one**1.5 for one in h], 2.0, x="h", y="e", title="t")
    assert found.error == pytest.approx(0.5)
    assert found.plots[0].slopes == (2.0,)
    with pytest.raises(ValueError, match="three"):
        order(h[:2], [1.0, 0.5], 1.0, x="h", y="e", title="t")


def test_all_cases_are_described():
    found = cases()
    topics = list(dict.fromkeys(one.id.split("/")[0] for one in found))
    assert topics == [topic for topic in TOPICS if topic in topics]
    assert len({str(row) for one in found for row in one.rows()}) > 400
    assert len({one.id for one in found}) == len(found)
    for one in found:
        assert all((one.title, one.quantity, one.unit, one.formula, one.source, one.reason)), one.id
