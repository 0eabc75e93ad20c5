# SPDX-License-Identifier: BSD-3-Clause
"""Where the lines of the lattice cross a surface.

All lattice edges lie on ten bundles of parallel lines: four along the short edges, and for each axis one through the
corners and one through the centres. In the coordinates (u, v, w) of a bundle the lines stand over integer (u, v) and
its lattice points at integer w.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel, scalar
from meshes.stuffing.lattice import DIRECTIONS
from meshes.types import Cells, Points

_TINY = 1e-300
LineData: TypeAlias = tuple[
    NDArray[np.int64],
    NDArray[np.int64],
    int,
    NDArray[np.int64],
    NDArray[np.float64],
    NDArray[np.int32],
    NDArray[np.int8],
]


@dataclass(frozen=True)
class Bundle:
    """Parallel lattice lines.

    Parameters
    ----------
    direction : Lattice direction 0 to 6 along which w grows by one from point to point.
    odd : 1 for the bundle of an axis that runs through centres, else 0.
    """

    direction: int
    odd: int

    @property
    def axes(self) -> tuple[int, int]:
        """Coordinate axes that u and v run along."""
        if self.direction < 4:
            return 0, 1
        axis = self.direction - 4
        return (axis + 1) % 3, (axis + 2) % 3

    @property
    def frame(self) -> NDArray[np.int64]:
        """Half steps of the lattice point at (0, 0, 0), and per unit of u, v and w, shape [4, 3]."""
        frame = np.zeros((4, 3), np.int64)
        frame[0] = self.odd
        frame[1, self.axes[0]] = frame[2, self.axes[1]] = 2
        frame[3] = DIRECTIONS[self.direction]
        return frame

    @property
    def step(self) -> float:
        """Distance between successive points on a line, in units of the spacing."""
        return float(np.linalg.norm(DIRECTIONS[self.direction])) / 2.0

    def project(self, half_steps: Points) -> Points:
        """Coordinates (u, v, w), shape [n, 3], of positions given in half steps."""
        frame = self.frame
        return np.ascontiguousarray((half_steps - frame[0]) @ np.linalg.inv(frame[1:].astype(np.float64)))


BUNDLES = tuple(Bundle(d, 0) for d in range(4)) + tuple(Bundle(d, odd) for d in (4, 5, 6) for odd in (0, 1))


@dataclass(frozen=True, eq=False)
class Crossings:
    """Crossings of one bundle, line by line and ascending in w.

    Parameters
    ----------
    low : Smallest u and v of the lines.
    columns : Number of lines along v; line (u, v) has the number (u - low[0]) columns + v - low[1].
    start : First crossing of each line, shape [n_lines + 1].
    height : w of each crossing.
    face : Triangle of each crossing.
    turn : Change of the winding number there when w grows: +1 into the body, -1 out of it.
    """

    low: tuple[int, int]
    columns: int
    start: NDArray[np.int64]
    height: NDArray[np.float64]
    face: NDArray[np.int32]
    turn: NDArray[np.int8]

    def line_data(self, bundle: Bundle) -> LineData:
        """What kernels that walk along the lines need, in the order of their last seven arguments."""
        low = np.array(self.low, np.int64)
        return bundle.frame, low, self.columns, self.start, self.height, self.face, self.turn

    @property
    def unbalanced(self) -> int:
        """Lines whose winding number does not return to zero: rounding at a vertex or edge of the surface."""
        total = np.concatenate([[0], np.cumsum(self.turn, dtype=np.int64)])
        return int((np.diff(total[self.start]) != 0).sum())


def cross(bundle: Bundle, half_steps: Points, triangles: Cells) -> Crossings:
    """Intersect all lines of a bundle with a closed surface whose vertices are given in half steps."""
    points = bundle.project(half_steps)
    low, high = (np.array([bound(points[:, axis]) for axis in (0, 1)]) for bound in (np.min, np.max))
    low, high = np.ceil(low).astype(np.int64), np.floor(high).astype(np.int64)
    lines = np.maximum(high - low + 1, 0)
    start = np.zeros(int(lines.prod()) + 1, np.int64)
    nothing = (np.empty(0), np.empty(0, np.int32), np.empty(0, np.int8))
    _cast(points, triangles, low, int(lines[1]), start[1:], *nothing)
    np.cumsum(start, out=start)
    n = int(start[-1])
    found = (np.empty(n), np.empty(n, np.int32), np.empty(n, np.int8))
    _cast(points, triangles, low, int(lines[1]), start[:-1].copy(), *found)
    _sort_lines(start, *found)
    return Crossings((int(low[0]), int(low[1])), int(lines[1]), start, *found)


@scalar
def lattice_number(frame: NDArray[np.int64], strides: NDArray[np.int64], u: int, v: int, w: int) -> int:
    """Number of the lattice point (u, v, w) of a bundle."""
    x = frame[0, 0] + u * frame[1, 0] + v * frame[2, 0] + w * frame[3, 0]
    y = frame[0, 1] + u * frame[1, 1] + v * frame[2, 1] + w * frame[3, 1]
    z = frame[0, 2] + u * frame[1, 2] + v * frame[2, 2] + w * frame[3, 2]
    return (x >> 1) * strides[0] + (y >> 1) * strides[1] + (z >> 1) * strides[2] + (x & 1)


@scalar
def _left_of(ax: float, ay: float, a: int, bx: float, by: float, b: int, x: float, y: float) -> float:
    """Twice the area of (a, b, point), exactly opposite for (b, a, point), and never zero.

    Always computed from the lower vertex number, so that two triangles decide alike about a line near their common
    edge. A line exactly on it is decided as if it stood at (x + e, y + e^2) with e > 0 too small to matter elsewhere.
    """
    sign = 1.0
    if a > b:
        ax, ay, bx, by = bx, by, ax, ay
        sign = -1.0
    area = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    if area == 0.0:
        area = _TINY if by < ay or (by == ay and bx > ax) else -_TINY
    return sign * area


@kernel
def _cast(
    points: Points,
    triangles: Cells,
    low: NDArray[np.int64],
    columns: int,
    cursor: NDArray[np.int64],
    height: NDArray[np.float64],
    face: NDArray[np.int32],
    turn: NDArray[np.int8],
) -> None:
    """Advance the cursor of a line for each triangle it crosses; write the crossing there unless height is empty."""
    for f in range(triangles.shape[0]):
        a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        ax, ay, bx, by, cx, cy = points[a, 0], points[a, 1], points[b, 0], points[b, 1], points[c, 0], points[c, 1]
        first_v, last_v = int(np.ceil(min(ay, by, cy))), int(np.floor(max(ay, by, cy)))
        for u in range(int(np.ceil(min(ax, bx, cx))), int(np.floor(max(ax, bx, cx))) + 1):
            for v in range(first_v, last_v + 1):
                wa = _left_of(bx, by, b, cx, cy, c, u, v)
                wb = _left_of(cx, cy, c, ax, ay, a, u, v)
                wc = _left_of(ax, ay, a, bx, by, b, u, v)
                if (wa > 0.0) != (wb > 0.0) or (wa > 0.0) != (wc > 0.0):
                    continue
                line = (u - low[0]) * columns + v - low[1]
                if height.shape[0] > 0:
                    i = cursor[line]
                    height[i] = (wa * points[a, 2] + wb * points[b, 2] + wc * points[c, 2]) / (wa + wb + wc)
                    face[i] = f
                    turn[i] = -1 if wa > 0.0 else 1
                cursor[line] += 1


@kernel
def _sort_lines(
    start: NDArray[np.int64], height: NDArray[np.float64], face: NDArray[np.int32], turn: NDArray[np.int8]
) -> None:
    """Insertion sort of each line by (w, triangle): a line has few crossings."""
    for line in range(start.shape[0] - 1):
        for i in range(start[line] + 1, start[line + 1]):
            h, f, t = height[i], face[i], turn[i]
            j = i
            while j > start[line] and (height[j - 1] > h or (height[j - 1] == h and face[j - 1] > f)):
                height[j], face[j], turn[j] = height[j - 1], face[j - 1], turn[j - 1]
                j -= 1
            height[j], face[j], turn[j] = h, f, t
