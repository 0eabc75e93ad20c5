# SPDX-License-Identifier: BSD-3-Clause
"""Closed surfaces: their defects, their orientation, and the boundary of a tetrahedral mesh."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes.connectivity import component_labels, vertex_bound, vertex_cells
from meshes.errors import MeshError
from meshes.jit import kernel, scalar
from meshes.types import Points, TriMesh

Indices = NDArray[np.int32]


@dataclass(frozen=True)
class ManifoldReport:
    """What keeps a set of triangles from being a closed, oriented 2-manifold.

    Parameters
    ----------
    triangles, edges, vertices : Numbers of each.
    open_edges : Edges of one triangle only.
    crowded_edges : Edges of three or more triangles.
    inconsistent_edges : Edges whose two triangles run along them in the same direction.
    pinched_vertices : Vertices whose triangles form more than one fan.
    components : Pieces connected through shared vertices.
    """

    triangles: int
    edges: int
    vertices: int
    open_edges: int
    crowded_edges: int
    inconsistent_edges: int
    pinched_vertices: int
    components: int

    @property
    def closed(self) -> bool:
        """Every edge belongs to exactly two triangles."""
        return self.open_edges == 0 and self.crowded_edges == 0

    @property
    def manifold(self) -> bool:
        """Closed, consistently wound, and every vertex has one fan."""
        return self.closed and self.inconsistent_edges == 0 and self.pinched_vertices == 0

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "closed": self.closed, "manifold": self.manifold}


def manifold_report(triangles: Indices) -> ManifoldReport:
    """Count the defects of a triangle set.

    Parameters
    ----------
    triangles : Vertex indices, shape [n_triangles, 3]; vertices that no triangle uses are not counted.
    """
    triangles = np.ascontiguousarray(triangles, np.int32)
    _, faces, balance = edge_table(triangles)
    used = np.flatnonzero(np.bincount(triangles.ravel()))
    return ManifoldReport(
        triangles=len(triangles),
        edges=len(faces),
        vertices=len(used),
        open_edges=int((faces == 1).sum()),
        crowded_edges=int((faces > 2).sum()),
        inconsistent_edges=int(((faces == 2) & (balance != 0)).sum()),
        pinched_vertices=len(pinched_vertices(triangles)),
        components=len(np.unique(component_labels(triangles)[used])),
    )


def check_closed(surface: TriMesh) -> None:
    """Refuse a surface that encloses no well-defined volume.

    Raises
    ------
    MeshError
        Open edges, edges of three or more triangles, or neighbouring triangles of opposite winding.
    """
    report = manifold_report(surface.cells)
    where = surface.origin.source if surface.origin.source != "procedural" else surface.origin.name
    if not report.closed:
        raise MeshError(
            "the surface is not closed",
            where=where,
            found=f"{report.open_edges} open edges and {report.crowded_edges} edges of 3 or more triangles"
            f" among {report.edges}",
            allowed="every edge in exactly 2 triangles",
            advice="merge duplicate vertices and fill the holes, or mesh it with the extra 'pytetwild',"
            " which accepts dirty surfaces",
        )
    if report.inconsistent_edges:
        raise MeshError(
            "neighbouring triangles are wound in opposite directions",
            where=where,
            found=f"{report.inconsistent_edges} such edges among {report.edges}",
            allowed="counter-clockwise seen from outside, everywhere",
            advice="make the winding consistent in the program that wrote the surface, or use the extra 'pytetwild'",
        )


def outward(surface: TriMesh) -> TriMesh:
    """Turn the triangles of a closed surface outwards.

    The whole is turned when it encloses a negative volume. A component that lies outside all others and is still
    inside out is then turned alone; one inside another component is left as it is, since it may bound a void.
    """
    cells = surface.cells
    if surface.enclosed_volume < 0.0:
        cells = cells[:, ::-1]
    pieces = triangle_components(cells)
    if pieces.max() > 0:
        cells = _turn_inverted_solids(surface.points, cells, pieces)
    return surface if cells is surface.cells else replace(surface, cells=np.ascontiguousarray(cells))


def triangle_components(triangles: Indices) -> Indices:
    """Component number of each triangle, counted from 0 by the lowest vertex, shape [n_triangles], int32."""
    labels = component_labels(np.ascontiguousarray(triangles, np.int32))[triangles[:, 0]]
    lowest = np.zeros(vertex_bound(triangles), np.int32)
    lowest[labels] = 1
    return (np.cumsum(lowest, dtype=np.int32) - np.int32(1))[labels]


def _turn_inverted_solids(points: Points, cells: Indices, pieces: Indices) -> Indices:
    a, b, c = (points[cells[:, k]] for k in range(3))
    volumes = np.bincount(pieces, np.einsum("ij,ij->i", a, np.cross(b, c)))
    turn = np.zeros(len(volumes), bool)
    for piece in np.flatnonzero(volumes < 0.0).tolist():
        probe = points[cells[np.flatnonzero(pieces == piece)[0], 0]]
        turn[piece] = _depth(probe, piece, a, b, c, pieces) % 2 == 0
    return np.where(turn[pieces][:, None], cells[:, ::-1], cells)


def _depth(probe: Points, piece: int, a: Points, b: Points, c: Points, pieces: Indices) -> int:
    """Number of other components that wind around a point (solid angles, Van Oosterom and Strackee 1983)."""
    a, b, c = a - probe, b - probe, c - probe
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    bottom = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    winding = np.bincount(pieces, np.arctan2(top, bottom)) / (2.0 * np.pi)
    winding[piece] = 0.0
    return int((np.abs(winding) > 0.5).sum())


def boundary(cells: Indices) -> Indices:
    """Boundary triangles of a tetrahedral mesh, turned outwards, shape [n_triangles, 3], int32.

    Parameters
    ----------
    cells : Vertex indices of positively oriented tetrahedra, shape [n_tets, 4].
    """
    return boundary_with_owners(cells)[0]


def boundary_with_owners(cells: Indices) -> tuple[Indices, Indices]:
    """Boundary triangles as `boundary` gives them, and the tetrahedron that each belongs to.

    Returns
    -------
    triangles : Vertex indices, turned outwards, shape [n_triangles, 3], int32.
    owners : Row of ``cells``, shape [n_triangles], int32.
    """
    cells = np.ascontiguousarray(cells, np.int32)
    bucket = np.empty(4 * len(cells), np.int32)
    faces = bucket[: _boundary_faces(cells, vertex_bound(cells), bucket)].copy()
    return _outward_triangles(cells, faces), faces >> 2


def edge_table(triangles: Indices) -> tuple[Indices, Indices, Indices]:
    """Return all edges [n, 2], how many triangles each has, and how many more run up than down along it."""
    most = 3 * len(triangles)
    edges, faces, balance = np.empty((most, 2), np.int32), np.zeros(most, np.int32), np.zeros(most, np.int32)
    n = _edge_table(triangles, vertex_bound(triangles), edges, faces, balance)
    return edges[:n].copy(), faces[:n].copy(), balance[:n].copy()


def pinched_vertices(triangles: Indices) -> Indices:
    """Vertices whose triangles form more than one fan, ascending, int32."""
    return np.flatnonzero(_fans(triangles, vertex_bound(triangles)) > 1).astype(np.int32)


@scalar
def _sorted_face(cells: Indices, face: int) -> tuple[int, int, int]:
    # Face number 4 e + k lies opposite vertex k of tetrahedron e.
    e, k = face >> 2, face & 3
    a, b, c = cells[e, (k + 1) & 3], cells[e, (k + 2) & 3], cells[e, (k + 3) & 3]
    low, high = min(a, b, c), max(a, b, c)
    return low, a + b + c - low - high, high


@kernel
def _boundary_faces(cells: Indices, n_vertices: int, bucket: Indices) -> int:
    # Faces meet in the bucket of their lowest vertex: one 4-byte entry per face, no sorting. The bucket is then
    # overwritten by the faces met once, whose number is returned.
    n_faces = 4 * cells.shape[0]
    start = np.zeros(n_vertices + 1, np.int64)
    for face in range(n_faces):
        start[_sorted_face(cells, face)[0] + 1] += 1
    widest = np.int64(0)
    for v in range(n_vertices):
        widest = max(widest, start[v + 1])
        start[v + 1] += start[v]
    cursor = start.copy()
    for face in range(n_faces):
        low = _sorted_face(cells, face)[0]
        bucket[cursor[low]] = face
        cursor[low] += 1
    middle, high = np.empty(widest, np.int32), np.empty(widest, np.int32)
    alone = np.empty(widest, np.bool_)
    n_alone = 0
    for v in range(n_vertices):
        n = start[v + 1] - start[v]
        for i in range(n):
            _, middle[i], high[i] = _sorted_face(cells, bucket[start[v] + i])
            alone[i] = True
            for j in range(i):
                if middle[j] == middle[i] and high[j] == high[i]:
                    alone[i] = alone[j] = False
        for i in range(n):
            if alone[i]:
                bucket[n_alone] = bucket[start[v] + i]
                n_alone += 1
    return n_alone


@kernel
def _outward_triangles(cells: Indices, faces: Indices) -> Indices:
    triangles = np.empty((faces.shape[0], 3), np.int32)
    for i in range(faces.shape[0]):
        e, k = faces[i] >> 2, faces[i] & 3
        # Opposite vertices 0 and 2 the cyclic order looks outwards, opposite 1 and 3 inwards.
        swap = k & 1
        triangles[i, 0] = cells[e, (k + 1) & 3]
        triangles[i, 1 + swap] = cells[e, (k + 2) & 3]
        triangles[i, 2 - swap] = cells[e, (k + 3) & 3]
    return triangles


@kernel
def _edge_table(triangles: Indices, n_vertices: int, edges: Indices, faces: Indices, balance: Indices) -> int:
    n = 3 * triangles.shape[0]
    start = np.zeros(n_vertices + 1, np.int64)
    for f in range(triangles.shape[0]):
        for k in range(3):
            start[min(triangles[f, k], triangles[f, (k + 1) % 3]) + 1] += 1
    for v in range(n_vertices):
        start[v + 1] += start[v]
    other, direction = np.empty(n, np.int32), np.empty(n, np.int32)
    cursor = start.copy()
    for f in range(triangles.shape[0]):
        for k in range(3):
            a, b = triangles[f, k], triangles[f, (k + 1) % 3]
            low = min(a, b)
            other[cursor[low]] = max(a, b)
            direction[cursor[low]] = 1 if a < b else -1
            cursor[low] += 1
    n_edges = 0
    for v in range(n_vertices):
        first = n_edges
        for i in range(start[v], start[v + 1]):
            e = first
            while e < n_edges and edges[e, 1] != other[i]:
                e += 1
            if e == n_edges:
                edges[e, 0], edges[e, 1] = v, other[i]
                n_edges += 1
            faces[e] += 1
            balance[e] += direction[i]
    return n_edges


@kernel
def _fans(triangles: Indices, n_vertices: int) -> Indices:
    start, around = vertex_cells(triangles, n_vertices)
    fans = np.zeros(n_vertices, np.int32)
    widest = np.int64(0)
    for v in range(n_vertices):
        widest = max(widest, start[v + 1] - start[v])
    ends = np.empty((widest, 2), np.int32)
    fan = np.empty(widest, np.int32)
    for v in range(n_vertices):
        n = start[v + 1] - start[v]
        for i in range(n):
            f = around[start[v] + i]
            k = 0 if triangles[f, 0] == v else (1 if triangles[f, 1] == v else 2)
            ends[i, 0], ends[i, 1] = triangles[f, (k + 1) % 3], triangles[f, (k + 2) % 3]
            fan[i] = i
            for j in range(i):
                if _meet(ends, i, j) and fan[j] != fan[i]:
                    old, new = fan[i], fan[j]
                    for m in range(i + 1):
                        if fan[m] == old:
                            fan[m] = new
        for i in range(n):
            if fan[i] == i:
                fans[v] += 1
    return fans


@scalar
def _meet(ends: Indices, i: int, j: int) -> bool:
    return ends[i, 0] == ends[j, 0] or ends[i, 0] == ends[j, 1] or ends[i, 1] == ends[j, 0] or ends[i, 1] == ends[j, 1]
