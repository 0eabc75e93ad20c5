# SPDX-License-Identifier: BSD-3-Clause
"""Small scenes and grids for tests of the bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.femgal.scenes import hanging_beam_text
from verify.work_precision.executor import Local
from verify.work_precision.grid import Grid, make_grid
from verify.work_precision.store import Store
from verify.work_precision.study import Options, Study


def beam_file(folder: Path, frames: int = 3) -> Path:
    """A beam of 400 vertices with one end held and the rest moving downwards."""
    path = folder / "beam.toml"
    path.write_text(hanging_beam_text(frames=frames))
    return path


def beam_grid(folder: Path, solvers: list[dict[str, Any]], **keys: Any) -> Grid:
    """A grid over the beam."""
    data = {"scenes": [str(beam_file(folder))], "solvers": solvers, "frames": 2, **keys}
    return make_grid(data, "a test")


def make_study(folder: Path, grid: Grid, executor: Any = None, told: list[str] | None = None, **options: Any) -> Study:
    """A study with both folders below one; what it announces goes to `told`."""
    announce = (lambda text: None) if told is None else told.append
    stores = Store(folder / "runs"), Store(folder / "references")
    return Study(grid, *stores, executor or Local(), Options(**options), announce)
