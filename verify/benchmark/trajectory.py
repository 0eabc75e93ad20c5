# SPDX-License-Identifier: BSD-3-Clause
"""How far one motion is from another."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.floating]


def trajectory_error(mass: Reals, displacement: Reals, reference: Reals, *, free: bool = False) -> float:
    """Mass-weighted RMS over vertices and frames of the difference, over that of the reference's own motion.

    Parameters
    ----------
    mass : Vertex masses [kg], shape [n].
    displacement, reference : Displacements since the start [m], shape [frames, n, 3].
    free : Whether nothing holds the body: then the motion of its centre of mass, which any method has right, is taken
        out of the reference's motion, or a long fall would hide every error.

    Returns
    -------
    Relative error; infinite when the displacement is not finite.
    """
    difference = norm = 0.0
    for u, v in zip(displacement, reference, strict=True):
        v = np.asarray(v, np.float64)
        difference += float(mass @ ((u - v) ** 2).sum(axis=1))
        if free:
            v = v - mass @ v / mass.sum()
        norm += float(mass @ (v**2).sum(axis=1))
    return float(np.sqrt(difference / norm)) if np.isfinite(difference) else float("inf")


def momenta(mass: Reals, x: Reals, v: Reals) -> dict[str, Any]:
    """Linear momentum [kg m/s], and angular momentum about the centre of mass [kg m^2/s], three components each.

    Parameters
    ----------
    mass : Vertex masses [kg], shape [n].
    x, v : Positions [m] and velocities [m/s], shape [n, 3].
    """
    arm = x - mass @ x / mass.sum()
    return {"linear_momentum": (mass @ v).tolist(), "angular_momentum": (mass @ np.cross(arm, v)).tolist()}
