# SPDX-License-Identifier: BSD-3-Clause
"""The lattice spacing that gives a wanted number of vertices.

A body of volume V and area A filled at spacing h has N = 2 V / h^3 + b / h^2 vertices: two lattice points per h^3, and
a layer of cuts and moved points whose density b / A hardly depends on h. Counting the vertices at one spacing therefore
gives b, and with it the next spacing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from meshes.types import TriMesh

# Vertices per h^2 of surface beyond 2 V / h^3: 1.0 to 1.4 on scanned bodies of 500 to 200,000 vertices.
LAYER_DENSITY = 1.3
_COUNTS = 5  # the model is good to a per cent or two after the first
# Spacings, relative and nearest first, tried one by one in changing placements of the lattice when the number jumps:
# for few vertices, and for plates that hold a whole number of layers.
_PLACEMENTS = 5
_SCAN = sorted((1.0 + 0.01 * k for k in range(-25, 31)), key=lambda factor: abs(factor - 1.0))


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
) -> Trial:
    """Trial nearest to the wanted number of vertices; the search ends within tolerance / 5, or when ideas run out.

    Parameters
    ----------
    attempt : Makes a trial from a spacing [m] and the number of a placement of the lattice.
    vertices : Wanted number.
    volume, area : Of the body [m^3, m^2].
    tolerance : Accepted relative difference; the trial returned may miss it when the number is small.
    """
    layer = LAYER_DENSITY * area
    spacing = first = spacing_for(vertices, volume, layer)
    best = attempt(spacing, 0)
    last = best
    for _ in range(_COUNTS):
        if _miss(best, vertices) <= 0.2 * tolerance:
            return best
        # The layer's density is bounded from below, or a tiny count would send the next spacing to infinity.
        layer = max((last.vertices - 2.0 * volume / spacing**3) * spacing**2, -0.5 * area)
        spacing = spacing_for(vertices, volume, layer)
        last = attempt(spacing, 0)
        best = min(best, last, key=lambda trial: _miss(trial, vertices))
    for k, factor in enumerate(_SCAN):
        if _miss(best, vertices) <= tolerance:
            break
        best = min(best, attempt(first * factor, k % _PLACEMENTS), key=lambda trial: _miss(trial, vertices))
    return best


def _miss(trial: Counted, vertices: int) -> float:
    return abs(trial.vertices / vertices - 1.0)
