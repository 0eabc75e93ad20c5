# SPDX-License-Identifier: BSD-3-Clause
"""How the nodes of one lattice move those of the next finer one, and at the bottom of all the free vertices.

The layers of `femgal.hierarchy` are each connected to the finest mesh; a V-cycle needs neighbours connected. Here every
coarser lattice is laid over the nodes of the finer one, in the way the first is laid over the vertices
(`femgal.hierarchy.lattice`): a node is moved by the corners of the tetrahedron of the coarser lattice that holds it.
Body-centred cubic lattices of spacings h, 2 h, 4 h, ... with one origin are nested, and so are their hat functions:
what a node does to the vertices through all lattices in between is what it would do directly, and a node of the finer
lattice, being a corner or the middle of an edge of the coarser one, has two parents at most.

In one thing the lattices differ from those of the hierarchy: nodes are left out only where they carry next to nothing.
Where one is left out the others no longer reproduce linear functions, rotations among them, and conjugate gradients
take up to four times as many iterations (`LIGHTEST_NODE`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.lattice import LatticeNodes
from femgal.hierarchy.layer import transpose
from femgal.kernels.backend import Precision

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# Sum of the weights below which a node is left out. Iterations to 1e-2 for 0.05, 0.25, 0.5 and 1 (bunny hung by an ear,
# 2,000 vertices, two lattices, E = 1e8 Pa, rho = 1, h = 1/60 s): 11, 14, 17, 31. Without any limit two nodes may move
# the same single vertex, and the matrix is singular.
LIGHTEST_NODE = 0.05


@dataclass(frozen=True, eq=False)
class Transfer:
    """Prolongation P from k nodes to n finer ones, the same for the three components.

    Parameters
    ----------
    parent, weight : Nodes that move each finer one and their weights, -1 for none, shape [n, p].
    child_ptr, child, child_weight : The transpose: finer nodes of each node, ascending.
    """

    parent: Ints
    weight: Reals
    child_ptr: Longs
    child: Ints
    child_weight: Reals

    @property
    def n_fine(self) -> int:
        """Number of finer nodes."""
        return len(self.parent)

    @property
    def n_coarse(self) -> int:
        """Number of nodes."""
        return len(self.child_ptr) - 1


def make_transfer(nodes: LatticeNodes, rows: NDArray[np.bool_], precision: Precision) -> Transfer:
    """The transfer from nodes of a lattice to the points that it was laid over.

    Parameters
    ----------
    rows : Which points are rows of the matrix.
    """
    parent, weight = np.ascontiguousarray(nodes.parent[rows]), np.ascontiguousarray(nodes.weight[rows])
    child_ptr, child, child_weight = transpose(parent, weight, len(nodes.position))
    return Transfer(parent, weight.astype(precision), child_ptr, child, child_weight.astype(precision))
