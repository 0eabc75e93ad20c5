# SPDX-License-Identifier: BSD-3-Clause
"""Energies and momenta of a motion, frame by frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verify.benchmark.trajectory import momenta
from verify.compare.reference import Reference

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Balance:
    """Of f frames; NaN where a frame tells nothing.

    Parameters
    ----------
    elastic, kinetic, gravity : Energies [J], shape [f]; gravity's is zero at rest.
    linear, angular : Momentum [kg m/s], and that about the centre of mass [kg m^2/s], shape [f, 3].
    """

    elastic: Floats
    kinetic: Floats
    gravity: Floats
    linear: Floats
    angular: Floats

    @property
    def total(self) -> Floats:
        """Sum of the energies [J], shape [f]."""
        return self.elastic + self.kinetic + self.gravity


def balance(reference: Reference, x: Floats, v: Floats) -> Balance:
    """Energies and momenta of positions and velocities, both of shape [f, n, 3]."""
    target, mass = reference.target, reference.mass
    gravity = np.asarray(target.scene.gravity)
    with np.errstate(invalid="ignore", over="ignore"):
        elastic = [float(target.backend.energies(one)[0].sum()) if np.isfinite(one).all() else np.nan for one in x]
        found = [momenta(mass, one, speed) for one, speed in zip(x, v, strict=True)]
        return Balance(
            np.array(elastic),
            0.5 * np.einsum("i,fij,fij->f", mass, v, v),
            -np.einsum("i,fij,j->f", mass, x - target.disc.mesh.points, gravity),
            np.array([one["linear_momentum"] for one in found]),
            np.array([one["angular_momentum"] for one in found]),
        )


def told(rows: Sequence[Mapping[str, Any]]) -> Balance:
    """The same from what the reference told of its frames."""
    return Balance(
        *(np.array([row[f"{name}_energy"] for row in rows]) for name in ("elastic", "kinetic", "potential")),
        *(np.array([row[f"{name}_momentum"] for row in rows]) for name in ("linear", "angular")),
    )


def differences(frames: Integers, x: Floats, v0: Floats, frame: float) -> Floats:
    """Velocities by central differences of positions; NaN where a neighbour is missing, v0 at the start."""
    v = np.full_like(x, np.nan)
    inner = np.flatnonzero((np.diff(frames)[:-1] == 1) & (np.diff(frames)[1:] == 1)) + 1
    v[inner] = (x[inner + 1] - x[inner - 1]) / (2.0 * frame)
    if len(frames) and frames[0] == 0:
        v[0] = v0
    return v
