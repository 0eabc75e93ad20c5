# SPDX-License-Identifier: BSD-3-Clause
"""Numbers, judgements and counts of a record in words, the same in every kind of report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

STATUSES = ("PASS", "FAIL", "SKIP", "INFO")

# What each kind of reference is, from the strongest statement to the weakest.
KINDS = {
    "CLOSED-FORM": "a formula that can be evaluated by hand",
    "MANUFACTURED": "a chosen solution, with the load that belongs to it",
    "IDENTITY": "an exact statement about the discrete equations",
    "ODE": "an ordinary differential equation, integrated far more accurately",
    "CROSS-CODE": "another code: scikit-fem, or dense algebra",
    "LITERATURE": "a published number",
    "REGRESSION": "an earlier result of this code",
}


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
    sign = "<=" if row["status"] != "FAIL" else "is not <=" if isinstance(row["error"], str) else ">"
    return f"{number(row['error'])} {sign} {number(row['tolerance'])}"


def numbers(row: Mapping[str, Any]) -> str:
    """What was compared, and the two numbers where there are any."""
    what = f"{row['quantity']} [{row['unit']}]"
    if row["error"] is None:
        return what
    return f"{what}: computed {number(row['computed'], 6)}, reference {number(row['reference'], 6)}"


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


def count_of_kinds(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, tuple[int, ...]]]:
    """Counts by kind of reference, strongest first: of each status, and of all; the last line is of all kinds."""
    by_kind = [
        (kind, [row["status"] for row in rows if row["kind"] == kind])
        for kind in dict.fromkeys((*KINDS, *(row["kind"] for row in rows)))
    ]
    lines = [(kind, found) for kind, found in by_kind if found] + [("all", [row["status"] for row in rows])]
    return [(kind, (*map(found.count, STATUSES), len(found))) for kind, found in lines]


def plural(count: int, noun: str) -> str:
    """A count with its noun: "1 case", "2 cases"."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def verdict(record: Mapping[str, Any]) -> str:
    """One sentence about the whole run."""
    status = record["summary"]["status"]
    judged = status["PASS"] + status["FAIL"]
    if status["FAIL"]:
        return f"{status['FAIL']} of {plural(judged, 'judged row')} FAIL"
    if not judged:
        return "No row was judged"
    return f"All {judged} judged rows pass" if judged > 1 else "The one judged row passes"


def summary_lines(record: Mapping[str, Any]) -> list[str]:
    """The end of a run: verdict, counts by status and by kind of reference, times, and what was not run."""
    summary = record["summary"]
    return [
        f"{verdict(record)}: {counts(summary['status'])} of {plural(summary['cases'], 'case')}",
        f"references: {counts(summary['kinds'])}",
        f"time: {duration(summary['cpu_seconds'])} CPU, {duration(summary.get('wall_seconds'))} wall",
        *(f"not run: {what} ({why})" for what, why in summary.get("not_run", {}).items()),
    ]
