# SPDX-License-Identifier: BSD-3-Clause
"""`femgal run`: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from femgal.commands.options import scene_from_options, scene_options


@click.command()
@scene_options
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for everything that is written.")
@click.option("--resume", is_flag=True, help="Go on with the run in --out from its last checkpoint.")
@click.option("--format", "file_format", help="vtkhdf (one file) or vtu (one file per frame).")
@click.option("--fields", help="Output fields, separated by commas: displacement,velocity,von_mises,J ...")
@click.option("--quiet", is_flag=True, help="Print errors only.")
@click.pass_context
def command(
    ctx: click.Context,
    out: Path,
    resume: bool,
    file_format: str | None,
    fields: str | None,
    quiet: bool,
    settings: tuple[str, ...],
    **options: Any,
) -> None:
    """Solve SCENE, a built-in name or a TOML file (default: rabbit-drape), and write its frames to --out.

    \b
    --out holds frames.vtkhdf (open it in ParaView >= 5.12), run.json,
    scene.toml and checkpoint.h5. With --resume SCENE may be left out.
    Exit codes: 0 done, 2 bad input, 3 the run failed and its good frames
    are kept, 130 interrupted.
    """  # noqa: D301 - click reads the backspace
    if file_format:
        settings = (*settings, f'output.format="{file_format}"')
    if fields:
        names = ", ".join(f'"{name.strip()}"' for name in fields.split(","))
        settings = (*settings, f"output.fields=[{names}]")
    if resume and options["scene"] is None:
        options["scene"] = str(_scene_of(out))
    scene = scene_from_options(settings=settings, **options)
    from femgal.commands.progress import TerminalProgress
    from femgal.runner import run

    with TerminalProgress(quiet=quiet) as progress:
        result = run(scene, out, resume=resume, progress=progress, signals=True)
    _report(result, quiet)
    ctx.exit({"finished": 0, "failed": 3, "interrupted": 130}[result.status])


def _scene_of(out: Path) -> Path:
    """The scene that the run in a folder was begun with."""
    from femgal.output.folder import SCENE_FILE
    from meshes.errors import InputError

    path = out / SCENE_FILE
    if not path.is_file():
        advice = "name the SCENE, or leave out --resume to start from the beginning"
        raise InputError("nothing to resume", where=str(out), found=f"no {SCENE_FILE}", advice=advice)
    return path


def _report(result: Any, quiet: bool) -> None:
    if result.status == "failed":
        kept = f"{len(result.rows)} good frame(s) of this call are kept in {result.out}"
        click.echo(f"error: {result.failure}\n  kept:    {kept}", err=True)
    elif result.status == "interrupted":
        click.echo(f"interrupted; go on with: femgal run --out {result.out} --resume", err=True)
    elif not quiet and not result.rows:
        click.echo(f"{result.out}: all {result.simulation.scene.frames} frames are there; --frames N makes it longer")
    elif not quiet:
        seconds = sorted(row["seconds"] for row in result.rows[1:]) or [0.0]
        click.echo(f"{result.out}: {len(result.rows)} frames, {seconds[len(seconds) // 2]:.2f} s per frame (median)")
        _report_error(result)


def _report_error(result: Any) -> None:
    """Say how the accuracy that was asked for has been kept."""
    from femgal.commands.progress import percent

    asked, estimated = result.simulation.scene.solver.accuracy, result.estimated_error
    if asked is not None and estimated is not None:
        missed = " - not kept: earlier errors cannot be undone" if estimated > asked else ""
        click.echo(f"estimated trajectory error {percent(estimated)} (asked: {percent(asked)}){missed}")
