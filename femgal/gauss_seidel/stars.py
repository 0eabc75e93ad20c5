# SPDX-License-Identifier: BSD-3-Clause
"""The star of each free vertex: what its own part of the energy takes from the tetrahedra around it.

Seen from one vertex i of a tetrahedron of rest volume V, with a, b, c the other three such that

    n = (x_b - x_a) x (x_c - x_a),    z = cof F grad N_i = n / (6 V),    J = z . (x_i - x_a),

z does not depend on x_i. With F grad N_i = sum_k (grad N_k . grad N_i) x_k the gradient and the block of Lu et al. 2025
(Eq. 15 and 16) become

    g_i = sum over edges L_ik (x_k - x_i)  +  sum over tetrahedra (p n . (x_i - x_a) - q) n
    H_i = -(sum over edges L_ik) I         +  sum over tetrahedra p n n^T

with L_ik = sum of V mu grad N_i . grad N_k over the tetrahedra at the edge, p = V lam / (6 V)^2 and
q = V (lam + mu) / (6 V). H_i does not depend on x_i either: the energy is exactly quadratic in each vertex. Neither
deformation gradients nor inverse rest matrices are kept, only 28 bytes for each of the 4 pairs of a tetrahedron and 12
for each neighbour of a vertex. Numbering the vertices by colour changes no time that could be measured (bunny, 2 K to
200 K vertices), so positions stay in the order of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from meshes.connectivity import vertex_cells
from meshes.jit import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# The other three vertices of a positively oriented tetrahedron such that n points to vertex k.
_OTHERS = np.array([[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]])


@dataclass(frozen=True, eq=False)
class Stars:
    """Stars of k free vertices in the order of a sweep.

    Parameters
    ----------
    vertex : The vertices, shape [k].
    edge_ptr : Star s owns the edges edge_ptr[s] to edge_ptr[s + 1] - 1, shape [k + 1].
    neighbour, laplacian : Other end of each edge, free or not, and L_ik [N/m], shape [edges].
    face_ptr : Star s owns the faces face_ptr[s] to face_ptr[s + 1] - 1, shape [k + 1].
    face : Vertices a, b, c of each tetrahedron around, shape [faces, 3].
    stiffness : p [N/m^5] and q [N/m^2] of each, shape [faces, 2].
    diagonal : -(sum over edges L_ik) [N/m], shape [k].
    """

    vertex: Ints
    edge_ptr: Longs
    neighbour: Ints
    laplacian: Floats
    face_ptr: Longs
    face: Ints
    stiffness: Floats
    diagonal: Floats

    @property
    def arrays(self) -> tuple[NDArray, ...]:
        """Arguments of `femgal.gauss_seidel.sweep.descend`."""
        edges, faces = (self.edge_ptr, self.neighbour, self.laplacian), (self.face_ptr, self.face, self.stiffness)
        return self.vertex, *edges, *faces, self.diagonal


def build_stars(disc: Discretisation, vertex: Ints) -> Stars:
    """Stars of the given vertices, in their order."""
    cells, around = disc.mesh.cells, vertex_cells(disc.mesh.cells, disc.n_vertices)
    face_ptr = _offsets(np.diff(around[0])[vertex])
    count = np.empty(len(vertex), np.int64)
    _count_neighbours(cells, *around, vertex, count)
    edge_ptr = _offsets(count)
    neighbour, laplacian = np.empty(edge_ptr[-1], np.int32), np.zeros(edge_ptr[-1])
    face, stiffness = np.empty((face_ptr[-1], 3), np.int32), np.empty((face_ptr[-1], 2))
    _fill_faces(cells, *around, vertex, disc.V, disc.Vmu, disc.Vlam, face_ptr, face, stiffness)
    _fill_edges(cells, *around, vertex, disc.B, disc.Vmu, edge_ptr, neighbour, laplacian)
    diagonal = -np.bincount(np.repeat(np.arange(len(vertex)), count), laplacian, len(vertex)).astype(np.float64)
    return Stars(vertex, edge_ptr, neighbour, laplacian, face_ptr, face, stiffness, diagonal)


def _offsets(count: Longs) -> Longs:
    return np.concatenate(([0], np.cumsum(count))).astype(np.int64)


@kernel
def _count_neighbours(cells: Ints, start: Longs, incident: Ints, vertex: Ints, count: Longs) -> None:
    last = np.full(len(start) - 1, -1, np.int32)
    for s in range(len(vertex)):
        v = vertex[s]
        last[v] = s
        count[s] = 0
        for j in range(start[v], start[v + 1]):
            for k in range(4):
                w = cells[incident[j], k]
                if last[w] != s:
                    last[w] = s
                    count[s] += 1


@kernel
def _fill_faces(
    cells: Ints,
    start: Longs,
    incident: Ints,
    vertex: Ints,
    V: Floats,
    Vmu: Floats,
    Vlam: Floats,
    face_ptr: Longs,
    face: Ints,
    stiffness: Floats,
) -> None:
    for s in range(len(vertex)):
        p = face_ptr[s]
        for j in range(start[vertex[s]], start[vertex[s] + 1]):
            e = incident[j]
            k = 0
            while cells[e, k] != vertex[s]:
                k += 1
            for c in range(3):
                face[p, c] = cells[e, _OTHERS[k, c]]
            stiffness[p, 0] = Vlam[e] / (36.0 * V[e] * V[e])
            stiffness[p, 1] = (Vlam[e] + Vmu[e]) / (6.0 * V[e])
            p += 1


@kernel
def _fill_edges(
    cells: Ints,
    start: Longs,
    incident: Ints,
    vertex: Ints,
    B: Floats,
    Vmu: Floats,
    edge_ptr: Longs,
    neighbour: Ints,
    laplacian: Floats,
) -> None:
    at = np.full(len(start) - 1, -1, np.int64)
    grad = np.empty((4, 3))
    for s in range(len(vertex)):
        v = vertex[s]
        first = end = edge_ptr[s]
        for j in range(start[v], start[v + 1]):
            e = incident[j]
            own = 0
            for c in range(3):
                grad[1, c], grad[2, c], grad[3, c] = B[e, c], B[e, 3 + c], B[e, 6 + c]
                grad[0, c] = -(grad[1, c] + grad[2, c] + grad[3, c])
            while cells[e, own] != v:
                own += 1
            for k in range(4):
                w = cells[e, k]
                if w == v:
                    continue
                # Places of an earlier star lie before this one's.
                if at[w] < first:
                    at[w] = end
                    neighbour[end] = w
                    end += 1
                dot = grad[own, 0] * grad[k, 0] + grad[own, 1] * grad[k, 1] + grad[own, 2] * grad[k, 2]
                laplacian[at[w]] += Vmu[e] * dot
