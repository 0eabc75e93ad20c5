# SPDX-License-Identifier: BSD-3-Clause
"""The record of a study: one JSON object that tables, plots and pages are made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from femgal import __version__
from verify.benchmark.machine import describe_machine
from verify.work_precision.front import TimeTo, cost_of
from verify.work_precision.problem import Problem
from verify.work_precision.reference import ReferenceMotion, steps_per_frame
from verify.work_precision.study import Row, Study

SCHEMA = "femgal-bench-1"

# A reference's own error is at most this share of the smallest error shown, or it is flagged.
LARGEST_OWN_SHARE = 0.1


def make_record(study: Study, command: str) -> dict[str, Any]:
    """Everything that has been measured, JSON-ready.

    Parameters
    ----------
    command : What the user typed.
    """
    parts = [_part(study, problem) for problem in study.problems]
    return {
        "schema": SCHEMA,
        "command": command,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": __version__,
        "machine": describe_machine(),
        "clock": study.options.clock,
        "threads": study.grid.threads,
        "targets": list(study.grid.targets),
        "curves": list(dict.fromkeys(method.curve for method in study.methods)),
        "problems": [problem for problem, _ in parts],
        "rows": [row for _, rows in parts for row in rows],
        "summary": [entry for problem, rows in parts for entry in _summary(study, problem["id"], rows)],
    }


def _part(study: Study, problem: Problem) -> tuple[dict[str, Any], list[Row]]:
    rows = study.rows(problem)
    chosen = study.finalists(problem)
    for row, method in zip(rows, study.methods, strict=True):
        row["finalist"] = method in chosen
    survey = study.survey(problem) or {}
    return {
        "id": problem.id,
        "scene": problem.scene.name,
        "axes": dict(problem.axes),
        "chaotic": problem.is_chaotic,
        **{key: survey.get(key) for key in ("vertices", "tets", "dihedral", "E", "nu", "rho", "mesh")},
        "horizon": study.horizon(problem).as_dict() if survey else None,
        "reference": _reference(study.reference(problem), rows),
    }, rows


def _reference(found: ReferenceMotion | str, rows: Sequence[Row]) -> dict[str, Any]:
    if isinstance(found, str):
        return {"label": None, "failure": found, "own_error": None, "flagged": True}
    own = found.own_error if math.isfinite(found.own_error) else None
    smallest = min((row["error"] for row in rows if row["error"]), default=None)
    frames = found.numbers["rows"]
    return {
        "label": found.label,
        "failure": None,
        "own_error": own,
        "flagged": own is None or (smallest is not None and own > LARGEST_OWN_SHARE * smallest),
        "substeps": steps_per_frame(found.numbers),
        "seconds": sum(frame["seconds"] for frame in frames) / max(1, len(frames)),
    }


def _summary(study: Study, problem: str, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Seconds and passes per frame to each target, curve by curve."""
    found = []
    for curve in dict.fromkeys(row["curve"] for row in rows):
        mine = [row for row in rows if row["curve"] == curve]
        for target in study.grid.targets:
            seconds, passes = (cost_of(target, mine, cost) for cost in ("seconds", "passes"))
            found.append(
                {
                    "problem": problem,
                    "curve": curve,
                    "target": target,
                    "seconds": _cost(seconds),
                    "passes": _cost(passes),
                    "at_most": seconds is not None and seconds.at_most,
                    "row": seconds.rows[-1]["label"] if seconds else None,
                    "why": None if seconds else _why_not(mine),
                }
            )
    return found


def _cost(found: TimeTo | None) -> float | None:
    return None if found is None else found.cost


def _why_not(rows: Sequence[Row]) -> str:
    errors = [row["error"] for row in rows if row["error"] is not None]
    if errors:
        return f"not reached: {min(errors):.2g} at best"
    failed = sum(row["status"] == "failed" for row in rows)
    return f"not reached: {failed} of {len(rows)} rows failed" if failed else "not run"
