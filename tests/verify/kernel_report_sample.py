# SPDX-License-Identifier: BSD-3-Clause
"""A report of kernels with numbers that can be followed by hand."""

from __future__ import annotations

from verify.benchmark.kernel_report import FirstCall, KernelReport, PassResult, StreamResult
from verify.benchmark.passes import BLOCKS, GRADIENT, SUBSTEPS
from verify.benchmark.timing import Timing

MACHINE = {
    "cpu": "Abacus",
    "compiled_for": "beads",
    "processors": 2,
    "last_level_cache": 2**20,
    "transparent_huge_pages": None,
    "load_before": 0.25,
    "python": "3.11",
    "numpy": "2",
    "numba": "0.6",
}
MESH = {
    "name": "box",
    "source": "generated",
    "content_hash": "0",
    "vertices": 200,
    "tets": 1000,
    "layers": [
        {"name": "vertices", "nodes": 200, "active_tets": 1000},
        {"name": "clusters of 32", "nodes": 6, "active_tets": 700},
    ],
}


def same(wall: float, cpu: float, rounds: int = 3) -> Timing:
    """Every round the same [s]."""
    return Timing((wall,) * rounds, (cpu,) * rounds)


def sample_report() -> KernelReport:
    """1000 tets; STREAM moves 24 MB in 2 ms on one thread and in 1 ms on two.

    On one thread a gradient takes 0.5 ms, gradient + blocks 1, 2 and 4 ms in its rounds, a substep three times that.
    On two threads gradient + blocks takes 1 ms and 2 ms of CPU time.
    """
    blocks = Timing((1e-3, 2e-3, 4e-3), (1e-3, 1.5e-3, 1e-3))
    substep = Timing(tuple(3.0 * wall for wall in blocks.wall), (3e-3,) * 3)
    return KernelReport(
        MACHINE,
        MESH,
        {"repeats": 3, "threads": (1, 2), "variants": ("float32", "plain"), "stream_mb": 8.0},
        (
            StreamResult(1, 24_000_000, Timing((2e-3, 3e-3, 4e-3), (1.5e-3, 2e-3, 2e-3))),
            StreamResult(2, 24_000_000, Timing((1e-3, 1e-3, 2e-3), (2e-3, 2e-3, 2e-3))),
        ),
        (FirstCall(GRADIENT, "float32", 1.25, 0.75, same(15e-6, 15e-6)),),
        (
            PassResult(GRADIENT, "float32", 1, 1000, 60.0, same(0.5e-3, 0.5e-3)),
            PassResult(BLOCKS, "float32", 1, 1000, 80.0, blocks),
            PassResult(BLOCKS, "float32", 2, 1000, 80.0, same(1e-3, 2e-3)),
            PassResult(next(iter(SUBSTEPS)), "float32", 1, 1000, None, substep),
            PassResult(BLOCKS, "plain", 2, 1000, 150.0, same(8e-3, 16e-3)),
        ),
    )
