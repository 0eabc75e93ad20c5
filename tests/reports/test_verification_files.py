# SPDX-License-Identifier: BSD-3-Clause
"""JSON, JUnit XML and Markdown of the verification report.

1. The JSON is the record; a NaN in it is refused.
2. The XML parses, its counts are those of its test cases, and each status becomes what CI readers know; characters that
   XML cannot hold are replaced.
3. The Markdown has the verdict first, then failures, then one table line for each row; no text of a record can make
   markup or break a table.
4. Words: judgements, durations, counts, and one sentence about the run.
"""

from __future__ import annotations

import json
from xml.etree import ElementTree as Xml

import pytest

from reports.verification.render import NAMES, json_text, render
from reports.verification.words import duration, judgement, summary_lines, verdict
from tests.reports.verification_samples import HURTS, all_rows, good_rows, row, sample


@pytest.fixture(scope="module")
def files():
    return render(sample(all_rows(), cuda="no device"))


def test_all_files(files):
    assert tuple(files) == NAMES
    assert json.loads(files["verify.json"]) == sample(all_rows(), cuda="no device")


def test_json_holds_no_nan():
    with pytest.raises(ValueError, match="JSON"):
        json_text(sample([row("a/b", error=float("nan"))]))


def test_junit(files):
    root = Xml.fromstring(files["verify.xml"])
    assert root.tag == "testsuites"
    assert {k: root.get(k) for k in ("tests", "failures", "errors")} == {"tests": "10", "failures": "2", "errors": "1"}
    assert [suite.get("name") for suite in root] == ["material", "transfer", "space", "study"]
    for suite in root:
        tests = suite.findall("testcase")
        assert suite.get("tests") == str(len(tests))
        for count, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
            assert suite.get(count) == str(len(suite.findall(f"testcase/{tag}"))), (suite.get("name"), count)
        assert [child.tag for child in suite] == ["properties"] + ["testcase"] * len(tests)
        assert suite.get("timestamp") == "2026-01-17T09:30:00"
        assert {p.get("name"): p.get("value") for p in suite.iter("property")}["seed"] == "20260117"
    for test in root.iter("testcase"):
        assert set(test.attrib) == {"classname", "name", "time"}
        assert [child.tag for child in test] in (
            ["system-out"],
            ["skipped"],
            ["failure", "system-out"],
            ["error", "system-out"],
        )


def test_junit_texts(files):
    tests = {test.get("name"): test for test in Xml.fromstring(files["verify.xml"]).iter("testcase")}
    assert tests["material/dilation[float64,rabbit]"].find("failure").get("message") == "0.3 > 1e-06"
    assert tests["transfer/nan"].find("failure").get("message") == "nan is not <= 1e-06"
    assert HURTS + "? (solve" in tests["transfer/raises[float32]"].find("error").get("message")
    assert "bunny.ply is not" in tests["transfer/bunny[float64,bunny]"].find("skipped").get("message")
    assert tests["study/substeps"].find("system-out").text.startswith("INFO: 0.052, not judged")
    assert HURTS in tests["material/markup[float64]"].find("system-out").text


def test_markdown(files):
    text = files["verify.md"]
    lines = text.splitlines()
    assert lines[2].startswith("**3 of 8 judged rows FAIL")
    assert "- not run: cuda (no device)" in lines
    assert text.index("## Failures") < text.index("## Counts") < text.index("## material")
    table = [line for line in lines if line.startswith(("| PASS", "| **FAIL**", "| SKIP", "| INFO"))]
    assert len(table) == 10
    assert {line.replace("\\|", "").count("|") for line in table} == {7}
    assert "<script" not in text.replace("\\<script", "")
    assert "| **FAIL** | transfer/nan | nan | 1e-06 | IDENTITY |" in text


def test_markdown_without_failures():
    text = render(sample(good_rows()))["verify.md"]
    assert "**All 3 judged rows pass: 3 PASS of 2 cases**" in text
    assert "Failures" not in text


def test_empty_record():
    files = render(sample([]))
    assert "No row was judged" in files["verify.md"]
    assert "No row was judged" in files["verify.html"]
    assert Xml.fromstring(files["verify.xml"]).get("tests") == "0"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "2e-10 <= 1e-06"),
        ({"status": "FAIL", "error": 0.1}, "0.1 > 1e-06"),
        ({"status": "FAIL", "error": "inf"}, "inf is not <= 1e-06"),
        ({"status": "FAIL", "error": None}, "no result"),
        ({"status": "INFO", "tolerance": None}, "2e-10, not judged"),
        ({"error": 0.0, "tolerance": 0.0}, "0 <= 0"),
    ],
)
def test_judgements(changes, expected):
    assert judgement(row("a/b") | changes) == expected


def test_durations():
    assert (duration(None), duration(0.04), duration(119.9), duration(135.2)) == ("-", "0.0 s", "119.9 s", "2 min 15 s")


def test_verdicts():
    assert verdict(sample([row("a/b", "INFO"), row("a/c", "SKIP")])) == "No row was judged"
    assert verdict(sample([row("a/b")])) == "The one judged row passes"
    assert verdict(sample([row("a/b", "FAIL")])) == "1 of 1 judged row FAIL"
    assert summary_lines(sample(all_rows(), cuda="no device"))[1:] == [
        "references: 5 CLOSED-FORM, 1 MANUFACTURED, 2 IDENTITY, 1 ODE, 1 CROSS-CODE",
        "time: 2.5 s CPU, 1.5 s wall",
        "not run: cuda (no device)",
    ]
