# SPDX-License-Identifier: BSD-3-Clause
"""The tables of a study on the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from reports.benchmark.charts import Record
from reports.benchmark.rows import HEADS, cells, choice_text


@dataclass(frozen=True)
class Table:
    """A table of text; the first column holds words.

    Parameters
    ----------
    title : What it shows.
    heads : Head of each column.
    rows : Cells, as many per row as heads.
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def tables(record: Record) -> list[Table]:
    """Time to each target over all scenes, then every row scene by scene."""
    return [_summary(record), *(_rows(record, problem) for problem in record["problems"])]


def notes(record: Record) -> list[str]:
    """What the columns mean, how good the references are, what was chosen, and what failed."""
    clock = "CPU time of all threads" if record["clock"] == "cpu" else "wall time"
    found = [
        f"s/frame: {clock} per frame, without compilation; spread: over the runs, or over the frames of a single run. "
        "passes, iterations (/ of the linear solver): per frame; solvers that assemble make few passes. "
        "energy gap: the largest of the substeps looked at; energy: largest gain of energy over what the start had.",
        "error: mass-weighted RMS distance from the reference over vertices and frames, over that of its own motion; "
        "of chaotic scenes, of the shape at the end.",
    ]
    found += [_reference_note(problem) for problem in record["problems"]]
    found += [f"{row['problem']}: {text}" for row in record["rows"] if (text := choice_text(row)) is not None]
    older = sum(row.get("older", False) for row in record["rows"])
    if older:
        found.append(f"{older} rows were run by other sources than the present ones (--keep-older).")
    failed = [row for row in record["rows"] if row["failure"]]
    return found + [f"{row['problem']}: {row['label']}: {row['failure'].splitlines()[0]}" for row in failed]


def _summary(record: Record) -> Table:
    heads = ("scene", "solver", *(f"s/frame to {target:g}" for target in record["targets"]))
    entries = {(e["problem"], e["curve"], e["target"]): e for e in record["summary"]}
    rows = []
    for problem in record["problems"]:
        for curve in record["curves"]:
            found = [entries[problem["id"], curve, target] for target in record["targets"]]
            best = [_best(record, problem["id"], target) for target in record["targets"]]
            times = (_time_to(entry, least) for entry, least in zip(found, best, strict=True))
            rows.append((problem["id"], curve, *times))
    return Table("time to an error; * is the soonest", heads, tuple(rows))


def _best(record: Record, problem: str, target: float) -> float | None:
    times = [
        e["seconds"] for e in record["summary"] if e["problem"] == problem and e["target"] == target and e["seconds"]
    ]
    return min(times, default=None)


def _time_to(entry: Mapping[str, Any], best: float | None) -> str:
    if entry["seconds"] is None:
        return str(entry["why"])
    sign = "<= " if entry["at_most"] else ""
    return f"{sign}{entry['seconds']:.3g}" + (" *" if entry["seconds"] == best else "")


def _rows(record: Record, problem: Mapping[str, Any]) -> Table:
    rows = [row for row in record["rows"] if row["problem"] == problem["id"]]
    horizon = problem["horizon"]
    length = ""
    if horizon:
        length = f", {horizon['frames']} frames of {1e3 / horizon['frames_per_second']:.4g} ms"
        length += f", {horizon['periods']:.2g} periods" if horizon["periods"] else ""
    title = f"{problem['id']}: {problem['vertices']} vertices, {problem['tets']} tetrahedra{length}"
    return Table(title, HEADS, tuple(map(cells, rows)))


def _reference_note(problem: Mapping[str, Any]) -> str:
    reference = problem["reference"]
    if reference["failure"]:
        return f"{problem['id']}: no reference, {reference['failure']}"
    own = "unknown" if reference["own_error"] is None else f"{reference['own_error']:.1e}"
    flag = " - MORE than a tenth of the smallest error shown" if reference["flagged"] else ""
    return f"{problem['id']}: reference {reference['label']}; its own error {own}{flag}"
