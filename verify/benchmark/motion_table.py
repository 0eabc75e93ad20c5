# SPDX-License-Identifier: BSD-3-Clause
"""The table of `femgal bench motion`."""

from __future__ import annotations

from statistics import median
from typing import Any

from verify.benchmark.kernel_tables import TextTable

_HEADS = (
    "solver",
    "error",
    "s/frame",
    "min..max",
    "passes",
    "substeps",
    "retaken",
    "energy",
    "mesh s",
    "tree s",
    "first s",
    "peak MB",
)


def table(result: dict[str, Any]) -> TextTable:
    """One row per candidate, in the order in which they were asked for."""
    title = f"{result['scene']['name']}: {result['vertices']} vertices, {result['tets']} tetrahedra"
    return TextTable(title, _HEADS, tuple(_row(row) for row in result["rows"]))


def notes(result: dict[str, Any]) -> list[str]:
    """What the columns mean, and how good the reference is."""
    reference = result["reference"]
    own = "unknown, as that fails" if reference["own_error"] is None else f"{reference['own_error']:.1e}"
    failed = [f"{row['label']}: {row['failure']}" for row in result["rows"] if row["failure"]]
    return [
        f"reference: {reference['label']}, {reference['substeps']} substeps in the last frame; its own error, from its "
        f"distance to Verlet at the default step: {own}.",
        "error: mass-weighted RMS of the difference over all vertices and frames, over that of the reference's motion. "
        "s/frame: median, without compilation; passes: per frame.",
        "energy: largest gain over the start, over what the start had. mesh s, tree s: CPU time of all threads, mesh "
        "and hierarchy; first s: wall time of compiling or loading kernels and of estimates before the first frame.",
        *failed,
    ]


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    stages, seconds = row["stages"], row["seconds"]
    return (
        row["label"],
        "failed" if row["error"] is None else f"{row['error']:.1e}",
        f"{median(seconds):.3f}" if seconds else "-",
        f"{min(seconds):.2f}..{max(seconds):.2f}" if seconds else "-",
        f"{row['passes']:.0f}",
        _range(row["substeps"]),
        str(row["retakes"]),
        "-" if row["growth"] is None else f"{row['growth']:+.0e}",
        f"{stages['building the mesh'][1]:.1f}",
        f"{stages.get('building the hierarchy', (0.0, 0.0))[1]:.1f}",
        f"{stages['compiling and estimating'][0]:.1f}",
        f"{row['peak_mb']:.0f}",
    )


def _range(counts: list[int]) -> str:
    if not counts:
        return "-"
    return f"{counts[0]}" if min(counts) == max(counts) else f"{min(counts)}..{max(counts)}"
