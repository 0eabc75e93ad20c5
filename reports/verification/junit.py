# SPDX-License-Identifier: BSD-3-Clause
"""The record as JUnit XML: a suite for each topic, a test case for each row.

A row that FAILs with a number is a failure, one whose case raised an exception is an error, SKIP is skipped. INFO
counts as passed: nothing judges it; what it says stands in system-out.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as Xml

from reports.verification.groups import Row, topics
from reports.verification.words import judgement, number, numbers

# What XML 1.0 cannot hold, not even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit_xml(record: Mapping[str, Any]) -> str:
    """One ``testsuites`` element."""
    root = Xml.Element("testsuites", {"name": "femgal verify", **_counts(record["rows"], with_skipped=False)})
    for topic in topics(record["rows"]):
        suite = Xml.SubElement(root, "testsuite", {"name": topic.name, **_counts(topic.rows)})
        suite.set("timestamp", record["header"]["date"][:19])
        _properties(suite, record["header"])
        for row in topic.rows:
            _test_case(suite, row)
    Xml.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"


def _counts(rows: Sequence[Row], *, with_skipped: bool = True) -> dict[str, str]:
    failed = [row for row in rows if row["status"] == "FAIL"]
    errors = sum(_is_error(row) for row in failed)
    skipped = {"skipped": str(sum(row["status"] == "SKIP" for row in rows))} if with_skipped else {}
    return {
        "tests": str(len(rows)),
        "failures": str(len(failed) - errors),
        "errors": str(errors),
        **skipped,
        "time": _seconds(sum(row["seconds"] for row in rows)),
    }


def _properties(suite: Xml.Element, header: Mapping[str, Any]) -> None:
    properties = Xml.SubElement(suite, "properties")
    for name, value in header.items():
        if isinstance(value, str | int | float):
            Xml.SubElement(properties, "property", name=name, value=_clean(str(value)))


def _test_case(suite: Xml.Element, row: Row) -> None:
    test = Xml.SubElement(
        suite,
        "testcase",
        classname=f"femgal.{row['case'].replace('/', '.')}",
        name=row["id"],
        time=_seconds(row["seconds"]),
    )
    if row["status"] == "SKIP":
        Xml.SubElement(test, "skipped", message=_clean(row["note"]))
    elif row["status"] == "FAIL":
        name = "error" if _is_error(row) else "failure"
        message = row["note"] if _is_error(row) else judgement(row)
        Xml.SubElement(test, name, message=_clean(message), type=row["kind"]).text = _clean(_details(row))
    if row["status"] != "SKIP":
        Xml.SubElement(test, "system-out").text = _clean(f"{row['status']}: {judgement(row)}\n{_details(row)}")


def _details(row: Row) -> str:
    lines = [
        row["title"],
        numbers(row),
        f"{row['kind']}: {row['formula']} ({row['source']})",
        f"tolerance {number(row['tolerance'])}: {row['reason']}",
        row["note"],
    ]
    return "\n".join(filter(None, lines))


def _is_error(row: Row) -> bool:
    return row["error"] is None


def _seconds(value: float) -> str:
    return f"{value:.3f}"


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("?", text)
