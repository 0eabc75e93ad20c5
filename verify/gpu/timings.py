# SPDX-License-Identifier: BSD-3-Clause
"""How fast the CUDA backend is: passes against the bandwidth of a copy, substeps and frames, launches, memory.

Times are medians of REPEATS after a warm-up, from events of the device where there are such, else from the clock after
waiting. Bytes are those that a pass has to move: its own arrays once, its slots written and read, the vectors once.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import numpy as np

from femgal.hierarchy.layer import Layer
from femgal.scene.build import World, build_world
from femgal.scene.load import load_scene
from femgal.simulation import Simulation
from verify.gpu.scenes import expected_bytes

REPEATS = 7

# [L] drapes its bunny with 44 K, 200 K and 1.19 M vertices; with the last, solvers that wait for the host are left out.
SIZES = (44_000, 200_000, 1_190_000)
LARGE = 1_000_000

SOLVERS: dict[str, dict[str, object]] = {
    "fas, fresh blocks": {"name": "fas", "substeps": 400, "steps": "spectral", "blocks": "fresh"},
    "fas, kept blocks": {"name": "fas", "substeps": 400, "steps": "spectral"},
    "verlet": {"name": "verlet"},
    "fas, exact steps": {"name": "fas", "substeps": 50},
    "jacobi": {"name": "jacobi", "substeps": 400, "steps": "spectral", "blocks": "fresh"},
    "vbd": {"name": "vbd", "substeps": 100},
    "newton-multigrid": {"name": "newton-multigrid", "substeps": 4},
}
OF_LARGE = ("fas, fresh blocks", "fas, kept blocks", "verlet")


@cache
def world(scene: str, vertices: int) -> World:
    """The bodies of a scene; they take longer to make than to simulate, so those of the last scenes are kept."""
    return build_world(load_scene(scene, vertices=vertices))


def prepare(scene: str, vertices: int, precision: str, solver: Mapping[str, object], frames: int) -> Simulation:
    """A scene on the device; `vertices` of each body."""
    settings = {f"solver.{key}": value for key, value in solver.items()}
    overrides = settings | {"solver.device": "cuda", "solver.precision": precision}
    found = load_scene(scene, vertices=vertices, frames=frames, overrides=overrides)
    return Simulation.assemble(found, world(scene, vertices))


def seconds(backend: Any, work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Median time on the device of some launches."""
    from femgal.kernels.cuda.jit import SIMULATED, cuda

    found, stream = [], backend.stream
    work()
    stream.wait()
    for _ in range(repeats):
        first, last = cuda.event(), cuda.event()
        began = time.perf_counter()
        first.record(stream.handle)
        work()
        last.record(stream.handle)
        stream.wait()
        found.append(time.perf_counter() - began if SIMULATED else 1e-3 * cuda.event_elapsed_time(first, last))
    return statistics.median(found)


def copy_bandwidth(backend: Any, rows: int) -> float:
    """Bytes per second, read and written, of a copy of so many rows."""
    from femgal.kernels.cuda import nodes

    x, y = backend.zeros(rows), backend.zeros(rows)
    return 2 * 24 * rows / seconds(backend, lambda: backend.stream.over_rows(nodes.copy_rows, rows, x, y))


def passes(backend: Any, layers: tuple[Layer, ...]) -> list[dict[str, Any]]:
    """Time and bytes of the passes of each layer."""
    rows = []
    x = backend.to_device(backend.disc.mesh.points.copy())
    xhat, d = backend.copy(x), backend.copy(x)
    for layer in layers:
        work: dict[str, tuple[int, int, Callable[[], object]]] = {
            "terms": (9, 5, partial(backend.correction, layer, x, xhat, 1e4)),
            "forces": (3, 4, partial(backend.nodal_gradient, layer, x, xhat, 1e4)),
            "product": (3, 4, partial(backend.nodal_product, layer, x, d, 1e4)),
        }
        for name, (width, vectors, call) in work.items():
            taken, moved = seconds(backend, call), pass_bytes(backend, layer, width, vectors)
            row = {"layer": layer.name, "pass": name, "seconds": taken, "bytes": moved, "bandwidth": moved / taken}
            rows.append(row | {"tets": len(layer.active), "tets_per_second": len(layer.active) / taken})
    return rows


def pass_bytes(backend: Any, layer: Layer, width: int, vectors: int) -> int:
    """Bytes that a pass has to move at the least."""
    one = backend._layer(layer)
    own = sum(int(array.nbytes) for array in (*one.blocks.arrays, *one.targets, one.slot, one.slot_ptr))
    slots = 2 * width * np.dtype(backend.precision).itemsize * one.n_slots
    gathered = 2 * 24 * int(one.blocks.arrays[1].shape[0])
    return own + slots + gathered + 24 * vectors * layer.n_nodes


def frames(simulation: Simulation, number: int) -> dict[str, Any]:
    """Seconds per frame after the first, per substep, and how the substeps were launched."""
    backend, stepper = simulation.backend, simulation.stepper
    simulation.compile()
    rows = [frame.row for frame, _ in zip(simulation.frames(), range(number + 2), strict=False)][2:]
    taken = statistics.median(row["seconds"] for row in rows)
    stream, own = getattr(backend, "stream"), getattr(backend, "pool")  # noqa: B009 - those of CUDA only
    return {
        "seconds_per_frame": taken,
        "substeps": rows[-1]["substeps"],
        "seconds_per_substep": taken / max(1, rows[-1]["substeps"]),
        "passes": rows[-1]["passes"],
        "waits": stream.waits,
        "launches": stream.launches,
        "repeated": getattr(stepper, "repeated", 0),
        "graphs": getattr(stepper, "graphs", False),
        "bytes_of_arrays": own.nbytes,
        "bytes_expected": expected_bytes(simulation),
    }


def launch_overhead(simulation: Simulation) -> dict[str, float]:
    """Seconds of the host per substep: with the solver's Python, and repeated."""
    stepper: Any = simulation.stepper
    state, substeps = stepper.begin_frame(simulation.start(), simulation.frame_duration)
    h, stream = simulation.frame_duration / substeps, simulation.backend.stream  # type: ignore[attr-defined]
    found = {}
    for name, take in {"plain": stepper.stepper.step, "repeated": stepper.step}.items():
        after = take(take(take(state, h), h), h)
        stream.wait()
        began = time.perf_counter()
        for _ in range(REPEATS):
            after = take(after, h)
        found[name] = (time.perf_counter() - began) / REPEATS
        stream.wait()
        found[f"{name}, done"] = (time.perf_counter() - began) / REPEATS
    return found
