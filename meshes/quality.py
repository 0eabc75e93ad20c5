# SPDX-License-Identifier: BSD-3-Clause
"""Figures that tell whether a tetrahedral mesh is fit for a solver."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes.connectivity import component_labels, vertex_cells
from meshes.jit import kernel, scalar
from meshes.surface import boundary, manifold_report
from meshes.types import Cells, Points, TetMesh

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Quality:
    """Quality of a tetrahedral mesh.

    A tetrahedron's *smallest* dihedral angle and its radius ratio 3 r_in / R_circ (1 for the regular one) are the
    figures whose distribution is given; percentiles are over tetrahedra.

    Parameters
    ----------
    vertices, tets, components : Numbers; components are connected through vertices.
    volume : Total volume [m^3].
    dihedral_min, dihedral_1, dihedral_5, dihedral_median : Smallest dihedral angle of the tetrahedra [degrees]:
        minimum, 1st and 5th percentile, median.
    dihedral_max : Largest dihedral angle anywhere [degrees].
    below_1, below_5 : Tetrahedra whose smallest dihedral angle is below 1 and 5 degrees.
    radius_ratio_min, radius_ratio_1, radius_ratio_median : Radius ratio: minimum, 1st percentile, median.
    volume_min, volume_median, volume_max : Volumes of the tetrahedra [m^3].
    edge_min, edge_median, edge_max, edge_mean : Lengths of the mesh's edges [m].
    tets_per_vertex : tets / vertices.
    manifold : The boundary is a closed 2-manifold, at edges and at vertices.
    warnings : What a solver may trip over, in words.
    """

    vertices: int
    tets: int
    components: int
    volume: float
    dihedral_min: float
    dihedral_1: float
    dihedral_5: float
    dihedral_median: float
    dihedral_max: float
    below_1: int
    below_5: int
    radius_ratio_min: float
    radius_ratio_1: float
    radius_ratio_median: float
    volume_min: float
    volume_median: float
    volume_max: float
    edge_min: float
    edge_median: float
    edge_max: float
    edge_mean: float
    tets_per_vertex: float
    manifold: bool
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "warnings": list(self.warnings)}

    def rows(self) -> list[tuple[str, str]]:
        """Label and value of each line of a printed table."""
        dihedral = (self.dihedral_min, self.dihedral_1, self.dihedral_5, self.dihedral_median)
        ratio = (self.radius_ratio_min, self.radius_ratio_1, self.radius_ratio_median)
        edges = (self.edge_min, self.edge_median, self.edge_mean, self.edge_max)
        return [
            ("vertices", f"{self.vertices:,}"),
            ("tetrahedra", f"{self.tets:,} ({self.tets_per_vertex:.2f} per vertex)"),
            ("components", f"{self.components}"),
            ("boundary", "closed 2-manifold" if self.manifold else "NOT a closed 2-manifold"),
            ("volume [m^3]", f"{self.volume:.6g}"),
            ("smallest dihedral min / 1% / 5% / median [deg]", " / ".join(f"{x:.1f}" for x in dihedral)),
            ("largest dihedral [deg]", f"{self.dihedral_max:.1f}"),
            ("tetrahedra below 1 / 5 deg", f"{self.below_1:,} / {self.below_5:,}"),
            ("radius ratio min / 1% / median", " / ".join(f"{x:.3f}" for x in ratio)),
            (
                "cell volume min / median / max [m^3]",
                f"{self.volume_min:.3g} / {self.volume_median:.3g} / {self.volume_max:.3g}",
            ),
            ("edge min / median / mean / max [m]", " / ".join(f"{x:.4g}" for x in edges)),
        ]


@dataclass(frozen=True)
class Dihedrals:
    """Smallest dihedral angle of the tetrahedra [degrees]: minimum, 1st and 5th percentile, median; largest angle."""

    minimum: float
    percentile_1: float
    percentile_5: float
    median: float
    maximum: float


def quality(mesh: TetMesh) -> Quality:
    """Measure a tetrahedral mesh; slivers and a broken boundary become warnings, never errors."""
    smallest, ratio, volume, largest, total = _shapes(mesh.points, mesh.cells)
    start, around = vertex_cells(mesh.cells, len(mesh.points))
    lengths, total_length = _edge_lengths(mesh.points, mesh.cells, start, around)
    del start, around
    angles = np.percentile(smallest, (0, 1, 5, 50)).tolist()
    ratios = np.percentile(ratio, (0, 1, 50)).tolist()
    below_1, below_5 = int((smallest < 1.0).sum()), int((smallest < 5.0).sum())
    manifold = manifold_report(boundary(mesh.cells)).manifold
    return Quality(
        vertices=len(mesh.points),
        tets=len(mesh.cells),
        components=len(np.unique(component_labels(mesh.cells))),
        volume=float(total),
        dihedral_min=angles[0],
        dihedral_1=angles[1],
        dihedral_5=angles[2],
        dihedral_median=angles[3],
        dihedral_max=float(largest),
        below_1=below_1,
        below_5=below_5,
        radius_ratio_min=ratios[0],
        radius_ratio_1=ratios[1],
        radius_ratio_median=ratios[2],
        volume_min=float(volume.min()),
        volume_median=float(np.median(volume)),
        volume_max=float(volume.max()),
        edge_min=float(lengths.min()),
        edge_median=float(np.median(lengths)),
        edge_max=float(lengths.max()),
        edge_mean=total_length / len(lengths),
        tets_per_vertex=len(mesh.cells) / len(mesh.points),
        manifold=manifold,
        warnings=_warnings(len(mesh.cells), angles[0], below_1, below_5, manifold),
    )


def shapes(points: Points, cells: Cells) -> tuple[Floats, Floats, Floats]:
    """Smallest dihedral angle [degrees], radius ratio and volume [m^3] of each tetrahedron, all of shape [n_tets]."""
    return _shapes(points, cells)[:3]


def dihedrals(points: Points, cells: Cells) -> Dihedrals:
    """Distribution of the smallest dihedral angle alone: the cheap part of `quality`."""
    smallest, _, _, largest, _ = _shapes(points, cells)
    least, percentile_1, percentile_5, median = np.percentile(smallest, (0, 1, 5, 50)).tolist()
    return Dihedrals(least, percentile_1, percentile_5, median, float(largest))


def _warnings(tets: int, smallest: float, below_1: int, below_5: int, manifold: bool) -> tuple[str, ...]:
    found = []
    if below_5:
        found.append(
            f"{below_5} of {tets} tetrahedra have a dihedral angle below 5 degrees, {below_1} below 1 degree"
            f" (smallest {smallest:.3g}): they shorten the stable step and slow every iterative solver"
        )
    if not manifold:
        found.append("the boundary is not a closed 2-manifold: parts touch in single edges or vertices")
    return tuple(found)


@kernel
def _shapes(points: Points, cells: Cells) -> tuple[Floats, Floats, Floats, float, float]:
    """Smallest dihedral angle [degrees], radius ratio and volume of each cell; largest angle, total volume."""
    n = cells.shape[0]
    smallest, ratio, volume = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    normal, edge = np.empty((4, 3)), np.empty((3, 3))
    least_cosine, total = 1.0, 0.0
    for e in range(n):
        for k in range(3):
            for c in range(3):
                edge[k, c] = points[cells[e, k + 1], c] - points[cells[e, 0], c]
        _face_normals(edge, normal)
        most, least = _dihedral_cosines(normal)
        six_volumes = -(edge[0, 0] * normal[0, 0] + edge[0, 1] * normal[0, 1] + edge[0, 2] * normal[0, 2])
        smallest[e] = np.degrees(np.arccos(min(most, 1.0)))
        ratio[e] = _radius_ratio(edge, normal, six_volumes)
        volume[e] = six_volumes / 6.0
        least_cosine = min(least_cosine, least)
        total += six_volumes / 6.0
    return smallest, ratio, volume, np.degrees(np.arccos(max(least_cosine, -1.0))), total


@scalar
def _face_normals(edge: Points, normal: Points) -> None:
    """Outward normals, each of twice its face's area; the fourth closes the surface."""
    for k in range(3):
        a, b = (k + 2) % 3, (k + 1) % 3
        for c in range(3):
            c1, c2 = (c + 1) % 3, (c + 2) % 3
            normal[k, c] = edge[a, c1] * edge[b, c2] - edge[a, c2] * edge[b, c1]
    for c in range(3):
        normal[3, c] = -(normal[0, c] + normal[1, c] + normal[2, c])


@scalar
def _norm(x: float, y: float, z: float) -> float:
    return np.sqrt(x * x + y * y + z * z)


@scalar
def _dihedral_cosines(normal: Points) -> tuple[float, float]:
    """Largest and smallest cosine of the six dihedral angles."""
    most, least = -1.0, 1.0
    for k in range(4):
        for m in range(k):
            dot = normal[k, 0] * normal[m, 0] + normal[k, 1] * normal[m, 1] + normal[k, 2] * normal[m, 2]
            areas = _norm(normal[k, 0], normal[k, 1], normal[k, 2]) * _norm(normal[m, 0], normal[m, 1], normal[m, 2])
            most, least = max(most, -dot / areas), min(least, -dot / areas)
    return most, least


@scalar
def _radius_ratio(edge: Points, normal: Points, six_volumes: float) -> float:
    """3 r_in / R_circ with r_in = 6V / sum |n| and R_circ = |sum |e_k|^2 n_k| / (2 * 6V)."""
    x = y = z = faces = 0.0
    for k in range(3):
        squared = edge[k, 0] ** 2 + edge[k, 1] ** 2 + edge[k, 2] ** 2
        x += squared * normal[k, 0]
        y += squared * normal[k, 1]
        z += squared * normal[k, 2]
    for k in range(4):
        faces += _norm(normal[k, 0], normal[k, 1], normal[k, 2])
    return 6.0 * six_volumes * six_volumes / (faces * _norm(x, y, z))


@kernel
def _edge_lengths(points: Points, cells: Cells, start: NDArray[np.int64], around: Cells) -> tuple[Floats, float]:
    """Length of every edge, met at its lower vertex, and their sum."""
    n = points.shape[0]
    seen = np.full(n, -1, np.int32)
    n_edges = 0
    for fill in range(2):
        if fill == 1:
            lengths = np.empty(n_edges, np.float32)
            seen[:] = -1
            n_edges = 0
            total = 0.0
        for v in range(n):
            for i in range(start[v], start[v + 1]):
                for k in range(4):
                    w = cells[around[i], k]
                    if w > v and seen[w] != v:
                        seen[w] = v
                        if fill == 1:
                            squared = 0.0
                            for c in range(3):
                                squared += (points[w, c] - points[v, c]) ** 2
                            lengths[n_edges] = np.sqrt(squared)
                            total += np.sqrt(squared)
                        n_edges += 1
    return lengths, total
