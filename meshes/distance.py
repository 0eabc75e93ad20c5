# SPDX-License-Identifier: BSD-3-Clause
"""How far two surfaces are apart: point-to-triangle distances through a tree of bounding boxes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meshes.errors import MeshError
from meshes.jit import kernel, scalar
from meshes.ordering import morton_order
from meshes.types import Points, TriMesh

LEAF = 4  # triangles per leaf: fewer boxes than triangles, and a leaf's corners fill five cache lines
_STACK = 64  # twice the depth of a tree over 2^31 triangles


@dataclass(frozen=True)
class DirectedDistance:
    """Distance from one surface to the other [m]: area-weighted mean and RMS, and the largest sample."""

    mean: float
    rms: float
    maximum: float


@dataclass(frozen=True)
class SurfaceDistance:
    """Two-sided distance between surfaces a and b.

    Parameters
    ----------
    forward, backward : From a to b, and from b to a.
    diagonal : Diagonal of the box around b [m], to make the figures relative.
    """

    forward: DirectedDistance
    backward: DirectedDistance
    diagonal: float

    @property
    def mean(self) -> float:
        """Larger of the two means [m]."""
        return max(self.forward.mean, self.backward.mean)

    @property
    def maximum(self) -> float:
        """Hausdorff distance over the samples [m]."""
        return max(self.forward.maximum, self.backward.maximum)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            **asdict(self),
            "relative_mean": self.mean / self.diagonal,
            "relative_maximum": self.maximum / self.diagonal,
        }


@dataclass(frozen=True, eq=False)
class BoxTree:
    """Complete binary tree of boxes over triangles in Morton order.

    Parameters
    ----------
    corners : Triangle corners [m] in tree order, shape [n_triangles, 9].
    boxes : Lower and upper corner of each node [m], shape [2 n_leaves, 6]; node i has the children 2i and 2i + 1,
        leaf l is node n_leaves + l and holds the triangles LEAF l to LEAF (l + 1) - 1.
    order : Index of each triangle in the surface it came from, shape [n_triangles].
    """

    corners: Points
    boxes: Points
    order: NDArray[np.int64]

    @classmethod
    def over(cls, surface: TriMesh) -> BoxTree:
        """Build the tree of a surface."""
        corners = surface.points[surface.cells]
        order = morton_order(corners.mean(axis=1))
        packed = np.ascontiguousarray(corners[order].reshape(-1, 9))
        n_leaves = 1 << int(np.ceil(np.log2(-(-len(packed) // LEAF)))) if len(packed) > LEAF else 1
        return cls(packed, _boxes(packed, n_leaves), order)

    def distances(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Distance [m] from each point, shape [n, 3], to the surface, and the index of the nearest triangle."""
        queries = np.ascontiguousarray(points, np.float64)
        squared, nearest = _nearest(queries, self.corners, self.boxes)
        return np.sqrt(squared), self.order[nearest]


def surface_distance(a: TriMesh, b: TriMesh) -> SurfaceDistance:
    """Two-sided distance between two surfaces.

    Each surface is sampled at its vertices and its triangles' centroids; means are weighted with the rule
    (1/12, 1/12, 1/12, 3/4) over each triangle, exact for quadratic functions.

    Raises
    ------
    MeshError
        A surface without area.
    """
    extent = b.points.max(axis=0) - b.points.min(axis=0)
    return SurfaceDistance(_directed(a, b), _directed(b, a), float(np.linalg.norm(extent)))


def _directed(source: TriMesh, target: TriMesh) -> DirectedDistance:
    corners = source.points[source.cells]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not areas.sum() > 0.0:
        raise MeshError("the surface has no area", where=source.origin.name, found=0.0, allowed="> 0 m^2")
    tree = BoxTree.over(target)
    at_vertex, _ = tree.distances(source.points)
    at_centroid, _ = tree.distances(corners.mean(axis=1))
    weights = areas / areas.sum()

    def average(power: int) -> float:
        vertices = (at_vertex**power)[source.cells].sum(axis=1) / 12.0
        return float(weights @ (vertices + 0.75 * at_centroid**power))

    return DirectedDistance(average(1), average(2) ** 0.5, float(max(at_vertex.max(), at_centroid.max())))


@kernel
def _boxes(corners: Points, n_leaves: int) -> Points:
    boxes = np.empty((2 * n_leaves, 6))
    boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
    for f in range(corners.shape[0]):
        node = n_leaves + f // LEAF
        for c in range(9):
            boxes[node, c % 3] = min(boxes[node, c % 3], corners[f, c])
            boxes[node, 3 + c % 3] = max(boxes[node, 3 + c % 3], corners[f, c])
    for node in range(n_leaves - 1, 0, -1):
        for c in range(3):
            boxes[node, c] = min(boxes[2 * node, c], boxes[2 * node + 1, c])
            boxes[node, 3 + c] = max(boxes[2 * node, 3 + c], boxes[2 * node + 1, 3 + c])
    return boxes


@kernel
def _nearest(points: Points, corners: Points, boxes: Points) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    n_leaves = boxes.shape[0] // 2
    squared = np.empty(points.shape[0])
    nearest = np.empty(points.shape[0], np.int64)
    node_stack, bound_stack = np.empty(_STACK, np.int64), np.empty(_STACK)
    guess = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        # Neighbours in the list are usually neighbours in space: the last hit bounds this search.
        best = _triangle_squared(corners, guess, x, y, z)
        node_stack[0], bound_stack[0] = 1, _box_squared(boxes, 1, x, y, z)
        depth = 1
        while depth > 0:
            depth -= 1
            if bound_stack[depth] >= best:
                continue
            node = node_stack[depth]
            if node >= n_leaves:
                first = (node - n_leaves) * LEAF
                for f in range(first, min(first + LEAF, corners.shape[0])):
                    d = _triangle_squared(corners, f, x, y, z)
                    if d < best:
                        best, guess = d, f
                continue
            left, right = 2 * node, 2 * node + 1
            near, far = _box_squared(boxes, left, x, y, z), _box_squared(boxes, right, x, y, z)
            if near > far:
                left, right, near, far = right, left, far, near
            node_stack[depth], bound_stack[depth] = right, far
            node_stack[depth + 1], bound_stack[depth + 1] = left, near
            depth += 2
        squared[i], nearest[i] = best, guess
    return squared, nearest


@scalar
def _box_squared(boxes: Points, node: int, x: float, y: float, z: float) -> float:
    dx = max(boxes[node, 0] - x, 0.0, x - boxes[node, 3])
    dy = max(boxes[node, 1] - y, 0.0, y - boxes[node, 4])
    dz = max(boxes[node, 2] - z, 0.0, z - boxes[node, 5])
    return dx * dx + dy * dy + dz * dz


@scalar
def _segment_squared(px: float, py: float, pz: float, ex: float, ey: float, ez: float) -> float:
    """Squared distance of p to the segment from the origin to e."""
    length = ex * ex + ey * ey + ez * ez
    t = (px * ex + py * ey + pz * ez) / length if length > 0.0 else 0.0
    t = min(max(t, 0.0), 1.0)
    dx, dy, dz = px - t * ex, py - t * ey, pz - t * ez
    return dx * dx + dy * dy + dz * dz


@scalar
def _triangle_squared(corners: Points, f: int, x: float, y: float, z: float) -> float:
    """Squared distance to a triangle: to its plane when the foot falls inside, else to the nearest edge."""
    ax, ay, az = corners[f, 0], corners[f, 1], corners[f, 2]
    px, py, pz = x - ax, y - ay, z - az
    ux, uy, uz = corners[f, 3] - ax, corners[f, 4] - ay, corners[f, 5] - az
    vx, vy, vz = corners[f, 6] - ax, corners[f, 7] - ay, corners[f, 8] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    nn = nx * nx + ny * ny + nz * nz
    # Barycentric coordinates of the foot times nn; a triangle without area always falls through to its edges.
    s = nx * (py * vz - pz * vy) + ny * (pz * vx - px * vz) + nz * (px * vy - py * vx)
    t = nx * (uy * pz - uz * py) + ny * (uz * px - ux * pz) + nz * (ux * py - uy * px)
    if nn > 0.0 and s >= 0.0 and t >= 0.0 and s + t <= nn:
        height = px * nx + py * ny + pz * nz
        return height * height / nn
    first = _segment_squared(px, py, pz, ux, uy, uz)
    second = _segment_squared(px, py, pz, vx, vy, vz)
    third = _segment_squared(px - ux, py - uy, pz - uz, vx - ux, vy - uy, vz - uz)
    return min(first, second, third)
