# SPDX-License-Identifier: BSD-3-Clause
"""A row of a record in words: one text per column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

HEADS = (
    "solver",
    "error",
    "s/frame",
    "spread",
    "passes",
    "GB",
    "iterations",
    "substeps",
    "retaken",
    "eps18",
    "solver error",
    "energy gap",
    "energy",
    "setup s",
    "peak MB",
)


def cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Texts under HEADS; of a row that failed or has not been run, its solver and the reason."""
    if row["status"] != "done":
        return (row["label"], row["failure_kind"] or row["status"], *["-"] * (len(HEADS) - 2))
    times = row["times"]["cpu" if row["seconds"] == row["times"]["cpu"]["median"] else "wall"]
    return (
        _name(row),
        _number(row["error"], ".2e"),
        _number(row["seconds"], ".3g"),
        f"{times['least']:.2g}..{times['most']:.2g}",
        _number(row["passes"], ".0f"),
        f"{row['bytes'] / 1e9:.2g}",
        _iterations(row),
        _range(row["substeps"]),
        str(row["retakes"]),
        _number(row["eps18"], ".1e"),
        _number(row["solver_error"], ".1e"),
        _number(max(row["gaps"], default=None), ".1e"),
        _number(row["energy_gain"], "+.0e"),
        f"{sum(cpu for _, cpu in row['stages'].values()):.1f}",
        _number(row["peak_mb"], ".0f"),
    )


def choice_text(row: Mapping[str, Any]) -> str | None:
    """What `auto` chose and expected, and what it took; None of a solver that was named."""
    if row["status"] != "done" or not row.get("choice"):
        return None
    choice, wasted = row["choice"], row["wasted_passes"]
    text = f"{row['label']} chose {choice['solver']}: {choice['reason']}. It took {row['passes']:.0f} passes a frame"
    return text + (f", {wasted:.0f} of them for a pilot that it gave up." if wasted else ".")


def _name(row: Mapping[str, Any]) -> str:
    chosen = f" ({row['choice']['solver']})" if row.get("choice") else ""
    return row["label"] + chosen + (" (final)" if row["finalist"] else "")


def _iterations(row: Mapping[str, Any]) -> str:
    linear = row["linear_iterations"]
    return _number(row["iterations"], ".0f") + ("" if linear is None else f" / {linear:.0f}")


def _number(value: float | None, style: str) -> str:
    return "-" if value is None else format(value, style)


def _range(counts: Sequence[int]) -> str:
    return f"{counts[0]}" if counts[0] == counts[-1] else f"{counts[0]}..{counts[-1]}"
