# SPDX-License-Identifier: BSD-3-Clause
"""In the simulator: whole scenes with both devices; prints how they differ as JSON."""

from __future__ import annotations

import json
import sys

import numpy as np

from femgal.runner import run
from femgal.scene.load import parse_scene

BEAM = """
frames = {frames}
damping = 0.5

[[bodies]]
mesh = "beam"
vertices = 60
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


def main(solver: str, precision: str, frames: str, path: str) -> None:
    results = {}
    for device in ("cpu", "cuda"):
        text = BEAM.format(solver=solver, device=device, precision=precision, frames=frames, path=path)
        results[device] = run(parse_scene(text, "beam.toml"))
    cpu, cuda = results["cpu"], results["cuda"]
    moved = np.abs(cpu.displacements[-1]).max()
    worst = max(np.abs(a - b).max() for a, b in zip(cpu.displacements, cuda.displacements, strict=True))
    scale = max(row["kinetic_energy"] + row["elastic_energy"] for row in cpu.rows)
    energies = [abs(a[k] - b[k]) for a, b in zip(cpu.rows, cuda.rows, strict=True) for k in a if k.endswith("energy")]
    stream = cuda.simulation.backend.stream
    print(
        json.dumps(
            {
                "status": [cpu.status, cuda.status],
                "moved": float(moved),
                "positions": float(worst / moved),
                "energies": float(max(energies) / scale),
                "substeps": [[row["substeps"] for row in result.rows] for result in (cpu, cuda)],
                "passes": [[row["passes"] for row in result.rows] for result in (cpu, cuda)],
                "waits": stream.waits,
            }
        )
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
