# SPDX-License-Identifier: BSD-3-Clause
"""The chain of ever coarser lattices of a body, each connected to the next finer one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.galerkin import GalerkinProduct, galerkin_product
from femgal.assembly.pattern import Pattern
from femgal.assembly.transfer import LIGHTEST_NODE, make_transfer
from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import FIRST_SPACING, LARGEST_SHARE
from femgal.hierarchy.lattice import lattice_nodes
from femgal.kernels.backend import Precision
from meshes.connectivity import cell_edges

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def lattice_chain(
    disc: Discretisation, pattern: Pattern, enough: int, precision: Precision = "float32"
) -> list[GalerkinProduct]:
    """Products that coarsen a matrix over the free vertices, finest first, until a level has few nodes.

    The first lattice has FIRST_SPACING mean edges, as that of `build_linear_hierarchy`, each other one twice the
    spacing of the one before, or more where that would join too few nodes. Bodies that do not touch stay apart on
    every level, so there may be no level with few nodes; the chain then ends when no wider lattice joins any.

    Parameters
    ----------
    disc : The discretised bodies.
    pattern : Of the finest matrix.
    enough : Nodes of a level that needs no coarser one.
    precision : Of the weights.
    """
    X = disc.mesh.points
    origin, widest = 0.5 * (X.min(axis=0) + X.max(axis=0)), 2.0 * float(np.ptp(X, axis=0).max())
    points, rows, edges = X, disc.free, cell_edges(disc.mesh.cells, disc.n_vertices)
    spacing = FIRST_SPACING * _mean_length(X, edges[rows[edges].any(axis=1)])
    chain: list[GalerkinProduct] = []
    while pattern.n_rows > enough:
        nodes = lattice_nodes(points, rows, edges, spacing, origin, LIGHTEST_NODE)
        if len(nodes.position) <= LARGEST_SHARE * pattern.n_rows:
            chain.append(galerkin_product(make_transfer(nodes, rows, precision), pattern))
            points, pattern = nodes.position, chain[-1].pattern
            rows, edges = np.ones(len(points), bool), _edges(pattern)
        elif spacing > widest:
            break
        spacing *= 2.0
    return chain


def _mean_length(X: Floats, edges: Ints) -> float:
    return float(np.linalg.norm(X[edges[:, 0]] - X[edges[:, 1]], axis=1).mean())


def _edges(pattern: Pattern) -> Ints:
    """Pairs of nodes that the matrix couples, lower one first."""
    row = np.repeat(np.arange(pattern.n_rows, dtype=np.int32), np.diff(pattern.ptr))
    right = pattern.column > row
    return np.stack([row[right], pattern.column[right]], axis=1)
