# SPDX-License-Identifier: BSD-3-Clause
"""Rows of a record in the order in which people read them: topics, their cases, the rows of each case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Row = Mapping[str, Any]


@dataclass(frozen=True)
class CaseRows:
    """Rows of one case; what they share stands in the first."""

    id: str
    rows: tuple[Row, ...]

    @property
    def shared(self) -> Row:
        """Title, kind, formula, source and the like."""
        return self.rows[0]


@dataclass(frozen=True)
class Topic:
    """Cases of one topic."""

    name: str
    cases: tuple[CaseRows, ...]

    @property
    def rows(self) -> list[Row]:
        """Rows of all cases."""
        return [row for case in self.cases for row in case.rows]


def topics(rows: Sequence[Row]) -> list[Topic]:
    """Rows by topic and by case, in the order in which they were run."""
    by_topic: dict[str, dict[str, list[Row]]] = {}
    for row in rows:
        name = str(row["case"]).split("/")[0]
        by_topic.setdefault(name, {}).setdefault(row["case"], []).append(row)
    return [
        Topic(name, tuple(CaseRows(id, tuple(its)) for id, its in cases.items())) for name, cases in by_topic.items()
    ]


def failures(rows: Sequence[Row]) -> list[Row]:
    """Rows that failed."""
    return [row for row in rows if row["status"] == "FAIL"]


def axis_values(row: Row) -> str:
    """Values of the row's axes: "float64, box"; the name of the case where it has none."""
    return ", ".join(row["values"].values()) or str(row["case"]).split("/")[-1]
