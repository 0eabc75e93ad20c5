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

from dataclasses import dataclass, replace

from meshes.errors import MeshError
from meshes.stuffing.fill import Filling, fill
from meshes.stuffing.lattice import Lattice
from meshes.stuffing.repair import Repairs, repair
from meshes.stuffing.report import StuffingReport, report
from meshes.stuffing.signs import Sample, sample
from meshes.stuffing.spacing import LAYER_DENSITY, nearest_trial, surface_area, vertices_at
from meshes.stuffing.warp import Warped, warp
from meshes.surface import check_closed, outward
from meshes.types import TetMesh, TriMesh

__all__ = ["StuffingReport", "tetrahedralise"]

_PLACEMENTS = 3  # of the lattice, while rounding leaves a line with an open winding number
_ROUNDS = 4  # repairs change the number of vertices; the aim is shifted by what they took


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
    trial, filling, repairs = _stuffed(surface, vertices, tolerance)
    mesh = TetMesh(filling.points, filling.cells, replace(surface.origin))
    return mesh, report(vertices, mesh, surface, trial.sample, repairs)


def _solid(surface: TriMesh) -> TriMesh:
    check_closed(surface)
    surface = outward(surface)
    if not surface.enclosed_volume > 0.0:
        raise MeshError("the surface encloses no volume", where=surface.origin.name, found=surface.enclosed_volume)
    return surface


def _stuffed(surface: TriMesh, vertices: int, tolerance: float) -> tuple[_Trial, Filling, Repairs]:
    aim, nearest = vertices, 0
    for _ in range(_ROUNDS):
        trial = _nearest_trial(surface, aim, tolerance)
        if trial is None or trial.vertices == 0:
            break
        filling, repairs = repair(fill(trial.sample, trial.warped), surface)
        nearest = len(filling.points)
        if abs(nearest - vertices) <= tolerance * vertices:
            return trial, filling, repairs
        aim = max(round(aim * vertices / nearest), 4)
    raise MeshError(
        "no lattice gives so many vertices",
        where=surface.origin.name,
        found=f"{nearest} vertices at the nearest, {vertices} asked",
        allowed=f"within {100 * tolerance:g}%",
        advice=f"ask for at least {_sensible(surface)} vertices, or accept a larger tolerance",
    )


def _nearest_trial(surface: TriMesh, vertices: int, tolerance: float) -> _Trial | None:
    area = surface_area(surface)
    best = None
    for trial in nearest_trial(
        lambda spacing, placement: _trial(surface, spacing, placement),
        vertices,
        surface.enclosed_volume,
        area,
        tolerance,
    ):
        best = trial
    return best


def _trial(surface: TriMesh, spacing: float, placement: int) -> _Trial:
    for attempt in range(_PLACEMENTS):
        found = sample(surface, Lattice.around(surface.points, spacing, placement + 7 * attempt))
        if found.unbalanced == 0:
            break
    return _Trial(found, warp(found))


def _sensible(surface: TriMesh) -> int:
    """Vertices at a spacing of three times volume over area, the radius for a ball: fewer show no shape."""
    volume, area = surface.enclosed_volume, surface_area(surface)
    return round(vertices_at(3.0 * volume / area, volume, LAYER_DENSITY * area))
