# SPDX-License-Identifier: BSD-3-Clause
"""``femgal view``: a picture of a run."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("view")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--png",
    type=click.Path(path_type=Path),
    is_flag=False,
    flag_value="",
    help="Picture to write  [default, and with no FILE: RUN/picture.png].",
    metavar="FILE",
)
@click.option("--frame", default="last", show_default=True, metavar="N", help="A number, first or last.")
@click.option("--frames", metavar="A,B,C", help="Several frames side by side, instead of --frame.")
@click.option("--field", metavar="NAME", help="Array to colour by  [default: von_mises, else displacement].")
def command(run: Path, png: Path | None, frame: str, frames: str | None, field: str | None) -> None:
    """Draw the deformed surface of RUN, an output folder or its .vtkhdf or .pvd file.

    Needs pyvista (pip install "femgal[view]"), but no display. To look at a whole run, open its frames.vtkhdf in
    ParaView and apply Warp By Vector with the displacement.
    """
    from femgal.output.read import read_run
    from femgal.output.view import save_picture

    result = read_run(run)
    chosen = [part.strip() for part in frames.split(",")] if frames else [frame]
    target = png if png and png.name else result.path.parent / "picture.png"
    picture = save_picture(result, target, frames=chosen, field=field)
    click.echo(picture)
