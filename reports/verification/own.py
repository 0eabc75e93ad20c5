# SPDX-License-Identifier: BSD-3-Clause
"""What a run on a user's own mesh or result adds to the report: findings, and frames beside the reference."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from reports.verification.words import number

# Frames that a table shows at most, the last one always among them.
MOST_FRAMES = 60

# Statuses whose colours the severities take.
TONES = {"ok": "PASS", "note": "INFO", "warning": "SKIP", "problem": "FAIL"}


@dataclass(frozen=True)
class Section:
    """A titled table.

    Parameters
    ----------
    title, text : Its heading, and a sentence below that.
    heads, rows : Its cells.
    """

    title: str
    text: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def sections(record: Mapping[str, Any]) -> list[Section]:
    """Tables of the diagnosis and of the comparison, where the record has them."""
    found = []
    if "diagnosis" in record:
        found.append(_diagnosis(record["diagnosis"]))
    if "comparison" in record:
        found.append(_comparison(record["comparison"]))
    return found


def _diagnosis(diagnosis: Mapping[str, Any]) -> Section:
    order = list(TONES)
    findings = sorted(diagnosis["findings"], key=lambda one: -order.index(one["severity"]))
    counts = ", ".join(f"{count} {name}" for name, count in reversed(diagnosis["counts"].items()) if count)
    return Section(
        f"Diagnosis of {diagnosis['name']}",
        counts,
        ("severity", "about", "found", "what to do"),
        tuple((one["severity"], one["topic"], one["what"], one["advice"]) for one in findings),
    )


def _comparison(comparison: Mapping[str, Any]) -> Section:
    rows = comparison["rows"]
    step = max(1, math.ceil(len(rows) / MOST_FRAMES))
    shown = rows[::step] if (len(rows) - 1) % step == 0 else [*rows[::step], rows[-1]]
    own = number(comparison["reference"]["own_error"])
    text = (
        f"{comparison['matching']}; {comparison['frames']} of the {comparison['frames_of_scene'] + 1} frames of the "
        f"scene; velocities: {comparison['velocities']}. Relative trajectory error {number(comparison['error'])}; "
        f"that of the reference itself {own}."
    )
    heads = ("frame", "time [s]", "error", "largest [m]", "total energy [J]", "of the reference [J]", "|p|", "|p| ref")
    return Section(f"{comparison['result']}, frame by frame", text, heads, tuple(map(_frame, shown)))


def _frame(row: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(row["frame"]),
        number(row["time_s"], 4),
        number(row["error"]),
        number(row["largest_m"]),
        number(row["total_J"], 5),
        number(row["reference_total_J"], 5),
        number(_length(row["linear_momentum"]), 4),
        number(_length(row["reference_linear_momentum"]), 4),
    )


def _length(vector: list[float | str]) -> float | str:
    """Of three components; of a lost one the word that stands for it."""
    lost = next((one for one in vector if isinstance(one, str)), None)
    return lost if lost is not None else math.hypot(*(float(one) for one in vector))
