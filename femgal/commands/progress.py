# SPDX-License-Identifier: BSD-3-Clause
"""Progress of a run on the terminal: a bar where one can be drawn, plain lines where not."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from femgal.runner import Progress
from femgal.simulation import Simulation


def percent(share: float) -> str:
    """A share in per cent, two digits: 0.73%."""
    return f"{100.0 * share:.2g}%"


class TerminalProgress(Progress):
    """Says what is being built, compiled and solved; use as a context manager."""

    def __init__(self, *, quiet: bool = False) -> None:
        self._console = Console(stderr=True, quiet=quiet, highlight=False, soft_wrap=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
        )
        self._bar = Bar(*columns, console=self._console, disable=quiet or not self._console.is_terminal)
        self._task: Any = None
        self._since = time.perf_counter()
        self._doing = ""

    def __enter__(self) -> TerminalProgress:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        # The terminal may be gone by now; the run is not.
        with contextlib.suppress(OSError):
            self._bar.stop()

    def announce(self, text: str) -> None:
        """Print how long the last thing took; on a terminal also what comes next."""
        self._close()
        self._doing, self._since = text, time.perf_counter()
        if self._console.is_terminal:
            self._console.print(f"{text} ...", style="dim")

    def start(self, simulation: Simulation, first_frame: int) -> None:
        """Print mesh and warnings, and start the bar."""
        self._close()
        disc, scene = simulation.disc, simulation.scene
        for body in simulation.world.origins:
            origin = f"{body['name']} ({body['source']}" + (
                f", sha256 {body['sha256'][:12]})" if body["sha256"] else ")"
            )
            self._console.print(f"mesh {origin}: {body['vertices']} vertices, {body['tets']} tetrahedra")
        if simulation.mass_scaling:
            self._console.print(f"mass scaling: {simulation.mass_scaling}")
        for warning in simulation.world.warnings:
            self._console.print(f"warning: {warning}", style="yellow")
        if simulation.choice:
            self._console.print(f"chosen: {simulation.choice}")
        threads = simulation.backend.threads
        self._console.print(f"{scene.name}: {disc.n_tets} tetrahedra, solver {scene.solver.name}, {threads} thread(s)")
        self._task = self._bar.add_task("solving", total=scene.frames + 1, completed=first_frame, note="")

    def substep(self, substep: int, substeps: int) -> None:
        """Show the substep, at most some ten times a frame."""
        if substep % max(1, substeps // 10) == 0:
            self._bar.update(self._task, note=f"substep {substep}/{substeps}")

    def frame(self, row: Mapping[str, Any]) -> None:
        """Advance the bar, or print a line where there is none."""
        note = f"{row['seconds']:.2f} s, energy {row['total_energy']:.4g} J, min J {row['min_J']:.3g}"
        if row.get("estimated_error"):
            note += f", estimated error {percent(row['estimated_error'])}"
        if row["retakes"]:
            note += f", taken again {row['retakes']} time(s), the last with {row['substeps']} substeps"
        self._bar.update(self._task, advance=1, note=note)
        if self._bar.disable:
            self._console.print(f"frame {row['frame']}: {note}")

    def _close(self) -> None:
        if self._doing:
            self._console.print(f"{self._doing}: {time.perf_counter() - self._since:.1f} s", style="dim")
            self._doing = ""
