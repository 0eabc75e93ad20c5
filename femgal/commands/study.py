# SPDX-License-Identifier: BSD-3-Clause
"""`femgal study`: the studies of Lu et al. 2025 on this machine, our figures beside the paper's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from verify.studies.definition import StudyDefinition
    from verify.studies.motion import Bench
    from verify.studies.study import PublishedStudy

INTERRUPTED = 130

_HELP = {
    "scene": "A built-in scene or a file, in place of the study's: rabbit-drape comes with its mesh.",
    "sizes": "Numbers of vertices, in place of the study's.",
    "levels": "Levels of eps18: in metres, for single substeps as shares of the prediction's.",
    "limit": "Longest CPU time per thread of one run [s]; then it counts as failed.",
    "older": "Take runs of other sources where there are none of these.",
}


@click.command()
@click.argument("name", required=False)
@click.option("--quick", is_flag=True, help="Small sizes and short motions: minutes in place of hours.")
@click.option("--sizes", metavar="N,N", help=_HELP["sizes"])
@click.option("--scene", metavar="SCENE", help=_HELP["scene"])
@click.option("--rho", metavar="RHO,RHO", help="Densities [kg/m^3], in place of the study's.")
@click.option("--levels", metavar="L,L", help=_HELP["levels"])
@click.option("--frames", type=click.IntRange(min=1), help="Frames of every motion.")
@click.option("--threads", type=click.IntRange(min=1), help="CPU threads of every run; 1 by default.")
@click.option("--time-limit", type=click.FloatRange(0.0, min_open=True), help=_HELP["limit"])
@click.option("--clock", type=click.Choice(("cpu", "wall")), default="cpu", show_default=True, help="Time that counts.")
@click.option("--work", type=click.Path(path_type=Path), default=Path("studies"), show_default=True, help="Runs.")
@click.option("--references", type=click.Path(path_type=Path), help="References; in femgal's cache by default.")
@click.option("--keep-older", is_flag=True, help=_HELP["older"])
@click.option("--retry-failed", is_flag=True, help="Run failed rows again.")
@click.option("--report", type=click.Path(path_type=Path), metavar="DIR", help="Write study.json and study.html.")
@click.option("--json", "json_path", metavar="PATH", help="Write the record to PATH; - prints it and nothing else.")
@click.option("--force", is_flag=True, help="Overwrite an existing file; write into a folder that holds other files.")
@click.pass_context
def command(ctx: click.Context, name: str | None, **options: Any) -> None:
    """Repeat a study of Lu et al. 2025; without a name, list them.

    \b
    femgal study smoothers --quick                            a few minutes
    femgal study sizes --sizes 2000,20000 --report sizes/     two of its sizes, and a page
    Runs are kept in --work: the same command goes on where it was stopped.
    Exit codes: 0 done (failed rows are rows), 2 bad input, 130 interrupted.
    """  # noqa: D301 - click reads the backspace
    if name is None:
        _list()
        return
    from femgal.commands.verify import typed_command

    out = _Out(options["json_path"], options["report"], options["force"])
    study = _study(_definition(name, options), options)
    code = 0
    try:
        study.run()
    except KeyboardInterrupt:
        click.echo("stopped; the same command goes on", err=True)
        code = INTERRUPTED
    out.deliver(study.record(typed_command(ctx), quick=options["quick"]))
    ctx.exit(code)


def _list() -> None:
    from verify.studies.definition import NAMES, load_definition

    for name in NAMES:
        click.echo(f"{name:17s}{load_definition(name).title}")


def _definition(name: str, options: dict[str, Any]) -> StudyDefinition:
    """The study, as the options change it."""
    from verify.studies.definition import load_definition
    from verify.work_precision.shorthand import numbers

    definition = load_definition(name)
    if options["quick"]:
        definition = definition.shrunk()
    lists = {"sizes": "vertices", "rho": "rho"}
    changes = {key: numbers(options[name], f"--{name}") for name, key in lists.items() if options[name]}
    changes |= {key: options[key] for key in ("frames", "threads", "time_limit") if options[key] is not None}
    changes |= {"scenes": [options["scene"]]} if options["scene"] else {}
    definition = definition.with_grid(**changes)
    return definition.with_levels(numbers(options["levels"], "--levels")) if options["levels"] else definition


def _study(definition: StudyDefinition, options: dict[str, Any]) -> PublishedStudy:
    from verify.studies.study import PublishedStudy

    return PublishedStudy(definition, _bench(options))


def _bench(options: dict[str, Any]) -> Bench:
    from verify.studies.motion import Bench
    from verify.work_precision.executor import Local
    from verify.work_precision.reference import default_folder
    from verify.work_precision.store import Store
    from verify.work_precision.study import Options

    work = Store(options["work"], keep_older=options["keep_older"], retry_failed=options["retry_failed"])
    references = Store(options["references"] or default_folder(), retry_failed=options["retry_failed"])
    return Bench(work, references, Local(), Options(options["clock"]), lambda text: click.echo(text, err=True))


class _Out:
    """Where results go; refused before anything runs."""

    def __init__(self, json_path: str | None, report: Path | None, force: bool) -> None:
        from femgal.commands.bench import target_file
        from femgal.output.report import prepare_report
        from reports.studies.render import NAMES

        self._alone, self._file = json_path == "-", target_file(json_path, force)
        self._report = prepare_report(report, NAMES, force=force) if report is not None else None

    def deliver(self, record: dict[str, Any]) -> None:
        """Print the tables, or the record alone, and write the files."""
        from femgal.commands.bench import show_tables
        from verify.studies.tables import notes, tables

        text = json.dumps(record, indent=1, allow_nan=False) + "\n"
        if self._alone:
            click.echo(text, nl=False)
        else:
            show_tables(tables(record), notes(record))
        if self._file is not None:
            self._file.write_text(text, encoding="utf-8")
            click.echo(f"wrote {self._file}", err=True)
        if self._report is not None:
            self._write(self._report, json.loads(text))

    def _write(self, folder: Path, record: dict[str, Any]) -> None:
        from femgal.output.report import write_report
        from reports.studies.render import render

        write_report(folder, render(record))
        click.echo(f"wrote {folder}", err=True)
