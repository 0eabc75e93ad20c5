# SPDX-License-Identifier: BSD-3-Clause
"""Records of the verification suite made by hand: every status, numbers that are none, texts that hurt, plots."""

from __future__ import annotations

from collections import Counter
from typing import Any

from reports.verification.words import KINDS, STATUSES

HURTS = "<script>alert('1')</script> & \"a\" | *b* `c`"

HEADER = {
    "date": "2026-01-17T09:30:00+00:00",
    "command": "femgal verify --full --report out",
    "device": "cpu",
    "devices": {"cpu": "available", "cuda": "this version of femgal has no CUDA backend"},
    "threads": None,
    "seed": 20_260_117,
    "python": "3.11.9",
    "femgal": "0.1.0",
    "numpy": "2.2.1",
    "scikit-fem": "12.0.1",
    "pyamg": None,
    "platform": "Linux-6.1-x86_64",
    "cpu": "A processor @ 2.5 GHz",
    "processors": 2,
    "load_before": 0.25,
}


def row(id: str, status: str = "PASS", **changes: Any) -> dict[str, Any]:
    """A row; its axes are read off the id."""
    case, _, axes = id.removesuffix("]").partition("[")
    names = ("precision", "mesh", "state")
    numbers = {"computed": 1.0000000002, "reference": 1.0, "error": 2e-10}
    return {
        "id": id,
        "case": case,
        "title": f"What {case.split('/')[-1]} says is true",
        "values": dict(zip(names, axes.split(","), strict=False)) if axes else {},
        "device": "cpu",
        "quantity": "largest difference of a force over the largest term of one element",
        "unit": "N",
        "kind": "CLOSED-FORM",
        "formula": "P = mu F + c cof F,  c = lam (J - 1) - mu",
        "source": "Smith et al. 2018, Eq. 13",
        "requires": "",
        **(dict.fromkeys(numbers) if status == "SKIP" else numbers),
        "tolerance": None if status == "INFO" else 1e-6,
        "reason": "rounding of a sum over some twenty elements",
        "status": status,
        "note": "",
        "seconds": 0.25,
        "plots": [],
        **changes,
    }


CONVERGENCE = {
    "title": "Error of P1 on a manufactured solution",
    "x": "element size h [m]",
    "y": "relative error",
    "curves": [
        {"name": "L2 norm", "x": [0.25, 0.125, 0.0625, 0.03125], "y": [4.1e-2, 1.12e-2, 2.86e-3, 7.2e-4]},
        {"name": "H1 seminorm", "x": [0.25, 0.125, 0.0625, 0.03125], "y": [0.31, 0.161, 0.081, 0.0405]},
    ],
    "slopes": [2.0, 1.0],
}

SUBSTEPS = {
    "title": "Error against substeps",
    "x": "substeps per frame",
    "y": "trajectory error against velocity Verlet",
    "curves": [
        {
            "name": "spectral steps",
            "x": [25, 50, 100, 200, 400, 800],
            "y": [1.1e-2, 2.9e-3, 1.6e-3, 8e-4, 4.1e-4, 2.1e-4],
        },
        {
            "name": "fixed steps (0.25, 0.5)",
            "x": [25, 50, 100, 200, 400, 800],
            "y": [5.9e-2, 5.6e-2, 5.5e-2, 5.3e-2, 5.2e-2, 5.2e-2],
        },
        {
            "name": "eps18 of fixed steps",
            "x": [25, 50, 100, 200, 400, 800],
            "y": [8e-7, 2e-7, 5e-8, 1.2e-8, 3e-9, 8e-10],
        },
    ],
    "slopes": [1.0],
}

UNDRAWABLE = {
    "title": "A curve that left the numbers",
    "x": "h [s]",
    "y": "error",
    "curves": [{"name": HURTS, "x": [1.0, 2.0, 4.0], "y": ["nan", 0.0, "inf"]}],
    "slopes": [1.0],
}


def good_rows() -> list[dict[str, Any]]:
    """Nothing failed, was skipped or has a plot."""
    return [row("material/shear[float64,box]"), row("material/shear[float32,box]", error=3e-7), row("transfer/unity")]


def all_rows() -> list[dict[str, Any]]:
    """Every status, and what hurts."""
    return [
        *good_rows(),
        row("material/dilation[float64,rabbit]", "FAIL", computed=1.3, error=0.3, note="worst at vertex 12"),
        row("material/markup[float64]", title=HURTS, note=HURTS, formula=HURTS, kind="IDENTITY"),
        row("transfer/nan", "FAIL", computed="nan", error="nan", kind="IDENTITY"),
        row(
            "transfer/raises[float32]",
            "FAIL",
            computed=None,
            reference=None,
            error=None,
            note=f"ValueError: {HURTS}\x00 (solve, line 12)",
            kind="CROSS-CODE",
        ),
        row("transfer/bunny[float64,bunny]", "SKIP", note="bunny.ply is not in a folder of FEMGAL_MESH_PATH"),
        row(
            "space/rates",
            kind="MANUFACTURED",
            plots=[CONVERGENCE],
            note="orders 1.87, 1.95, 1.98",
            error=0.02,
            tolerance=0.1,
        ),
        row("study/substeps", "INFO", kind="ODE", plots=[SUBSTEPS, UNDRAWABLE], note="flat by design", error=0.052),
    ]


def sample(rows: list[dict[str, Any]], **not_run: str) -> dict[str, Any]:
    """A record of some rows."""
    status, kinds = Counter(one["status"] for one in rows), Counter(one["kind"] for one in rows)
    return {
        "schema": "femgal-verify-1",
        "header": dict(HEADER),
        "summary": {
            "rows": len(rows),
            "cases": len({one["case"] for one in rows}),
            "status": {name: status[name] for name in STATUSES},
            "kinds": {name: kinds[name] for name in KINDS},
            "cpu_seconds": sum(one["seconds"] for one in rows),
            "wall_seconds": 1.5,
            "not_run": not_run,
        },
        "rows": rows,
    }
