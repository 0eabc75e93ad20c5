# SPDX-License-Identifier: BSD-3-Clause
"""Error and energies of a comparison over time, for plots with logarithmic axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verify.compare.comparison import Comparison
from verify.suite.case import Curve, Plot

Floats = NDArray[np.float64]


def plots(comparison: Comparison) -> tuple[Plot, ...]:
    """Error and energies over time; what is not positive has no place on logarithmic axes."""
    time = np.asarray(comparison.aligned.frames * comparison.reference.target.frame)
    error = Plot(
        "Error of each frame",
        "time [s]",
        "RMS difference / RMS motion",
        _curves(time, {"result": comparison.frame_error, "reference itself": comparison.frame_own}),
    )
    theirs, ours = comparison.theirs, comparison.ours
    energies: dict[str, Floats] = {}
    for name in ("elastic", "kinetic"):
        energies |= {f"{name}, result": getattr(theirs, name), f"{name}, reference": getattr(ours, name)}
    return tuple(
        one for one in (error, Plot("Energies", "time [s]", "energy [J]", _curves(time, energies))) if one.curves
    )


def _curves(time: Floats, values: dict[str, Floats]) -> tuple[Curve, ...]:
    curves = []
    for name, y in values.items():
        shown = np.isfinite(y) & (y > 0.0) & (time > 0.0)
        if shown.sum() > 1:
            curves.append(Curve(name, tuple(time[shown].tolist()), tuple(y[shown].tolist())))
    return tuple(curves)
