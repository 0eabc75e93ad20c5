# SPDX-License-Identifier: BSD-3-Clause
"""How far a motion is from the reference, frame by frame and as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verify.benchmark.trajectory import trajectory_error
from verify.compare.align import Aligned, align
from verify.compare.balance import Balance, balance, differences, told
from verify.compare.reference import Reference
from verify.compare.result import ForeignMotion
from verify.diagnose.finding import plain

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Comparison:
    """A motion beside the reference; f frames.

    Parameters
    ----------
    name : Of the result.
    aligned : The motion in our order.
    reference : What it is held against.
    theirs, ours : Energies and momenta of both, got in the same way.
    frame_error : Mass-weighted RMS of the difference in each frame, in units of the RMS of the reference's motion over
        all frames that are compared, shape [f]; its own RMS over the frames is the trajectory error.
    frame_own : The same of the reference itself.
    largest, vertex : Largest difference of a vertex in each frame [m], and which vertex, in our order; shape [f].
    """

    name: str
    aligned: Aligned
    reference: Reference
    theirs: Balance
    ours: Balance
    frame_error: Floats
    frame_own: Floats
    largest: Floats
    vertex: NDArray[np.int64]

    @property
    def error(self) -> float:
        """Relative trajectory error over the frames that are there; infinite where one is not a number."""
        return _rms(self.frame_error)

    @property
    def own_error(self) -> float:
        """Of the reference, over the same frames."""
        return _rms(self.frame_own)

    @property
    def worst(self) -> int:
        """Row of the frame with the largest difference."""
        return int(np.argmax(np.where(np.isfinite(self.largest), self.largest, np.inf)))

    @property
    def last_frame(self) -> int:
        """Last frame of the scene."""
        return len(self.reference.x) - 1

    @property
    def good_until(self) -> int:
        """Last frame up to which all that are there are numbers; -1 for none."""
        lost = np.flatnonzero(~self.aligned.finite)
        kept = self.aligned.frames if not len(lost) else self.aligned.frames[: lost[0]]
        return int(kept[-1]) if len(kept) else -1

    def place(self, row: int) -> dict[str, Any]:
        """Vertex of the largest difference of a frame, by its number in the result and where it is at rest."""
        vertex = int(self.vertex[row])
        rest = self.reference.target.disc.mesh.points[vertex]
        return {"vertex": int(self.aligned.matching.theirs[vertex]), "rest_m": rest.tolist()}

    def rows(self) -> list[dict[str, Any]]:
        """Everything about each frame."""
        return [
            {
                "frame": int(frame),
                "time_s": float(frame * self.reference.target.frame),
                "error": float(self.frame_error[k]),
                "reference_own_error": float(self.frame_own[k]),
                "largest_m": float(self.largest[k]),
                "largest_at": self.place(k),
                **{f"{name}_J": float(getattr(self.theirs, name)[k]) for name in _ENERGIES},
                **{f"reference_{name}_J": float(getattr(self.ours, name)[k]) for name in _ENERGIES},
                **{f"{name}_momentum": getattr(self.theirs, name)[k].tolist() for name in _MOMENTA},
                **{f"reference_{name}_momentum": getattr(self.ours, name)[k].tolist() for name in _MOMENTA},
            }
            for k, frame in enumerate(self.aligned.frames)
        ]

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return plain(
            {
                "result": self.name,
                "scene": self.reference.target.scene.model_dump(mode="json"),
                "vertices": len(self.reference.mass),
                "matching": self.aligned.matching.how,
                "frames": len(self.aligned.frames),
                "frames_of_scene": self.last_frame,
                "frames_beyond": self.aligned.beyond,
                "velocities": "from the result" if self.aligned.v is not None else "differences of positions",
                "error": self.error,
                "reference": {
                    "label": self.reference.label,
                    "substeps": self.reference.substeps,
                    "own_error": self.own_error,
                },
                "rows": self.rows(),
            }
        )


_ENERGIES, _MOMENTA = ("elastic", "kinetic", "gravity", "total"), ("linear", "angular")


def compare_motion(motion: ForeignMotion, reference: Reference) -> Comparison:
    """Hold a motion against the reference.

    Raises
    ------
    InputError
        It is of another mesh, or its times are no frames of the scene.
    """
    aligned = align(motion, reference.target)
    frames, mass = aligned.frames, reference.mass
    ours, start = reference.x[frames], reference.target.world.x0
    with np.errstate(invalid="ignore", over="ignore"):
        difference = aligned.x - ours
        distance = np.linalg.norm(difference, axis=2)
        squared = np.einsum("i,fi->f", mass, distance**2)
    scale = _scale(mass, ours - start, reference.free)
    vertex = np.argmax(np.where(np.isfinite(distance), distance, np.inf), axis=1)
    own = np.full(len(frames), np.inf)
    if reference.own is not None:
        own = np.sqrt(np.einsum("i,fij,fij->f", mass, reference.own[frames], reference.own[frames])) / scale
    theirs, mine = _balances(aligned, reference)
    return Comparison(
        motion.name,
        aligned,
        reference,
        theirs,
        mine,
        np.where(np.isfinite(squared), np.sqrt(squared), np.inf) / scale,
        own,
        np.take_along_axis(distance, vertex[:, None], axis=1)[:, 0],
        vertex,
    )


def _scale(mass: Floats, motion: Floats, free: bool) -> float:
    """What a difference of unit relative error is, in kg^(1/2) m: root of the mean over frames of m |u|^2."""
    # Half a motion is half wrong: that is where the norm of `trajectory_error` is to be had from.
    half = trajectory_error(mass, 0.5 * motion, motion, free=free) if motion.any() else 0.0
    total = np.einsum("i,fij,fij->", mass, 0.5 * motion, 0.5 * motion) / len(motion)
    return float(np.sqrt(total) / half) if half > 0.0 else float(np.sqrt(mass.sum()))


def _balances(aligned: Aligned, reference: Reference) -> tuple[Balance, Balance]:
    """Energies and momenta of both; without velocities both from differences of positions."""
    frames = aligned.frames
    if aligned.v is not None:
        return balance(reference, aligned.x, aligned.v), told([reference.rows[k] for k in frames])
    v0, frame = reference.target.world.v0, reference.target.frame
    # Scenes whose damping or constraints act at the start have other velocities there in the mean, not in v0.
    both = []
    for x in (aligned.x, reference.x[frames]):
        both.append(balance(reference, x, differences(frames, x, v0, frame)))
    return both[0], both[1]


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) and np.isfinite(values).all() else float("inf")
