# SPDX-License-Identifier: BSD-3-Clause
"""The record as Markdown: verdict, counts, failures, then a table for each topic."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from reports.verification.facts import facts
from reports.verification.groups import Row, Topic, failures, topics
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
    return "\n\n".join(["## Failures", *map(_failure, rows)])


def _failure(row: Row) -> str:
    lines = [
        f"**{_plain(row['id'])}**: {_plain(judgement(row))}",
        f"{_plain(row['title'])}.",
        _plain(numbers(row)),
        f"{row['kind']}: {_plain(row['formula'])} ({_plain(row['source'])})",
        f"tolerance {number(row['tolerance'])}: {_plain(row['reason'])}",
        _plain(row["note"]),
    ]
    return "\n".join(f"- {line}" if k == 0 else f"  - {line}" for k, line in enumerate(filter(None, lines)))


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
