# SPDX-License-Identifier: BSD-3-Clause
"""Results of the suite as plain data: what verify.json holds and `reports` draws from."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from verify.benchmark.machine import describe_machine
from verify.suite.case import Kind, Plot
from verify.suite.run import Result, Status
from verify.suite.use import DEVICES, Use, unavailable

SCHEMA = "femgal-verify-1"


def record(
    results: Sequence[Result],
    use: Use,
    command: str,
    *,
    wall_seconds: float | None = None,
    not_run: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Everything about a run of the suite, ready for JSON.

    Parameters
    ----------
    command : What was typed, without paths.
    wall_seconds : Duration of the run [s].
    not_run : What the run left out, and why.
    """
    return {
        "schema": SCHEMA,
        "header": {
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "command": command,
            "device": use.device,
            "devices": {name: unavailable(name) or "available" for name in DEVICES},
            "threads": use.threads,
            "seed": use.seed,
            **describe_machine(),
            **_versions(),
        },
        "summary": summary(results) | {"wall_seconds": wall_seconds, "not_run": dict(not_run or {})},
        "rows": [as_row(result) for result in results],
    }


def summary(results: Sequence[Result]) -> dict[str, Any]:
    """Counts by status and by kind of reference, and CPU time [s]."""
    status = Counter(result.status.value for result in results)
    kinds = Counter(result.row.case.kind.value for result in results)
    return {
        "rows": len(results),
        "cases": len({result.row.case.id for result in results}),
        "status": {one.value: status[one.value] for one in Status},
        "kinds": {one.value: kinds[one.value] for one in Kind},
        "cpu_seconds": sum(result.seconds for result in results),
    }


def as_row(result: Result) -> dict[str, Any]:
    """One result as plain data, with everything that a stranger needs to check it."""
    case, measured = result.row.case, result.measurement
    return {
        "id": str(result.row),
        "case": case.id,
        "title": case.title,
        "values": {name: str(value) for name, value in result.row.values.items()},
        "device": result.device,
        "quantity": case.quantity,
        "unit": case.unit,
        "kind": case.kind.value,
        "formula": case.formula,
        "source": case.source,
        "requires": case.requires,
        "computed": None if measured is None else _number(measured.computed),
        "reference": None if measured is None else _number(measured.reference),
        "error": None if measured is None else _number(measured.error),
        "tolerance": result.row.tolerance,
        "reason": case.reason,
        "status": result.status.value,
        "note": result.note,
        "seconds": result.seconds,
        "plots": [] if measured is None else [_plot(plot) for plot in measured.plots],
    }


def _plot(plot: Plot) -> dict[str, Any]:
    curves = [
        {"name": curve.name, "x": [*map(_number, curve.x)], "y": [*map(_number, curve.y)]} for curve in plot.curves
    ]
    return asdict(plot) | {"curves": curves, "slopes": list(plot.slopes)}


def _number(value: float) -> float | str:
    """JSON knows no infinity and no NaN."""
    return float(value) if math.isfinite(value) else str(float(value))


def _versions() -> dict[str, str | None]:
    from importlib.metadata import PackageNotFoundError, version

    found: dict[str, str | None] = {}
    for package in ("scikit-fem", "pyamg"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return found
