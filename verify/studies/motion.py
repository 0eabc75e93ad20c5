# SPDX-License-Identifier: BSD-3-Clause
"""A part of a study that solves whole motions: a grid of `femgal bench`, and what the levels cost on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from verify.studies.definition import MOST_OF_REFERENCES, Part
from verify.studies.entries import motion_entries
from verify.work_precision.executor import Executor
from verify.work_precision.grid import Grid
from verify.work_precision.record import make_record
from verify.work_precision.store import Store
from verify.work_precision.study import Options, Study


@dataclass(frozen=True, eq=False)
class Bench:
    """Where and how runs are made.

    Parameters
    ----------
    store, references : Folders of runs and of references.
    executor : Carries out runs.
    options : Which time counts.
    announce : Told what begins, and what has ended how.
    """

    store: Store
    references: Store
    executor: Executor
    options: Options
    announce: Callable[[str], None] = lambda text: None


class MotionPart:
    """Whole motions; scenes beyond a size have no reference, and so no trajectory error.

    Raises
    ------
    InputError
        No such scene or solver, or settings that one does not have.
    """

    def __init__(self, part: Part, bench: Bench) -> None:
        self.part = part
        self.studies = [
            Study(grid, bench.store, bench.references, bench.executor, _options(bench, known), bench.announce)
            for grid, known in _split(part.make_grid())
        ]

    def run(self) -> None:
        """Run what is missing."""
        for study in self.studies:
            study.run()

    def record(self) -> dict[str, Any]:
        """Problems, rows and entries, JSON-ready."""
        records = [make_record(study, "") for study in self.studies]
        rows = [row for record in records for row in record["rows"]]
        return {
            "problems": [problem for record in records for problem in record["problems"]],
            "rows": rows,
            "entries": motion_entries(rows, self.part.levels, self.part.targets),
        }


def _split(grid: Grid) -> list[tuple[Grid, bool]]:
    """The grid of the sizes that have a reference, and that of the others."""
    if not grid.vertices:
        return [(grid, True)]
    small = tuple(size for size in grid.vertices if size <= MOST_OF_REFERENCES)
    large = tuple(size for size in grid.vertices if size > MOST_OF_REFERENCES)
    parts = ((small, True), (large, False))
    return [(grid.model_copy(update={"vertices": sizes}), known) for sizes, known in parts if sizes]


def _options(bench: Bench, references: bool) -> Options:
    return replace(bench.options, references=references)
