# SPDX-License-Identifier: BSD-3-Clause
"""`femgal bench`: how fast things are here, one question per sub-command."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from verify.benchmark.kernel_report import KernelReport
    from verify.benchmark.kernel_tables import TextTable


@click.group()
def command() -> None:
    """Measure speed on this machine."""


@command.command()
@click.option("--mesh", metavar="NAME", help="A mesh of `femgal mesh info` or a file; a jittered Kuhn box by default.")
@click.option("--vertices", type=click.IntRange(min=8), help="Wanted number of vertices of --mesh.")
@click.option("--cells", type=click.IntRange(3, 1000), help="Grid cells along each axis of the box; 59 by default.")
@click.option("--threads", metavar="N,N", help="Numbers of threads; 1 and all processors by default.")
@click.option("--precision", metavar="P,P", help="Some of float32, float64, plain (the reference); all by default.")
@click.option("--repeats", type=int, default=7, show_default=True, help="Rounds, 7 or more.")
@click.option("--stream-mb", type=float, default=900.0, show_default=True, help="MB of each of STREAM's three arrays.")
@click.option("--json", "json_path", metavar="PATH", help="Write every sample to PATH; - prints it and nothing else.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def kernels(
    mesh: str | None,
    vertices: int | None,
    cells: int | None,
    threads: str | None,
    precision: str | None,
    repeats: int,
    stream_mb: float,
    json_path: str | None,
    force: bool,
) -> None:
    """Time every pass over the elements beside STREAM triad, and say how far it is from what the memory allows."""
    out = _target(json_path, force)
    if mesh is None and vertices is not None:
        raise click.UsageError("--vertices goes with --mesh; the box takes --cells")
    if mesh is not None and cells is not None:
        raise click.UsageError("--cells is of the box; a --mesh takes --vertices")
    from verify.benchmark.kernels import DEFAULT_CELLS, KernelSettings, bench_kernels
    from verify.benchmark.passes import VARIANTS

    settings = KernelSettings(
        _numbers(threads, "--threads") if threads is not None else _default_threads(),
        VARIANTS if precision is None else tuple(part.strip() for part in precision.split(",")),
        repeats,
        stream_mb,
    )
    report = bench_kernels(
        settings,
        mesh=mesh,
        vertices=vertices,
        cells=cells or DEFAULT_CELLS,
        announce=lambda text: click.echo(f"{text} ...", err=True),
    )
    _show(report, json_path, out)


@command.command()
@click.argument("scene", required=False)
@click.option("--vertices", type=click.IntRange(min=8), help="Vertices of every body.")
@click.option("--frames", type=click.IntRange(min=1), help="Number of frames.")
@click.option("--substeps", metavar="N,N", default="50", show_default=True, help="Time steps per frame of each row.")
@click.option("--steps", metavar="S,S", default="exact", show_default=True, help="exact, spectral, lu2025 ...")
@click.option("--precision", metavar="P,P", default="float64", show_default=True, help="float32, float64.")
@click.option("--ratio", metavar="N,N", default="32", show_default=True, help="Ratios, or linear.")
@click.option(
    "--variant", "variants", multiple=True, metavar="KEY=VALUE ...", help='Rows with keys of solver: "cycle=V pre=1".'
)
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Any key: --set bodies.0.E=1e7")
@click.option("--reference-safety", type=click.FloatRange(0.01, 0.5), default=0.45, show_default=True)
@click.option("--work", type=click.Path(path_type=Path), required=True, help="Folder of the runs; resumes from it.")
@click.option("--json", "json_path", metavar="PATH", help="Write all numbers to PATH; - prints them and nothing else.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def motion(
    scene: str | None,
    vertices: int | None,
    frames: int | None,
    substeps: str,
    steps: str,
    precision: str,
    ratio: str,
    variants: tuple[str, ...],
    settings: tuple[str, ...],
    reference_safety: float,
    work: Path,
    json_path: str | None,
    force: bool,
) -> None:
    """Run a scene with many settings: error against a Verlet reference, time and memory of each.

    Every combination of the lists is a row of FAS, beside Verlet with its own defaults; what --set says of the solver
    holds for the rows of FAS. Each --variant makes all of them once more with other keys; --variant "" is the plain
    one. Runs are kept in --work: an interrupted study goes on.
    """
    out = _target(json_path, force)
    from femgal.commands.options import scene_from_options
    from femgal.scene.overrides import parse_override
    from verify.benchmark.motion import candidates, study
    from verify.benchmark.motion_table import notes, table

    base = scene_from_options(scene, vertices, frames, settings)
    transfers = [
        ("linear", 8) if part == "linear" else ("constant", _numbers(part, "--ratio")[0]) for part in _words(ratio)
    ]
    others = [tuple(map(parse_override, one.split())) for one in variants] or [()]
    rows = candidates(_numbers(substeps, "--substeps"), _words(steps), _words(precision), transfers, others)
    result = study(
        base, rows, work, reference_safety=reference_safety, announce=lambda text: click.echo(f"{text} ...", err=True)
    )
    _deliver(result, [table(result)], notes(result), json_path, out)


def _words(text: str) -> list[str]:
    return [part.strip() for part in text.split(",")]


def _target(json_path: str | None, force: bool) -> Path | None:
    """The file to write, checked before anything is measured; None for none."""
    if json_path in (None, "-"):
        return None
    from meshes.io.source import writable

    return writable(Path(str(json_path)), force=force)


def _default_threads() -> tuple[int, ...]:
    import os

    return tuple(sorted({1, len(os.sched_getaffinity(0))}))


def _numbers(text: str, option: str) -> tuple[int, ...]:
    from meshes.errors import InputError

    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        allowed = "whole numbers separated by commas"
        raise InputError("not a list of numbers", where=option, found=repr(text), allowed=allowed) from None


def _show(report: KernelReport, json_path: str | None, out: Path | None) -> None:
    from verify.benchmark.kernel_tables import notes, preamble, tables

    _deliver(report.as_dict(), tables(report), notes(report), json_path, out, preamble(report))


def _deliver(
    result: dict[str, Any],
    tables: Sequence[TextTable],
    notes: Iterable[str],
    json_path: str | None,
    out: Path | None,
    preamble: Iterable[str] = (),
) -> None:
    """Print tables and notes, or JSON alone, and write the file that was asked for."""
    import json

    text = json.dumps(result, indent=1)
    if json_path == "-":
        click.echo(text)
        return
    from rich.console import Console

    # No figure is cut off, however narrow the terminal and long the labels: its lines wrap.
    console = Console(width=400, highlight=False)
    for line in preamble:
        console.print(line, soft_wrap=True, markup=False)
    for table in tables:
        console.print(_drawn(table))
    for line in notes:
        console.print(line, soft_wrap=True, markup=False)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")
        click.echo(f"wrote {out}")


def _drawn(table: TextTable) -> Any:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    drawn = Table(title=table.title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for number, head in enumerate(table.heads):
        drawn.add_column(Text(head), justify="right" if number else "left", no_wrap=True)
    for row in table.rows:
        drawn.add_row(*map(Text, row))  # Text: "[s]" is a unit here, not markup
    return drawn
