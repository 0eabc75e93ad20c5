# SPDX-License-Identifier: BSD-3-Clause
"""What a level costs: seconds, passes, iterations and substeps until eps18, or our error, is below it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from femgal.scene.solver import DEFAULTS
from verify.work_precision.front import cost_of

Row = dict[str, Any]
Entry = dict[str, Any]

# Quantities of an entry.
COSTS = ("seconds", "passes", "iterations", "substeps")


def motion_entries(rows: Sequence[Row], levels: Sequence[float], targets: Sequence[float]) -> list[Entry]:
    """Entries of whole motions: costs per frame on each curve's own front, seconds and passes interpolated.

    Iterations are inner ones, those of the linear solver where there is one; like substeps they are those of the
    cheapest row that is good enough. eps18 carries the effective step squared, so that of second-order steppings is
    another quantity: their rows take part in our error alone.
    """
    found = []
    for problem, curve in dict.fromkeys((row["problem"], row["curve"]) for row in rows):
        mine = [row for row in rows if row["problem"] == problem and row["curve"] == curve]
        done = [row for row in mine if row["status"] == "done"]
        by_eps18 = [{**row, "error": row["eps18"]} for row in done if _is_backward_euler(row)]
        for measure, judged, wanted in (("eps18", by_eps18, levels), ("error", done, targets)):
            for level in wanted:
                entry = {"problem": problem, "curve": curve, "measure": measure, "level": level}
                found.append({**entry, **_motion_costs(level, judged), **_least(judged), "tried": len(mine)})
    return found


def _is_backward_euler(row: Row) -> bool:
    default = DEFAULTS.get(row["solver"], {}).get("stepping", "backward-euler")
    return bool(row["settings"].get("stepping", default) == "backward-euler")


def _motion_costs(level: float, rows: Sequence[Row]) -> dict[str, Any]:
    seconds, passes = (cost_of(level, rows, cost) for cost in ("seconds", "passes"))
    if seconds is None:
        return dict.fromkeys(COSTS)
    row = seconds.rows[-1]
    linear = row["linear_iterations"]
    return {
        "seconds": seconds.cost,
        "passes": None if passes is None else passes.cost,
        "iterations": row["iterations"] if linear is None else linear,
        "substeps": row["substeps"][-1],
        "at_most": seconds.at_most,
    }


def _least(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """The best that has been reached, where it is known."""
    return {"best": min((row["error"] for row in rows if row["error"] is not None), default=None)}


def substep_entries(
    traces: Sequence[Row], levels: Sequence[float], targets: Sequence[float], clock: str
) -> list[Entry]:
    """Entries of single substeps: costs from the prediction to the first iterate from which on a share is kept.

    Parameters
    ----------
    levels : Shares of the prediction's eps18.
    targets : Shares of the prediction's distance from the minimiser.
    clock : "cpu" or "wall".
    """
    found = []
    for problem, curve in dict.fromkeys((trace["problem"], trace["curve"]) for trace in traces):
        mine = [trace for trace in traces if trace["problem"] == problem and trace["curve"] == curve]
        for measure, key, wanted in (("eps18", "eps18", levels), ("error", "distance", targets)):
            for level in wanted:
                costs = [cost for trace in mine if (cost := _substep_costs(trace, key, level, clock))]
                best = min(costs, key=lambda cost: cost["seconds"], default=dict.fromkeys(COSTS))
                entry = {"problem": problem, "curve": curve, "measure": measure, "level": level}
                found.append({**entry, **best, "best": _reached(mine, key), "tried": len(mine)})
    return found


def _substep_costs(trace: Row, key: str, level: float, clock: str) -> dict[str, Any] | None:
    shares = list(shares_of(trace, key))
    kept = next((k for k in range(len(shares) - 1, -1, -1) if not (shares[k] <= level)), -1) + 1
    if kept == len(shares):
        return None
    row = trace["iterates"][kept]
    seconds = row["cpu_seconds" if clock == "cpu" else "seconds"]
    return {"seconds": seconds, "passes": row["passes"], "iterations": row["iteration"], "substeps": None}


def shares_of(trace: Row, key: str) -> Iterator[float]:
    """Of the prediction's eps18, gap or distance, what each iterate has left; infinite where it is lost."""
    first = trace["prediction"][key] if trace["iterates"] else 1.0
    for row in trace["iterates"]:
        yield float("inf") if row[key] is None else row[key] / first


def _reached(traces: Sequence[Row], key: str) -> float | None:
    return min((share for trace in traces for share in shares_of(trace, key)), default=None)
