# SPDX-License-Identifier: BSD-3-Clause
"""What one process is asked to run, and the name of its result."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, Self

from femgal.scene.model import Scene
from femgal.scene.write import scene_to_toml
from verify.work_precision.method import Method
from verify.work_precision.sources import source_digest

# Raised when a run measures something else than before.
VERSION = 1

Kind = Literal["motion", "survey", "substep"]


@dataclass(frozen=True)
class Request:
    """A run.

    Parameters
    ----------
    kind : "motion": solve the scene; "survey": build it, and say how large and how slow it is; "substep": solve one
        of its steps, iteration by iteration.
    label : For people.
    scene : Text of the scene file.
    solver : Solver of `verify.solvers` in place of the scene's; None for the scene's own.
    settings : Settings of that solver.
    gaps : Substeps whose energy gap is measured.
    options : What a substep is taken at, and for how long it is solved (`verify.work_precision.run_substep`).
    repeat : 0, or the number of the repetition.
    identity : What the result depends on, where that is not the text of the scene and all sources.
    time_limit : Longest CPU time per thread [s]; None for any.
    """

    kind: Kind
    label: str
    scene: str
    solver: str | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    gaps: int = 0
    options: dict[str, Any] = field(default_factory=dict)
    repeat: int = 0
    identity: str | None = None
    time_limit: float | None = None

    @property
    def key(self) -> str:
        """Digest of all that the result depends on but the sources, 16 hexadecimal digits."""
        parts: tuple[Any, ...] = (
            (self.identity,) if self.identity else (self.scene, self.solver, self.settings, self.gaps)
        )
        parts += (self.options,) if self.options else ()
        text = json.dumps([VERSION, self.kind, self.repeat, *parts], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def name(self) -> str:
        """Name of the result's files: the key, and the sources where they count."""
        if self.identity:
            return self.key
        of_a_substep = self.kind == "substep"
        digest = source_digest(with_reference_solvers=self.solver is not None, with_substeps=of_a_substep)
        return f"{self.key}-{digest}"

    def as_json(self) -> str:
        """All of it."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The request that `as_json` wrote."""
        return cls(**json.loads(text))

    def repeated(self, number: int) -> Request:
        """The same once more."""
        return replace(self, repeat=number, label=f"{self.label}, run {number + 1}")


def survey_request(scene: Scene, label: str) -> Request:
    """Build a scene."""
    return Request("survey", f"{label}: size and lowest mode", scene_text(scene))


def motion_request(
    scene: Scene, method: Method, threads: int, label: str, *, gaps: int = 0, time_limit: float | None = None
) -> Request:
    """Solve a scene with a method.

    Raises
    ------
    InputError
        Settings that the solver does not have.
    """
    text = scene_text(method.scene(scene, threads))
    solver = method.name if method.is_reference else None
    settings = method.own_settings if solver else {}
    return Request("motion", f"{label}: {method}", text, solver, settings, gaps, time_limit=time_limit)


def substep_request(
    scene: Scene, method: Method, threads: int, label: str, options: dict[str, Any], time_limit: float | None = None
) -> Request:
    """Solve one step of a scene with a method, iteration by iteration.

    Parameters
    ----------
    options : Of `verify.work_precision.run_substep.SubstepOptions`.

    Raises
    ------
    InputError
        Settings that the solver does not have.
    """
    request = motion_request(scene, method, threads, label, time_limit=time_limit)
    return replace(request, kind="substep", options=options)


def scene_text(scene: Scene) -> str:
    """The scene as TOML, with nothing that a motion does not depend on."""
    output = scene.output.model_copy(update={"fields": ()})
    return scene_to_toml(scene.model_copy(update={"description": "", "output": output}))
