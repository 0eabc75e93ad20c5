# SPDX-License-Identifier: BSD-3-Clause
"""The command line. Sub-commands are loaded when they are called; `femgal --help` imports none of them."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any, ClassVar

import click

# Exit codes: 2 bad input, 3 a run that failed with its good frames kept, 130 interrupted by the user.
BAD_INPUT, RUN_FAILED, INTERRUPTED = 2, 3, 130


class _LazyGroup(click.Group):
    """Knows the one-line help of each command without importing it."""

    summaries: ClassVar[dict[str, str]] = {
        "run": "Solve a scene and write its frames.",
        "plan": "Print what a run of a scene would do, and what it would skip.",
        "scenes": "List the built-in scenes, or print one as TOML.",
        "mesh": "Make, inspect and convert meshes.",
        "view": "Draw a picture of a run.",
        "verify": "Check the solvers against references, row by row.",
        "bench": "Measure how fast the passes are, and error against time.",
        "doctor": "Print what a run would use on this machine, GPUs included.",
        "study": "Repeat the studies of Lu et al. 2025, beside the paper's figures.",
    }

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.summaries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.summaries:
            return None
        # Dense problems here are small, and threads that wait for a busy core make them a hundred times slower. Read
        # when NumPy is imported, which no command has done yet.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        command: click.Command = importlib.import_module(f"femgal.commands.{cmd_name}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(self.summaries.items()))

    def invoke(self, ctx: click.Context) -> Any:
        # Imported here: the error type lives with the meshes, and help must stay light.
        from meshes.errors import InputError

        try:
            return super().invoke(ctx)
        except InputError as error:
            click.echo(f"error: {error}", err=True)
            ctx.exit(BAD_INPUT)
        except MemoryError as error:
            click.echo(f"error: not enough memory: {error}\n  do:      ask for fewer vertices", err=True)
            ctx.exit(BAD_INPUT)


def _print_version(ctx: click.Context, _option: click.Parameter, value: bool) -> None:
    if value:
        from femgal import __version__

        click.echo(f"femgal {__version__}")
        ctx.exit()


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--version", is_flag=True, expose_value=False, is_eager=True, callback=_print_version)
def main() -> None:
    """Elastodynamics of tetrahedral bodies with matrix-free Galerkin multigrid.

    \b
    femgal run rabbit-drape --out out/      solve the default scene
    femgal view out/ --png                  draw its last frame
    """  # noqa: D301 - click reads the backspace


if __name__ == "__main__":
    sys.exit(main())
