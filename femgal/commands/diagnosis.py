# SPDX-License-Identifier: BSD-3-Clause
"""`femgal verify --mesh`: rows of the suite on a user's own mesh, and a table of what is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from femgal.commands.verify import Outputs
    from verify.diagnose.target import Target
    from verify.suite.case import Row
    from verify.suite.use import Use

COLOURS = {"ok": "green", "note": "blue", "warning": "yellow", "problem": "bold red"}
_WIDTH = 110


def find_user_target(mesh: str | None, scene: str | None, settings: tuple[str, ...]) -> Target | None:
    """The user's own mesh or scene; None where the suite's own meshes are meant."""
    if mesh is None and scene is None:
        if settings:
            raise click.UsageError("--set changes a scene: give --mesh or --scene")
        return None
    from femgal.scene.overrides import parse_override
    from verify.diagnose.target import find_target

    return find_target(mesh, scene, dict(parse_override(text) for text in settings))


def find_rows(target: Target, pattern: str | None, quick: bool) -> list[Row]:
    """Rows of the suite that are true on any mesh."""
    from verify.diagnose.rows import own_rows

    return own_rows(target, pattern, quick=quick)


def carry_out_diagnosis(target: Target, rows: Sequence[Row], use: Use, outputs: Outputs, typed: str) -> int:
    """Look at the mesh, run the rows on it, and return the exit code: 1 also where there is a problem."""
    from femgal.commands.verify import FAILURES, carry_out
    from verify.diagnose.diagnosis import diagnose
    from verify.diagnose.finding import Severity

    found = diagnose(target, lambda text: click.echo(f"{text} ...", err=True))
    code = carry_out(rows, use, outputs, typed, {}, {"diagnosis": found.as_dict()})
    print_diagnosis(found.as_dict(), on_stderr=outputs.json_alone)
    return code or (FAILURES if found.worst is Severity.PROBLEM else 0)


def print_diagnosis(diagnosis: Mapping[str, Any], *, on_stderr: bool = False) -> None:
    """Print a table of all findings, the counts below it.

    Parameters
    ----------
    diagnosis : As `verify.diagnose.diagnosis.Diagnosis.as_dict` makes it.
    on_stderr : Whether standard output belongs to somebody else.
    """
    console = Console(stderr=on_stderr, highlight=False)
    if not console.is_terminal:
        console = Console(stderr=on_stderr, highlight=False, width=_WIDTH)
    console.print()
    console.print(_table(diagnosis))
    console.print(Text(summary(diagnosis)))


def summary(diagnosis: Mapping[str, Any]) -> str:
    """One sentence: how many findings of which severity."""
    counts = diagnosis["counts"]
    shown = [f"{n} {severity}{'s' if n != 1 and severity != 'ok' else ''}" for severity, n in counts.items() if n]
    return f"{diagnosis['name']}: " + ", ".join(reversed(shown))


def _table(diagnosis: Mapping[str, Any]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=f"Diagnosis of {diagnosis['name']}", title_justify="left")
    table.add_column("")
    table.add_column("about", no_wrap=True)
    table.add_column("what was found, and what to do", overflow="fold")
    for finding in diagnosis["findings"]:
        severity = finding["severity"]
        said = Text(finding["what"])
        if finding["advice"]:
            said.append("\n-> " + finding["advice"], "bold")
        table.add_row(Text(severity.upper() if severity != "ok" else "ok", COLOURS[severity]), finding["topic"], said)
    return table
