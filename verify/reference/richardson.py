# SPDX-License-Identifier: BSD-3-Clause
"""Richardson's extrapolation of a mesh sequence, its observed order, and the grid convergence index."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

# Roache's factor for an order that was observed on three meshes.
SAFETY = 1.25


@dataclass(frozen=True)
class Extrapolation:
    """What three meshes, each with cells half as wide as the one before, say about the limit.

    Parameters
    ----------
    value : The limit.
    order : Observed order of convergence p.
    gci : Uncertainty of the finest value, as a share of it.
    """

    value: float
    order: float
    gci: float


def extrapolate(values: Sequence[float]) -> Extrapolation:
    """Limit of f + a h^p through the last three values, h halved from one to the next (Roache 1994).

    p = log2((f2 - f1) / (f3 - f2)), f = f3 + (f3 - f2) / (2^p - 1), GCI = 1.25 |f - f3| / |f3|.

    Raises
    ------
    ArithmeticError
        The values do not approach anything: differences grow or change sign.
    """
    coarse, middle, fine = values[-3:]
    ratio = (middle - coarse) / (fine - middle) if fine != middle else math.inf
    if not ratio > 1.0:
        raise ArithmeticError(f"no convergence in {coarse:.6g}, {middle:.6g}, {fine:.6g}")
    value = fine + (fine - middle) / (ratio - 1.0)
    return Extrapolation(value, math.log2(ratio), SAFETY * abs(value - fine) / abs(fine))
