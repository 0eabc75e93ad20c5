# SPDX-License-Identifier: BSD-3-Clause
"""Triangle surface of an implicit function: marching tetrahedra on a body-centred cubic lattice.

Marching tetrahedra give a closed 2-manifold whatever the function does between the lattice nodes: every lattice edge
is cut once or not at all, and two tetrahedra agree on their common face. The cuts are then found by bisection, and
smoothing along the surface rounds out the thin triangles that a lattice leaves.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshError
from meshes.jit import kernel
from meshes.types import Origin, Points, TriMesh

Vector = tuple[float, float, float]
Values = Callable[[Points], NDArray[np.float64]]

_BISECTIONS = 30
_MAX_NODES = 400_000_000

# The four vertices of a tetrahedron by the bit mask of those inside, reordered by an even permutation: the single
# vertex, or the pair of inside ones, comes first.
_ORDER = np.array(
    [
        (0, 1, 2, 3),  # none
        (0, 1, 2, 3),
        (1, 0, 3, 2),
        (0, 1, 2, 3),
        (2, 3, 0, 1),
        (0, 2, 3, 1),
        (1, 2, 0, 3),
        (3, 2, 1, 0),
        (3, 2, 1, 0),
        (0, 3, 1, 2),
        (1, 3, 2, 0),
        (2, 3, 0, 1),
        (2, 3, 0, 1),
        (1, 0, 3, 2),
        (0, 1, 2, 3),
        (0, 1, 2, 3),  # all
    ],
    np.int64,
)
_INSIDE_COUNT = np.array([bin(mask).count("1") for mask in range(16)], np.int64)


def isosurface(
    values: Values,
    lower: Vector,
    upper: Vector,
    spacing: float,
    *,
    smoothing: int = 6,
    origin: Origin | None = None,
) -> TriMesh:
    """Surface where a function is zero, outward from where it is negative.

    Parameters
    ----------
    values : Function of points [n, 3] that returns [n] numbers: negative inside, continuous, smooth near its zeros.
    lower, upper : Corners of a box [m] that contains the surface.
    spacing : Edge of the cubic lattice cells [m]; triangles are about half as long.
    smoothing : Rounds of smoothing along the surface; 0 leaves the lattice's thin triangles.

    Returns
    -------
    Closed 2-manifold without degenerate triangles.

    Raises
    ------
    MeshError
        No surface in the box, the surface leaves the box, or the lattice has more than 4e8 nodes.
    """
    low, shape, at_nodes = _sampled(values, lower, upper, spacing)
    ends = np.empty((_march(at_nodes, *shape, np.empty((0, 3, 2), np.int64)), 3, 2), np.int64)
    if len(ends) == 0:
        raise MeshError("the function has no zero in the box", where="isosurface", found=f"spacing {spacing} m")
    _march(at_nodes, *shape, ends)
    keys, inverse = np.unique(ends[..., 0] * len(at_nodes) + ends[..., 1], return_inverse=True)
    first, second = (_positions(k, low, spacing, shape) for k in np.divmod(keys, len(at_nodes)))
    points = _bisected(values, first, second)
    triangles = inverse.reshape(-1, 3).astype(np.int32)
    for _ in range(smoothing):
        points = _on_surface(values, _smoothed(points, triangles), spacing)
    return TriMesh(points, triangles, origin or Origin("isosurface"))


def count_triangles(values: Values, lower: Vector, upper: Vector, spacing: float) -> int:
    """Triangles that `isosurface` would make, without making them; same arguments and errors."""
    _, shape, at_nodes = _sampled(values, lower, upper, spacing)
    return _march(at_nodes, *shape, np.empty((0, 3, 2), np.int64))


def _sampled(
    values: Values, lower: Vector, upper: Vector, spacing: float
) -> tuple[Points, tuple[int, int, int], NDArray[np.float64]]:
    """Lowest corner of the lattice, its cells along each axis, and the function at its nodes."""
    shape = _lattice_shape(np.asarray(lower), np.asarray(upper), spacing)
    low = 0.5 * (np.asarray(lower) + np.asarray(upper)) - 0.5 * spacing * np.array(shape)
    at_nodes = _node_values(values, low, spacing, shape)
    _refuse_cut_boundary(at_nodes, shape)
    return low, shape, at_nodes


def _lattice_shape(lower: Points, upper: Points, spacing: float) -> tuple[int, int, int]:
    cells = np.ceil((upper - lower) / spacing).astype(np.int64) + 2
    if 2 * np.prod(cells.astype(np.float64)) > _MAX_NODES:
        raise MeshError("the lattice is too fine", where="isosurface", found=cells.tolist(), allowed="4e8 nodes")
    return int(cells[0]), int(cells[1]), int(cells[2])


def _positions(nodes: NDArray[np.int64], low: Points, spacing: float, shape: tuple[int, int, int]) -> Points:
    """Positions of lattice nodes: first the corners of the cells, then their centres."""
    corner_shape = tuple(n + 1 for n in shape)
    corners = int(np.prod(corner_shape))
    is_corner = nodes < corners
    place = np.empty((len(nodes), 3))
    place[is_corner] = np.stack(np.unravel_index(nodes[is_corner], corner_shape), axis=1)
    place[~is_corner] = np.stack(np.unravel_index(nodes[~is_corner] - corners, shape), axis=1) + 0.5
    return low + spacing * place


def _node_values(values: Values, low: Points, spacing: float, shape: tuple[int, int, int]) -> NDArray[np.float64]:
    number = int(np.prod([n + 1 for n in shape]) + np.prod(shape))
    at_nodes = np.empty(number)
    for start in range(0, number, 1 << 20):
        nodes = np.arange(start, min(start + (1 << 20), number))
        at_nodes[nodes] = values(_positions(nodes, low, spacing, shape))
    return at_nodes


def _refuse_cut_boundary(at_nodes: NDArray[np.float64], shape: tuple[int, int, int]) -> None:
    corner_shape = tuple(n + 1 for n in shape)
    corners = at_nodes[: int(np.prod(corner_shape))].reshape(corner_shape)
    centres = at_nodes[corners.size :].reshape(shape)
    for grid in (corners, centres):
        if min(np.take(grid, side, axis).min() for axis in range(3) for side in (0, -1)) < 0.0:
            raise MeshError("the surface leaves the box", where="isosurface", advice="enlarge the box")


@kernel
def _march(at_nodes: NDArray[np.float64], nx: int, ny: int, nz: int, ends: NDArray[np.int64]) -> int:
    """Write the end nodes of the cut edges, [triangle, corner, 2]; only count when ``ends`` is empty."""
    cells = (nx, ny, nz)
    corner_steps = ((ny + 1) * (nz + 1), nz + 1, 1)
    centre_steps = (ny * nz, nz, 1)
    corners = (nx + 1) * (ny + 1) * (nz + 1)
    tet = np.empty(4, np.int64)
    found = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                here = (i, j, k)
                centre = corners + i * centre_steps[0] + j * centre_steps[1] + k
                for axis in range(3):
                    if here[axis] + 1 == cells[axis]:
                        continue
                    # Around the edge between two cell centres: the four edges of the face that it crosses.
                    u, v = corner_steps[(axis + 1) % 3], corner_steps[(axis + 2) % 3]
                    base = i * corner_steps[0] + j * corner_steps[1] + k + corner_steps[axis]
                    ring = (base, base + u, base + u + v, base + v)
                    for side in range(4):
                        tet[0], tet[1] = centre, centre + centre_steps[axis]
                        tet[2], tet[3] = ring[side], ring[(side + 1) % 4]
                        found = _cut_tetrahedron(tet, at_nodes, ends, found)
    return found


@kernel
def _cut_tetrahedron(tet: NDArray[np.int64], at_nodes: NDArray[np.float64], ends: NDArray[np.int64], at: int) -> int:
    """Write the none to two triangles in one positively oriented tetrahedron; return the count so far."""
    mask = 0
    for k in range(4):
        if at_nodes[tet[k]] < 0.0:
            mask |= 1 << k
    inside = _INSIDE_COUNT[mask]
    if inside == 0 or inside == 4:
        return at
    if len(ends) == 0:
        return at + (2 if inside == 2 else 1)
    p, q, r, s = (tet[_ORDER[mask, 0]], tet[_ORDER[mask, 1]], tet[_ORDER[mask, 2]], tet[_ORDER[mask, 3]])
    if inside == 1:
        _write_triangle(ends[at], p, q, p, r, p, s)
    elif inside == 3:
        _write_triangle(ends[at], p, q, p, s, p, r)
    else:
        _write_triangle(ends[at], p, r, p, s, q, s)
        at += 1
        _write_triangle(ends[at], p, r, q, s, q, r)
    return at + 1


@kernel
def _write_triangle(out: NDArray[np.int64], a: int, b: int, c: int, d: int, e: int, f: int) -> None:
    out[0, 0], out[0, 1] = min(a, b), max(a, b)
    out[1, 0], out[1, 1] = min(c, d), max(c, d)
    out[2, 0], out[2, 1] = min(e, f), max(e, f)


def _bisected(values: Values, first: Points, second: Points) -> Points:
    """Zero of the function between two ends of opposite sign, for every pair."""
    starts_inside = values(first) < 0.0
    inner = np.where(starts_inside[:, None], first, second)
    outer = np.where(starts_inside[:, None], second, first)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inner + outer)
        inside = (values(middle) < 0.0)[:, None]
        inner, outer = np.where(inside, middle, inner), np.where(inside, outer, middle)
    return 0.5 * (inner + outer)


def _smoothed(points: Points, triangles: NDArray[np.int32]) -> Points:
    """Move every vertex half way to the mean of its neighbours."""
    total = np.zeros_like(points)
    neighbours = np.bincount(triangles.ravel(), minlength=len(points))
    for axis in range(3):
        corner = points[triangles, axis]
        # Each neighbour is met in two triangles, once as the next corner and once as the one before.
        both = np.roll(corner, -1, axis=1) + np.roll(corner, 1, axis=1)
        total[:, axis] = np.bincount(triangles.ravel(), both.ravel(), len(points))
    return 0.5 * points + 0.5 * total / (2.0 * neighbours[:, None])


def _on_surface(values: Values, points: Points, spacing: float) -> Points:
    """Two Newton steps along the gradient, each at most a quarter of the spacing."""
    step = 1e-3 * spacing
    for _ in range(2):
        now = values(points)
        gradient = np.empty_like(points)
        for axis in range(3):
            offset = step * np.eye(3)[axis]
            gradient[:, axis] = (values(points + offset) - values(points - offset)) / (2.0 * step)
        length = np.maximum(np.linalg.norm(gradient, axis=1), 1e-12)
        distance = np.clip(now / length, -0.25 * spacing, 0.25 * spacing)
        points = points - (distance / length)[:, None] * gradient
    return points
