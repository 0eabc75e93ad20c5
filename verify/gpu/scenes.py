# SPDX-License-Identifier: BSD-3-Clause
"""Whole scenes with both devices, on a GPU or in the simulator.

`python -m verify.gpu.scenes SOLVER PRECISION FRAMES PATH [VERTICES]` prints how they differ as JSON; SOLVER is the
table of a scene file, PATH a line of its constraint or nothing.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np

from femgal.device_memory import array_bytes
from femgal.runner import run
from femgal.scene.load import parse_scene
from femgal.simulation import Simulation
from femgal.timestep.control import AccuracyControl

BEAM = """
frames = {frames}
damping = 0.5

[[bodies]]
mesh = "beam"
vertices = {vertices}
E = 1e5
nu = 0.4
rho = 1000.0
velocity = [0.0, 0.0, -1.0]

[[constraints]]
where = {{halfspace = {{point = [0.1, 0.5, 0.5], normal = [-1, 0, 0]}}, relative = true}}
{path}
{solver}
device = "{device}"
precision = "{precision}"

[output]
fields = ["displacement", "velocity", "von_mises"]
"""


def compare(solver: str, precision: str, frames: int, path: str = "", vertices: int = 60) -> dict[str, Any]:
    """How far the two motions are apart, in units of the motion and of its largest energy, and what they took."""
    results = {}
    for device in ("cpu", "cuda"):
        table = {"solver": solver, "precision": precision, "frames": frames, "path": path, "vertices": vertices}
        results[device] = run(parse_scene(BEAM.format(device=device, **table), "beam.toml"))
    cpu, cuda = results["cpu"], results["cuda"]
    moved = max(float(np.abs(u).max()) for u in cpu.displacements)
    worst = max(float(np.abs(a - b).max()) for a, b in zip(cpu.displacements, cuda.displacements, strict=True))
    scale = max(row["kinetic_energy"] + row["elastic_energy"] for row in cpu.rows)
    energies = [abs(a[k] - b[k]) for a, b in zip(cpu.rows, cuda.rows, strict=True) for k in a if k.endswith("energy")]
    backend: Any = cuda.simulation.backend
    stepper: Any = cuda.simulation.stepper
    if isinstance(stepper, AccuracyControl):
        stepper = stepper.stepper
    return {
        "status": [cpu.status, cuda.status],
        "moved": moved,
        "positions": worst / moved,
        "energies": max(energies) / scale,
        "substeps": [[row["substeps"] for row in result.rows] for result in (cpu, cuda)],
        "passes": [[row["passes"] for row in result.rows] for result in (cpu, cuda)],
        "estimated_error": [result.estimated_error or 0.0 for result in (cpu, cuda)],
        "waits": backend.stream.waits,
        "bytes": [backend.pool.nbytes, expected_bytes(cuda.simulation)],
        "repeated": stepper.repeated,
        "graphs": stepper.graphs,
    }


def expected_bytes(simulation: Simulation) -> int:
    """What the arrays of a simulation were expected to take on the device."""
    layers = simulation.hierarchy.layers if simulation.hierarchy else ()
    return array_bytes(simulation.scene.solver, simulation.disc, layers)


if __name__ == "__main__":
    _, table, precision, frames, path, *vertices = sys.argv
    print(json.dumps(compare(table, precision, int(frames), path, *(int(n) for n in vertices))))
