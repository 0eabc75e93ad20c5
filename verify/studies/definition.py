# SPDX-License-Identifier: BSD-3-Clause
"""What a study is: grids to run, levels to reach, claims to judge. Each is a TOML file in `definitions`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from femgal.scene.problems import close_match, scene_error
from femgal.scene.quantities import Count, NotEmpty, Number, Text
from femgal.scene.shapes import Table
from meshes.errors import InputError
from verify.studies.published import published_tables
from verify.work_precision.grid import Grid, make_grid

# In the order of the paper.
NAMES = (
    "smoothers",
    "substeps",
    "against-vbd-sgm",
    "sizes",
    "stiffness",
    "ratios-cycles",
    "five-million",
)

# Vertices from which on a Verlet reference takes longer than the study itself.
MOST_OF_REFERENCES = 20_000

What = Literal["seconds", "passes", "iterations", "substeps", "eps18", "error", "seconds per frame", "peak_mb"]


class Claim(Table):
    """A statement of the paper that figures can support or refute.

    Attributes
    ----------
    text : The statement, in our words.
    source : Where the paper says so.
    part : Id of the part whose figures judge it.
    rule : "at-most": `what` of a curve is at most `factor` times that of every other one named; "trend": from the
        first to the last value of the axis, `what` of a curve (or, with `than`, that of the other over that of the
        curve) changes by a factor between `least` and `most`; "inner-minimum": over the substeps, seconds of a curve
        are least neither at their fewest nor at their most.
    what : Quantity. Up to "substeps" it is that of reaching a level; the others are those of a curve's only row, or the
        largest of its rows.
    measure : Which levels: of eps18, or of our error.
    of, than : Curves.
    at : Values of the axis that the claim is about; empty for all.
    """

    text: Text
    source: Text
    part: Text
    rule: Literal["at-most", "trend", "inner-minimum"] = "at-most"
    what: What = "seconds"
    measure: Literal["eps18", "error"] = "eps18"
    of: Annotated[tuple[Text, ...], NotEmpty]
    than: tuple[Text, ...] = ()
    factor: Annotated[Number, Field(gt=0)] = 1.0
    least: Number | None = None
    most: Number | None = None
    at: tuple[Number, ...] = ()


class Part(Table):
    """One grid of a study.

    Attributes
    ----------
    kind : "motion": whole motions, row by row as in `femgal bench`; "substep": one step, iteration by iteration.
    about : What was chosen where the paper leaves it open.
    grid : Keys of `verify.work_precision.grid.Grid`.
    substeps : Of every solver that does not say otherwise.
    options : Of a single substep (`verify.work_precision.run_substep`).
    quick : Keys of `grid`, and `substeps` and `options`, that replace the others with ``--quick``.
    levels : To reach: of eps18 in metres, for a single substep as shares of the prediction's.
    targets : To reach of our error: trajectory error, for a single substep the distance from the minimiser.
    baseline : Curve that others are compared with.
    axis : What the problems differ in.
    table : Name of the published table to print beside.
    plots : Pairs of quantities of the rows to draw: "seconds eps18".
    """

    id: Text
    kind: Literal["motion", "substep"]
    title: Text
    source: Text
    about: Text
    grid: dict[str, Any]
    substeps: tuple[Count, ...] = ()
    options: dict[str, Any] = Field(default_factory=dict)
    quick: dict[str, Any] = Field(default_factory=dict)
    levels: Annotated[tuple[Annotated[Number, Field(gt=0)], ...], NotEmpty]
    targets: Annotated[tuple[Annotated[Number, Field(gt=0)], ...], NotEmpty]
    baseline: Text = ""
    axis: Literal["vertices", "E", ""] = ""
    table: Text = ""
    plots: tuple[Text, ...] = ()

    def shrunk(self) -> Part:
        """The quick version, with three of a solver's own numbers of substeps at most."""
        own = {key: value for key, value in self.quick.items() if key in ("substeps", "options")}
        grid = {**self.grid, **{key: value for key, value in self.quick.items() if key not in own}}
        grid["solvers"] = list(map(_thinned, grid["solvers"]))
        return Part.model_validate({**self.model_dump(), **own, "grid": grid, "quick": {}})

    def with_grid(self, **changes: Any) -> Part:
        """With other values of some of the grid's keys."""
        return self.model_copy(update={"grid": {**self.grid, **changes}})

    def make_grid(self) -> Grid:
        """The grid.

        Raises
        ------
        InputError
            Keys or values that a grid cannot have.
        """
        solvers = [self._with_substeps(solver) for solver in self.grid["solvers"]]
        return make_grid({**self.grid, "solvers": solvers, "targets": list(self.targets)}, f"study part {self.id}")

    def _with_substeps(self, solver: Mapping[str, Any]) -> dict[str, Any]:
        return {"substeps": list(self.substeps), **solver} if self.substeps else dict(solver)


def _thinned(solver: Mapping[str, Any]) -> dict[str, Any]:
    """With the first, the middle and the last of its numbers of substeps."""
    counts = solver.get("substeps")
    if not isinstance(counts, list) or len(counts) <= 3:
        return dict(solver)
    return {**solver, "substeps": [counts[0], counts[len(counts) // 2], counts[-1]]}


class StudyDefinition(Table):
    """A study.

    Attributes
    ----------
    title, question : For people.
    """

    name: Text
    title: Text
    question: Text
    parts: Annotated[tuple[Part, ...], NotEmpty]
    claims: tuple[Claim, ...] = ()

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        parts = {part.id: part for part in self.parts}
        for part in self.parts:
            if part.table and part.table not in published_tables():
                raise PydanticCustomError("table", "no such published table", {"key": "table", "found": part.table})
        for claim in self.claims:
            curves = _curves(parts[claim.part]) if claim.part in parts else set()
            unknown = {*claim.of, *claim.than} - curves
            if unknown:
                context = {"key": "claims", "found": f"{claim.part}: {', '.join(sorted(unknown))}"}
                raise PydanticCustomError("curves", "no such part or curve", context)
        return self

    def shrunk(self) -> StudyDefinition:
        """The quick version: minutes in place of hours."""
        return self.model_copy(update={"parts": tuple(part.shrunk() for part in self.parts)})

    def with_grid(self, **changes: Any) -> StudyDefinition:
        """With other values of some keys of every grid."""
        return self.model_copy(update={"parts": tuple(part.with_grid(**changes) for part in self.parts)})

    def with_levels(self, levels: Sequence[float]) -> StudyDefinition:
        """With other levels of eps18 in every part.

        Raises
        ------
        InputError
            None, or one that is not positive.
        """
        if not levels or min(levels) <= 0.0:
            raise InputError("not levels", where="--levels", found=str(list(levels)), allowed="positive numbers")
        changed = tuple(part.model_copy(update={"levels": tuple(map(float, levels))}) for part in self.parts)
        return self.model_copy(update={"parts": changed})


def _curves(part: Part) -> set[str]:
    return {solver.get("label", solver["name"]) for solver in part.grid["solvers"]}


def load_definition(name: str) -> StudyDefinition:
    """Read a study by its name.

    Raises
    ------
    InputError
        There is no such study.
    """
    if name not in NAMES:
        allowed = ", ".join(NAMES)
        raise InputError("no such study", found=repr(name), allowed=allowed, advice=close_match(name, NAMES))
    text = files("verify.studies").joinpath("definitions", f"{name}.toml").read_text(encoding="utf-8")
    try:
        return StudyDefinition.model_validate({"name": name, **tomllib.loads(text)})
    except ValidationError as error:
        raise scene_error(error, StudyDefinition, f"study {name}") from None
