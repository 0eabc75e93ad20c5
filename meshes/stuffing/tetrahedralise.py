# SPDX-License-Identifier: BSD-3-Clause
"""Tetrahedra from any closed surface by isosurface stuffing.

F. Labelle and J. R. Shewchuk, Isosurface Stuffing: Fast Tetrahedral Meshes with Good Dihedral Angles, ACM Transactions
on Graphics 26(3), 2007. Where this differs:

1. The surface is a triangle mesh, so signs and cuts are exact crossings of lattice lines, not zeros of a function.
2. Inside is where the surface winds around a point a positive number of times.
3. Outside points are moved onto the surface before inside ones.
4. Contacts that warping makes between parts of the boundary are separated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from meshes.errors import MeshError
from meshes.stuffing.fill import Filling, fill
from meshes.stuffing.lattice import Lattice
from meshes.stuffing.repair import Repairs, repair
from meshes.stuffing.report import StuffingReport, report
from meshes.stuffing.signs import Sample, sample
from meshes.stuffing.spacing import nearest_trial, surface_area
from meshes.stuffing.warp import Warped, warp
from meshes.surface import check_closed, outward
from meshes.types import TetMesh, TriMesh

__all__ = ["StuffingReport", "tetrahedralise"]

_PLACEMENTS = 3  # of the lattice, while lines through edges or vertices of the surface leave a cut unknown
_ROUNDS = 8  # repairs change the number of vertices, so the aim is shifted, then bracketed; scans need 1 or 2
_FEWEST = 30  # below, hardly any number can be met
_LARGER_SIZES = 8  # tried in search of advice, up to a number of vertices that takes a second or two
_LARGEST_TRIED = 200_000
_MOST_GROWTH = 4.0  # of the aim from one round to the next, also when the repairs left little or nothing


@dataclass(frozen=True, eq=False)
class _Stuffed:
    sample: Sample
    filling: Filling
    repairs: Repairs


@dataclass(frozen=True, eq=False)
class _Trial:
    sample: Sample
    warped: Warped

    @property
    def vertices(self) -> int:
        return self.warped.vertices


def tetrahedralise(surface: TriMesh, vertices: int, *, tolerance: float = 0.05) -> tuple[TetMesh, StuffingReport]:
    """Fill a closed surface with about so many vertices' worth of uniform tetrahedra.

    The result is the same bit for bit in every run. All volumes are positive, dihedral angles lie between 9.2 and 161.7
    degrees, and the boundary is a closed 2-manifold whose vertices lie on the surface, save where parts of it touched.
    Sharp edges of the surface are cut off at the scale of the spacing.

    Parameters
    ----------
    surface : Closed surface; it may overlap itself and may be turned inside out.
    vertices : Wanted number of vertices.
    tolerance : Accepted relative difference from it.

    Raises
    ------
    MeshError
        An open surface, one that encloses nothing, or a number of vertices too small (or too large) for it.
    """
    surface = _solid(surface)
    if not vertices >= 4:
        raise MeshError("too few vertices for a tetrahedron", found=vertices, allowed=">= 4")
    stuffed = _stuffed(surface, vertices, tolerance)
    if not isinstance(stuffed, _Stuffed):
        raise _refusal(surface, vertices, stuffed, tolerance)
    mesh = TetMesh(stuffed.filling.points, stuffed.filling.cells, surface.origin)
    return mesh, report(vertices, mesh, surface, stuffed.sample, stuffed.repairs)


def _solid(surface: TriMesh) -> TriMesh:
    check_closed(surface)
    surface = outward(surface)
    if not surface.enclosed_volume > 0.0:
        raise MeshError("the surface encloses no volume", where=surface.origin.name, found=surface.enclosed_volume)
    return surface


def _stuffed(surface: TriMesh, vertices: int, tolerance: float) -> _Stuffed | int:
    """Filling within the tolerance, or else the nearest number of vertices that was met."""
    volume, area = surface.enclosed_volume, surface_area(surface)
    aim, nearest = float(vertices), 0
    below, above = 0.0, np.inf
    for _ in range(_ROUNDS):
        trial = nearest_trial(partial(_trial, surface), round(aim), volume, area, tolerance)
        if abs(trial.vertices - aim) > tolerance * aim:
            return nearest or trial.vertices
        filling, repairs = repair(fill(trial.sample, trial.warped), surface)
        obtained = len(filling.points)
        if abs(obtained - vertices) <= tolerance * vertices:
            return _Stuffed(trial.sample, filling, repairs)
        nearest = min(nearest, obtained, key=lambda n: abs(n - vertices))
        below, above = (aim, above) if obtained < vertices else (below, aim)
        aim *= min(vertices / max(obtained, 1), _MOST_GROWTH)
        if not below < aim < above:
            aim = (below * above) ** 0.5
    return nearest


def _trial(surface: TriMesh, spacing: float, placement: int) -> _Trial:
    for attempt in range(_PLACEMENTS):
        found = sample(surface, Lattice.around(surface.points, spacing, placement + 7 * attempt))
        if found.unbalanced + found.unresolved == 0:
            break
    return _Trial(found, warp(found))


def _refusal(surface: TriMesh, vertices: int, nearest: int, tolerance: float) -> MeshError:
    """Error that names the next round number of vertices that works, where trying that is cheap."""
    sizes = (round(first * 10**k) for k in range(1, 6) for first in (1, 1.5, 2, 3, 5, 7))
    larger = [size for size in sizes if max(vertices, _FEWEST) < size <= _LARGEST_TRIED][:_LARGER_SIZES]
    works = next((size for size in larger if _works(surface, size, tolerance)), None)
    return MeshError(
        "no lattice fills the surface with so many vertices",
        where=surface.origin.name,
        found=f"{nearest} vertices at the nearest, {vertices} asked",
        allowed=f"within {100 * tolerance:g}%",
        advice=f"ask for {works} vertices" if works else "ask for far more vertices, or accept a larger tolerance",
    )


def _works(surface: TriMesh, vertices: int, tolerance: float) -> bool:
    try:
        return isinstance(_stuffed(surface, vertices, tolerance), _Stuffed)
    except Exception:  # whatever it is, the user asked for another number and must hear about that one
        return False
