# SPDX-License-Identifier: BSD-3-Clause
"""From the unchecked arrays of a file to arrays that a mesh type accepts, with a message for every change."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshError
from meshes.types import Cells, Points, signed_volumes

# Six volumes over the cube of the longest edge: below this the four points lie in one plane up to rounding.
FLAT = 1e-12


def checked_points(points: NDArray, where: str) -> Points:
    """Return finite three-dimensional positions, shape [n_vertices, 3].

    Raises
    ------
    MeshError
        No points, two-dimensional points, NaN or infinity.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3:
        found = f"{points.shape[1]} coordinates" if points.ndim == 2 else f"shape {points.shape}"
        raise MeshError("the vertices are not points in space", where=where, found=found, allowed="3 coordinates")
    points = points.astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{len(bad)} vertex positions are not finite",
            where=where,
            found=f"{points[bad[0]].tolist()} at vertex {bad[0]}",
            allowed="finite numbers",
        )
    return points


def checked_cells(cells: NDArray, n_points: int, kind: str, where: str) -> Cells:
    """Return vertex indices within range as int32, shape [n_cells, width].

    Raises
    ------
    MeshError
        An index outside 0 to ``n_points - 1``; the message shows the first such cell.
    """
    bad = np.flatnonzero(((cells < 0) | (cells >= n_points)).any(axis=1))
    if len(bad):
        raise MeshError(
            f"{kind} {bad[0]} refers to a vertex that does not exist ({len(bad)} such)",
            where=where,
            found=cells[bad[0]].tolist(),
            allowed=f"indices 0 to {n_points - 1}" if n_points else "vertices, and there are none",
        )
    return np.ascontiguousarray(cells, np.int32)


def drop_unused(points: Points, cells: Cells) -> tuple[Points, Cells, list[str]]:
    """Remove vertices that no cell uses; the others keep their order."""
    used = np.zeros(len(points), bool)
    used[cells] = True
    unused = len(points) - int(used.sum())
    if unused == 0:
        return points, cells, []
    renumbered = (np.cumsum(used) - 1).astype(np.int32)
    return points[used], renumbered[cells], [f"dropped {unused} of {len(points)} vertices that no cell uses"]


def repair_winding(points: Points, tets: Cells, where: str) -> tuple[Cells, list[str]]:
    """Turn tetrahedra of negative volume by swapping their last two vertices.

    Raises
    ------
    MeshError
        Tetrahedra without volume: six volumes at most 1e-12 of the longest edge cubed.
    """
    volumes = signed_volumes(points, tets)
    flat = np.flatnonzero(6.0 * np.abs(volumes) <= FLAT * _longest_edges(points, tets) ** 3)
    if len(flat):
        raise MeshError(
            f"{len(flat)} of {len(tets)} tetrahedra have zero volume",
            where=where,
            found=f"volume {volumes[flat[0]]:.3g} in tetrahedron {flat[0]}, vertices {tets[flat[0]].tolist()}",
            allowed=f"6 volume > {FLAT:g} longest edge^3",
            advice="remove the flat cells and mesh again; slivers with some volume are accepted",
        )
    wrong = volumes < 0.0
    if not wrong.any():
        return tets, []
    turned = tets.copy()
    turned[wrong] = tets[wrong][:, [0, 1, 3, 2]]
    return turned, [f"winding repaired: {int(wrong.sum())} of {len(tets)} tetrahedra had negative volume"]


def _longest_edges(points: Points, tets: Cells) -> NDArray[np.float64]:
    longest = np.zeros(len(tets))
    for a in range(4):
        for b in range(a):
            edge = points[tets[:, a]] - points[tets[:, b]]
            np.maximum(longest, np.einsum("ij,ij->i", edge, edge), out=longest)
    return np.sqrt(longest)
