# SPDX-License-Identifier: BSD-3-Clause
"""The converged motion of a scene: velocity Verlet at a share of its stable step, and what it is itself wrong by.

References are kept by what they depend on: the arrays of the scene, the length of the motion, the share of the stable
step, the sources of the explicit method, and VERSION. An edit of another solver leaves them valid.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from femgal.scene.build import World
from femgal.scene.model import Scene
from meshes.cache import cache_root
from meshes.errors import InputError
from verify.work_precision.launch import launch
from verify.work_precision.measure import Reference
from verify.work_precision.method import Method
from verify.work_precision.request import Request, scene_text
from verify.work_precision.sources import explicit_digest
from verify.work_precision.store import Result, Store
from verify.work_precision.survey import physics_digest

# Raised when references are made in another way.
VERSION = 1

# Largest share of the stable step that a motion is compared at.
_LARGEST_SAFETY = 0.9


@dataclass(frozen=True)
class ReferencePair:
    """Requests of a reference and of the same at twice its step, from whose distance its own error follows."""

    fine: Request
    coarse: Request

    @property
    def both(self) -> tuple[Request, Request]:
        """The two of them."""
        return self.fine, self.coarse


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """A reference that is there.

    Parameters
    ----------
    name : Unique among references.
    label : Its settings.
    motion : Where it goes.
    own_error : Its own relative trajectory error; infinite where it is not known.
    numbers : Everything else that its run told.
    coarse : The same at twice the step.
    factor : Distance of the two in units of the reference's own error.
    """

    name: str
    label: str
    motion: Reference
    own_error: float
    numbers: dict[str, Any]
    coarse: Result
    factor: float


def default_folder() -> Path:
    """Where references are kept: in femgal's cache, for all studies."""
    return cache_root() / "references"


def reference_pair(scene: Scene, physics: str, label: str, safety: float, threads: int | None) -> ReferencePair:
    """What has to be run for a reference.

    Parameters
    ----------
    scene : With its final number of frames.
    physics : Digest of its arrays, from `verify.work_precision.survey`.
    safety : Share of the stable step.
    """
    return ReferencePair(
        *(
            _request(scene, physics, f"{label}: {what}", share, threads)
            for what, share in (("reference", safety), ("coarser reference", min(2.0 * safety, _LARGEST_SAFETY)))
        )
    )


def _request(scene: Scene, physics: str, label: str, safety: float, threads: int | None) -> Request:
    method = Method("verlet", (("safety", safety),), "reference")
    length = f"{scene.frames} {scene.frames_per_second!r}"
    identity = f"reference {VERSION} {explicit_digest()} {physics} {length} {safety!r}"
    return Request("motion", label, scene_text(method.scene(scene, threads or 1)), identity=identity)


def read_reference(pair: ReferencePair, store: Store) -> ReferenceMotion | str:
    """The reference from the folder, or why there is none."""
    fine, coarse = (store.find(request) for request in pair.both)
    if fine is None or coarse is None:
        return "has not been run"
    if fine.failure or fine.motion is None:
        return fine.failure or "left no motion"
    motion = motion_of(fine)
    factor = _factor(fine.numbers, coarse.numbers)
    own = math.inf
    if factor > 0.0 and coarse.failure is None and coarse.motion is not None:
        own = motion.trajectory_error(coarse.arrays()["displacement"]) / factor
    label = f"velocity Verlet, {steps_per_frame(fine.numbers):.0f} steps per frame"
    return ReferenceMotion(pair.fine.name, label, motion, own, fine.numbers, coarse, factor)


def motion_of(result: Result) -> Reference:
    """The motion of a run, as one that others are held against."""
    arrays = result.arrays()
    return Reference(*(arrays[name] for name in ("mass", "part", "held", "start", "displacement")))


def _factor(fine: dict[str, Any], coarse: dict[str, Any]) -> float:
    """Errors fall with h^2: those of two steps differ by so many times the smaller one."""
    if not fine["rows"] or not coarse["rows"]:
        return 0.0
    return (steps_per_frame(fine) / steps_per_frame(coarse)) ** 2 - 1.0


def steps_per_frame(numbers: dict[str, Any]) -> float:
    """Mean number of substeps."""
    rows = numbers["rows"]
    return sum(row["substeps"] for row in rows) / len(rows) if rows else math.nan


def find_reference_motion(
    scene: Scene, world: World, folder: Path | None, safety: float, announce: Callable[[str], None]
) -> ReferenceMotion:
    """The reference of one scene with the length that it has, computed here when it is not there yet.

    Parameters
    ----------
    world : The arrays of the scene.
    folder : Where references are; `default_folder` when None.

    Raises
    ------
    InputError
        The reference itself fails.
    """
    store = Store(folder or default_folder())
    pair = reference_pair(scene, physics_digest(scene, world), scene.name, safety, scene.solver.threads)
    for request in pair.both:
        if store.find(request) is None:
            announce(request.label)
            launch(request, store.stem(request))
    found = read_reference(pair, store)
    if isinstance(found, str):
        raise InputError("the reference fails", where=scene.name, found=found, advice="see the failure")
    return found
