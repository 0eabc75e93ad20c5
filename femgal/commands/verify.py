# SPDX-License-Identifier: BSD-3-Clause
"""`femgal verify`: what is right, against which kind of reference, to which tolerance."""

from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

if TYPE_CHECKING:
    from verify.suite.case import Row
    from verify.suite.use import Use

FAILURES, NOT_RUN, INTERRUPTED = 1, 2, 130


@click.command()
@click.option("--list", "listing", is_flag=True, help="Print all cases, or those of --quick or -k, and run none.")
@click.option(
    "-k", "pattern", metavar="PATTERN", help="Part of an id or title, or a pattern with *; several by blanks."
)
@click.option("--quick/--full", default=None, help="Below a minute of CPU time (the default), or everything.")
@click.option("--mesh", type=click.Path(), metavar="FILE", help="Diagnose this mesh, and run what is true on any.")
@click.option("--scene", type=click.Path(), metavar="FILE", help="Its material and constraints; or a scene as it is.")
@click.option("--compare", "result", type=click.Path(), metavar="RESULT", help="A motion of --scene to be judged.")
@click.option("--tolerance", type=click.FloatRange(0.0, 1.0, min_open=True), help="Of --compare; 0.02 by default.")
@click.option(
    "--solver", type=click.Path(), metavar="FILE.py:FUNCTION", help="Your own solver, through the same cases."
)
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Of the scene: --set bodies.0.nu=0.49")
@click.option("--device", type=click.Choice(("cpu", "cuda")), default="cpu", show_default=True)
@click.option("--report", type=click.Path(path_type=Path), metavar="DIR", help="Write JSON, JUnit, Markdown and HTML.")
@click.option(
    "--json",
    "json_path",
    type=click.Path(),
    metavar="PATH",
    help="Write the record to PATH; - prints it and nothing else.",
)
@click.option("--force", is_flag=True, help="Overwrite an existing file; write into a folder that holds other files.")
@click.pass_context
def command(
    ctx: click.Context,
    listing: bool,
    pattern: str | None,
    quick: bool | None,
    mesh: str | None,
    scene: str | None,
    result: str | None,
    tolerance: float | None,
    solver: str | None,
    settings: tuple[str, ...],
    device: str,
    report: Path | None,
    json_path: str | None,
    force: bool,
) -> None:
    """Run the verification suite: every row is a computed number, its reference, and what may lie between them.

    \b
    femgal verify                         quick rows, below a minute of CPU time
    femgal verify -k material --full      all rows of a topic
    femgal verify --full --report out/    out/verify.html shows everything
    femgal verify --mesh body.msh         what is wrong with a mesh; --scene or --set give its material
    femgal verify --compare out/ --scene drape.toml    somebody's result (.vtkhdf, .pvd, .csv) against the reference
    femgal verify --solver my_solver.py:step           a solver of your own; verify/integrators/under_test.py says how
    Exit codes: 0 all pass, 1 failures (of --mesh also a problem found), 2 could not run, 130 interrupted.
    """  # noqa: D301 - click reads the backspace
    from femgal.commands.comparison import carry_out_comparison
    from femgal.commands.diagnosis import carry_out_diagnosis, find_rows, find_user_target
    from verify.suite.use import Use

    quick = not listing if quick is None else quick
    if result is not None:
        if mesh is not None or listing or pattern is not None or solver is not None:
            raise click.UsageError("--compare goes with --scene, and not with --mesh, --solver, --list or -k")
        use, outputs = Use(device), Outputs(report, json_path, force)
        ctx.exit(carry_out_comparison(result, scene, settings, tolerance, use, outputs, typed_command(ctx)))
    if tolerance is not None:
        raise click.UsageError("--tolerance goes with --compare")
    if solver is not None and (mesh is not None or scene is not None or settings):
        raise click.UsageError("--solver goes without --mesh, --scene and --set: its cases bring their own bodies")
    target, choose = find_user_target(mesh, scene, settings), _chooser(solver)
    rows = choose(pattern, quick=quick) if target is None else find_rows(target, pattern, quick)
    if listing:
        from verify.suite.listing import listing as lines_of

        click.echo("\n".join(lines_of(rows)))
        return
    outputs = Outputs(report, json_path, force)
    _need_packages()
    use = Use(device)
    _need_device(use)
    if target is not None:
        ctx.exit(carry_out_diagnosis(target, rows, use, outputs, typed_command(ctx)))
    more = len(choose(pattern, quick=False)) - len(rows)
    ctx.exit(carry_out(rows, use, outputs, typed_command(ctx), _left_out(more)))


def _chooser(solver: str | None) -> Callable[..., list[Row]]:
    """Chooses rows by pattern and quick: those of the suite, or those of a solver of one's own."""
    from functools import partial

    from verify.suite.run import choose

    if solver is None:
        return choose
    from verify.integrators.plug_in import load_solver, own_solver_rows

    return partial(own_solver_rows, load_solver(solver))


class Outputs:
    """Where the results go, checked before anything is computed.

    Raises
    ------
    InputError
        A file or a folder cannot be written, or holds something else.
    """

    def __init__(self, report: Path | None, json_path: str | None, force: bool) -> None:
        from femgal.output.report import prepare_report
        from meshes.io.source import writable
        from reports.verification.render import NAMES

        self.json_alone = json_path == "-"
        self.file = writable(Path(json_path), force=force) if json_path and not self.json_alone else None
        self.folder = prepare_report(report, NAMES, force=force) if report else None

    def write(self, record: dict[str, Any]) -> list[Path]:
        """Write what was asked for and return the paths; print the record where it was asked for."""
        from femgal.output.atomic import write_text
        from femgal.output.report import write_report
        from reports.verification.render import json_text, render

        if self.json_alone:
            click.echo(json_text(record), nl=False)
        if self.file is not None:
            write_text(self.file, json_text(record))
        if self.folder is not None:
            write_report(self.folder, render(record))
        return [path for path in (self.file, self.folder) if path is not None]


def carry_out(
    rows: Sequence[Row],
    use: Use,
    outputs: Outputs,
    typed: str,
    left_out: dict[str, str],
    more: Mapping[str, Any] | None = None,
) -> int:
    """Run rows, show and write their results, and return the exit code; Ctrl-C ends the run, not the report.

    Parameters
    ----------
    typed : The command, for the reader of the report.
    left_out : What is not run, and why.
    more : Entries of the record beside those of the suite.
    """
    from femgal.commands.suite_progress import SuiteProgress
    from verify.suite.record import as_row, record
    from verify.suite.run import Result, run_all

    results: list[Result] = []
    began = time.perf_counter()

    def finish(result: Result) -> None:
        results.append(result)
        progress.finish(as_row(result))

    with SuiteProgress(len(rows), on_stderr=outputs.json_alone) as progress, contextlib.suppress(KeyboardInterrupt):
        run_all(rows, use, progress.start, finish)
    if unasked := sum("set step." in one.note for one in results if one.status.value == "SKIP"):
        left_out = {f"{unasked} of these rows": "they need step.method or step.order, which is not set"} | left_out
    if missing := len(rows) - len(results):
        left_out = {_rows(missing): "interrupted"} | left_out
    content = record(results, use, typed, wall_seconds=time.perf_counter() - began, not_run=left_out) | dict(more or {})
    progress.summary(content)
    for path in outputs.write(content):
        progress.print(f"wrote {path}")
    return INTERRUPTED if missing else _exit_code(content["summary"]["status"])


def _exit_code(status: dict[str, int]) -> int:
    if status["FAIL"]:
        return FAILURES
    return 0 if status["PASS"] or status["INFO"] else NOT_RUN


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"


def typed_command(ctx: click.Context) -> str:
    """The command as it was typed, but of paths the last part only: folders are nobody's business."""
    words = ["femgal", str(ctx.info_name)]
    for option in ctx.command.params:
        value = ctx.params[str(option.name)]
        if ctx.get_parameter_source(str(option.name)) is not ParameterSource.COMMANDLINE:
            continue
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(option, click.Argument):
                words.append(shlex.quote(Path(str(one)).name))
                continue
            words.append(option.secondary_opts[0] if one is False else option.opts[0])
            if not isinstance(one, bool):
                words.append(shlex.quote(Path(one).name if isinstance(option.type, click.Path) else str(one)))
    return " ".join(words)


def _left_out(more: int) -> dict[str, str]:
    from verify.suite.use import DEVICES, unavailable

    reasons = {device: reason for device in DEVICES if (reason := unavailable(device))}
    return ({_rows(more): "they take longer; --full runs them"} if more else {}) | reasons


def _need_packages() -> None:
    from importlib.util import find_spec

    from meshes.errors import InputError

    packages = {"skfem": "scikit-fem", "pyamg": "pyamg"}
    missing = [name for module, name in packages.items() if find_spec(module) is None]
    if missing:
        raise InputError(
            "the references need packages that are not installed",
            where="femgal verify",
            found="no " + ", no ".join(missing),
            advice='pip install "femgal[verify]"',
        )


def _need_device(use: Use) -> None:
    from meshes.errors import InputError
    from verify.suite.use import DEVICES, unavailable

    if reason := unavailable(use.device):
        allowed = ", ".join(name for name in DEVICES if not unavailable(name))
        raise InputError(
            "the device cannot be used here", where="--device", found=f"{use.device}: {reason}", allowed=allowed
        )
