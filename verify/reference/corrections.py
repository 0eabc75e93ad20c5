# SPDX-License-Identifier: BSD-3-Clause
"""Multigrid on a quadratic potential as matrices: corrections of layers, and what a sequence makes of an error.

One smoothing of layer l with step w is u -= w P D^-1 P^T (A u - b) with D the block diagonal of P^T A P, so it takes
the error e = u - A^-1 b to (I - w P D^-1 P^T A) e. A cycle is the product of these in the order of its layers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer
from verify.reference.elasticity import AssembledElasticity
from verify.reference.transfer import block_diagonal, diagonal_blocks, galerkin, mass_matrix, prolongation

Floats = NDArray[np.float64]

# Layers in the order of smoothing: of the published sequence, and of the cycles of any textbook with one smoothing
# before and one after, by the number of layers. The coarsest layer is smoothed once at each visit, and W does not visit
# it twice in a row.
SEQUENCES: dict[tuple[str, int], tuple[int, ...]] = {
    ("fas", 2): (1, 0),
    ("fas", 3): (2, 1, 0),
    ("fas", 4): (3, 2, 1, 0),
    ("v", 2): (0, 1, 0),
    ("v", 3): (0, 1, 2, 1, 0),
    ("v", 4): (0, 1, 2, 3, 2, 1, 0),
    ("f", 2): (0, 1, 0),
    ("f", 3): (0, 1, 2, 1, 1, 2, 1, 0),
    ("f", 4): (0, 1, 2, 3, 2, 2, 3, 2, 1, 1, 2, 3, 2, 1, 0),
    ("w", 2): (0, 1, 0),
    ("w", 3): (0, 1, 2, 1, 1, 2, 1, 0),
    ("w", 4): (0, 1, 2, 3, 2, 2, 3, 2, 1, 1, 2, 3, 2, 2, 3, 2, 1, 0),
}


@dataclass(frozen=True, eq=False)
class Corrections:
    """A potential with constant Hessian at the free vertices, and the layers that correct it; f free components.

    Parameters
    ----------
    A : Hessian [N/m], shape [f, f].
    C : P D^-1 P^T of each layer [m/N], finest first, shape [f, f] each.
    """

    A: sp.csr_matrix
    C: tuple[sp.csr_matrix, ...]

    def solution(self, b: Floats) -> Floats:
        """A^-1 b [m] of a load [N], by a direct solver."""
        return spla.spsolve(self.A.tocsc(), b)

    def norm(self, e: Floats) -> float:
        """Energy norm sqrt(e . A e) of an error at the free vertices."""
        return float(np.sqrt(e.ravel() @ (self.A @ e.ravel())))

    def direction(self, layer: int, residual: Floats) -> Floats:
        """-P D^-1 P^T r [m] of a residual r = A u - b [N], shape [f]."""
        return -self.C[layer] @ residual

    def run(self, sequence: Sequence[int], w: Floats | None, b: Floats, u: Floats) -> Floats:
        """u after smoothing a sequence of layers with steps w, or with None each to the minimum along its correction.

        Parameters
        ----------
        b : Load [N], shape [f].
        u : Displacement [m], shape [f].
        """
        for layer in sequence:
            r = self.A @ u - b
            d = self.direction(layer, r)
            u = u + (w[layer] if w is not None else -(r @ d) / (d @ (self.A @ d))) * d
        return u

    def propagation(self, sequence: Sequence[int], w: Floats) -> Floats:
        """Error propagation of a sequence of layers, shape [f, f]."""
        E = np.eye(self.A.shape[0])
        for layer in sequence:
            E -= w[layer] * (self.C[layer] @ (self.A @ E))
        return E


def corrections_at(
    disc: Discretisation, layers: Sequence[Layer], x: Floats, inverse_h2: float, *, scalar: bool = False
) -> Corrections:
    """The incremental potential as it curves at x, with the blocks (or diagonals) of each layer there."""
    free = np.repeat(disc.free, 3)
    whole = AssembledElasticity(disc.mesh, disc.mu, disc.lam).hessian(x) + inverse_h2 * mass_matrix(disc.mass)
    A = whole.tocsr()[free][:, free]
    found = []
    for layer in layers:
        P = prolongation(layer)[free]
        blocks = diagonal_blocks(galerkin(P, A))
        inverse: Floats = np.asarray(np.linalg.inv(blocks * np.eye(3) if scalar else blocks), np.float64)
        found.append((P @ block_diagonal(inverse) @ P.T).tocsr())
    return Corrections(A, tuple(found))
