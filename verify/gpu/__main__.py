# SPDX-License-Identifier: BSD-3-Clause
"""`python -m verify.gpu FILE`: everything about the CUDA backend that a machine with a GPU can tell, as JSON.

With `--toy` at sizes for the simulator. Every part is written as soon as it is done; one that fails says so and does
not stop the others.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from femgal.kernels.backend import Precision
from femgal.kernels.cuda.device import find_devices, require_device
from femgal.output.environment import describe_environment
from verify.gpu import passes, scenes, timings

SOLVERS = {
    "fas, spectral": '[solver]\nname = "fas"\nsubsteps = 10\nratio = 8\nsteps = "spectral"',
    "fas, exact": '[solver]\nname = "fas"\nsubsteps = 5\nratio = 8',
    "fas, linear": '[solver]\nname = "fas"\ntransfer = "linear"\nsubsteps = 5\nstepping = "bdf2"\ncycle = "V"',
    "jacobi": '[solver]\nname = "jacobi"\nsubsteps = 10\niterations = 3\nchebyshev = "auto"',
    "verlet": '[solver]\nname = "verlet"',
    "vbd": '[solver]\nname = "vbd"\nsubsteps = 10',
    "newton-multigrid": '[solver]\nname = "newton-multigrid"\nsubsteps = 2',
    "newton-multigrid, layers": '[solver]\nname = "newton-multigrid"\nsubsteps = 2\npreconditioner = "layers"',
}


def environment() -> dict[str, Any]:
    """What it was measured on."""
    from femgal.kernels.cuda.graphs import why_no_graphs

    return {**describe_environment(), "cuda": asdict(find_devices()), "no_graphs": why_no_graphs()}


def correctness(toy: bool) -> dict[str, Any]:
    """Every pass and whole scenes against the CPU."""
    shape, frames, vertices = ((3, 2, 2), 1, 40) if toy else ((40, 20, 20), 10, 4000)
    found: dict[str, Any] = {"passes": {}, "scenes": {}}
    precisions: tuple[Precision, ...] = ("float64",) if toy else ("float64", "float32")
    for precision in precisions:
        found["passes"][precision] = passes.differences(precision, 0.25, rare=not toy, shape=shape)
        for name, solver in list(SOLVERS.items())[: 1 if toy else None]:
            found["scenes"][f"{name}, {precision}"] = scenes.compare(solver, precision, frames, "", vertices)
    return found


def speed(toy: bool) -> dict[str, Any]:
    """Bandwidth, passes, frames, launches."""
    found: dict[str, Any] = {"bunny drape": []}
    for vertices in (60,) if toy else timings.SIZES:
        for precision in ("float32",) if toy else ("float32", "float64"):
            for name, solver in list(timings.SOLVERS.items())[: 1 if toy else None]:
                small = {**solver, "substeps": 4} if toy else solver
                found["bunny drape"].append(_one(vertices, precision, name, small, toy))
    return found


def _one(vertices: int, precision: str, name: str, solver: dict[str, object], toy: bool) -> dict[str, Any]:
    """One scene with one solver; one that fails says why."""
    row: dict[str, Any] = {"vertices": vertices, "precision": precision, "solver": name}
    try:
        scene = "rabbit-drape" if toy else "bunny-drape"
        simulation = timings.prepare(scene, vertices, precision, solver, 2 if toy else 6)
        backend, layers = simulation.backend, simulation.hierarchy.layers if simulation.hierarchy else ()
        row |= {"tets": simulation.disc.n_tets, "frames": timings.frames(simulation, 0 if toy else 4)}
        if layers:
            row["copy_bandwidth"] = timings.copy_bandwidth(backend, 100 if toy else 10_000_000)
            row["passes"] = timings.passes(backend, layers[:1] if toy else layers)
            row["launch_overhead"] = timings.launch_overhead(simulation)
    except Exception:
        row["failure"] = traceback.format_exc()
    return row


def sanitizer(toy: bool) -> dict[str, Any]:
    """compute-sanitizer over the passes, where it is installed."""
    tool = shutil.which("compute-sanitizer")
    if toy or tool is None:
        return {"not_run": "toy size" if toy else "compute-sanitizer is not installed"}
    found = {}
    for check in ("memcheck", "racecheck", "synccheck", "initcheck"):
        command = [tool, "--tool", check, "--error-exitcode", "9", sys.executable, "-m", "verify.gpu.passes"]
        done = subprocess.run([*command, "float32", "0.25", "rare"], capture_output=True, text=True)
        found[check] = {"exit_code": done.returncode, "summary": done.stdout.splitlines()[-3:]}
    return found


def registers(toy: bool) -> list[dict[str, Any]] | dict[str, str]:
    """Registers and spills of every kernel."""
    if toy:
        return {"not_run": "the simulator compiles nothing"}
    from femgal.kernels.cuda.offline import compile_all

    kept = ("name", "precision", "registers", "stack", "spills")
    return [{key: getattr(one, key) for key in kept} for one in compile_all()]


PARTS: dict[str, Callable[[bool], Any]] = {
    "correctness": correctness,
    "registers": registers,
    "sanitizer": sanitizer,
    "speed": speed,
}


def main(file: Path, toy: bool) -> int:
    """Run all parts; 1 when one of them failed."""
    require_device()
    found: dict[str, Any] = {"environment": environment()}
    failed = False
    for name, part in PARTS.items():
        began = time.perf_counter()
        print(f"{name} ...", flush=True)
        try:
            found[name] = part(toy)
        except Exception:
            found[name], failed = {"failure": traceback.format_exc()}, True
        found.setdefault("seconds", {})[name] = time.perf_counter() - began
        file.write_text(json.dumps(found, indent=1, default=str), encoding="utf-8")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), "--toy" in sys.argv))
