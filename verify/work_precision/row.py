# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of one row: one method on one scene, from its runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import Any, Literal

from verify.benchmark import traffic
from verify.work_precision.measure import Reference
from verify.work_precision.method import Method
from verify.work_precision.problem import Problem
from verify.work_precision.reference import ReferenceMotion
from verify.work_precision.store import Result

Clock = Literal["wall", "cpu"]
# Errors by reference and run.
Known = dict[tuple[str, str], float]

_CLOCKS = {"wall": "seconds", "cpu": "cpu_seconds"}

_BYTES = {
    "gradient": traffic.vector_bytes,
    "gradient_and_blocks": traffic.block_bytes,
    "hessian_product": traffic.vector_bytes,
    "energy": traffic.energy_bytes,
}


def make_row(
    problem: Problem,
    method: Method,
    runs: Sequence[Result],
    reference: ReferenceMotion | None,
    clock: Clock,
    converged: Reference | None = None,
    known: Known | None = None,
) -> dict[str, Any]:
    """JSON-ready numbers of a row.

    Parameters
    ----------
    runs : The first run and its repetitions; none where it has not been run.
    clock : Which time `seconds` is.
    converged : The converged motion of the same time stepping, for the solver error.
    known : Errors that have been computed; those that have not are added. Motions of large bodies take seconds to read.
    """
    row: dict[str, Any] = {
        "problem": problem.id,
        "curve": method.curve,
        "solver": method.name,
        "label": str(method),
        "settings": dict(method.settings),
        "error": None,
        "solver_error": None,
        "passes": None,
        "finalist": False,
        **_times(runs, clock),
    }
    if not runs:
        return row | {"status": "not run", "failure": None, "failure_kind": None}
    first = runs[0]
    row |= {"failure": first.failure, "failure_kind": first.numbers.get("failure_kind"), "older": first.older}
    row |= {"status": "failed" if first.failure else "done"}
    if first.numbers["rows"]:
        row |= _counts(first.numbers) | _energies(first.numbers)
    if first.failure is None:
        row |= _errors(problem, first, reference, converged, {} if known is None else known)
    return row


def _times(runs: Sequence[Result], clock: Clock) -> dict[str, Any]:
    """Seconds per frame of each run; of a single run the extremes are those of its frames."""
    done = [run.numbers["rows"] for run in runs if run.failure is None and run.numbers["rows"]]
    found: dict[str, Any] = {}
    for name, key in _CLOCKS.items():
        per_run = [sum(frame[key] for frame in rows) / len(rows) for rows in done]
        spread = per_run if len(per_run) > 1 else [frame[key] for rows in done for frame in rows]
        found[name] = {
            "median": median(per_run) if per_run else None,
            "least": min(spread, default=None),
            "most": max(spread, default=None),
        }
    return {"seconds": found[clock]["median"], "times": found, "runs": len(done)}


def _counts(numbers: dict[str, Any]) -> dict[str, Any]:
    frames, count = numbers["rows"], len(numbers["rows"])
    by_kind = {kind: sum(f["passes_by_kind"][kind] for f in frames) / count for kind in frames[0]["passes_by_kind"]}
    precision, tets = numbers["precision"], numbers["tets"]
    moved = sum(_BYTES[kind](precision) * tets * passes for kind, passes in by_kind.items() if kind in _BYTES)
    substeps = [frame["substeps"] for frame in frames]
    choice = numbers.get("choice")
    wasted = choice["wasted_passes"] or {} if choice else {}
    return {
        "passes": sum(by_kind.values()),
        "passes_by_kind": by_kind,
        "bytes": moved,
        "iterations": _last(frames, "iterations"),
        "linear_iterations": _last(frames, "linear_iterations"),
        "substeps": [min(substeps), max(substeps)],
        "retakes": sum(frame["retakes"] for frame in frames),
        "unconverged": sum(frame["unconverged"] for frame in frames),
        "peak_mb": numbers["peak_mb"],
        "stages": numbers["stages"],
        "load": numbers["load"],
        "gaps": numbers["gaps"],
        "estimated_error": numbers.get("estimated_error"),
        "choice": choice,
        "wasted_passes": sum(wasted.values()) / count,
    }


def _last(frames: Sequence[dict[str, Any]], key: str) -> float | None:
    """Per frame, of a number that grows from frame to frame."""
    value = frames[-1].get(key)
    return None if value is None else value / len(frames)


def _energies(numbers: dict[str, Any]) -> dict[str, Any]:
    """eps18 [m], the median over frames; gain and drift of the total energy, over what the start had above rest."""
    frames, start = numbers["rows"], numbers["start"]
    eps = [frame["eps18"] for frame in frames if frame["eps18"] is not None]
    scale = start["kinetic_energy"] + start["elastic_energy"]
    change = [(frame["total_energy"] - start["total_energy"]) / scale if scale > 0.0 else math.nan for frame in frames]
    return {
        "eps18": _finite(median(eps)) if eps else None,
        "energy_gain": _finite(max(change)),
        "energy_drift": _finite(change[-1]),
    }


def _errors(
    problem: Problem, run: Result, reference: ReferenceMotion | None, converged: Reference | None, known: Known
) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if reference is not None:
        key = (reference.name, str(run.motion))
        if key not in known:
            ours, motion = reference.motion, run.arrays()["displacement"]
            known[key] = ours.shape_error(motion) if problem.is_chaotic else ours.trajectory_error(motion)
        found["error"] = _finite(known[key])
        found["energy_error"] = _energy_error(run.numbers, reference.numbers)
    if converged is not None:
        found["solver_error"] = _finite(converged.trajectory_error(run.arrays()["displacement"]))
    return found


def _energy_error(numbers: dict[str, Any], reference: dict[str, Any]) -> float | None:
    """Difference of the total energies at the end, over what the start had above rest."""
    start, ours, theirs = reference["start"], numbers["rows"][-1], reference["rows"][-1]
    scale = start["kinetic_energy"] + start["elastic_energy"]
    return _finite(abs(ours["total_energy"] - theirs["total_energy"]) / scale) if scale > 0.0 else None


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
