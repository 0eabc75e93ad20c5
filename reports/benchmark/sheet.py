# SPDX-License-Identifier: BSD-3-Clause
"""The rows of a record as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any

_OF_PROBLEM = ("scene", "vertices", "tets", "dihedral", "E", "nu", "rho")

_OF_ROW = (
    "problem",
    "curve",
    "solver",
    "label",
    "status",
    "finalist",
    "error",
    "solver_error",
    "energy_error",
    "estimated_error",
    "seconds",
    "runs",
    "passes",
    "bytes",
    "iterations",
    "linear_iterations",
    "retakes",
    "unconverged",
    "eps18",
    "energy_gain",
    "energy_drift",
    "peak_mb",
    "failure_kind",
    "failure",
)


def csv_text(record: Mapping[str, Any]) -> str:
    """One line per row, with the size and material of its scene."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*_OF_PROBLEM, *_OF_ROW))
    problems = {problem["id"]: problem for problem in record["problems"]}
    for row in record["rows"]:
        about = problems[row["problem"]]
        writer.writerow([_flat(about.get(key)) for key in _OF_PROBLEM] + [_flat(row.get(key)) for key in _OF_ROW])
    return text.getvalue()


def _flat(value: Any) -> Any:
    """A span of one value is that value."""
    if isinstance(value, list | tuple):
        return value[0] if value[0] == value[-1] else " to ".join(map(str, value))
    return "" if value is None else value
