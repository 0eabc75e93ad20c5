# SPDX-License-Identifier: BSD-3-Clause
"""Error and time of the motion of one scene, for several solvers, substeps and precisions.

The reference is velocity Verlet in double precision at a share of its stable step. Verlet at its default step is a row
of the table like every other; as its error falls with the square of the step, its distance from the reference says how
large the reference's own error is: a third of it with half the step.

Every run is kept in a folder under a digest of scene and sources: an interrupted study goes on where it was, another
row costs one run.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

import femgal
import meshes
from femgal import __version__
from femgal.scene.model import Scene
from femgal.scene.problems import scene_error
from femgal.scene.write import scene_to_toml
from meshes.errors import InputError
from verify.benchmark import motion_run
from verify.benchmark.machine import describe_machine
from verify.benchmark.trajectory import trajectory_error

# Of the stable step; half of what Verlet takes on its own.
REFERENCE_SAFETY = 0.45
SCHEMA = "femgal-bench-motion-1"


@dataclass(frozen=True)
class Candidate:
    """Settings of one row: keys of the scene's solver table that differ from the scene's own.

    ``print(candidate)`` names transfer, step lengths, substeps, precision and what else was set.
    """

    settings: tuple[tuple[str, Any], ...]

    def scene(self, base: Scene) -> Scene:
        """The scene with these settings."""
        data = base.model_dump()
        settings = dict(self.settings)
        if settings.get("name") == "verlet":
            # What the other solvers are asked for is not for this one.
            data["solver"] = {"threads": data["solver"]["threads"]}
        data["solver"].update(settings)
        try:
            return Scene.model_validate(data)
        except ValidationError as error:
            raise scene_error(error, Scene, str(self)) from None

    def __str__(self) -> str:
        given = dict(self.settings)
        if given.get("name") == "verlet":
            return f"verlet {given['precision']}" + (f" safety {given['safety']}" if "safety" in given else "")
        transfer = "linear" if given["transfer"] == "linear" else f"clusters {given['ratio']}"
        more = [f"{key} {value}" for key, value in self.settings if key not in _NAMED]
        return " ".join([f"{transfer} {given['steps']} {given['substeps']} {given['precision']}", *more])


# Settings that a label of FAS shows without their names, or not at all.
_NAMED = {"name", "mass_scaling", "transfer", "ratio", "steps", "substeps", "precision"}

VERLET = (("name", "verlet"), ("substeps", None), ("precision", "float64"))


def candidates(
    substeps: Sequence[int],
    steps: Sequence[str],
    precisions: Sequence[str],
    transfers: Sequence[tuple[str, int]],
    variants: Sequence[tuple[tuple[str, Any], ...]] = ((),),
) -> list[Candidate]:
    """Every combination, those of one precision together, beside Verlet in every precision.

    Parameters
    ----------
    variants : Further keys of the solver table and their values, each a set of its own: ((), (("cycle", "V"),)).
    """
    rows = []
    for precision in precisions:
        rows.append(Candidate((*VERLET[:-1], ("precision", precision))))
        for (transfer, ratio), variant, rule, count in itertools.product(transfers, variants, steps, substeps):
            settings = (
                ("name", "fas"),
                ("mass_scaling", None),
                ("transfer", transfer),
                ("ratio", ratio),
                ("steps", rule),
                ("substeps", count),
            )
            rows.append(Candidate((*settings, ("precision", precision), *variant)))
    return rows


@dataclass(frozen=True)
class Row:
    """Numbers of one candidate.

    Parameters
    ----------
    label : Its settings.
    seconds : Wall time of every frame [s], compilation apart.
    passes : Passes over the elements per frame, by kind.
    error : Relative trajectory error against the reference; infinite when the run failed.
    growth : Largest total energy of any frame over the first, in units of the energy that the start had above rest.
    run : Everything else that the run told, as in `verify.benchmark.motion_run`.
    """

    label: str
    seconds: tuple[float, ...]
    passes: float
    error: float
    growth: float
    run: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, without the rows of the frames."""
        kept = {key: value for key, value in self.run.items() if key not in ("rows", "start")}
        substeps = [row["substeps"] for row in self.run["rows"]]
        return {
            **kept,
            "label": self.label,
            "seconds": list(self.seconds),
            "median_seconds": median(self.seconds) if self.seconds else None,
            "passes": self.passes,
            "error": self.error if np.isfinite(self.error) else None,
            "growth": self.growth if np.isfinite(self.growth) else None,
            "substeps": substeps,
            "retakes": sum(row["retakes"] for row in self.run["rows"]),
        }


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """A motion that others are held against, and the same at a longer step, which tells how good it is.

    Parameters
    ----------
    label : Its settings.
    mass : Vertex masses [kg], shape [n].
    motion : Displacements since the start [m], shape [frames, n, 3], float32.
    coarser : The same at the default step; fewer frames where that failed.
    factor : Distance of the two in units of the reference's own error.
    numbers : Everything else that the run told, as in `verify.benchmark.motion_run`.
    """

    label: str
    mass: NDArray[np.float64]
    motion: NDArray[np.float32]
    coarser: NDArray[np.float32]
    factor: float
    numbers: dict[str, Any]

    @property
    def own_error(self) -> float:
        """Relative trajectory error of the reference itself; infinite where it is not known."""
        if len(self.coarser) != len(self.motion):
            return float("inf")
        return trajectory_error(self.mass, self.coarser, self.motion, free=self.numbers["free"]) / self.factor


def reference_motion(
    base: Scene,
    work: Path,
    *,
    reference_safety: float = REFERENCE_SAFETY,
    announce: Callable[[str], None] = lambda text: None,
) -> ReferenceMotion:
    """The converged motion of a scene, whatever its solver, from the folder when it is there.

    Raises
    ------
    InputError
        The reference itself fails.
    """
    work.mkdir(parents=True, exist_ok=True)
    reference, default = Candidate((*VERLET, ("safety", reference_safety))), Candidate(VERLET).scene(base)
    numbers, mass, motion = _run(reference.scene(base), work, f"reference ({reference})", announce)
    if numbers["failure"]:
        raise InputError("the reference fails", where=base.name, found=numbers["failure"], advice="see the failure")
    _, _, coarser = _run(default, work, "verlet at its default step", announce)
    # Errors e and (s' / s)^2 e at the shares s and s' of the stable step differ by the second less the first.
    factor = (default.solver.safety / reference_safety) ** 2 - 1.0
    return ReferenceMotion(str(reference), mass, motion, coarser, factor, numbers)


def study(
    base: Scene,
    rows: Sequence[Candidate],
    work: Path,
    *,
    reference_safety: float = REFERENCE_SAFETY,
    announce: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Run what has not been run yet, and compare.

    Parameters
    ----------
    base : The scene; its solver table holds what the candidates leave open.
    work : Folder of the runs; made when it is not there.

    Returns
    -------
    JSON-ready: machine, scene, the reference's own error, one entry per row.
    """
    reference = reference_motion(base, work, reference_safety=reference_safety, announce=announce)
    numbers, own = reference.numbers, reference.own_error
    results = []
    for candidate in rows:
        run, _, moved = _run(candidate.scene(base), work, str(candidate), announce)
        results.append(_row(str(candidate), run, reference.mass, moved, reference.motion, numbers["free"]))
    return {
        "schema": SCHEMA,
        "machine": describe_machine(),
        "version": __version__,
        "scene": base.model_dump(mode="json"),
        "vertices": numbers["vertices"],
        "tets": numbers["tets"],
        "reference": {
            "label": reference.label,
            "substeps": numbers["rows"][-1]["substeps"],
            "own_error": own if np.isfinite(own) else None,
        },
        "rows": [row.as_dict() for row in results],
    }


def _row(label: str, run: dict[str, Any], mass: Any, moved: Any, motion: Any, free: bool) -> Row:
    frames = run["rows"]
    complete = run["failure"] is None and len(moved) == len(motion)
    error = trajectory_error(mass, moved, motion, free=free) if complete else float("inf")
    passes = sum(row["passes"] for row in frames) / max(1, len(frames))
    return Row(label, tuple(row["seconds"] for row in frames), passes, error, _growth(run), run)


def _growth(run: dict[str, Any]) -> float:
    """Largest gain of total energy over the start, over the kinetic and elastic energy of the start."""
    if run["failure"] or not run["rows"]:
        return float("inf")
    start = run["start"]
    scale = start["kinetic_energy"] + start["elastic_energy"]
    gain = max(row["total_energy"] for row in run["rows"]) - start["total_energy"]
    return gain / scale if scale > 0.0 else float("nan")


def _run(scene: Scene, work: Path, label: str, announce: Callable[[str], None]) -> tuple[dict[str, Any], Any, Any]:
    """Numbers, masses and displacements of a scene, from the folder when they are there."""
    text = scene_to_toml(scene)
    name = work / hashlib.sha256(f"{_source_digest()}\n{text}".encode()).hexdigest()[:16]
    if not name.with_suffix(".json").is_file():
        announce(label)
        name.with_suffix(".toml").write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "verify.benchmark.motion_run", str(name.with_suffix(".toml")), str(name)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise InputError("a run ended badly", where=label, found=done.stderr.strip()[-2000:])
    with np.load(name.with_suffix(".npz")) as arrays:
        return json.loads(name.with_suffix(".json").read_text()), arrays["mass"], arrays["displacement"]


@cache
def _source_digest() -> str:
    """Of everything that a run executes: a run of other sources is another run."""
    digest = hashlib.sha256(__version__.encode())
    digest.update(Path(motion_run.__file__).read_bytes())
    for package in (femgal, meshes):
        folder = Path(str(package.__file__)).parent
        for source in sorted(folder.rglob("*.py")):
            digest.update(f"{source.relative_to(folder)}\n".encode() + source.read_bytes())
    return digest.hexdigest()
