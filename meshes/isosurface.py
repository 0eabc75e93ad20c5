# SPDX-License-Identifier: BSD-3-Clause
"""Triangle surface of an implicit function: marching tetrahedra on a body-centred cubic lattice.

Marching tetrahedra give a closed 2-manifold whatever the function does between the lattice nodes: every lattice edge
is cut once or not at all, and two tetrahedra agree on their common face. The cuts are then found by false position, and
smoothing along the surface rounds out the thin triangles that a lattice leaves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshError
from meshes.jit import kernel, scalar
from meshes.types import Origin, Points, TriMesh

Vector = tuple[float, float, float]
Values = Callable[[Points], NDArray[np.float64]]

_MOST_STEPS = 60  # of false position; a smooth function needs about six
_APART = 1e-9  # from the ends of its edge, as a fraction of it, stays every zero
_FOUND = 1e-10  # step along an edge, as a fraction of it, below which its zero counts as found
_MAX_NODES = 400_000_000
_MOST_POINTS = 1 << 16  # evaluated at once

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
    return sampled(values, lower, upper, spacing).surface(smoothing=smoothing, origin=origin)


@dataclass(frozen=True, eq=False)
class Sampled:
    """A function at the nodes of a lattice: it tells the number of triangles before they are made.

    Parameters
    ----------
    values : The function, see `isosurface`.
    low : Lowest corner of the lattice [m], shape [3].
    spacing : Edge of its cubic cells [m].
    shape : Cells along each axis.
    at_nodes : The function at the corners of the cells, then at their centres.
    triangles : Number of triangles that the surface has.
    """

    values: Values
    low: Points
    spacing: float
    shape: tuple[int, int, int]
    at_nodes: NDArray[np.float64]
    triangles: int

    def surface(self, *, smoothing: int = 6, origin: Origin | None = None) -> TriMesh:
        """Surface where the function is zero; arguments, result and errors as of `isosurface`."""
        if self.triangles == 0:
            raise MeshError(
                "the function has no zero in the box", where="isosurface", found=f"spacing {self.spacing} m"
            )
        ends = np.empty((self.triangles, 3, 2), np.int64)
        _march(self.at_nodes, *self.shape, ends)
        keys, inverse = np.unique(ends[..., 0] * len(self.at_nodes) + ends[..., 1], return_inverse=True)
        first, second = np.divmod(keys, len(self.at_nodes))
        points = self._zeros(first, second)
        triangles = inverse.reshape(-1, 3).astype(np.int32)
        for _ in range(smoothing):
            points = _on_surface(self.values, _smoothed(points, triangles), self.spacing)
        return TriMesh(points, triangles, origin or Origin("isosurface"))

    def _zeros(self, first: NDArray[np.int64], second: NDArray[np.int64]) -> Points:
        """Zero of the function on the edge between two nodes of opposite sign, for every pair."""
        start, end = (_positions(nodes, self.low, self.spacing, self.shape) for nodes in (first, second))
        way = end - start
        t = _false_position(
            lambda t: self.values(start + t[:, None] * way), self.at_nodes[first], self.at_nodes[second]
        )
        # Zeros at a node would make triangles without area.
        return start + np.clip(t, _APART, 1.0 - _APART)[:, None] * way


def sampled(values: Values, lower: Vector, upper: Vector, spacing: float) -> Sampled:
    """Evaluate a function at the nodes of the lattice that `isosurface` works on; same arguments and errors."""
    shape = _lattice_shape(np.asarray(lower), np.asarray(upper), spacing)
    low = 0.5 * (np.asarray(lower) + np.asarray(upper)) - 0.5 * spacing * np.array(shape)
    at_nodes = _node_values(values, low, spacing, shape)
    _refuse_cut_boundary(at_nodes, shape)
    return Sampled(values, low, spacing, shape, at_nodes, _march(at_nodes, *shape, np.empty((0, 3, 2), np.int64)))


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
    """The function at all nodes, a few planes of the lattice at a time."""
    found = []
    for number, offset in ((tuple(n + 1 for n in shape), 0.0), (shape, 0.5)):
        x, y, z = (low[axis] + spacing * (np.arange(number[axis]) + offset) for axis in range(3))
        planes = max(1, _MOST_POINTS // (len(y) * len(z)))
        for i in range(0, len(x), planes):
            grid = np.meshgrid(x[i : i + planes], y, z, indexing="ij")
            found.append(values(np.stack([axis.ravel() for axis in grid], axis=1)))
    return np.concatenate(found)


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
    found: Any = np.int64(0)  # a literal would be a second type of _cut_tetrahedron's argument, compiled apart
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
                    inside = int(at_nodes[centre] < 0.0) + int(at_nodes[centre + centre_steps[axis]] < 0.0)
                    for side in range(4):
                        inside += at_nodes[ring[side]] < 0.0
                    if inside == 0 or inside == 6:
                        continue
                    for side in range(4):
                        tet[0], tet[1] = centre, centre + centre_steps[axis]
                        tet[2], tet[3] = ring[side], ring[(side + 1) % 4]
                        found = _cut_tetrahedron(tet, at_nodes, ends, found)
    return found


@scalar
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
        _write_triangle(ends, at, p, q, p, r, p, s)
    elif inside == 3:
        _write_triangle(ends, at, p, q, p, s, p, r)
    else:
        _write_triangle(ends, at, p, r, p, s, q, s)
        at += 1
        _write_triangle(ends, at, p, r, q, s, q, r)
    return at + 1


@scalar
def _write_triangle(ends: NDArray[np.int64], at: int, a: int, b: int, c: int, d: int, e: int, f: int) -> None:
    ends[at, 0, 0], ends[at, 0, 1] = min(a, b), max(a, b)
    ends[at, 1, 0], ends[at, 1, 1] = min(c, d), max(c, d)
    ends[at, 2, 0], ends[at, 2, 1] = min(e, f), max(e, f)


def _false_position(function: Callable[[NDArray], NDArray], at_zero: NDArray, at_one: NDArray) -> NDArray:
    """Zero between 0 and 1 of many functions at once, from their values of opposite sign there.

    False position whose kept end has its value halved (Illinois), or one end would never move.
    """
    kept, at_kept, t, now = np.zeros(len(at_zero)), at_zero, np.ones(len(at_one)), at_one
    for _ in range(_MOST_STEPS):
        step = now * (kept - t) / (now - at_kept)
        before, t, now = now, t + step, function(t + step)
        crossed = (now < 0.0) != (before < 0.0)
        kept, at_kept = np.where(crossed, t - step, kept), np.where(crossed, before, 0.5 * at_kept)
        if np.abs(step).max() < _FOUND:
            break
    return t


def _smoothed(points: Points, triangles: NDArray[np.int32]) -> Points:
    """Move every vertex half way to the mean of its neighbours."""
    corners = triangles.ravel()
    met = np.bincount(corners)
    mean = np.empty_like(points)
    for axis in range(3):
        corner = points[:, axis][triangles]
        whole = corner[:, 0] + corner[:, 1] + corner[:, 2]
        # A vertex has as many triangles as neighbours, and meets each neighbour in two of them.
        mean[:, axis] = (np.bincount(corners, np.repeat(whole, 3)) / met - points[:, axis]) / 2.0
    return 0.5 * points + 0.5 * mean


def _on_surface(values: Values, points: Points, spacing: float) -> Points:
    """Two steps of Newton with one gradient, each at most a quarter of the spacing."""
    now, step = values(points), 1e-3 * spacing
    gradient = np.stack([values(points + step * axis) - now for axis in np.eye(3)], axis=1) / step
    length = np.maximum(np.linalg.norm(gradient, axis=1), 1e-12)
    direction = gradient / length[:, None]
    points = points - np.clip(now / length, -0.25 * spacing, 0.25 * spacing)[:, None] * direction
    return points - np.clip(values(points) / length, -0.25 * spacing, 0.25 * spacing)[:, None] * direction
