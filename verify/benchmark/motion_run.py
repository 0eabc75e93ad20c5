# SPDX-License-Identifier: BSD-3-Clause
"""One motion in a process of its own, so that its time, its compilation and its memory are its own.

``python -m verify.benchmark.motion_run SCENE.toml OUT`` writes OUT.npz (masses and displacements) and OUT.json.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from femgal.failure import SolverFailure
from femgal.hierarchy.layer import free_parts
from femgal.scene.load import load_scene
from femgal.simulation import Simulation
from verify.benchmark.trajectory import momenta


class _Stages:
    """Wall and CPU time [s] of what is announced, one after the other."""

    def __init__(self) -> None:
        self.seconds: dict[str, tuple[float, float]] = {}
        self._doing: str | None = None
        self._since = (0.0, 0.0)

    def __call__(self, text: str | None) -> None:
        now = (time.perf_counter(), time.process_time())
        if self._doing is not None:
            wall, cpu = self._since
            self.seconds[self._doing] = (now[0] - wall, now[1] - cpu)
        self._doing, self._since = text, now


def run_motion(scene_file: Path, out: Path) -> None:
    """Run a scene, and write its displacements (float32, from positions in double precision) and its numbers."""
    stages = _Stages()
    simulation = Simulation.prepare(load_scene(scene_file), stages)
    stages("compiling and estimating")
    simulation.compile()
    stages(None)
    X, moved, rows, failure = simulation.disc.mesh.points, [], [], None
    try:
        for frame in simulation.frames():
            moved.append((frame.state.x - X).astype(np.float32))
            rows.append(frame.row | momenta(simulation.disc.mass, frame.state.x, frame.state.v))
    except SolverFailure as error:
        failure = str(error)
    # The first entry is the start, which may be deformed: what counts is the motion since.
    displacement = np.stack(moved[1:]) - moved[0] if len(moved) > 1 else np.empty((0, *X.shape), np.float32)
    np.savez(out.with_suffix(".npz"), mass=simulation.disc.mass, displacement=displacement)
    numbers: dict[str, Any] = {
        "vertices": simulation.disc.n_vertices,
        "tets": simulation.disc.n_tets,
        "free": free_parts(simulation.disc) is not None,
        "stages": stages.seconds,
        "rows": rows[1:],
        "start": rows[0],
        "failure": failure,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "threads": simulation.backend.threads,
    }
    # Written last and at once: where it is, the run is complete.
    part = out.with_suffix(".part")
    part.write_text(json.dumps(numbers))
    part.replace(out.with_suffix(".json"))


if __name__ == "__main__":
    run_motion(Path(sys.argv[1]), Path(sys.argv[2]))
