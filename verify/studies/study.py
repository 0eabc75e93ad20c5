# SPDX-License-Identifier: BSD-3-Clause
"""A study, run and put together: one JSON object that tables and pages are made of."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from femgal import __version__
from verify.benchmark.machine import describe_machine
from verify.studies.claims import axis_value, judge
from verify.studies.definition import Part, StudyDefinition
from verify.studies.motion import Bench, MotionPart
from verify.studies.published import published_tables
from verify.studies.substep import SubstepPart

SCHEMA = "femgal-study-1"


class PublishedStudy:
    """A study with its folders; refuses at once whatever cannot be run.

    Raises
    ------
    InputError
        No such scene or solver, or settings that one does not have.
    """

    def __init__(self, definition: StudyDefinition, bench: Bench) -> None:
        self.definition, self._bench = definition, bench
        self._parts = [_RUNNERS[part.kind](part, bench) for part in definition.parts]

    def run(self) -> None:
        """Run what is missing.

        Raises
        ------
        InputError
            A scene that cannot be built.
        KeyboardInterrupt
            The user stops; what has ended is kept.
        """
        for part in self._parts:
            part.run()

    def record(self, command: str, *, quick: bool = False) -> dict[str, Any]:
        """Everything that has been measured, with the paper's figures and a verdict on each claim; JSON-ready.

        Parameters
        ----------
        command : What the user typed.
        quick : Whether this is the short version.
        """
        numbers = {part.part.id: part.record() for part in self._parts}
        parts = {part.id: part for part in self.definition.parts}
        return {
            "schema": SCHEMA,
            "command": command,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "version": __version__,
            "machine": describe_machine(),
            "clock": self._bench.options.clock,
            "quick": quick,
            "name": self.definition.name,
            "title": self.definition.title,
            "question": self.definition.question,
            "parts": [_about(part) | numbers[id] | _speedups(part, numbers[id]) for id, part in parts.items()],
            "claims": [judge(claim, parts[claim.part], numbers[claim.part]) for claim in self.definition.claims],
        }


_RUNNERS: dict[str, type[MotionPart] | type[SubstepPart]] = {"motion": MotionPart, "substep": SubstepPart}


def _about(part: Part) -> dict[str, Any]:
    keys = ("id", "kind", "title", "source", "about", "levels", "targets", "baseline", "axis", "plots")
    grid = part.make_grid()
    return {
        **{key: getattr(part, key) for key in keys},
        "curves": list(dict.fromkeys(method.curve for method in grid.methods())),
        "threads": grid.threads,
        "frames": grid.frames,
    }


def _speedups(part: Part, numbers: dict[str, Any]) -> dict[str, Any]:
    """Seconds of the baseline over those of each curve, and the paper's figure beside; empty without a baseline."""
    if not part.baseline:
        return {"speedups": [], "published": None}
    seconds = {(e["problem"], e["curve"], e["measure"], e["level"]): e["seconds"] for e in numbers["entries"]}
    table = published_tables().get(part.table)
    axis = {problem["id"]: axis_value(part, problem) for problem in numbers["problems"]}
    found = []
    for (problem, curve, measure, level), ours in seconds.items():
        base = seconds.get((problem, part.baseline, measure, level))
        found.append(
            {
                "problem": problem,
                "curve": curve,
                "measure": measure,
                "level": level,
                "speedup": base / ours if base and ours else None,
                "published": table.at(curve, axis[problem]) if table else None,
            }
        )
    return {"speedups": found, "published": table.as_dict() if table else None}
