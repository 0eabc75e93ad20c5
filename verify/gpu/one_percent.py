# SPDX-License-Identifier: BSD-3-Clause
"""What it takes each solver to solve a whole motion with an error of one percent, against a far more accurate one.

The error is the root mean square over frames and vertices, weighted by mass, of the distance from the reference, over
that of the motion (`femgal.timestep.control`). Solvers that control it themselves are asked for it; the others double
their substeps until they have it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.failure import SolverFailure
from femgal.simulation import Simulation

ACCURACY, REFERENCE = 0.01, 0.0005

# The last number of substeps that is tried, and the seconds after which no larger one is.
MOST_SUBSTEPS, MOST_SECONDS = 1600, 40.0

CONTROLLED: dict[str, dict[str, object]] = {
    "verlet": {"name": "verlet", "accuracy": ACCURACY},
    "newton-multigrid": {"name": "newton-multigrid", "accuracy": ACCURACY},
}
FIXED: dict[str, dict[str, object]] = {
    "fas, backward Euler": {"name": "fas"},
    "fas, BDF2": {"name": "fas", "stepping": "bdf2"},
    "fas, BDF2, spectral steps": {"name": "fas", "stepping": "bdf2", "steps": "spectral"},
    "jacobi, BDF2": {"name": "jacobi", "stepping": "bdf2", "steps": "spectral"},
    "vbd, BDF2": {"name": "vbd", "stepping": "bdf2"},
}

Floats = NDArray[np.float64]
# From a solver's settings to a simulation that is ready to run.
Prepare = Callable[[dict[str, object]], Simulation]


def reference(prepare: Prepare) -> list[Floats]:
    """Positions of each frame but the first, nearly exact."""
    return [frame.state.x for frame in prepare({"name": "verlet", "accuracy": REFERENCE}).frames()][1:]


def controlled(prepare: Prepare, solver: dict[str, object], exact: Sequence[Floats]) -> dict[str, Any]:
    """One run of a solver that keeps an accuracy."""
    row = _solved(prepare(solver), exact)
    return {**row, "reached": row["error"] <= ACCURACY}


def fixed(prepare: Prepare, solver: dict[str, object], exact: Sequence[Floats], first: int = 25) -> dict[str, Any]:
    """Runs with more and more substeps; the last one is the result, the others are kept with it."""
    tried: list[dict[str, Any]] = []
    substeps = first
    while True:
        try:
            tried.append(_solved(prepare({**solver, "substeps": substeps}), exact))
        except SolverFailure as failure:
            tried.append({"error": math.inf, "substeps": substeps, "seconds": 0.0, "failed": str(failure)})
        last, substeps = tried[-1], 2 * substeps
        if last["error"] <= ACCURACY or substeps > MOST_SUBSTEPS or last["seconds"] > MOST_SECONDS:
            return {**last, "reached": last["error"] <= ACCURACY, "tried": tried}


def _solved(simulation: Simulation, exact: Sequence[Floats]) -> dict[str, Any]:
    """Seconds of a whole motion, without building and compiling, and its error."""
    simulation.compile()
    start, mass = simulation.world.x0, simulation.disc.mass
    rows, error, moved = [], 0.0, 0.0
    began = time.perf_counter()
    for frame in simulation.frames():
        if frame.index > 0:
            rows.append(frame.row)
            error += _square(mass, frame.state.x - exact[frame.index - 1])
            moved += _square(mass, exact[frame.index - 1] - start)
    substeps = float(np.mean([row["substeps"] for row in rows]))
    seconds = sum(row["seconds"] for row in rows)
    return {
        "error": math.sqrt(error / moved),
        "estimated": rows[-1].get("estimated_error"),
        "substeps": substeps,
        "seconds": seconds,
        "seconds_per_frame": seconds / len(rows),
        "seconds_with_error": time.perf_counter() - began,
    }


def _square(mass: Floats, u: Floats) -> float:
    return float(mass @ np.einsum("ij,ij->i", u, u))
