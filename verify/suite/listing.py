# SPDX-License-Identifier: BSD-3-Clause
"""Cases as a text that a person reads before running any."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from verify.suite.case import Case, Row


def listing(rows: Sequence[Row]) -> list[str]:
    """Lines that name the cases of some rows: id, kind, tolerance, title, and the values of each axis."""
    by_case: dict[str, list[Row]] = {}
    for row in rows:
        by_case.setdefault(row.case.id, []).append(row)
    wide = max(map(len, by_case))
    lines = []
    for id, its in by_case.items():
        case = its[0].case
        lines.append(f"{id:{wide}s}  {case.kind.value:12s}  {tolerance_text(case)}")
        lines.append(f"    {case.title}")
        lines.append(f"    {_count(its)}")
    quick = sum(row.is_quick for row in rows)
    return [
        *lines,
        f"{_rows(len(rows))} of {len(by_case)} case{'s' if len(by_case) > 1 else ''}, {quick} of them quick",
    ]


def tolerance_text(case: Case) -> str:
    """Tolerance of all rows, or by precision; "not judged" where there is none."""
    if case.tolerance is None:
        return "not judged"
    if isinstance(case.tolerance, Mapping):
        return ", ".join(f"{value:g} ({precision})" for precision, value in case.tolerance.items())
    return f"{case.tolerance:g}"


def _count(rows: Sequence[Row]) -> str:
    values = {name: dict.fromkeys(str(row.values[name]) for row in rows) for name in rows[0].values}
    return "; ".join([_rows(len(rows)), *(f"{name} {', '.join(chosen)}" for name, chosen in values.items())])


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"
