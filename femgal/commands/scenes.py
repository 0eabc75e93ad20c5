# SPDX-License-Identifier: BSD-3-Clause
"""``femgal scenes``: what the built-in scenes are, and their files to start from."""

from __future__ import annotations

import json
from typing import Any

import click


@click.command("scenes")
@click.option("--show", "name", metavar="NAME", help="Print the scene file of NAME, which runs as it is.")
@click.option("--json", "as_json", is_flag=True, help="Print the list as one JSON array.")
def command(name: str | None, as_json: bool) -> None:
    """List the built-in scenes.

    Every scene runs at any vertex count: `femgal run SCENE --vertices N` gives N to every body. To make your own,
    save one with `femgal scenes --show NAME > my.toml`, change it, and run `femgal run my.toml`.
    """
    if name is not None and as_json:
        raise click.UsageError("--show prints a TOML file; leave --json out")
    if name is not None:
        from femgal.scene import builtin

        click.echo(builtin.text(name), nl=False)
    elif as_json:
        click.echo(json.dumps(_summaries(), indent=2))
    else:
        _print_table(_summaries())


def _summaries() -> list[dict[str, Any]]:
    from femgal.scene import builtin
    from femgal.scene.load import load_scene

    return [_summary(load_scene(name)) for name in builtin.names()]


def _summary(scene: Any) -> dict[str, Any]:
    return {
        "name": scene.name,
        "description": scene.description,
        "bodies": [{"mesh": body.mesh, "vertices": body.vertices} for body in scene.bodies],
        "vertices": sum(body.vertices or 0 for body in scene.bodies),
        "frames": scene.frames,
    }


def _print_table(summaries: list[dict[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("scene", "description", box=None, header_style="bold")
    table.add_column("vertices", justify="right")
    table.add_column("frames", justify="right")
    for row in summaries:
        table.add_row(row["name"], row["description"], str(row["vertices"]), str(row["frames"]))
    Console().print(table)
