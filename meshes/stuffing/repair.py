# SPDX-License-Identifier: BSD-3-Clause
"""Make the boundary of a filling a closed 2-manifold, and drop pieces that came off the body.

Warping can let two parts of the boundary meet in a vertex or an edge. Parts that hang together through such a contact
alone are separated by giving each its own copy of the vertex; where they also hang together elsewhere, the smaller part
around the contact is removed. Neither changes the shape of any remaining tetrahedron.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meshes.connectivity import component_labels
from meshes.errors import MeshError
from meshes.jit import kernel
from meshes.stuffing.fill import INTERIOR, Filling
from meshes.surface import boundary, edge_table, pinched_vertices, triangle_components
from meshes.types import Cells, TriMesh, signed_volumes

_MOST_ROUNDS = 100  # each removes tetrahedra or splits vertices; real surfaces need 1 to 4


@dataclass(frozen=True)
class Repairs:
    """What was done to a filling.

    Parameters
    ----------
    split_vertices : Copies made of vertices in which parts touched.
    removed_tets : Tetrahedra removed where parts touched in an edge or a vertex but hang together elsewhere.
    fragments : Pieces removed because they had come off the body.
    fragment_volume : Their volume [m^3].
    """

    split_vertices: int = 0
    removed_tets: int = 0
    fragments: int = 0
    fragment_volume: float = 0.0


def repair(filling: Filling, surface: TriMesh) -> tuple[Filling, Repairs]:
    """Separate what only touches, then keep one piece for each component of the surface that bounds a solid.

    Raises
    ------
    MeshError
        The contacts do not come to an end; never seen.
    """
    filling, split, removed = _separate(filling)
    filling, fragments, volume = _drop_fragments(filling, surface)
    return _compact(filling), Repairs(split, removed, fragments, volume)


def _separate(filling: Filling) -> tuple[Filling, int, int]:
    exposed = filling.face != INTERIOR
    split = removed = 0
    for _ in range(_MOST_ROUNDS):
        crowded, pinched = _contacts(filling.cells, exposed)
        if len(crowded) + len(pinched) == 0:
            return filling, split, removed
        filling, copies = _split_vertices(filling, np.union1d(crowded, pinched))
        exposed = np.concatenate([exposed, np.ones(copies, bool)])
        split += copies
        if copies:
            continue
        drop = _smaller_fans(filling, crowded) if len(crowded) else _touching(filling.cells, pinched, len(exposed))
        exposed[filling.cells[drop]] = True
        filling = replace(filling, cells=np.delete(filling.cells, drop, axis=0))
        removed += len(drop)
    raise MeshError(
        "contacts between parts of the boundary could not be removed",
        found=f"{len(crowded)} edges and {len(pinched)} vertices after {_MOST_ROUNDS} rounds",
        advice="ask for a slightly different number of vertices",
    )


def _contacts(cells: Cells, exposed: NDArray[np.bool_]) -> tuple[Cells, Cells]:
    """Boundary edges of more than two triangles, shape [n, 2], and boundary vertices of more than one fan."""
    triangles = boundary(cells[_may_bound(cells, exposed)])
    triangles = triangles[exposed[triangles].all(axis=1)]
    edges, faces, _ = edge_table(triangles)
    return edges[faces > 2], pinched_vertices(triangles)


def _split_vertices(filling: Filling, vertices: Cells) -> tuple[Filling, int]:
    """Give each face-connected part of a vertex's star, but the largest, its own copy of the vertex."""
    cells = filling.cells.copy()
    copied: list[int] = []
    n = len(filling.points)
    for v, star in _stars(cells, vertices, n):
        for part in _parts(cells[star], shared=3)[1:]:
            rows = star[part]
            cells[rows] = np.where(cells[rows] == v, n + len(copied), cells[rows])
            copied.append(v)
    if not copied:
        return filling, 0
    points, face = np.vstack([filling.points, filling.points[copied]]), np.append(filling.face, filling.face[copied])
    return Filling(points, cells, face), len(copied)


def _smaller_fans(filling: Filling, edges: Cells) -> NDArray[np.int64]:
    """Tetrahedra around the edges that are not in the largest face-connected fan there."""
    drop: list[int] = []
    fans = dict(_stars(filling.cells, np.unique(edges), len(filling.points)))
    for u, v in edges.tolist():
        around = np.intersect1d(fans[u], fans[v])
        drop += [row for part in _parts(filling.cells[around], shared=3)[1:] for row in around[part]]
    return np.unique(np.array(drop, np.int64))


def _stars(cells: Cells, vertices: Cells, n_vertices: int) -> list[tuple[int, NDArray[np.int64]]]:
    """Rows of the cells around each of a few vertices."""
    rows = _touching(cells, vertices, n_vertices)
    order = np.argsort(cells[rows], axis=None, kind="stable")
    corner = cells[rows].ravel()[order]
    first, last = np.searchsorted(corner, vertices, "left"), np.searchsorted(corner, vertices, "right")
    return [(int(v), rows[order[i:j] // 4]) for v, i, j in zip(vertices, first, last, strict=True)]


def _parts(cells: Cells, shared: int) -> list[NDArray[np.int64]]:
    """Groups of cells connected through `shared` common vertices, largest first, then by their first cell."""
    common = (cells[:, None, :, None] == cells[None, :, None, :]).any(axis=3).sum(axis=2)
    label = np.arange(len(cells))
    for _ in range(len(cells)):
        lower = np.where(common >= shared, label[None, :], len(cells)).min(axis=1)
        if (lower == label).all():
            break
        label = lower
    groups = [np.flatnonzero(label == first) for first in np.unique(label)]
    return sorted(groups, key=lambda group: (-len(group), group[0]))


def _drop_fragments(filling: Filling, surface: TriMesh) -> tuple[Filling, int, float]:
    labels = component_labels(filling.cells)[filling.cells[:, 0]]
    pieces, piece = np.unique(labels, return_inverse=True)
    if len(pieces) == 1:
        return filling, 0, 0.0
    cell_volumes = signed_volumes(filling.points, filling.cells)
    volumes = np.bincount(piece, cell_volumes)
    keep = _real_pieces(filling, piece, volumes, triangle_components(surface.cells))
    kept = filling.cells[keep[piece]]
    return replace(filling, cells=kept), int((~keep).sum()), float(volumes[~keep].sum())


def _real_pieces(filling: Filling, piece: NDArray, volumes: NDArray, components: NDArray) -> NDArray[np.bool_]:
    """For each component of the surface, the largest piece whose boundary lies on it."""
    cell, corner = np.nonzero(filling.face[filling.cells] != INTERIOR)
    met = np.unique(np.stack([components[filling.face[filling.cells[cell, corner]]], piece[cell]], axis=1), axis=0)
    keep = np.zeros(len(volumes), bool)
    for component in np.unique(met[:, 0]):
        candidates = met[met[:, 0] == component, 1]
        keep[candidates[np.argmax(volumes[candidates])]] = True
    return keep


def _compact(filling: Filling) -> Filling:
    used = np.zeros(len(filling.points), bool)
    used[filling.cells] = True
    if used.all():
        return filling
    number = (np.cumsum(used) - 1).astype(np.int32)
    return Filling(filling.points[used], number[filling.cells], filling.face[used])


def _touching(cells: Cells, vertices: Cells, n_vertices: int) -> NDArray[np.int64]:
    marked = np.zeros(n_vertices, bool)
    marked[vertices] = True
    return _at_least(cells, marked, 1)


def _may_bound(cells: Cells, exposed: NDArray[np.bool_]) -> NDArray[np.int64]:
    # A boundary face has three exposed vertices, and so have both cells of an inner face between such vertices.
    return _at_least(cells, exposed, 3)


def _at_least(cells: Cells, marked: NDArray[np.bool_], least: int) -> NDArray[np.int64]:
    """Rows of the cells with at least so many marked vertices."""
    rows = np.empty(len(cells), np.int64)
    return rows[: _write_at_least(cells, marked, least, rows)].copy()


@kernel
def _write_at_least(cells: Cells, marked: NDArray[np.bool_], least: int, rows: NDArray[np.int64]) -> int:
    n = 0
    for e in range(cells.shape[0]):
        marks = 0
        for k in range(4):
            marks += marked[cells[e, k]]
        if marks >= least:
            rows[n] = e
            n += 1
    return n
