# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark of the passes as a whole, on meshes of no interest.

1. Every pass of every variant is measured on every number of threads, as many rounds as asked for, and STREAM with it.
2. First calls are there for every variant; the report says on which mesh, machine and settings.
3. A mesh by name works as well as the box.
4. Settings that cannot be are refused, and so is what does not fit into memory, before anything is built.
"""

from __future__ import annotations

import os

import pytest

from meshes.errors import InputError
from verify.benchmark.kernels import KernelSettings, bench_kernels
from verify.benchmark.passes import BLOCKS, GRADIENT, VARIANTS

PROCESSORS = len(os.sched_getaffinity(0))
THREADS = tuple(sorted({1, PROCESSORS}))


def test_everything_is_measured():
    said: list[str] = []
    report = bench_kernels(KernelSettings(THREADS, stream_mb=0.5), cells=4, announce=said.append)
    measured = [(result.name, result.variant, result.threads) for result in report.passes]
    assert len(set(measured)) == len(measured)
    for variant in VARIANTS:
        names = {name for name, v, _ in measured if v == variant}
        assert {GRADIENT, BLOCKS} <= names
        assert {(name, variant, threads) for name in names for threads in THREADS} <= set(measured)
        assert {call.name for call in report.first_calls if call.variant == variant} >= names
    timings = [result.timing for result in (*report.passes, *report.stream)]
    assert {len(timing.wall) for timing in timings} == {7}
    assert all(min(timing.wall) > 0.0 for timing in timings)
    assert [result.threads for result in report.stream] == list(THREADS)
    assert report.mesh["tets"] == 6 * 4**3
    assert report.settings["stream_mb"] == 0.5
    assert report.machine["processors"] == PROCESSORS
    assert sum("round" in text for text in said) == 7


def test_mesh_by_name():
    settings = KernelSettings((1,), ("float64",), stream_mb=0.1)
    report = bench_kernels(settings, mesh="beam", vertices=500)
    assert report.mesh["name"] == "beam"
    assert report.mesh["vertices"] == pytest.approx(500, rel=0.05)
    assert {result.variant for result in report.passes} == {"float64"}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"threads": (0,)}, ["--threads", "found:   0", f"1 to {PROCESSORS}"]),
        ({"threads": (1, PROCESSORS + 1)}, ["--threads", f"1, {PROCESSORS + 1}"]),
        ({"threads": (1, 1)}, ["--threads", "each once"]),
        ({"threads": ()}, ["--threads", "nothing"]),
        ({"variants": ("float16",)}, ["--precision", "float16", "float32, float64, plain"]),
        ({"repeats": 6}, ["--repeats", "6", "7 or more"]),
        ({"stream_mb": 0.0}, ["--stream-mb", "0.0"]),
        ({"stream_mb": float("nan")}, ["--stream-mb", "nan"]),
    ],
)
def test_impossible_settings(arguments, expected):
    with pytest.raises(InputError) as caught:
        KernelSettings(**arguments)
    for text in expected:
        assert text in str(caught.value)


def test_more_than_fits():
    said: list[str] = []
    with pytest.raises(InputError, match="--cells") as caught:
        bench_kernels(KernelSettings(stream_mb=0.1), cells=1000, announce=said.append)
    for text in ("6000000000 tetrahedra", "available", "smaller mesh"):
        assert text in str(caught.value)
    assert said == ["building the mesh"]
    with pytest.raises(InputError, match="STREAM"):
        bench_kernels(KernelSettings(stream_mb=1e8), cells=3)
