# SPDX-License-Identifier: BSD-3-Clause
"""`femgal bench`: error against time of every solver, and the speed of the passes they are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import click

from femgal.commands.bench_grid import grid

if TYPE_CHECKING:
    from verify.benchmark.kernel_report import KernelReport
    from verify.benchmark.kernel_tables import TextTable
    from verify.benchmark.preconditioners import Result

_Number = TypeVar("_Number", int, float)


class _ScenesOrKernels(click.Group):
    """`bench kernels`, and `bench` of anything else: what is no sub-command's name is for the grid."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if args and args[0] in self.commands:
            return super().make_context(info_name, args, parent, **extra)
        return grid.make_context(info_name, args or ["--help"], parent, **extra)


@click.group(cls=_ScenesOrKernels)
def command() -> None:
    """Measure error against time, and speed, on this machine."""


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
    out = target_file(json_path, force)
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
@click.argument("scene")
@click.option("--vertices", metavar="N,N", default="2000,20000", show_default=True, help="Sizes of the mesh.")
@click.option("--E", "youngs", metavar="E,E", default="1e3,1e4,1e6,1e8", show_default=True, help="Young's moduli [Pa].")
@click.option("--rho", "densities", metavar="RHO,RHO", default="1,1000", show_default=True, help="Densities [kg/m^3].")
@click.option("--preconditioners", "names", metavar="P,P", help="Some of blocks, layers, cycle, mas, v-cycle.")
@click.option("--reduction", type=float, default=1e-2, show_default=True, help="Of the residual.")
@click.option("--threads", type=click.IntRange(min=1), default=1, show_default=True, help="CPU threads.")
@click.option("--json", "json_path", metavar="PATH", help="Write the record to PATH; - prints it and nothing else.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def preconditioners(
    scene: str,
    vertices: str,
    youngs: str,
    densities: str,
    names: str | None,
    reduction: float,
    threads: int,
    json_path: str | None,
    force: bool,
) -> None:
    """Count the iterations that Newton's linear systems take with each preconditioner, and time them."""
    out = target_file(json_path, force)
    from verify.benchmark.preconditioners import PRECONDITIONERS, Settings, bench_preconditioners, tables

    settings = Settings(
        scene,
        _numbers(vertices, "--vertices"),
        _decimals(youngs, "--E"),
        _decimals(densities, "--rho"),
        PRECONDITIONERS if names is None else tuple(part.strip() for part in names.split(",")),
        reduction,
        threads,
    )

    def announce(result: Result) -> None:
        system = f"{result.vertices} E={result.E:g} rho={result.rho:g} {result.state}"
        click.echo(f"{system}: {result.preconditioner} {result.smooth}, {result.rough} iterations", err=True)

    record = bench_preconditioners(settings, announce)
    notes = ["smooth, rough: iterations with the body's weight and with forces at random; times of the smooth ones."]
    _deliver(record, tables(record), notes, json_path, out)


def target_file(json_path: str | None, force: bool) -> Path | None:
    """The file to write, checked before anything is measured; None for none."""
    if json_path in (None, "-"):
        return None
    from meshes.io.source import writable

    return writable(Path(str(json_path)), force=force)


def _default_threads() -> tuple[int, ...]:
    import os

    return tuple(sorted({1, len(os.sched_getaffinity(0))}))


def _numbers(text: str, option: str) -> tuple[int, ...]:
    return tuple(_parts(text, option, int, "whole numbers"))


def _decimals(text: str, option: str) -> tuple[float, ...]:
    return tuple(_parts(text, option, float, "numbers"))


def _parts(text: str, option: str, kind: Callable[[str], _Number], what: str) -> list[_Number]:
    from meshes.errors import InputError

    try:
        return [kind(part) for part in text.split(",")]
    except ValueError:
        allowed = f"{what} separated by commas"
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
    show_tables(tables, notes, preamble)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")
        click.echo(f"wrote {out}")


class _Table(Protocol):
    """A table of text: of `verify.benchmark` or of `reports.benchmark`."""

    @property
    def title(self) -> str: ...

    @property
    def heads(self) -> tuple[str, ...]: ...

    @property
    def rows(self) -> tuple[tuple[str, ...], ...]: ...


def show_tables(tables: Iterable[_Table], notes: Iterable[str], preamble: Iterable[str] = ()) -> None:
    """Print tables, with lines before and after them."""
    from rich.console import Console

    # No figure is cut off, however narrow the terminal and long the labels: its lines wrap.
    console = Console(width=400, highlight=False)
    for line in preamble:
        console.print(line, soft_wrap=True, markup=False)
    for table in tables:
        console.print(_drawn(table))
    for line in notes:
        console.print(line, soft_wrap=True, markup=False)


def _drawn(table: _Table) -> Any:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    drawn = Table(title=table.title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for number, head in enumerate(table.heads):
        drawn.add_column(Text(head), justify="right" if number else "left", no_wrap=True)
    for row in table.rows:
        drawn.add_row(*map(Text, row))  # Text: "[s]" is a unit here, not markup
    return drawn
