# SPDX-License-Identifier: BSD-3-Clause
"""`femgal verify --compare`: somebody else's result for a scene beside the reference, as rows and as a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from femgal.commands.verify import Outputs
    from verify.compare.comparison import Comparison
    from verify.suite.use import Use


def carry_out_comparison(
    result: str,
    scene: str | None,
    settings: tuple[str, ...],
    tolerance: float | None,
    use: Use,
    outputs: Outputs,
    typed: str,
) -> int:
    """Compute or find the reference, print what is right, and return the exit code.

    Raises
    ------
    InputError
        No such result or scene, or the two do not belong together.
    """
    if scene is None:
        raise click.UsageError("--compare needs --scene: what the result is a result of")
    from femgal.commands.verify import carry_out
    from femgal.scene.overrides import parse_override
    from verify.compare.align import align
    from verify.compare.comparison import compare_motion
    from verify.compare.reference import find_reference
    from verify.compare.result import read_motion
    from verify.compare.rows import TOLERANCE, comparison_rows
    from verify.diagnose.target import find_target

    motion = read_motion(Path(result))
    target = find_target(None, scene, dict(parse_override(text) for text in settings))
    align(motion, target)  # what does not belong together is refused before the reference is computed
    reference = find_reference(target, announce=lambda text: click.echo(f"{text} ...", err=True))
    comparison = compare_motion(motion, reference)
    rows = comparison_rows(comparison, TOLERANCE if tolerance is None else tolerance)
    print_comparison(comparison, on_stderr=outputs.json_alone)
    return carry_out(rows, use, outputs, typed, {}, {"comparison": comparison.as_dict()})


def print_comparison(comparison: Comparison, *, on_stderr: bool = False) -> None:
    """Print a table of the frames.

    Parameters
    ----------
    on_stderr : Whether standard output belongs to somebody else.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from verify.compare.hints import hints
    from verify.compare.table import table, verdict

    found = table(comparison)
    console: Any = Console(stderr=on_stderr, highlight=False)
    if not console.is_terminal:
        console = Console(stderr=on_stderr, highlight=False, width=130)
    drawn = Table(title=found.title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for head in found.heads:
        drawn.add_column(Text(head), justify="right")
    for row in found.rows:
        drawn.add_row(*row)
    console.print(drawn)
    console.print(Text(verdict(comparison) + "."), soft_wrap=True)
    for line in hints(comparison):
        console.print(Text(line), soft_wrap=True)
