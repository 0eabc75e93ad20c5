# SPDX-License-Identifier: BSD-3-Clause
"""A small record of `femgal bench SCENE...` for tests of its reports."""

from __future__ import annotations

from typing import Any

TARGETS = (0.1, 0.01)


def row(problem: str, curve: str, error: float | None, seconds: float | None, **more: Any) -> dict[str, Any]:
    """A row that is done, or one that failed where there is no error."""
    found: dict[str, Any] = {
        "problem": problem,
        "curve": curve,
        "solver": curve,
        "label": f"{curve} substeps={more.get('substeps', [5, 5])[0]}",
        "settings": {},
        "status": "failed" if error is None else "done",
        "failure": "frame 1: the <energy> is not finite" if error is None else None,
        "failure_kind": "solver" if error is None else None,
        "finalist": False,
        "older": False,
        "error": error,
        "solver_error": None,
        "seconds": seconds,
        "times": {clock: {"median": seconds, "least": seconds, "most": seconds} for clock in ("wall", "cpu")},
        "runs": 0 if error is None else 1,
        "passes": None if seconds is None else 100.0 * seconds,
        "bytes": 1e9,
        "iterations": 5.0,
        "linear_iterations": None,
        "substeps": [5, 5],
        "retakes": 0,
        "eps18": 1e-6,
        "energy_gain": -0.01,
        "gaps": [],
        "stages": {"building the mesh": [1.0, 1.5]},
        "peak_mb": 200.0,
    }
    return found | more


def problem(id: str, vertices: int, E: float, own_error: float | None = 1e-5, flagged: bool = False) -> dict[str, Any]:
    """A scene that has been surveyed."""
    reference = {"label": "velocity Verlet, 90 steps per frame", "failure": None, "own_error": own_error}
    return {
        "id": id,
        "scene": "drape",
        "axes": {"vertices": vertices, "E": E, "nu": None, "rho": None},
        "chaotic": False,
        "vertices": vertices + 2,
        "tets": 5 * vertices,
        "E": [E, E],
        "nu": [0.4, 0.4],
        "rho": [1000.0, 1000.0],
        "horizon": {"frames": 20, "frames_per_second": 60.0, "period": 0.1, "seconds": 1 / 3, "periods": 3.3},
        "reference": reference | {"flagged": flagged, "substeps": 90.0, "seconds": 1.0},
    }


def entry(problem: str, curve: str, target: float, seconds: float | None, at_most: bool = False) -> dict[str, Any]:
    """Time to a target."""
    return {
        "problem": problem,
        "curve": curve,
        "target": target,
        "seconds": seconds,
        "passes": None if seconds is None else 100.0 * seconds,
        "at_most": at_most,
        "row": None if seconds is None else f"{curve} substeps=5",
        "why": "not reached: 0.05 at best" if seconds is None else None,
    }


def record() -> dict[str, Any]:
    """Two solvers on three scenes: soft and stiff, small and large."""
    soft, stiff, large = "drape 100 E=1e4", "drape 100 E=1e6", "drape 900 E=1e4"
    rows, summary = [], []
    for number, id in enumerate((soft, stiff, large), start=1):
        rows += [row(id, "verlet", 1e-4, 2.0 * number), row(id, "fas", 0.2, 0.5), row(id, "fas", 0.05, 1.0)]
        summary += [entry(id, "verlet", target, 2.0 * number, True) for target in TARGETS]
        summary += [entry(id, "fas", 0.1, 0.7 * number), entry(id, "fas", 0.01, None)]
    rows.append(row(stiff, "fas", None, None))
    return {
        "schema": "femgal-bench-1",
        "command": "femgal bench drape.toml",
        "date": "2026-02-03T04:05:06+00:00",
        "version": "0.1.0",
        "machine": {"python": "3.11", "numpy": "2.0", "cpu": "a <fast> one", "processors": 2},
        "clock": "cpu",
        "threads": 1,
        "targets": list(TARGETS),
        "curves": ["verlet", "fas"],
        "problems": [problem(soft, 100, 1e4), problem(stiff, 100, 1e6, None, True), problem(large, 900, 1e4)],
        "rows": rows,
        "summary": summary,
    }
