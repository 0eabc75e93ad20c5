# SPDX-License-Identifier: BSD-3-Clause
"""The record as Markdown: verdict, counts, failures, then a table for each topic."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from reports.verification.facts import facts
from reports.verification.groups import CaseRows, Row, Topic, failures, topics
from reports.verification.own import sections
from reports.verification.words import STATUSES, count_of_kinds, judgement, number, numbers, summary_lines

_SPECIAL = str.maketrans({c: f"\\{c}" for c in "\\`*_[]<>|#"} | {"\n": " ", "\r": " "})


def markdown(record: Mapping[str, Any]) -> str:
    """The whole report."""
    first, *rest = summary_lines(record)
    blocks = [
        "# Verification of femgal",
        f"**{_plain(first)}**",
        "\n".join(f"- {_plain(line)}" for line in rest),
        _failures(failures(record["rows"])),
        *(f"## {_plain(one.title)}\n\n{_plain(one.text)}\n\n{_table(one.heads, one.rows)}" for one in sections(record)),
        "## Counts",
        _table(
            ("kind of reference", *STATUSES, "rows"),
            ((kind, *(str(count) for count in counts)) for kind, counts in count_of_kinds(record["rows"])),
        ),
        "## Run",
        _table(("", ""), facts(record)),
        *(_topic(topic) for topic in topics(record["rows"])),
    ]
    return "\n\n".join(block for block in blocks if block) + "\n"


def _failures(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    return "\n\n".join(["## Failures", *(_failed_case(case) for topic in topics(rows) for case in topic.cases)])


def _failed_case(case: CaseRows) -> str:
    shared = case.shared
    lines = [f"Not true here: **{_plain(shared['title'])}**", ""]
    for row in case.rows:
        lines.append(f"- FAIL {_plain(row['id'])}: {_plain(judgement(row))}")
        lines += [f"  - {_plain(text)}" for text in (numbers(row), row["note"]) if text]
    lines.append(f"- {shared['kind']}: {_plain(shared['formula'])} ({_plain(shared['source'])})")
    lines.append(f"- tolerance {number(shared['tolerance'])}: {_plain(shared['reason'])}")
    return "\n".join(lines)


def _topic(topic: Topic) -> str:
    heads = ("status", "row", "error", "tolerance", "reference", "what passes, and what there is to say")
    cells = (
        (
            f"**{row['status']}**" if row["status"] == "FAIL" else row["status"],
            _plain(row["id"]),
            number(row["error"]),
            number(row["tolerance"]),
            row["kind"],
            _plain(row["title"] + (f" ({row['note']})" if row["note"] else "")),
        )
        for row in topic.rows
    )
    return f"## {_plain(topic.name)}\n\n" + _table(heads, cells, escape=False)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, escape: bool = True) -> str:
    lines = [heads, ["---"] * len(heads), *([_plain(cell) if escape else cell for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _plain(text: str) -> str:
    """Text that Markdown takes literally, in one line."""
    return text.translate(_SPECIAL)
