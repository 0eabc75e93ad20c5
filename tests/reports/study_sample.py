# SPDX-License-Identifier: BSD-3-Clause
"""The record of a study with one part of each kind, small enough to read."""

from __future__ import annotations

from typing import Any

LEVELS, TARGETS = [1e-2, 1e-3], [0.5]
CURVES = ["newton-pcg", "fas-constant"]


def study_record() -> dict[str, Any]:
    """Two sizes, two curves; the faster one does not reach the second level at the larger size."""
    claims = [
        claim("holds", 4, 4),
        claim("holds in 1 of 2 comparisons", 1, 2),
        claim("does not hold", 0, 2),
        claim("cannot be judged here", 0, 0),
    ]
    return {
        "schema": "femgal-study-1",
        "command": "femgal study small <quick>",
        "date": "2026-01-02T03:04:05+00:00",
        "version": "0.1",
        "machine": {"cpu": "a processor", "processors": 2, "python": "3.11"},
        "clock": "cpu",
        "quick": True,
        "name": "small",
        "title": "A & B",
        "question": "Which?",
        "parts": [motion_part(), substep_part()],
        "claims": claims,
    }


def claim(verdict: str, good: int, judged: int) -> dict[str, Any]:
    cases = [{"where": "p", "found": "1 < 2", "holds": True}, {"where": "q", "found": "-", "holds": None}]
    keys = {"verdict": verdict, "good": good, "judged": judged, "cases": cases}
    return {"text": f"It {verdict}.", "source": "Table 2", "part": "motion", "rule": "seconds: a at most b", **keys}


def motion_part() -> dict[str, Any]:
    sizes = (100, 1000)
    rows = [row(size, curve, s) for size in sizes for curve in CURVES for s in (4, 16)]
    entries = [entry(size, curve, level) for size in sizes for curve in CURVES for level in LEVELS]
    entries[-1] |= {"seconds": None, "iterations": None, "substeps": None, "best": 5e-3}
    return about("motion") | {
        "baseline": "newton-pcg",
        "axis": "vertices",
        "plots": ["seconds eps18", "seconds error"],
        "problems": [problem(size) for size in sizes],
        "rows": rows,
        "entries": entries,
        "speedups": [speedup(e) for e in entries],
        "published": {"source": "Table 2 of the paper", "axis": "vertices", "values": [100], "rows": {}},
    }


def about(kind: str) -> dict[str, Any]:
    texts = {"id": kind, "kind": kind, "title": f"Part {kind}", "source": "Fig. 2", "about": "Chosen here: h."}
    return texts | {"levels": LEVELS, "targets": TARGETS, "curves": CURVES, "threads": 1, "frames": 2}


def problem(size: int) -> dict[str, Any]:
    reference = {"failure": None, "label": "Verlet", "own_error": 1e-5} if size == 100 else {"failure": "none asked"}
    axes = {"vertices": size, "E": 1e6, "nu": None, "rho": 1.0}
    return {"id": f"drape {size}", "axes": axes, "vertices": size, "tets": 5 * size, "reference": reference}


def row(size: int, curve: str, substeps: int) -> dict[str, Any]:
    failed = size == 1000 and curve == "fas-constant" and substeps == 4
    return {
        "problem": f"drape {size}",
        "curve": curve,
        "label": f"{curve} substeps={substeps}",
        "status": "failed" if failed else "done",
        "failure": "ran away" if failed else None,
        "seconds": 0.01 * substeps * size,
        "eps18": 0.1 / substeps**2,
        "error": None if size == 1000 else 1.0 / substeps,
    }


def entry(size: int, curve: str, level: float) -> dict[str, Any]:
    seconds = size * (2.0 if curve == "newton-pcg" else 1.0) * 1e-2 / level
    keys = {"measure": "eps18", "level": level, "best": 1e-4, "seconds": seconds, "passes": 7.0}
    return {"problem": f"drape {size}", "curve": curve, "iterations": 40.0, "substeps": 10, **keys}


def speedup(of: dict[str, Any]) -> dict[str, Any]:
    keys = {key: of[key] for key in ("problem", "curve", "measure", "level")}
    factor = 2.0 if of["curve"] == "fas-constant" else 1.0
    return {**keys, "speedup": factor if of["seconds"] else None, "published": 2.15 * factor}


def substep_part() -> dict[str, Any]:
    start = {"eps18": 1.0, "gap": 1.0, "distance": 1.0}
    one = {"id": "drape 100", "axes": {"vertices": 100}, "vertices": 100, "tets": 500, "prediction": start}
    entries = [entry(100, curve, level) | {"substeps": None} for curve in CURVES for level in LEVELS]
    return about("substep") | {
        "baseline": "",
        "axis": "",
        "plots": ["iteration eps18", "seconds distance"],
        "problems": [one, {"id": "drape 9", "axes": {}, "vertices": None, "tets": None}],
        "traces": [trace(curve) for curve in CURVES] + [trace("fas-constant") | {"status": "not run", "iterates": []}],
        "entries": entries,
        "speedups": [],
        "published": None,
    }


def trace(curve: str) -> dict[str, Any]:
    iterates = [
        {"iteration": k, "seconds": 2.0 * k, "cpu_seconds": 1.0 * k, "eps18": 0.5**k, "gap": 0.5**k, "distance": 0.9**k}
        for k in range(200)
    ]
    keys = {"problem": "drape 100", "curve": curve, "label": curve, "status": "done", "failure": None}
    return keys | {"iterates": iterates, "prediction": iterates[0]}
