# SPDX-License-Identifier: BSD-3-Clause
"""How many elements lie between a point of the boundary and the one opposite to it.

From points of the boundary, chosen evenly by area, a ray goes inwards along the normal and through the elements until
it leaves the body. An element of volume V counts as a cell of width (6 V)^(1/3), which is the cell of a grid whose
cubes are split into six: there the number along a ray is the number of grid cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from meshes.surface import boundary_with_owners
from verify.problems.bodies import rng

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

RAYS = 2000
_LONGEST_WALK = 20_000


@dataclass(frozen=True, eq=False)
class Thickness:
    """Along each of k rays, of which each stands for the same area of the boundary.

    Parameters
    ----------
    length : Of the ray within the body [m], shape [k].
    elements : Widths of elements along it, shape [k].
    start : Where it enters [m], shape [k, 3].
    """

    length: Floats
    elements: Floats
    start: Floats


def thickness(disc: Discretisation, rays: int = RAYS) -> Thickness:
    """Measure the body along rays from its boundary."""
    mesh = disc.mesh
    triangles, owners = boundary_with_owners(mesh.cells)
    a, b, c = (mesh.points[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    chosen = rng(900).choice(len(triangles), rays, p=area / area.sum())
    origin = ((a + b + c) / 3.0)[chosen]
    direction = -(normal / area[:, None])[chosen]
    length, elements = _walk(disc, origin, direction, owners[chosen].astype(np.int64))
    return Thickness(length, elements, origin)


def face_neighbours(cells: NDArray[np.int32]) -> Integers:
    """Tetrahedron behind the face opposite to each vertex, -1 where there is none, shape [m, 4]."""
    opposite = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    faces = np.sort(cells[:, opposite].reshape(-1, 3), axis=1)
    order = np.lexsort(faces.T)
    same = (faces[order[1:]] == faces[order[:-1]]).all(axis=1)
    first, second = order[:-1][same], order[1:][same]
    neighbour = np.full(4 * len(cells), -1, np.int64)
    neighbour[first], neighbour[second] = second // 4, first // 4
    return neighbour.reshape(-1, 4)


def _walk(disc: Discretisation, origin: Floats, direction: Floats, element: Integers) -> tuple[Floats, Floats]:
    """Length and widths of elements along rays that start in the given elements."""
    neighbour, width = face_neighbours(disc.mesh.cells), np.cbrt(6.0 * disc.V)
    k = len(origin)
    length, elements, entry = np.zeros(k), np.zeros(k), np.full(k, -1)
    inside = np.arange(k)
    for _ in range(_LONGEST_WALK):
        if not len(inside):
            break
        e = element[inside]
        t, face = _exit(disc, e, origin[inside], direction[inside], entry[inside])
        elements[inside] += np.maximum(t - length[inside], 0.0) / width[e]
        length[inside] = np.maximum(t, length[inside])
        ahead = neighbour[e, face]
        # The face by which a ray comes in cannot be where it goes out.
        back = neighbour[np.maximum(ahead, 0)] == e[:, None]
        entry[inside], element[inside] = np.argmax(back, axis=1), ahead
        inside = inside[ahead >= 0]
    return length, elements


def _exit(
    disc: Discretisation, e: Integers, origin: Floats, direction: Floats, entry: Integers
) -> tuple[Floats, Integers]:
    """Distance along the ray to where it leaves each element, and the face by which it does."""
    B = disc.B[e].reshape(-1, 3, 3)
    gradient = np.concatenate([-B.sum(axis=1, keepdims=True), B], axis=1)
    at = origin - disc.mesh.points[disc.mesh.cells[e, 0]]
    value = np.einsum("kij,kj->ki", gradient, at)
    value[:, 0] += 1.0
    slope = np.einsum("kij,kj->ki", gradient, direction)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(slope < 0.0, -value / slope, np.inf)
    came = entry >= 0
    t[came, entry[came]] = np.inf
    face = np.argmin(t, axis=1)
    return t[np.arange(len(e)), face], face
