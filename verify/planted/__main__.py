# SPDX-License-Identifier: BSD-3-Clause
"""``python -m verify.planted``: plant every bug, one at a time, and print which case turned red.

The rows that the bugs name are run on the sound sources first: a row that is red without a bug proves nothing.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import click

from verify.planted.bugs import BUGS, Bug
from verify.planted.plant import Catch, copy_sources, run_cases, run_planted

_SHOWN = 3


@click.command()
@click.option("--only", default="", help="Bugs whose name has this in it.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write what was found to this file.")
def main(only: str, json_path: Path | None) -> None:
    """Plant bugs one at a time; exit code 1 when one stays green or a sound row is red."""
    chosen = [bug for bug in BUGS if only in bug.name]
    if not chosen:
        raise click.UsageError(f"no bug has {only!r} in its name")
    with tempfile.TemporaryDirectory() as folder:
        tree, cache = copy_sources(Path(folder) / "sources"), Path(folder) / "cache"
        sound = run_cases(Bug("no bug", "", "", "", " ".join(sorted({bug.cases for bug in chosen}))), tree, cache)
        click.echo(_line(sound))
        catches = []
        for bug in chosen:
            catches.append(run_planted(bug, tree, cache))
            click.echo(_line(catches[-1]))
    caught = sum(one.caught for one in catches)
    click.echo(f"{caught} of {len(chosen)} bugs caught, {sum(one.seconds for one in catches):.0f} s")
    if json_path is not None:
        json_path.write_text(json.dumps([asdict(one) for one in (sound, *catches)], indent=1) + "\n", encoding="utf-8")
    sys.exit(0 if caught == len(chosen) and not sound.red and not sound.trouble else 1)


def _line(catch: Catch) -> str:
    if catch.trouble:
        return f"{catch.bug.name} | {catch.bug.file} | {catch.trouble}"
    first = ", ".join(catch.red[:_SHOWN]) or "none"
    more = f" and {len(catch.red) - _SHOWN} more" if len(catch.red) > _SHOWN else ""
    return f"{catch.bug.name} | {catch.bug.file} | red: {first}{more} ({len(catch.green)} green)"


if __name__ == "__main__":
    main()
