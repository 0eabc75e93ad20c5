# SPDX-License-Identifier: BSD-3-Clause
"""What a tetrahedralisation gave, in figures."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from meshes.connectivity import component_labels
from meshes.quality import Dihedrals, dihedrals
from meshes.stuffing.repair import Repairs
from meshes.stuffing.signs import Sample
from meshes.stuffing.spacing import LAYER_DENSITY, surface_area, vertices_at
from meshes.stuffing.thickness import ACCEPTED_LOSS, LOST_BELOW, share_below, sufficient_spacing
from meshes.surface import boundary
from meshes.types import TetMesh, TriMesh


@dataclass(frozen=True)
class StuffingReport:
    """Figures of a tetrahedralisation.

    Parameters
    ----------
    asked, vertices, tets, components : Vertices asked for; vertices, tetrahedra and connected pieces obtained.
    spacing : Cubic spacing of the lattice [m].
    volume : Volume of the tetrahedra [m^3].
    volume_ratio : That over the volume inside the surface, overlaps of the surface with itself counted once.
    lost_share : Share of the volume inside the surface that no tetrahedron covers, in total.
    thin_share : Share of the volume inside the surface where it is thinner than 0.75 spacings: lost, as a rule.
    dihedral : Distribution of dihedral angles [degrees].
    repairs : Contacts separated, tetrahedra and fragments removed.
    unresolved_cuts, unbalanced_lines : Lattice edges and lines on which rounding spoiled the crossings; normally 0.
    warning : In words, when more than 1% of the volume is lost; names a number of vertices that should suffice.
    """

    asked: int
    vertices: int
    tets: int
    components: int
    spacing: float
    volume: float
    volume_ratio: float
    lost_share: float
    thin_share: float
    dihedral: Dihedrals
    repairs: Repairs
    unresolved_cuts: int
    unbalanced_lines: int
    warning: str

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


def report(asked: int, mesh: TetMesh, surface: TriMesh, sample: Sample, repairs: Repairs) -> StuffingReport:
    """Measure a mesh against the surface that it fills."""
    volume = skin_of(mesh).enclosed_volume
    enclosed = surface.enclosed_volume - sample.doubled
    lost = max(0.0, 1.0 - volume / enclosed)
    return StuffingReport(
        asked=asked,
        vertices=len(mesh.points),
        tets=len(mesh.cells),
        components=len(np.unique(component_labels(mesh.cells))),
        spacing=sample.lattice.spacing,
        volume=volume,
        volume_ratio=volume / enclosed,
        lost_share=lost,
        thin_share=share_below(sample.thin, sample.inside, LOST_BELOW),
        dihedral=dihedrals(mesh.points, mesh.cells),
        repairs=repairs,
        unresolved_cuts=sample.unresolved,
        unbalanced_lines=sample.unbalanced,
        warning=_warning(lost, enclosed, surface, sample) if lost > ACCEPTED_LOSS else "",
    )


def skin_of(mesh: TetMesh) -> TriMesh:
    """Boundary of a mesh as a surface with its own vertices."""
    triangles = boundary(mesh.cells)
    used = np.zeros(len(mesh.points), bool)
    used[triangles] = True
    number = (np.cumsum(used) - 1).astype(np.int32)
    return TriMesh(mesh.points[used], number[triangles])


def _warning(lost: float, enclosed: float, surface: TriMesh, sample: Sample) -> str:
    h = sample.lattice.spacing
    finer = h * sufficient_spacing(sample.thin, sample.inside, lost)
    thin = share_below(sample.thin, sample.inside, LOST_BELOW)
    enough = vertices_at(finer, enclosed, LAYER_DENSITY * surface_area(surface))
    return (
        f"{100 * lost:.1f}% of the volume is lost at a spacing of {h:.3g} m"
        f" ({100 * thin:.1f}% of the body is thinner than {LOST_BELOW * h:.3g} m);"
        f" about {_rounded_up(enough):,} vertices should keep all but 1%"
    )


def _rounded_up(number: float) -> int:
    """To two significant figures."""
    unit = 10.0 ** (np.floor(np.log10(number)) - 1)
    return int(np.ceil(number / unit) * unit)
