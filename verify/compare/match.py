# SPDX-License-Identifier: BSD-3-Clause
"""Which vertex of somebody else's mesh is which of ours: by where they are at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError
from meshes.types import TetMesh
from verify.problems.bodies import mean_edge

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Positions in float32 are off by 1e-7 of the body's size; no two vertices of a mesh are as close as this share of the
# mean edge, unless they are meant to be one.
NEAR = 1e-3


@dataclass(frozen=True, eq=False)
class Matching:
    """How two orders of the same vertices belong together.

    Parameters
    ----------
    theirs : Index in their order of each of our vertices, shape [n].
    distance : Largest distance between two that are the same [m].
    how : In words.
    """

    theirs: Integers
    distance: float
    how: str

    @property
    def moved(self) -> int:
        """How many vertices have another number."""
        return int((self.theirs != np.arange(len(self.theirs))).sum())


def match(ours: TetMesh, points: Floats, rest: Floats, cells: NDArray[np.int32] | None, where: str) -> Matching:
    """Find our vertices among theirs.

    Parameters
    ----------
    ours : The scene's mesh.
    points : Where its vertices are looked for [m]: at rest, or at the start; shape [n, 3].
    rest, cells : Theirs, in their order; the tetrahedra are checked where they are given.
    where : Their file, for messages.

    Raises
    ------
    InputError
        The meshes differ: other vertices, or the same ones joined to other tetrahedra.
    """
    from scipy.spatial import cKDTree

    n = len(points)
    check_count(len(rest), n, where)
    near = NEAR * mean_edge(ours)
    same_order = np.linalg.norm(rest - points, axis=1)
    if same_order.max() <= near:
        theirs, distance = np.arange(n), same_order
    else:
        distance, theirs = cKDTree(rest).query(points)
    if not distance.max() <= near or len(np.unique(theirs)) != n:
        raise InputError(
            "the result is of another mesh",
            where=where,
            found=f"{int((distance > near).sum())} of {n} vertices are not where the scene has one, "
            f"the furthest by {distance.max():.3g} m",
            allowed=f"rest positions within {near:.2g} m of the scene's",
            advice=_hint(points, rest),
        )
    _check_cells(ours.cells, cells, theirs, where)
    moved = int((theirs != np.arange(n)).sum())
    how = f"vertices in another order: {moved} of {n} matched by position" if moved else "vertices in the same order"
    return Matching(theirs, float(distance.max()), how)


def check_count(found: int, n: int, where: str) -> None:
    """Refuse another number of vertices.

    Raises
    ------
    InputError
        With both numbers.
    """
    if found != n:
        raise InputError(
            "the result is of another mesh",
            where=where,
            found=f"{found} vertices",
            allowed=f"{n} vertices, those of the scene",
            advice="the scene must have the mesh and the number of vertices that the result was computed with",
        )


def _check_cells(ours: NDArray[np.int32], cells: NDArray[np.int32] | None, theirs: Integers, where: str) -> None:
    if cells is None:
        return
    mine, other = (np.unique(np.sort(of, axis=1), axis=0) for of in (theirs[ours], np.asarray(cells, np.int64)))
    if mine.shape == other.shape and (mine == other).all():
        return
    shared = len(set(map(tuple, mine.tolist())) & set(map(tuple, other.tolist())))
    raise InputError(
        "the same vertices are joined to other tetrahedra",
        where=where,
        found=f"{len(other)} tetrahedra, of which {shared} are the scene's",
        allowed=f"the {len(mine)} of the scene",
        advice="compute the result on the mesh of the scene",
    )


def _hint(ours: Floats, rest: Floats) -> str:
    """What may have happened to a mesh that has as many vertices."""
    sizes = np.ptp(rest, axis=0) / np.ptp(ours, axis=0)
    shift = rest.mean(axis=0) - ours.mean(axis=0)
    if np.ptp(sizes) <= 1e-3 * sizes.max() and abs(sizes.mean() - 1.0) > 1e-3:
        return f"it is {sizes.mean():.4g} times as large: check the unit of length"
    if np.allclose(np.sort(np.ptp(rest, axis=0)), np.sort(np.ptp(ours, axis=0)), rtol=1e-3):
        if np.ptp(sizes) > 1e-3:
            return "it has the same size along other axes: check which axis points up"
        if np.linalg.norm(shift) > 1e-3 * np.ptp(ours, axis=0).max():
            return f"it stands elsewhere, by ({', '.join(f'{c:.4g}' for c in shift)}) m: check translate"
    return "write rest positions, not moved ones, as the points of the mesh; and check size, rotation and translation"
