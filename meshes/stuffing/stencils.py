# SPDX-License-Identifier: BSD-3-Clause
"""How a lattice tetrahedron is filled for each pattern of signs (Labelle and Shewchuk 2007, section 3).

A vertex is outside (-), on the surface (0) or inside (+); an edge between + and - carries a cut point. The inside
part is a tetrahedron, a pyramid or a prism, whose quadrilateral sides are split by rules of the lattice face alone, so
that neighbours agree. For a face with the inside vertices p, q and the outside vertex g:

1. p-q is a short edge: then one cut lies on a long edge, and the diagonal ends there.
2. p-q is a long edge: the *parity rule*. Around p-q the diagonals of successive faces start alternately from its lower
   and its upper end, so the two faces of one tetrahedron never start from the same one.

With cuts no nearer than ALPHA to any vertex kept in place, and vertices moved by no more than ALPHA along an edge,
every dihedral angle lies between 9.2 and 161.7 degrees whatever the surface does (the worst of all combinations of
extreme cuts and moves, tests/meshes/test_stuffing_stencils.py; the paper proves 10.7 for moves that can occur
together).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from meshes.stuffing.lattice import CELL, DIRECTIONS, EDGES, N_DIRECTIONS

# Fraction of an edge within which a cut moves the vertex: short edges, long edges.
ALPHA_SHORT, ALPHA_LONG = 0.41189, 0.24999
ALPHA = np.array([ALPHA_SHORT] * 4 + [ALPHA_LONG] * 3)
# A part of a stencil is a lattice vertex 0 to 3, or 4 + number of the edge whose cut it is.
FIRST_CUT = 4
N_CODES = 3**4
# In Python's integers, in which thousands of small sums are far quicker. Twice the place of each part is that of the
# vertex or of the middle of the edge: orientation does not depend on where on its edge a cut lies.
_CELL = CELL.tolist()
_TWICE = [
    [[2 * x for x in v] for v in cell] + [[x + y for x, y in zip(cell[p], cell[q], strict=True)] for p, q in EDGES]
    for cell in _CELL
]


def code_of(signs: tuple[int, ...]) -> int:
    """Row of the stencil table for the four signs -1, 0, 1."""
    return sum((sign + 1) * 3**k for k, sign in enumerate(signs))


def stencil(tetrahedron: int, signs: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Positively oriented tetrahedra, as lists of parts, that fill one lattice tetrahedron.

    Parameters
    ----------
    tetrahedron : Which of the twelve of a cell.
    signs : -1, 0 or 1 for each of its vertices.
    """
    inside, zero, outside = ([v for v in range(4) if signs[v] == s] for s in (1, 0, -1))
    if not inside:
        return []
    if len(inside) == 1:
        filled = [tuple(inside + zero + [_cut(inside[0], g) for g in outside])]
    elif not outside:
        filled = [(0, 1, 2, 3)]
    elif len(inside) == 2 and len(outside) == 1:
        filled = _pyramid(tetrahedron, inside, zero[0], outside[0])
    elif len(inside) == 2:
        filled = _wedge(tetrahedron, inside, outside)
    else:
        filled = _truncated(tetrahedron, inside, outside[0])
    return [_oriented(tetrahedron, parts) for parts in filled]


def carrier(tetrahedron: int, p: int, q: int, g: int) -> int:
    """Which of the inside vertices p and q the diagonal of the face (p, q, g) starts from."""
    if not _is_long(p, q):
        return q if _is_long(p, g) else p
    low, high, third = (_CELL[tetrahedron][v] for v in (p, q, g))
    axis = next(c for c in range(3) if low[c] != high[c])
    offset = [third[c] - (low[c] + high[c]) // 2 for c in range(3)]
    even = offset[(axis + 1) % 3] * offset[(axis + 2) % 3] > 0
    return min(p, q) if even else max(p, q)


def _is_long(p: int, q: int) -> bool:
    return p // 2 == q // 2


def _cut(p: int, g: int) -> int:
    return FIRST_CUT + EDGES.index((min(p, g), max(p, g)))


def _pyramid(tetrahedron: int, inside: list[int], apex: int, g: int) -> list[tuple[int, ...]]:
    p = carrier(tetrahedron, inside[0], inside[1], g)
    q = inside[0] + inside[1] - p
    return [(apex, p, q, _cut(q, g)), (apex, p, _cut(q, g), _cut(p, g))]


def _truncated(tetrahedron: int, inside: list[int], g: int) -> list[tuple[int, ...]]:
    wins = {v: 0 for v in inside}
    for p, q in combinations(inside, 2):
        wins[carrier(tetrahedron, p, q, g)] += 1
    x, y, z = sorted(inside, key=lambda v: -wins[v])
    return _prism((x, y, z), (_cut(x, g), _cut(y, g), _cut(z, g)))


def _wedge(tetrahedron: int, inside: list[int], outside: list[int]) -> list[tuple[int, ...]]:
    # The diagonals start from opposite ends, so the third side must be split from the cut of q to that of p.
    p, q = inside
    g, k = outside if carrier(tetrahedron, p, q, outside[0]) == p else outside[::-1]
    return _prism((_cut(p, k), p, _cut(p, g)), (_cut(q, k), q, _cut(q, g)))


def _prism(lower: tuple[int, int, int], upper: tuple[int, int, int]) -> list[tuple[int, ...]]:
    """Split a prism whose diagonals run from lower x to upper y and z, and from lower y to upper z."""
    (x, y, z), (above_x, above_y, above_z) = lower, upper
    return [(x, y, z, above_z), (x, y, above_y, above_z), (x, above_x, above_y, above_z)]


def _oriented(tetrahedron: int, parts: tuple[int, ...]) -> tuple[int, ...]:
    (ax, ay, az), b, c, d = (_TWICE[tetrahedron][part] for part in parts)
    bx, by, bz = b[0] - ax, b[1] - ay, b[2] - az
    cx, cy, cz = c[0] - ax, c[1] - ay, c[2] - az
    volume = (by * cz - bz * cy) * (d[0] - ax) + (bz * cx - bx * cz) * (d[1] - ay) + (bx * cy - by * cx) * (d[2] - az)
    return parts if volume > 0 else (parts[0], parts[1], parts[3], parts[2])


def tables() -> tuple[NDArray[np.int8], NDArray[np.int8], NDArray[np.int8]]:
    """All stencils as arrays for the kernels.

    Returns
    -------
    count : Tetrahedra in each stencil, shape [81].
    parts : Their parts, shape [12, 81, 3, 4].
    cuts : Vertex from which the direction of each edge's cut starts, and that direction, shape [12, 6, 2].
    """
    count = np.zeros(N_CODES, np.int8)
    parts = np.full((len(CELL), N_CODES, 3, 4), -1, np.int8)
    for code in range(N_CODES):
        signs = tuple(code // 3**k % 3 - 1 for k in range(4))
        for tetrahedron in range(len(CELL)):
            filled = stencil(tetrahedron, signs)
            count[code] = len(filled)
            for n, piece in enumerate(filled):
                parts[tetrahedron, code, n] = piece
    cuts = np.array([[_along(cell[p], cell[q], p, q) for p, q in EDGES] for cell in CELL], np.int8)
    return count, parts, cuts


def _along(start: NDArray[np.int64], end: NDArray[np.int64], p: int, q: int) -> tuple[int, int]:
    ways = np.vstack([DIRECTIONS, -DIRECTIONS])
    way = int(np.flatnonzero((ways == end - start).all(axis=1))[0])
    return (p, way) if way < N_DIRECTIONS else (q, way - N_DIRECTIONS)
