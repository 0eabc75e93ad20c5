# SPDX-License-Identifier: BSD-3-Clause
"""Assembled prolongation of a layer and the Galerkin products that the matrix-free passes must equal."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer

Floats = NDArray[np.float64]


def prolongation(layer: Layer) -> sp.csr_matrix:
    """P of x += P dx, shape [3n, 3k] for n vertices and k nodes, three rows per vertex and three columns per node."""
    vertex, slot = np.nonzero(layer.parent >= 0)
    entries = (layer.weight[vertex, slot], (vertex, layer.parent[vertex, slot]))
    scalar = sp.coo_matrix(entries, shape=(len(layer.parent), layer.n_nodes))
    return sp.kron(scalar, sp.eye(3)).tocsr()


def galerkin(P: sp.csr_matrix, A: sp.csr_matrix) -> sp.csr_matrix:
    """P^T A P."""
    return (P.T @ A @ P).tocsr()


def mass_matrix(mass: Floats) -> sp.csr_matrix:
    """Lumped mass matrix [kg], shape [3n, 3n], from vertex masses of shape [n]."""
    return sp.diags(np.repeat(mass, 3)).tocsr()


def diagonal_blocks(A: sp.csr_matrix) -> Floats:
    """3x3 blocks on the diagonal of A, shape [k, 3, 3]."""
    k = A.shape[0] // 3
    rows = 3 * np.arange(k)[:, None, None] + np.arange(3)[None, :, None]
    columns = 3 * np.arange(k)[:, None, None] + np.arange(3)[None, None, :]
    flat = A[np.broadcast_to(rows, (k, 3, 3)).ravel(), np.broadcast_to(columns, (k, 3, 3)).ravel()]
    return np.asarray(flat).reshape(k, 3, 3)


def block_diagonal(blocks: Floats) -> sp.csr_matrix:
    """Matrix with the given 3x3 blocks on its diagonal, from shape [k, 3, 3]."""
    return sp.block_diag(list(blocks), format="csr")


def unpacked(H: Floats) -> Floats:
    """Full symmetric blocks, shape [k, 3, 3], of the packed form xx xy xz yy yz zz, shape [k, 6]."""
    return H[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
