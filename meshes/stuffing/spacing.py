# SPDX-License-Identifier: BSD-3-Clause
"""The lattice spacing that gives a wanted number of vertices.

A body of volume V and area A filled at spacing h has N = 2 V / h^3 + b / h^2 vertices: two lattice points per h^3, and
a layer of cuts and moved points whose density b / A hardly depends on h. Counting the vertices at one spacing therefore
gives b, and with it the next spacing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from meshes.types import TriMesh

# Vertices per h^2 of surface beyond 2 V / h^3: 1.0 to 1.4 on scanned bodies of 500 to 200,000 vertices.
LAYER_DENSITY = 1.3
_COUNTS = 6  # the model is good to a per cent or two after the first
_SCAN = np.linspace(0.75, 1.3, 45)  # spacings, relative, tried one by one when N is too small for the model


class Counted(Protocol):
    """Anything that knows how many vertices it will have."""

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        ...


Trial = TypeVar("Trial", bound=Counted)


def surface_area(surface: TriMesh) -> float:
    """Area of a surface [m^2]."""
    a, b, c = (surface.points[surface.cells[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def vertices_at(spacing: float, volume: float, layer: float) -> float:
    """Vertices N = 2 V / h^3 + b / h^2 at a spacing [m]; layer is b [m^2]."""
    return 2.0 * volume / spacing**3 + layer / spacing**2


def spacing_for(vertices: float, volume: float, layer: float) -> float:
    """Spacing [m] at which the model has so many vertices (Newton in 1 / h, from above, monotone)."""
    x = (vertices / (2.0 * volume)) ** (1.0 / 3.0)
    for _ in range(60):
        excess = 2.0 * volume * x**3 + layer * x**2 - vertices
        step = excess / (6.0 * volume * x**2 + 2.0 * layer * x)
        x -= step
        if abs(step) < 1e-12 * x:
            break
    return 1.0 / x


def nearest_trial(
    attempt: Callable[[float, int], Trial], vertices: int, volume: float, area: float, tolerance: float
) -> Iterator[Trial]:
    """Trials ever nearer to the wanted number of vertices, until one is within tolerance / 5 or ideas run out.

    Parameters
    ----------
    attempt : Makes a trial from a spacing [m] and the number of a lattice placement.
    vertices : Wanted number.
    volume, area : Of the body [m^3, m^2].
    tolerance : Accepted relative difference.
    """
    best = np.inf
    layer = LAYER_DENSITY * area
    spacing = spacing_for(vertices, volume, layer)
    for _ in range(_COUNTS):
        trial = attempt(spacing, 0)
        miss = abs(trial.vertices / vertices - 1.0)
        if miss < best:
            best = miss
            yield trial
        if best <= 0.2 * tolerance:
            return
        # The layer's density is bounded from below, or a tiny count would send the next spacing to infinity.
        layer = max((trial.vertices - 2.0 * volume / spacing**3) * spacing**2, -0.5 * area)
        spacing = spacing_for(vertices, volume, layer)
    if best > tolerance:
        yield from _scan(attempt, spacing_for(vertices, volume, LAYER_DENSITY * area), vertices, tolerance, best)


def _scan(
    attempt: Callable[[float, int], Trial], spacing: float, vertices: int, tolerance: float, best: float
) -> Iterator[Trial]:
    factors: NDArray[np.float64] = _SCAN[np.argsort(np.abs(np.log(_SCAN)), kind="stable")]
    for placement in range(2):
        for factor in factors:
            trial = attempt(float(spacing * factor), placement)
            miss = abs(trial.vertices / vertices - 1.0)
            if miss < best:
                best = miss
                yield trial
            if best <= tolerance:
                return
