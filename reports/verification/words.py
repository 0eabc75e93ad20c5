# SPDX-License-Identifier: BSD-3-Clause
"""Numbers, judgements and counts of a record in words, the same in every kind of report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

STATUSES = ("PASS", "FAIL", "SKIP", "INFO")


def number(value: float | str | None, digits: int = 3) -> str:
    """A number with some significant digits; "nan" and "inf" as they are, a dash for none."""
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.{digits}g}"


def judgement(row: Mapping[str, Any]) -> str:
    """What the tolerance says about the error: "3.1e-16 <= 1e-12", "0.2 > 0.1", "0.31, not judged"."""
    if row["error"] is None:
        return "no result"
    if row["tolerance"] is None:
        return f"{number(row['error'])}, not judged"
    sign = ">" if row["status"] == "FAIL" else "<="
    return f"{number(row['error'])} {sign} {number(row['tolerance'])}"


def topic(row: Mapping[str, Any]) -> str:
    """First part of the id."""
    return str(row["id"]).split("/")[0]


def duration(seconds: float | None) -> str:
    """Seconds, or minutes and seconds from two minutes on."""
    if seconds is None:
        return "-"
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{int(seconds) // 60} min {int(seconds) % 60} s"


def counts(of: Mapping[str, int]) -> str:
    """Counts that are not zero: "12 PASS, 1 FAIL"."""
    return ", ".join(f"{count} {name}" for name, count in of.items() if count) or "nothing"


def verdict(record: Mapping[str, Any]) -> str:
    """One sentence about the whole run."""
    status = record["summary"]["status"]
    judged = status["PASS"] + status["FAIL"]
    if status["FAIL"]:
        return f"{status['FAIL']} of {judged} judged rows FAIL"
    if not judged:
        return "No row was judged"
    return f"All {judged} judged rows pass"


def summary_lines(record: Mapping[str, Any]) -> list[str]:
    """The end of a run: verdict, counts by status and by kind of reference, times, and what was not run."""
    summary = record["summary"]
    return [
        f"{verdict(record)}: {counts(summary['status'])} of {summary['cases']} cases",
        f"references: {counts(summary['kinds'])}",
        f"time: {duration(summary['cpu_seconds'])} CPU, {duration(summary.get('wall_seconds'))} wall",
        *(f"not run: {what} ({why})" for what, why in summary.get("not_run", {}).items()),
    ]
