# SPDX-License-Identifier: BSD-3-Clause
"""What a grid file may say: which scenes, sizes and materials, which solvers with which settings, how to measure.

A grid file is TOML; `EXAMPLE` is one with all keys. Every solver table is one curve of the plots: a list is a choice,
and all combinations of its lists are points of the curve.
"""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from femgal.scene.problems import scene_error
from femgal.scene.quantities import (
    Count,
    Density,
    DihedralAngle,
    NotEmpty,
    Number,
    PoissonsRatio,
    Text,
    Unit,
    Words,
    YoungsModulus,
)
from femgal.scene.shapes import Table
from meshes.errors import InputError
from verify.work_precision.method import Method, check_name

EXAMPLE = """\
# femgal bench --grid grid.toml --work runs
scenes = ["rabbit-drape", "beam-drop.toml"]   # built-in scenes, or files beside this one
vertices = [2000, 20000]      # of every body; left out: as the scene says
E = [1e4, 1e6]                # Young's modulus of every body [Pa]; left out: as the scene says
rho = [1.0, 1000.0]           # density of every body [kg/m^3]
# slivers = [10, 1, 0.1]      # smallest angle [degrees] of tetrahedra that are flattened on purpose
set = { damping = 0.0 }       # any other key of the scenes
periods = 5                   # length of the motion, in periods of the lowest mode that the scene excites
# frames = 20                 # or its length in frames of the scene; with both, frames so short that they end there
threads = 1
time_limit = 600              # seconds of CPU time per thread of a run's frames, after which it counts as failed
repeats = 5                   # runs of the finalists
targets = [0.1, 0.01, 0.001]  # errors that the tables ask the time to

[[solvers]]                   # a table is a curve; a list is a choice, all combinations are points of the curve
name = "verlet"

[[solvers]]
name = "fas"
label = "fas, bdf2"           # name of the curve
stepping = "bdf2"
substeps = [5, 10, 25, 50, 100]
steps = ["exact", "spectral"]
"""

# Substeps per frame where a solver's table leaves them open: a curve needs several points. A substep of the first ones
# is a sweep or a cycle, one of the others a converged solution.
_SWEEPS = (5, 10, 25, 50, 100, 200)
_SOLVES = (1, 2, 4, 8, 16, 32)
_SWEEPING = ("fas", "jacobi", "jacobi-explicit", "scalar-jacobi", "vbd", "vbd-explicit")

# `auto` is asked for accuracies instead.
_ACCURACIES = (0.1, 0.03, 0.01, 0.003, 0.001)


class SolverGrid(BaseModel):
    """One curve: a solver and choices for its settings.

    Attributes
    ----------
    name : A solver of femgal or of `verify.solvers`.
    label : Name of the curve; that of the solver when left out.
    Any other key is one of the solver's, with a value or a list of them.
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    name: Text
    label: Text = ""

    def methods(self) -> list[Method]:
        """All combinations."""
        choices: dict[str, Any] = self._left_open() | dict(self.model_extra or {})
        lists = [value if isinstance(value, list | tuple) else [value] for value in choices.values()]
        if not all(lists):
            empty = next(key for key, value in zip(choices, lists, strict=True) if not value)
            raise InputError("a choice of nothing", where=f"solver {self.name}: {empty}", found="[]")
        curve = self.label or self.name
        return [
            Method(self.name, tuple(zip(choices, map(_hashable, values), strict=True)), curve)
            for values in itertools.product(*lists)
        ]

    def _left_open(self) -> dict[str, Any]:
        """Several points for a curve that does not say which."""
        given = self.model_extra or {}
        if self.name == "verlet" or "substeps" in given or "accuracy" in given:
            return {}
        if self.name == "auto":
            return {"accuracy": list(_ACCURACIES)}
        return {"substeps": list(_SWEEPS if self.name in _SWEEPING else _SOLVES)}


class Grid(Table):
    """A grid of runs.

    Attributes
    ----------
    scenes : Built-in scenes or files.
    vertices, slivers, E, nu, rho : Values for every body, each a list; empty: what the scenes say.
    set : Other keys of the scenes, dotted, and their values.
    solvers : The curves.
    periods : Length of the motion in periods of the lowest mode that the scene excites, but no longer than the scene;
        5 where `frames` is not given either.
    frames : Length of the motion in frames of the scene; with `periods` these frames become so short that they are no
        longer than that.
    threads : CPU threads of every run.
    time_limit : Longest CPU time per thread of the frames of one run [s]; none for references.
    repeats : Runs of each finalist.
    targets : Errors that the tables ask the time to.
    reference_safety : Share of the stable step that the reference takes.
    """

    scenes: Annotated[tuple[Text, ...], NotEmpty, Words("one or more scenes")]
    vertices: tuple[Annotated[Count, Field(ge=8)], ...] = ()
    slivers: tuple[DihedralAngle, ...] = ()
    E: tuple[YoungsModulus, ...] = ()
    nu: tuple[PoissonsRatio, ...] = ()
    rho: tuple[Density, ...] = ()
    set: dict[str, Any] = Field(default_factory=dict)
    solvers: Annotated[tuple[SolverGrid, ...], NotEmpty, Words("one or more [[solvers]] tables")]
    periods: Annotated[Number, Field(gt=0)] | None = None
    frames: Count | None = None
    threads: Count = 1
    time_limit: Annotated[Number, Field(gt=0), Unit("s")] = 600.0
    repeats: Count = 1
    targets: Annotated[tuple[Annotated[Number, Field(gt=0, lt=1)], ...], NotEmpty] = (0.1, 0.01, 0.001)
    reference_safety: Annotated[Number, Field(ge=0.01, le=0.5)] = 0.2

    @model_validator(mode="after")
    def _curves_have_names_of_their_own(self) -> Self:
        names = [solver.label or solver.name for solver in self.solvers]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            context = {"key": "solvers", "found": twice, "advice": "give each of them a label"}
            raise PydanticCustomError("curves", "two curves of one name", context)
        return self

    def methods(self) -> list[Method]:
        """Every method of every curve, those that stand in several curves once for each.

        Raises
        ------
        InputError
            Unknown solver, or a choice of nothing.
        """
        for solver in self.solvers:
            check_name(solver.name, "solvers")
        return list(dict.fromkeys(method for solver in self.solvers for method in solver.methods()))


def load_grid(path: Path, changes: Mapping[str, Any] | None = None) -> Grid:
    """Read a grid file.

    Parameters
    ----------
    changes : Keys that replace those of the file.

    Raises
    ------
    InputError
        No such file, not TOML, or keys or values that a grid cannot have.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError("cannot be read", where=str(path), found=error.strerror, allowed="a TOML file") from None
    except ValueError as error:
        raise InputError(f"not valid TOML: {error}", where=str(path)) from None
    scenes = data.get("scenes")
    if isinstance(scenes, list):
        data["scenes"] = [_beside(path, scene) for scene in scenes]
    return make_grid({**data, **(changes or {})}, str(path))


def make_grid(data: Mapping[str, Any], source: str) -> Grid:
    """Validate a grid.

    Raises
    ------
    InputError
        Keys or values that a grid cannot have.
    """
    try:
        return Grid.model_validate(data)
    except ValidationError as error:
        raise scene_error(error, Grid, source) from None


def _beside(grid: Path, scene: Any) -> Any:
    """A scene file counts from the folder of the grid file."""
    if isinstance(scene, str) and scene.endswith(".toml"):
        return str(grid.parent / scene)
    return scene


def _hashable(value: Any) -> Any:
    return tuple(map(_hashable, value)) if isinstance(value, list) else value
