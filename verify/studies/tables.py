# SPDX-License-Identifier: BSD-3-Clause
"""The tables of a study on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from verify.benchmark.kernel_tables import TextTable

Numbers = Mapping[str, Any]


def tables(record: Numbers) -> list[TextTable]:
    """What each level costs, part by part and measure by measure; then the verdicts."""
    found = [_costs(part, measure) for part in record["parts"] for measure in ("eps18", "error")]
    return [*found, _claims(record["claims"])]


def notes(record: Numbers) -> list[str]:
    """What the columns mean, and what failed."""
    clock = "CPU time of all threads" if record["clock"] == "cpu" else "wall time"
    found = [
        f"s: {clock}, per frame of whole motions; x: times as fast as the baseline; [L]: the paper's figure. "
        "Levels: eps18 in metres, of single substeps as a share of the prediction's; error: trajectory error, "
        "of single substeps the share of the distance from the minimiser that is left.",
    ]
    rows = [row for part in record["parts"] for row in part.get("rows", part.get("traces", ()))]
    found += [f"{row['problem']}: {row['label']}: {row['failure'].splitlines()[0]}" for row in rows if row["failure"]]
    return found


def _costs(part: Numbers, measure: str) -> TextTable:
    levels = part["levels"] if measure == "eps18" else part["targets"]
    entries = {(e["problem"], e["curve"], e["level"]): e for e in part["entries"] if e["measure"] == measure}
    speedups = {(e["problem"], e["curve"], e["level"]): e for e in part["speedups"] if e["measure"] == measure}
    heads = ["scene", "solver", *(f"s to {level:g}" for level in levels), *(f"its to {level:g}" for level in levels)]
    heads += [f"x at {level:g}" for level in levels] + ["[L]"] if speedups else []
    lines = []
    for problem, curve in dict.fromkeys((e["problem"], e["curve"]) for e in part["entries"]):
        keys = [(problem, curve, level) for level in levels]
        cells = [_seconds(entries[key]) for key in keys] + [_number(entries[key]["iterations"], ".0f") for key in keys]
        if speedups:
            cells += [_number(speedups[key]["speedup"], ".2f") for key in keys]
            cells.append(_number(speedups[keys[0]]["published"], ".2f"))
        lines.append((problem, curve, *cells))
    return TextTable(f"{part['title']}: to a level of {measure}", tuple(heads), tuple(lines))


def _seconds(entry: Numbers) -> str:
    if entry["seconds"] is None:
        return "-" if entry["best"] is None else f"- ({entry['best']:.1e})"
    return ("<= " if entry.get("at_most") else "") + f"{entry['seconds']:.3g}"


def _claims(claims: Sequence[Numbers]) -> TextTable:
    lines = tuple((claim["text"], claim["source"], claim["verdict"]) for claim in claims)
    return TextTable("Claims of the paper", ("claim", "where", "here"), lines)


def _number(value: float | None, style: str) -> str:
    return "-" if value is None else format(value, style)
