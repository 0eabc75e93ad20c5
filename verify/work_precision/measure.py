# SPDX-License-Identifier: BSD-3-Clause
"""How far a motion is from the reference's, as a share of what the reference moves beyond falling and being carried."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Reference:
    """A motion of n vertices that others are held against.

    Parameters
    ----------
    mass : Vertex masses [kg], shape [n].
    part : Connected part of each vertex, shape [n].
    held : Vertices whose motion is prescribed, shape [n], bool.
    start : Positions at the start [m], shape [n, 3].
    displacement : Since the start [m], shape [frames, n, 3].
    """

    mass: Floats
    part: NDArray[np.integer]
    held: NDArray[np.bool_]
    start: Floats
    displacement: Reals

    def trajectory_error(self, displacement: Reals) -> float:
        """Mass-weighted RMS over vertices and frames of the difference, over that of the reference's own motion.

        What carries a part is taken out of the reference's motion, or a long fall would hide every error: the mean
        displacement of its held vertices, or of its mass where nothing holds it.

        Returns
        -------
        Relative error; infinite when the motion is not finite or not complete.
        """
        if len(displacement) != len(self.displacement):
            return math.inf
        difference = norm = 0.0
        carriers = self._carriers()
        for u, v in zip(displacement, self.displacement, strict=True):
            v = np.asarray(v, np.float64)
            difference += float(self.mass @ ((u - v) ** 2).sum(axis=1))
            norm += float(self.mass @ (_without(carriers, v) ** 2).sum(axis=1))
        return _share(difference, norm)

    def shape_error(self, displacement: Reals) -> float:
        """The same of the shapes at the end alone: each turned and moved to fit the reference's.

        For motions that are too sensitive to be compared frame by frame. The reference's motion is the distance of its
        shapes at the start and at the end, the one laid over the other as well.
        """
        if len(displacement) != len(self.displacement) or not np.isfinite(displacement[-1]).all():
            return math.inf
        end = self.start + self.displacement[-1]
        difference = norm = 0.0
        for root in np.unique(self.part):
            mine = self.part == root
            difference += fit_distance(self.mass[mine], self.start[mine] + displacement[-1][mine], end[mine])
            norm += fit_distance(self.mass[mine], self.start[mine], end[mine])
        return _share(difference, norm)

    def _carriers(self) -> list[tuple[NDArray[np.intp], Floats]]:
        """Vertices of each part, and the weights [1] of those that tell how it is carried."""
        found = []
        for root in np.unique(self.part):
            vertices = np.flatnonzero(self.part == root)
            held = self.held[vertices]
            weight = held.astype(np.float64) if held.any() else self.mass[vertices]
            found.append((vertices, weight / weight.sum()))
        return found


def _without(carriers: list[tuple[NDArray[np.intp], Floats]], v: Floats) -> Floats:
    left = v.copy()
    for vertices, weight in carriers:
        left[vertices] -= weight @ v[vertices]
    return left


def fit_distance(mass: Floats, x: Reals, y: Reals) -> float:
    """Least of sum m |R x + t - y|^2 over rotations R and translations t [kg m^2] (Kabsch 1976)."""
    a, b = x - mass @ x / mass.sum(), y - mass @ y / mass.sum()
    U, s, Vt = np.linalg.svd((mass[:, None] * a).T @ b)
    s[2] *= np.sign(np.linalg.det(U @ Vt))
    return max(0.0, float(mass @ ((a**2).sum(axis=1) + (b**2).sum(axis=1)) - 2.0 * s.sum()))


def _share(difference: float, norm: float) -> float:
    if not math.isfinite(difference):
        return math.inf
    return math.sqrt(difference / norm) if norm > 0.0 else (0.0 if difference == 0.0 else math.inf)
