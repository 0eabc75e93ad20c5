# SPDX-License-Identifier: BSD-3-Clause
"""Bytes that each pass has to move per tetrahedron, at least: fixed numbers, the same for every implementation.

The element phase reads nine entries of Dm^-1, V mu and V lam in its precision and four local vertex numbers of 16 bits:
52 bytes in float32, 96 in float64. Blocks of elements pass nine sums per vertex (3 of the gradient, 6 of the block) on
to the phase that adds them up: 26 and 53 bytes, so 78 and 149 with block output. A pass whose data are fatter
has the same bound and a lower share of it.

What follows from these for the others: a pass with vectors as output passes on three sums of nine. Energies are written
per tetrahedron, energy and J in float64. Passes over coarse layers, and energies along a line, have next to no output.
Vertices are shared by many tetrahedra and count as cached. Node work is in float64 always: a block solve reads 9
values per node and writes 3; a prolongation reads and writes 3 per vertex, and reads the number of its node and 3
values per node.
"""

from __future__ import annotations

from femgal.kernels.backend import Precision

_ELEMENT = {"float32": 52.0, "float64": 96.0}
_WITH_BLOCKS = {"float32": 78.0, "float64": 149.0}
_DOUBLE = 8.0


def element_bytes(precision: Precision) -> float:
    """Per tetrahedron, of an element phase with next to no output."""
    return _ELEMENT[precision]


def vector_bytes(precision: Precision) -> float:
    """Per tetrahedron, of a pass that gives a vector per vertex: gradient or Hessian product."""
    return _ELEMENT[precision] + (_WITH_BLOCKS[precision] - _ELEMENT[precision]) / 3.0


def block_bytes(precision: Precision) -> float:
    """Per tetrahedron, of a pass over the finest layer that gives gradient and diagonal blocks."""
    return _WITH_BLOCKS[precision]


def energy_bytes(precision: Precision) -> float:
    """Per tetrahedron, of a pass that gives the energy and J of each."""
    return _ELEMENT[precision] + 2.0 * _DOUBLE


def solve_bytes(nodes: int) -> float:
    """Of block solves at a number of nodes, together."""
    return 12.0 * _DOUBLE * nodes


def prolongation_bytes(nodes: int, vertices: int) -> float:
    """Of x += P dx with one node per vertex, together."""
    return 3.0 * _DOUBLE * nodes + (6.0 * _DOUBLE + 4.0) * vertices
