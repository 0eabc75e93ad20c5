# SPDX-License-Identifier: BSD-3-Clause
"""The body-centred cubic lattice: numbering, edges, and the twelve tetrahedra of a cell.

Positions are written in *half steps*: the cubic spacing h is 2, so corners have even coordinates and centres odd ones.
Point (i, j, k) of sublattice s (0 corner, 1 centre) lies at (2i + s, 2j + s, 2k + s) and has the number
2 ((i n_y + j) n_z + k) + s, so that both sublattices, and with them the final mesh, are numbered column by column.

Every point has 14 edges: along seven directions and back along them. Directions 0 to 3 are the short edges (length
sqrt(3)/2 h) to the other sublattice, 4 to 6 the long ones (length h) along the axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshError
from meshes.types import Points

# In half steps; the reverse of each is the other seven edges of a point.
DIRECTIONS = np.array([(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1), (2, 0, 0), (0, 2, 0), (0, 0, 2)], dtype=np.int64)
N_DIRECTIONS = 7
# The vertices of a tetrahedron are ordered so that 0-1 and 2-3 are its long edges, each from low to high.
EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
_MARGIN = 3  # layers of outside points around the surface, so that no edge or tetrahedron leaves the array
_LARGEST = 2**31 - 1
# No lattice plane may coincide with a plane of the surface, which for models of boxes is likely.
_SHIFT = np.array([0.1234567, 0.2718281, 0.3141592])


@dataclass(frozen=True)
class Lattice:
    """A block of the lattice.

    Parameters
    ----------
    origin : Position of the corner point (0, 0, 0) [m], shape [3].
    spacing : Cubic spacing h [m]; there are two points per h^3.
    shape : Points of each sublattice along x, y, z.
    """

    origin: NDArray[np.float64]
    spacing: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, points: Points, spacing: float, attempt: int = 0) -> Lattice:
        """Block with a margin around points; each attempt places the lattice differently.

        Raises
        ------
        MeshError
            More lattice points than 32-bit numbers can tell apart.
        """
        low, high = points.min(axis=0), points.max(axis=0)
        shift = np.mod(_SHIFT * (1 + attempt), 1.0)
        extent = (high - low) / spacing
        shape = tuple(int(n) for n in np.ceil(extent + shift).astype(np.int64) + 2 * _MARGIN)
        if 2 * float(np.prod(np.asarray(shape, np.float64))) > _LARGEST:
            raise MeshError(
                "the box around the surface holds too many lattice points",
                found=f"{2.0 * np.prod(np.asarray(shape, np.float64)):.3g} at a spacing of {spacing:.3g} m",
                allowed=_LARGEST,
                advice="ask for fewer vertices, or turn the surface so that its box is smaller",
            )
        return cls(low - (_MARGIN - 1 + shift) * spacing, spacing, (shape[0], shape[1], shape[2]))

    @property
    def size(self) -> int:
        """Number of points of both sublattices."""
        return 2 * int(np.prod(self.shape))

    @property
    def strides(self) -> NDArray[np.int64]:
        """Difference of numbers between neighbours along x, y, z, shape [3]."""
        return np.array([2 * self.shape[1] * self.shape[2], 2 * self.shape[2], 2], np.int64)

    @property
    def steps(self) -> NDArray[np.int64]:
        """Difference of numbers from a point of sublattice s to its neighbour, shape [2, 14].

        Column d is the neighbour along direction d, column 7 + d the one against it.
        """
        ways = np.vstack([DIRECTIONS, -DIRECTIONS])
        points = np.arange(2)[:, None, None] + ways
        return (points >> 1) @ self.strides + (points[..., 0] & 1) - np.arange(2)[:, None]

    @property
    def tetrahedra(self) -> NDArray[np.int64]:
        """Numbers of the vertices of the twelve tetrahedra of a cell relative to its centre, shape [12, 4]."""
        points = 1 + CELL
        return (points >> 1) @ self.strides + (points[..., 0] & 1) - 1


def _cell() -> NDArray[np.int64]:
    """Vertices of the tetrahedra that belong to the centre at the origin, in half steps, shape [12, 4, 3].

    Each spans the long edge to the next centre along an axis and one of the four edges of the face between them.
    """
    unit = np.eye(3, dtype=np.int64)
    tetrahedra = []
    for axis in range(3):
        a, b, c = unit[axis], unit[(axis + 1) % 3], unit[(axis + 2) % 3]
        for across, side in ((b, c), (c, b)):
            for sign in (-1, 1):
                middle = a + sign * side
                tetrahedra.append([0 * a, 2 * a, middle - across, middle + across])
    return np.array(tetrahedra)


CELL = _cell()
