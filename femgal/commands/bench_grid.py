# SPDX-License-Identifier: BSD-3-Clause
"""`femgal bench SCENE...`: every solver over a grid of scenes, sizes and materials, error against time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from verify.work_precision.executor import Executor
    from verify.work_precision.grid import Grid
    from verify.work_precision.study import Study

INTERRUPTED = 130

_HELP = {
    "solver": 'A curve with choices: "fas substeps=5,10,25 steps=exact,spectral label=mine".',
    "vary": "Choices for every solver that has the key: steps=exact,spectral",
    "limit": "Longest CPU time per thread of one run [s]; then it counts as failed.",
    "cluster": "Run on the workers of this Dask scheduler: tcp://127.0.0.1:8786.",
    "clock": "The time that counts: wall, cpu (of all threads), or auto: cpu on one thread.",
    "gap": "Measure the energy gap of the first N substeps, by a direct solver: for small meshes.",
    "slivers": "Smallest angles [degrees] of tetrahedra that are flattened on purpose, around 1% of the vertices.",
    "solver_error": "Distance from the converged motion of the same steps; one more run for each kind of steps.",
    "periods": "Of the lowest excited mode, 5 by default; with --frames these become so short that they end there.",
    "json": "Write the record to PATH; - prints it and nothing else.",
    "report": "Write bench.json, bench.csv, plots and bench.html.",
    "safety": "Share of the stable step that the references take.",
    "older": "Take runs of other sources where there are none of these; they are marked.",
}


@click.command()
@click.argument("scenes", nargs=-1)
@click.option("--grid", "grid_file", type=click.Path(path_type=Path), metavar="FILE", help="A grid as TOML.")
@click.option("--example", is_flag=True, help="Print a grid file with all keys.")
@click.option("--vertices", metavar="N,N", help="Vertices of every body.")
@click.option("--E", "youngs", metavar="E,E", help="Young's moduli of every body [Pa].")
@click.option("--slivers", metavar="A,A", help=_HELP["slivers"])
@click.option("--nu", metavar="NU,NU", help="Poisson's ratios of every body.")
@click.option("--rho", metavar="RHO,RHO", help="Densities of every body [kg/m^3].")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Any key of the scenes.")
@click.option("--solvers", metavar="S,S", help="Solvers, each a curve.")
@click.option("--solver", "specs", multiple=True, metavar="SPEC", help=_HELP["solver"])
@click.option("--substeps", metavar="N,N", help="Time steps per frame, of all solvers but verlet.")
@click.option("--stepping", metavar="T,T", help="backward-euler, bdf2; of all solvers but verlet.")
@click.option("--precision", metavar="P,P", help="float32, float64.")
@click.option("--vary", multiple=True, metavar="KEY=V,V", help=_HELP["vary"])
@click.option("--frames", type=click.IntRange(min=1), help="Frames of every scene.")
@click.option("--periods", type=click.FloatRange(0.0, min_open=True), help=_HELP["periods"])
@click.option("--threads", type=click.IntRange(min=1), help="CPU threads of every run; 1 by default.")
@click.option("--time-limit", type=click.FloatRange(0.0, min_open=True), help=_HELP["limit"])
@click.option("--repeats", type=click.IntRange(min=1), help="Runs of each finalist; 1 by default.")
@click.option("--targets", metavar="E,E", help="Errors that are asked the time to; 0.1,0.01,0.001 by default.")
@click.option("--reference-safety", type=click.FloatRange(0.01, 0.5), help=_HELP["safety"])
@click.option("--solver-error", is_flag=True, help=_HELP["solver_error"])
@click.option("--energy-gap", type=click.IntRange(min=0), default=0, metavar="N", help=_HELP["gap"])
@click.option("--clock", type=click.Choice(("auto", "wall", "cpu")), default="auto", show_default=True)
@click.option("--work", type=click.Path(path_type=Path), default=Path("bench"), show_default=True, help="Runs.")
@click.option("--references", type=click.Path(path_type=Path), help="References; in femgal's cache by default.")
@click.option("--refresh-references", is_flag=True, help="Make the references anew.")
@click.option("--keep-older", is_flag=True, help=_HELP["older"])
@click.option("--retry-failed", is_flag=True, help="Run failed rows again.")
@click.option("--cluster", metavar="ADDRESS", help=_HELP["cluster"])
@click.option("--report", type=click.Path(path_type=Path), metavar="DIR", help=_HELP["report"])
@click.option("--json", "json_path", metavar="PATH", help=_HELP["json"])
@click.option("--force", is_flag=True, help="Overwrite an existing file; write into a folder that holds other files.")
@click.pass_context
def grid(ctx: click.Context, **options: Any) -> None:
    """Run every solver with every setting on every scene, size and material; compare error and time.

    \b
    femgal bench rabbit-drape --solvers verlet,fas --work runs
    femgal bench rabbit-drape beam.toml --vertices 2000,20000 --E 1e4,1e6 --rho 1,1000 --solvers verlet,fas,jacobi \\
        --stepping bdf2 --work runs --report out
    femgal bench --grid grid.toml --work runs --report out       femgal bench --example prints one
    femgal bench kernels                                         times the element passes alone
    Runs are kept in --work: the same command goes on where it was stopped.
    Exit codes: 0 done (failed rows are rows), 2 bad input, 130 interrupted.
    """  # noqa: D301 - click reads the backspace
    if options["example"]:
        from verify.work_precision.grid import EXAMPLE

        click.echo(EXAMPLE, nl=False)
        return
    from femgal.commands.verify import typed_command

    out = _Out(options["json_path"], options["report"], options["force"])
    study = _study(_grid(options), options)
    code = 0
    try:
        study.run()
    except KeyboardInterrupt:
        click.echo("stopped; the same command goes on", err=True)
        code = INTERRUPTED
    finally:
        study.executor.close()
    out.deliver(study, typed_command(ctx))
    ctx.exit(code)


def _grid(options: dict[str, Any]) -> Grid:
    """The grid that file and options describe."""
    from femgal.scene.overrides import parse_override
    from verify.work_precision.grid import load_grid, make_grid
    from verify.work_precision.shorthand import numbers

    lists = {
        "vertices": "vertices",
        "slivers": "slivers",
        "youngs": "E",
        "nu": "nu",
        "rho": "rho",
        "targets": "targets",
    }
    given: dict[str, Any] = {key: numbers(options[o], f"--{key}") for o, key in lists.items() if options[o] is not None}
    plain = ("frames", "periods", "threads", "time_limit", "repeats", "reference_safety")
    given |= {key: options[key] for key in plain if options[key] is not None}
    if options["scenes"]:
        given["scenes"] = list(options["scenes"])
    if options["settings"]:
        given["set"] = dict(map(parse_override, options["settings"]))
    tables = _solvers(options)
    if tables:
        given["solvers"] = tables
    if options["grid_file"] is not None:
        return load_grid(options["grid_file"], given)
    if "scenes" not in given:
        raise click.UsageError("name one or more scenes, or give a --grid")
    return make_grid(given, "femgal bench")


def _solvers(options: dict[str, Any]) -> list[dict[str, Any]]:
    from verify.work_precision.shorthand import assignment, choices, solver_tables

    common = {key: choices(options[key]) for key in ("substeps", "stepping", "precision") if options[key] is not None}
    common |= dict(assignment(text, "--vary") for text in options["vary"])
    names = [name.strip() for name in (options["solvers"] or "").split(",") if name.strip()]
    if common and not names and not options["specs"]:
        raise click.UsageError("--substeps, --stepping, --precision and --vary go with --solvers or --solver")
    return solver_tables(names, options["specs"], common)


def _study(grid: Grid, options: dict[str, Any]) -> Study:
    from verify.work_precision.reference import default_folder
    from verify.work_precision.store import Store
    from verify.work_precision.study import Options, Study

    clock = options["clock"]
    if clock == "auto":
        clock = "cpu" if grid.threads == 1 else "wall"
    work = Store(options["work"], keep_older=options["keep_older"], retry_failed=options["retry_failed"])
    references = Store(options["references"] or default_folder(), retry_failed=options["retry_failed"])
    settings = Options(
        clock,
        options["energy_gap"],
        options["refresh_references"],
        solver_error=options["solver_error"],
    )
    return Study(grid, work, references, _executor(options), settings, lambda text: click.echo(text, err=True))


def _executor(options: dict[str, Any]) -> Executor:
    if options["cluster"] is None:
        from verify.work_precision.executor import Local

        return Local()
    from verify.work_precision.cluster import Cluster

    return Cluster(options["cluster"])


class _Out:
    """Where results go; refused before anything runs."""

    def __init__(self, json_path: str | None, report: Path | None, force: bool) -> None:
        from femgal.commands.bench import target_file
        from femgal.output.report import prepare_report
        from reports.benchmark.render import NAMES

        self._alone, self._file = json_path == "-", target_file(json_path, force)
        self._report = prepare_report(report, NAMES, force=force) if report is not None else None

    def deliver(self, study: Study, command: str) -> None:
        """Print the tables, or the record alone, and write the files."""
        from femgal.commands.bench import show_tables
        from reports.benchmark.tables import notes, tables
        from verify.work_precision.record import make_record

        record = make_record(study, command)
        text = json.dumps(record, indent=1, allow_nan=False) + "\n"
        if self._alone:
            click.echo(text, nl=False)
        else:
            show_tables(tables(record), notes(record))
        if self._file is not None:
            self._file.write_text(text, encoding="utf-8")
            click.echo(f"wrote {self._file}", err=True)
        if self._report is not None:
            _write_report(self._report, record)


def _write_report(folder: Path, record: dict[str, Any]) -> None:
    from femgal.output.report import write_report
    from reports.benchmark.pictures import draw_pictures
    from reports.benchmark.render import render

    write_report(folder, render(record))
    try:
        draw_pictures(record, folder)
    except ImportError:
        click.echo('no PNG plots: matplotlib is missing; pip install "femgal[view]"', err=True)
    click.echo(f"wrote {folder}", err=True)
