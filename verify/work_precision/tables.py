# SPDX-License-Identifier: BSD-3-Clause
"""The tables of a study on the terminal, and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from verify.benchmark.kernel_tables import TextTable

_HEADS = (
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
    "energy",
    "setup s",
    "peak MB",
)

_PLAIN = (
    "problem",
    "curve",
    "solver",
    "label",
    "status",
    "finalist",
    "error",
    "solver_error",
    "energy_error",
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
_OF_PROBLEM = ("scene", "vertices", "tets", "E", "nu", "rho")


def tables(record: dict[str, Any]) -> list[TextTable]:
    """Time to each target over all scenes, then every row scene by scene."""
    return [_summary(record), *(_rows(record, problem) for problem in record["problems"])]


def notes(record: dict[str, Any]) -> list[str]:
    """What the columns mean, how good the references are, and what failed."""
    clock = "CPU time of all threads" if record["clock"] == "cpu" else "wall time"
    found = [
        f"s/frame: {clock} per frame, without compilation; spread: over the runs, or over the frames of a single run. "
        f"passes, iterations: per frame. energy: largest gain of total energy over what the start had.",
        "error: mass-weighted RMS distance from the reference over vertices and frames, over that of its own motion; "
        "of chaotic scenes, of the shape at the end.",
    ]
    found += [_reference_note(problem) for problem in record["problems"]]
    older = sum(row.get("older", False) for row in record["rows"])
    if older:
        found.append(f"{older} rows were run by other sources than the present ones (--keep-older).")
    failed = [row for row in record["rows"] if row["failure"]]
    return found + [f"{row['problem']}: {row['label']}: {row['failure'].splitlines()[0]}" for row in failed]


def csv_text(record: dict[str, Any]) -> str:
    """One line per row, with the size and material of its scene."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*_OF_PROBLEM, *_PLAIN))
    problems = {problem["id"]: problem for problem in record["problems"]}
    for row in record["rows"]:
        about = problems[row["problem"]]
        writer.writerow([_flat(about.get(key)) for key in _OF_PROBLEM] + [_flat(row.get(key)) for key in _PLAIN])
    return text.getvalue()


def _flat(value: Any) -> Any:
    """A span of one value is that value."""
    if isinstance(value, list):
        return value[0] if value[0] == value[-1] else " to ".join(map(str, value))
    return "" if value is None else value


def _summary(record: dict[str, Any]) -> TextTable:
    heads = ("scene", "solver", *(f"s/frame to {target:g}" for target in record["targets"]))
    entries = {(e["problem"], e["curve"], e["target"]): e for e in record["summary"]}
    rows = []
    for problem in record["problems"]:
        for curve in record["curves"]:
            found = [entries[problem["id"], curve, target] for target in record["targets"]]
            best = [_best(record, problem["id"], target) for target in record["targets"]]
            cells = (_time_to(entry, least) for entry, least in zip(found, best, strict=True))
            rows.append((problem["id"], curve, *cells))
    return TextTable("time to an error; * is the soonest", heads, tuple(rows))


def _best(record: dict[str, Any], problem: str, target: float) -> float | None:
    times = [
        e["seconds"] for e in record["summary"] if e["problem"] == problem and e["target"] == target and e["seconds"]
    ]
    return min(times, default=None)


def _time_to(entry: dict[str, Any], best: float | None) -> str:
    if entry["seconds"] is None:
        return str(entry["why"])
    sign = "<= " if entry["at_most"] else ""
    return f"{sign}{entry['seconds']:.3g}" + (" *" if entry["seconds"] == best else "")


def _rows(record: dict[str, Any], problem: dict[str, Any]) -> TextTable:
    rows = [row for row in record["rows"] if row["problem"] == problem["id"]]
    horizon = problem["horizon"]
    length = ""
    if horizon:
        length = f", {horizon['frames']} frames of {1e3 / horizon['frames_per_second']:.4g} ms"
        length += f", {horizon['periods']:.2g} periods" if horizon["periods"] else ""
    title = f"{problem['id']}: {problem['vertices']} vertices, {problem['tets']} tetrahedra{length}"
    return TextTable(title, _HEADS, tuple(map(_row, rows)))


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    if row["status"] != "done":
        return (row["label"], row["failure_kind"] or row["status"], *["-"] * (len(_HEADS) - 2))
    times = row["times"]["cpu" if row["seconds"] == row["times"]["cpu"]["median"] else "wall"]
    stages = sum(cpu for _, cpu in row["stages"].values())
    return (
        row["label"] + (" (final)" if row["finalist"] else ""),
        _number(row["error"], ".2e"),
        _number(row["seconds"], ".3g"),
        f"{times['least']:.2g}..{times['most']:.2g}",
        _number(row["passes"], ".0f"),
        _number(row["bytes"] / 1e9, ".2g"),
        _number(row["iterations"], ".0f")
        + (f"/{row['linear_iterations']:.0f}" if row["linear_iterations"] is not None else ""),
        _range(row["substeps"]),
        str(row["retakes"]),
        _number(row["eps18"], ".1e"),
        _number(row["solver_error"], ".1e"),
        _number(row["energy_gain"], "+.0e"),
        _number(stages, ".1f"),
        _number(row["peak_mb"], ".0f"),
    )


def _number(value: float | None, style: str) -> str:
    return "-" if value is None else format(value, style)


def _range(counts: Sequence[int]) -> str:
    return f"{counts[0]}" if counts[0] == counts[-1] else f"{counts[0]}..{counts[-1]}"


def _reference_note(problem: dict[str, Any]) -> str:
    reference = problem["reference"]
    if reference["failure"]:
        return f"{problem['id']}: no reference, {reference['failure']}"
    own = "unknown" if reference["own_error"] is None else f"{reference['own_error']:.1e}"
    flag = " - MORE than a tenth of the smallest error shown" if reference["flagged"] else ""
    return f"{problem['id']}: reference {reference['label']}; its own error {own}{flag}"
