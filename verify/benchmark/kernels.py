# SPDX-License-Identifier: BSD-3-Clause
"""`femgal bench kernels`: how fast the passes are here, and how far from what the memory allows."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from femgal.kernels.cpu.threads import Workers
from meshes.errors import InputError
from meshes.make import make_tets
from meshes.types import TetMesh
from verify.benchmark.body import BenchmarkBody, benchmark_body, few_tets, kuhn_box
from verify.benchmark.kernel_report import FirstCall, KernelReport, PassResult, StreamResult
from verify.benchmark.machine import describe_machine
from verify.benchmark.memory import require_memory
from verify.benchmark.passes import VARIANTS, Pass, all_passes, make_backend
from verify.benchmark.stream import DEFAULT_MEGABYTES, Stream
from verify.benchmark.timing import Call, Timing, interleaved, timed

Announce = Callable[[str], None]

# 1.23 million tetrahedra.
DEFAULT_CELLS = 59
# A median of fewer rounds says little.
FEWEST_REPEATS = 7

# Peak use per tetrahedron [bytes] of one backend, and of the mesh with its hierarchy; measured, rounded up.
_BACKEND_BYTES, _MESH_BYTES = 400.0, 400.0

_LAUNCHES = 50


@dataclass(frozen=True)
class KernelSettings:
    """How to measure.

    Parameters
    ----------
    threads : Numbers of threads.
    variants : Some of `verify.benchmark.passes.VARIANTS`.
    repeats : Rounds, `FEWEST_REPEATS` or more.
    stream_mb : Size of each array of STREAM [10^6 bytes].
    """

    threads: tuple[int, ...] = (1,)
    variants: tuple[str, ...] = VARIANTS
    repeats: int = FEWEST_REPEATS
    stream_mb: float = DEFAULT_MEGABYTES

    def __post_init__(self) -> None:
        processors = len(os.sched_getaffinity(0))
        _check_each(self.threads, range(1, processors + 1), "--threads", f"1 to {processors}, separated by commas")
        _check_each(self.variants, VARIANTS, "--precision", ", ".join(VARIANTS))
        if self.repeats < FEWEST_REPEATS:
            raise InputError(
                "too few rounds", where="--repeats", found=self.repeats, allowed=f"{FEWEST_REPEATS} or more"
            )
        if not 0.0 < self.stream_mb < 1e9:
            raise InputError(
                "impossible size of an array", where="--stream-mb", found=self.stream_mb, allowed="0 < MB < 1e9"
            )


def bench_kernels(
    settings: KernelSettings,
    *,
    mesh: str | None = None,
    vertices: int | None = None,
    cells: int = DEFAULT_CELLS,
    announce: Announce = lambda text: None,
) -> KernelReport:
    """Time all passes, and STREAM in the same rounds.

    Parameters
    ----------
    mesh, vertices : As in `meshes.make.make_tets`; without a mesh a jittered Kuhn box is taken.
    cells : Grid cells along each axis of the box.
    announce : Called with what is being done now.

    Raises
    ------
    InputError
        A mesh that cannot be made, or more than fits into memory.
    """
    announce("building the mesh")
    tets = _mesh(settings, mesh, vertices, cells)
    machine = describe_machine()
    announce("building the hierarchy")
    body = benchmark_body(tets)
    announce("compiling or loading the kernels")
    first_calls = [call for variant in settings.variants for call in _first_calls(variant, settings.repeats)]
    passes = _passes(settings, body)
    stream = Stream(settings.stream_mb)
    candidates: dict[Any, Call] = {threads: _triad(stream, threads) for threads in settings.threads}
    candidates |= {key: entry.call for key, entry in passes.items()}
    timings = interleaved(
        candidates, settings.repeats, on_round=lambda k: announce(f"measuring, round {k + 1} of {settings.repeats}")
    )
    return KernelReport(
        machine,
        _describe(body),
        asdict(settings),
        tuple(StreamResult(threads, stream.bytes_moved, timings[threads]) for threads in settings.threads),
        tuple(first_calls),
        tuple(_result(key, entry, timings[key]) for key, entry in passes.items()),
    )


def _mesh(settings: KernelSettings, mesh: str | None, vertices: int | None, cells: int) -> TetMesh:
    if mesh is None:
        _require(settings, 6 * cells**3, "--cells")
        return kuhn_box(cells)
    made = make_tets(mesh, vertices).mesh
    _require(settings, len(made.cells), "--mesh")
    return made


def _require(settings: KernelSettings, n_tets: int, where: str) -> None:
    per_tet = _MESH_BYTES + _BACKEND_BYTES * len(settings.threads) * len(settings.variants)
    needed = 3e6 * settings.stream_mb + per_tet * n_tets
    advice = "a smaller mesh, a smaller --stream-mb, fewer --threads or --precision"
    require_memory(needed, f"STREAM and {n_tets} tetrahedra", where=where, advice=advice)


def _first_calls(variant: str, repeats: int) -> list[FirstCall]:
    body = few_tets()
    backend = make_backend(variant, body, 1)
    passes = all_passes(backend, body)
    first = {entry.name: timed(entry.call) for entry in passes}
    launches = interleaved({entry.name: entry.call for entry in passes}, repeats, calls=_LAUNCHES)
    return [FirstCall(name, variant, *first[name], launches[name]) for name in first]


def _passes(settings: KernelSettings, body: BenchmarkBody) -> dict[tuple[str, str, int], Pass]:
    """Passes by name, variant and threads."""
    found: dict[tuple[str, str, int], Pass] = {}
    for variant in settings.variants:
        for threads in settings.threads:
            backend = make_backend(variant, body, threads)
            found |= {(entry.name, variant, threads): entry for entry in all_passes(backend, body)}
    return found


def _triad(stream: Stream, threads: int) -> Call:
    workers = Workers(threads)
    return lambda: stream.run(workers)


def _result(key: tuple[str, str, int], entry: Pass, timing: Timing) -> PassResult:
    name, variant, threads = key
    return PassResult(name, variant, threads, entry.tets, entry.bytes_per_tet, timing)


def _describe(body: BenchmarkBody) -> dict[str, Any]:
    mesh = body.disc.mesh
    return {
        "name": mesh.origin.name,
        "source": mesh.origin.source,
        "content_hash": mesh.content_hash,
        "vertices": body.disc.n_vertices,
        "tets": body.disc.n_tets,
        "layers": [
            {"name": layer.name, "nodes": layer.n_nodes, "active_tets": len(layer.active)}
            for layer in body.hierarchy.layers
        ],
    }


def _check_each(values: Sequence[object], allowed: Sequence[object], where: str, what: str) -> None:
    wrong = [value for value in values if value not in allowed]
    if wrong or not values or len(set(values)) < len(values):
        found = ", ".join(map(str, values)) or "nothing"
        raise InputError("cannot be measured", where=where, found=found, allowed=f"each once: {what}")
