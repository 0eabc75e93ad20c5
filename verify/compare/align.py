# SPDX-License-Identifier: BSD-3-Clause
"""A foreign motion in our order of vertices, at our frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError
from verify.compare.match import Matching, check_count, match
from verify.compare.result import ForeignMotion
from verify.diagnose.target import Target

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# A time belongs to a frame when it is no further from it than this share of a frame.
ON_TIME = 0.01


@dataclass(frozen=True, eq=False)
class Aligned:
    """Those frames of a foreign motion that the scene has too.

    Parameters
    ----------
    frames : Their numbers, ascending, shape [f].
    x : Positions [m] in our order, shape [f, n, 3].
    v : Velocities [m/s]; None where there are none.
    matching : Of the vertices.
    beyond : Frames after the last one of the scene.
    """

    frames: Integers
    x: Floats
    v: Floats | None
    matching: Matching
    beyond: int

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Frames of which every position is a number, shape [f]."""
        return np.asarray(np.isfinite(self.x).all(axis=(1, 2)))


def align(motion: ForeignMotion, target: Target) -> Aligned:
    """Bring a motion into our order.

    Raises
    ------
    InputError
        Another mesh, or times that are no frames of the scene.
    """
    frames, last = _frames(motion, target), target.scene.frames
    kept = frames <= last
    if not kept.any():
        raise InputError(
            "no frame is one of the scene",
            where=motion.name,
            found=f"frames {frames.min()} to {frames.max()}",
            allowed=f"0 to {last}",
        )
    matching = _matching(motion, frames, target)
    x = motion.x[kept][:, matching.theirs]
    if motion.displacements:
        x = target.disc.mesh.points + x
    v = None if motion.v is None else motion.v[kept][:, matching.theirs]
    return Aligned(frames[kept], x, v, matching, int((~kept).sum()))


def _frames(motion: ForeignMotion, target: Target) -> Integers:
    frame = 1.0 if motion.counted else target.frame
    number = np.asarray(motion.times, np.float64) / frame
    nearest = np.round(number)
    off = np.flatnonzero(~(np.abs(number - nearest) <= ON_TIME) | (nearest < 0))
    if len(off):
        raise InputError(
            "a time is no frame of the scene",
            where=motion.name,
            found=f"{motion.times[off[0]]:g}" + ("" if motion.counted else " s"),
            allowed="whole frame numbers from 0" if motion.counted else f"multiples of {frame:g} s",
            advice="write the result at the frames of the scene, or change its frames_per_second",
        )
    if len(np.unique(nearest)) != len(nearest):
        raise InputError(
            "a frame is there twice",
            where=motion.name,
            found=f"{len(nearest)} frames at {len(np.unique(nearest))} times",
            allowed="each frame once",
        )
    order = np.argsort(nearest)
    if not np.array_equal(order, np.arange(len(order))):
        raise InputError("frames are not in order", where=motion.name, found="times that fall", allowed="rising times")
    return nearest.astype(np.int64)


def _matching(motion: ForeignMotion, frames: Integers, target: Target) -> Matching:
    mesh = target.disc.mesh
    if motion.rest is not None:
        return match(mesh, mesh.points, motion.rest, motion.cells, motion.name)
    if not motion.displacements and frames[0] == 0:
        return match(mesh, target.world.x0, motion.x[0], motion.cells, motion.name)
    check_count(motion.x.shape[1], len(mesh.points), motion.name)
    return Matching(target.vertex_numbers, 0.0, "vertices numbered as in the mesh file, not checked by position")
