# SPDX-License-Identifier: BSD-3-Clause
"""femgal's own converged motion of a scene, and how good it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verify.diagnose.target import Target
from verify.work_precision.reference import find_reference_motion

Floats = NDArray[np.float64]

# Of the stable step; half of what Verlet takes on its own.
REFERENCE_SAFETY = 0.45


@dataclass(frozen=True, eq=False)
class Reference:
    """Frames 0 to f of a scene with n vertices.

    Parameters
    ----------
    target : The scene and its arrays.
    x : Positions [m], shape [f + 1, n, 3].
    own : Distance to the same motion at twice the step, in units of the reference's own error, shape [f + 1, n, 3].
    mass : Vertex masses [kg], shape [n].
    own_error : Relative trajectory error of the reference itself; infinite where it is not known.
    rows : Energies and momenta of each frame, as `verify.work_precision.run_motion` tells them.
    label : Its settings.
    substeps : Of its last frame.
    free : Whether nothing holds the bodies.
    """

    target: Target
    x: Floats
    own: Floats | None
    mass: Floats
    own_error: float
    rows: list[dict[str, Any]]
    label: str
    substeps: int
    free: bool

    @property
    def times(self) -> Floats:
        """Times of the frames [s], shape [f + 1]."""
        return np.arange(len(self.x), dtype=np.float64) * self.target.frame


def find_reference(
    target: Target,
    work: Path | None = None,
    *,
    safety: float = REFERENCE_SAFETY,
    announce: Callable[[str], None] = lambda text: None,
) -> Reference:
    """Compute the reference of a target's scene, or find it where it was computed before.

    Parameters
    ----------
    work : Folder of the runs; femgal's cache when None.
    safety : Share of the stable step.

    Raises
    ------
    InputError
        The reference itself fails.
    """
    found = find_reference_motion(target.scene, target.world, work, safety, announce)
    numbers, motion = found.numbers, np.asarray(found.motion.displacement)
    start = np.zeros_like(motion[:1])
    own = None
    if math.isfinite(found.own_error):
        own = np.concatenate([start, (found.coarse.arrays()["displacement"] - motion) / np.float32(found.factor)])
    return Reference(
        target,
        target.world.x0 + np.concatenate([start, motion]),
        own,
        found.motion.mass,
        found.own_error,
        [numbers["start"], *numbers["rows"]],
        found.label,
        numbers["rows"][-1]["substeps"],
        numbers["free"],
    )
