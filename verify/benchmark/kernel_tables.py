# SPDX-License-Identifier: BSD-3-Clause
"""The tables of `femgal bench kernels`, as rows of text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from verify.benchmark.kernel_report import KernelReport, PassResult
from verify.benchmark.passes import BLOCKS, GRADIENT, SUBSTEPS

# The rule of STREAM: arrays at least so many times as large as the last-level cache.
_BEYOND_CACHE = 4.0
# Passes of one triad that differ by more than this share were disturbed.
_QUIET = 1.25


@dataclass(frozen=True)
class TextTable:
    """A table of text; the first column holds words, the others numbers.

    Parameters
    ----------
    title : What the table shows.
    heads : Head of each column.
    rows : Cells, as many per row as heads.
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def tables(report: KernelReport) -> list[TextTable]:
    """STREAM, the passes of each variant, ratios of passes, first calls."""
    variants = list(dict.fromkeys(result.variant for result in report.passes))
    return [_stream(report), *(_passes(report, variant) for variant in variants), _ratios(report), _first_calls(report)]


def preamble(report: KernelReport) -> list[str]:
    """Machine, mesh and settings, one sentence each."""
    machine, mesh, settings = report.machine, report.mesh, report.settings
    cache = "unknown" if machine["last_level_cache"] is None else f"{machine['last_level_cache'] / 2**20:.0f} MiB"
    layers = ", ".join(f"{layer['name']} {layer['active_tets']}" for layer in mesh["layers"][1:])
    return [
        f"machine: {machine['cpu']} (code for {machine['compiled_for']}), processors {machine['processors']}, "
        f"last-level cache {cache}, huge pages {machine['transparent_huge_pages']}, "
        f"load before {machine['load_before']:.1f}",
        f"versions: Python {machine['python']}, NumPy {machine['numpy']}, Numba {machine['numba']}",
        f"mesh: {mesh['name']}, {mesh['vertices']} vertices, {mesh['tets']} tetrahedra; active in coarse layers: "
        f"{layers or 'there are none'}",
        f"{settings['repeats']} rounds, all passes and STREAM in turns; times are medians, CPU times sum over threads",
    ]


def notes(report: KernelReport) -> list[str]:
    """How to read the tables, and what in them is to be doubted."""
    found = [
        "wall / CPU: by elapsed time, and by CPU time as if the threads shared the work evenly, each on "
        "a processor of its own.",
        "B/tet: bytes that a pass has to move at least, fixed: 52 or 96 for the element phase, 78 or 149 with blocks; "
        "vectors a third of that output, energies 16 more, coarse layers and energies along a line no output, node "
        "work by its float64 arrays.",
        "bound [Mtet/s]: the best STREAM triad on as many threads, over B/tet; what stays in the cache can pass it.",
    ]
    cache = report.machine["last_level_cache"] or 0
    smallest = min(result.bytes_moved / 3 for result in report.stream)
    if smallest < _BEYOND_CACHE * cache:
        found.append(
            f"doubtful bound: arrays of STREAM of {smallest / 1e6:.0f} MB are less than {_BEYOND_CACHE:.0f} times the "
            f"last-level cache of {cache / 1e6:.0f} MB."
        )
    spread = max(result.timing.worst / result.timing.best for result in report.stream)
    if spread > _QUIET:
        found.append(f"disturbed machine: the passes of one STREAM triad differ by a factor of {spread:.2f}.")
    return found


def _stream(report: KernelReport) -> TextTable:
    rows = tuple(
        (
            "triad",
            f"{result.threads}",
            f"{result.bytes_moved / 3e6:.0f}",
            f"{result.bytes_moved / result.timing.best / 1e9:.1f}",
            f"{result.bytes_moved / result.timing.median / 1e9:.1f}",
            f"{result.threads * result.bytes_moved / min(result.timing.cpu) / 1e9:.1f}",
        )
        for result in report.stream
    )
    heads = ("STREAM", "threads", "MB per array", "best GB/s", "median GB/s", "best by CPU time")
    return TextTable("memory bandwidth", heads, rows)


def _passes(report: KernelReport, variant: str) -> TextTable:
    heads = ("pass", "threads", "ms", "min..max", "CPU ms (best)", "Mtet/s", "B/tet", "bound", "% of bound", "speed-up")
    title = "float64 reference without tiles" if variant == "plain" else f"{variant} tiles"
    chosen = [result for result in report.passes if result.variant == variant]
    # Threads of one pass under one another.
    names = list(dict.fromkeys(result.name for result in chosen))
    chosen.sort(key=lambda result: names.index(result.name))
    return TextTable(f"{title}; pairs are wall / CPU", heads, tuple(_pass_row(report, result) for result in chosen))


def _pass_row(report: KernelReport, result: PassResult) -> tuple[str, ...]:
    timing, bound = result.timing, report.bound(result)
    return (
        result.name,
        f"{result.threads}",
        _number(1e3 * timing.median),
        f"{_number(1e3 * timing.best)}..{_number(1e3 * timing.worst)}",
        f"{_number(1e3 * timing.cpu_median)} ({_number(1e3 * min(timing.cpu))})",
        f"{_number(result.rate / 1e6)} / {_number(result.cpu_rate / 1e6)}",
        "" if result.bytes_per_tet is None else _number(result.bytes_per_tet),
        "" if bound is None else _number(bound / 1e6),
        _pair(report.bound_share(result), 100.0, 0),
        _pair(report.speed_up(result), 1.0, 2) if result.threads > 1 else "",
    )


def _ratios(report: KernelReport) -> TextTable:
    heads = ("ratio of times", "variant", "threads", "median", "min..max", "by CPU time")
    return TextTable("ratios within a round", heads, tuple(_ratio_rows(report)))


def _ratio_rows(report: KernelReport) -> Iterator[tuple[str, ...]]:
    for name, unit in ((BLOCKS, GRADIENT), *((substep, BLOCKS) for substep in SUBSTEPS)):
        for result in report.passes:
            ratio = report.relative(result, unit) if result.name == name else None
            if ratio is not None:
                spread = f"{ratio.smallest:.2f}..{ratio.largest:.2f}"
                words = (f"{name} over {unit}", result.variant, f"{result.threads}")
                yield (*words, f"{ratio.median:.2f}", spread, f"{ratio.by_cpu:.2f}")


def _first_calls(report: KernelReport) -> TextTable:
    rows = tuple(
        (
            call.name,
            call.variant,
            _pair((call.wall, call.cpu), 1.0, 3),
            _number(1e6 * call.launch.median),
            f"{_number(1e6 * call.launch.best)}..{_number(1e6 * call.launch.worst)}",
        )
        for call in report.first_calls
    )
    heads = ("pass over a few tets", "variant", "first call [s], wall / CPU", "later calls [us]", "min..max")
    return TextTable("kernels compiled or loaded from the cache, and what a start costs", heads, rows)


def _number(value: float) -> str:
    """Three digits, never in powers of ten."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _pair(values: tuple[float, float] | None, scale: float, digits: int) -> str:
    return "" if values is None else " / ".join(f"{scale * value:.{digits}f}" for value in values)
