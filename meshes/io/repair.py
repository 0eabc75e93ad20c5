# SPDX-License-Identifier: BSD-3-Clause
"""What can be repaired in the checked arrays of a file, with a message for every change."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshError
from meshes.types import Cells, Points, signed_volumes

# Six volumes over the cube of the longest edge: below this the four points lie in one plane up to rounding.
FLAT = 1e-12


def drop_unused(points: Points, cells: Cells) -> tuple[Points, Cells, list[str]]:
    """Remove vertices that no cell uses; the others keep their order."""
    used = np.zeros(len(points), bool)
    used[cells] = True
    unused = len(points) - int(used.sum())
    if unused == 0:
        return points, cells, []
    renumbered = (np.cumsum(used) - 1).astype(np.int32)
    return points[used], renumbered[cells], [f"dropped {unused} of {len(points)} vertices that no cell uses"]


def refuse_repeated(tets: Cells, where: str) -> None:
    """Refuse a mesh that lists a tetrahedron twice, whatever the order of its vertices: it would count twice.

    Raises
    ------
    MeshError
        Naming the first pair.
    """
    vertices = np.sort(tets, axis=1)
    order = np.lexsort(vertices.T)
    repeated = np.flatnonzero((vertices[order[1:]] == vertices[order[:-1]]).all(axis=1))
    if len(repeated):
        first, second = sorted(order[repeated[0] : repeated[0] + 2].tolist())
        raise MeshError(
            f"{len(repeated)} of {len(tets)} tetrahedra are listed more than once",
            where=where,
            found=f"tetrahedra {first} and {second}, vertices {tets[first].tolist()}",
            allowed="each tetrahedron once",
            advice="remove the copies",
        )


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
