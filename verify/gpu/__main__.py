# SPDX-License-Identifier: BSD-3-Clause
"""`python -m verify.gpu FILE [SECONDS]`: everything about the CUDA backend that a machine with a GPU can tell, as JSON.

With `--toy` at sizes for the simulator. Every figure is written as soon as it is there, and one that fails says so and
does not stop the others. After SECONDS nothing is begun any more; the same command then goes on.
"""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any

from femgal.kernels.backend import Precision
from femgal.kernels.cuda.device import find_devices, require_device
from femgal.output.environment import describe_environment
from femgal.scene.load import load_scene
from meshes.errors import InputError
from verify.gpu import one_percent, passes, scenes, timings
from verify.gpu.journal import Journal, Task
from verify.gpu.table1 import TABLE_1

# Ends with this when some figures are still missing.
NOT_YET = 3

SOLVERS = {
    "fas, spectral": '[solver]\nname = "fas"\nsubsteps = 10\nratio = 8\nsteps = "spectral"',
    "fas, exact": '[solver]\nname = "fas"\nsubsteps = 5\nratio = 8',
    "fas, linear": '[solver]\nname = "fas"\ntransfer = "linear"\nsubsteps = 5\nstepping = "bdf2"\ncycle = "V"',
    "jacobi": '[solver]\nname = "jacobi"\nsubsteps = 10\niterations = 3\nchebyshev = "auto"',
    "verlet": '[solver]\nname = "verlet"',
    "verlet, accuracy": '[solver]\nname = "verlet"\naccuracy = 0.01',
    "vbd": '[solver]\nname = "vbd"\nsubsteps = 10',
    # Cycles in single and in double precision take different paths to the solution: solve far enough to meet there.
    "newton-multigrid": '[solver]\nname = "newton-multigrid"\nsubsteps = 2\nreduction = 1e-9',
    "newton-multigrid, layers": '[solver]\nname = "newton-multigrid"\nsubsteps = 2\npreconditioner = "layers"',
}
PRECISIONS: tuple[Precision, ...] = ("float64", "float32")
CHECKS = ("memcheck", "racecheck", "synccheck", "initcheck")


def environment(toy: bool) -> dict[str, Any]:
    """What it is measured on."""
    from femgal.kernels.cuda.graphs import why_no_graphs

    found = {**describe_environment(), "cuda": asdict(find_devices()), "no_graphs": why_no_graphs()}
    return {**found, "size": "toy" if toy else "full"}


def tasks(toy: bool) -> Iterator[Task]:
    """All that is to be done, what matters most first."""
    shape, frames, vertices = ((3, 2, 2), 1, 40) if toy else ((40, 20, 20), 10, 4000)
    precisions = PRECISIONS[:1] if toy else PRECISIONS
    for precision in precisions:
        yield "passes", precision, partial(passes.differences, precision, 0.25, rare=not toy, shape=shape)
    yield from speed(toy)
    for precision in precisions:
        for name, solver in list(SOLVERS.items())[: 1 if toy else None]:
            compare = partial(scenes.compare, solver, precision, frames, "", vertices)
            yield "scenes", f"{name}, {precision}", compare
    for name, row in list(TABLE_1.items())[: 1 if toy else None]:
        n, given = (40, {**row.solver, "substeps": 4}) if toy else (row.vertices // row.bodies, row.solver)
        yield "table 1", name, partial(_timed, _named(row.scene, toy), n, row.precision, given, toy)
    yield from to_one_percent(toy)
    yield from sanitizer(toy)
    yield "registers", "all", partial(registers, toy)


def speed(toy: bool) -> Iterator[Task]:
    """Frames of the drape, passes and launches."""
    for vertices in (60,) if toy else timings.SIZES:
        large = vertices > timings.LARGE
        for precision in ("float32",) if toy else ("float32", "float64"):
            for name, solver in list(timings.SOLVERS.items())[: 1 if toy else None]:
                if large and (name not in timings.OF_LARGE or precision == "float64"):
                    continue
                given = {**solver, "substeps": 4} if toy else solver
                work = partial(_timed, _named("bunny-drape", toy), vertices, precision, given, toy)
                yield "speed", f"{vertices}, {precision}, {name}", work


def to_one_percent(toy: bool) -> Iterator[Task]:
    """Whole motions of the drape with an error of one percent."""
    vertices, frames = (40, 1) if toy else (44_000, 60)
    prepare = partial(_prepare, _named("bunny-drape", toy), vertices, frames)
    exact = cache(partial(one_percent.reference, prepare))
    for name, solver in list(one_percent.CONTROLLED.items())[: 1 if toy else None]:
        yield "one percent", name, partial(_against, one_percent.controlled, prepare, solver, exact)
    for name, solver in {} if toy else one_percent.FIXED.items():
        yield "one percent", name, partial(_against, one_percent.fixed, prepare, solver, exact)


def _prepare(scene: str, vertices: int, frames: int, solver: Mapping[str, object]) -> Any:
    return timings.prepare(scene, vertices, "float64", solver, frames)


def _against(run: Any, prepare: Any, solver: Mapping[str, object], exact: Any) -> dict[str, Any]:
    """A solver against the reference, which is made when the first one needs it."""
    return run(prepare, solver, exact())


def _timed(scene: str, vertices: int, precision: str, solver: Mapping[str, object], toy: bool) -> dict[str, Any]:
    """Frames of one scene with one solver, its passes, its launches and its memory."""
    simulation = timings.prepare(scene, vertices, precision, solver, 2 if toy else 6)
    backend, layers = simulation.backend, simulation.hierarchy.layers if simulation.hierarchy else ()
    row: dict[str, Any] = {"vertices": simulation.disc.n_vertices, "tets": simulation.disc.n_tets}
    row |= {"precision": precision, "scene": scene, "frames": timings.frames(simulation, 1 if toy else 4)}
    if layers:
        row["copy_bandwidth"] = timings.copy_bandwidth(backend, 100 if toy else 10_000_000)
        row["passes"] = timings.passes(backend, layers[:1] if toy else layers)
        row["launch_overhead"] = timings.launch_overhead(simulation)
    return row


@cache
def _named(scene: str, toy: bool) -> str:
    """The scene, or the one with the rabbit where there is no bunny; it needs no file."""
    try:
        load_scene(scene)
    except InputError:
        return "rabbit-drape"
    return "rabbit-drape" if toy else scene


def sanitizer(toy: bool) -> Iterator[Task]:
    """compute-sanitizer over the passes, where it is installed."""
    tool = shutil.which("compute-sanitizer")
    if toy or tool is None:
        reason = "toy size" if toy else "compute-sanitizer is not installed"
        yield "sanitizer", "all", lambda: {"not_run": reason}
        return
    for check in CHECKS:
        yield "sanitizer", check, partial(_checked, tool, check)


def _checked(tool: str, check: str) -> dict[str, Any]:
    command = [tool, "--tool", check, "--error-exitcode", "9", sys.executable, "-m", "verify.gpu.passes"]
    done = subprocess.run([*command, "float32", "0.25", "rare"], capture_output=True, text=True)
    return {"exit_code": done.returncode, "summary": done.stdout.splitlines()[-3:]}


def registers(toy: bool) -> dict[str, Any]:
    """Registers and spills of every kernel."""
    from femgal.kernels.cuda.offline import compile_all, find_ptxas

    if toy or find_ptxas() is None:
        return {"not_run": "the simulator compiles nothing" if toy else "ptxas is not installed"}
    kept = ("name", "precision", "registers", "stack", "spills")
    return {"kernels": [{key: getattr(one, key) for key in kept} for one in compile_all()]}


def main(file: Path, seconds: float, toy: bool) -> int:
    """Do what is left; 1 when something failed, NOT_YET when there was no time for all."""
    require_device()
    journal = Journal(file, environment(toy))
    if not journal.work_through(tasks(toy), seconds):
        print(f"no time left after {seconds:g} s: the same command goes on")
        return NOT_YET
    for failure in journal.failures:
        print("failed:", failure)
    return int(bool(journal.failures))


if __name__ == "__main__":
    given = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
    sys.exit(main(Path(given[0]), float(given[1]) if len(given) > 1 else math.inf, "--toy" in sys.argv))
