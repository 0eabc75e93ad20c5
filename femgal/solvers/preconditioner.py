# SPDX-License-Identifier: BSD-3-Clause
"""What a preconditioner of Newton's linear systems offers, and the two that are made of diagonal blocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.timestep.potential import IncrementalPotential

Floats = NDArray[np.float64]


class Preconditioner(Protocol):
    """z = M^-1 r near A^-1 r for A = d2 phi(x); symmetric and positive definite for as long as it is not refreshed.

    Attributes
    ----------
    price : Iterations of conjugate gradients that take as long as a refresh.
    """

    price: float

    def refresh(self, potential: IncrementalPotential, x: Floats) -> None:
        """Make ready for A at x.

        Parameters
        ----------
        potential : phi; its `inverse_h2` is the factor of the mass in A.
        x : Positions [m], shape [n, 3].
        """

    def apply(self, r: Floats) -> Floats:
        """z [m] for a residual r [N], rows of the free vertices, both shape [k, 3]."""


@runtime_checkable
class Assembled(Preconditioner, Protocol):
    """A preconditioner that has the definite part of A as a matrix, which multiplies in a fraction of a pass."""

    def product(self, p: Floats) -> Floats:
        """The definite part of A at the last refresh, times p [N], rows of the free vertices, shape [k, 3]."""


@dataclass(eq=False)
class LayerBlocks:
    """z = sum over the layers of P_l D_l^-1 P_l^T r, D_l the diagonal blocks of P_l^T A P_l.

    Multilevel diagonal scaling (Zhang 1992): additive, so all layers see the same residual and no step lengths are
    needed. With the finest layer alone it is block Jacobi.

    Parameters
    ----------
    layers : Layers, finest first.
    """

    layers: tuple[Layer, ...]
    price: float = field(default=1.0, init=False)
    _H: list[Floats] = field(default_factory=list, init=False, repr=False)
    _potential: IncrementalPotential | None = field(default=None, init=False, repr=False)

    def refresh(self, potential: IncrementalPotential, x: Floats) -> None:
        """Blocks of all layers at x."""
        backend, weight = potential.backend, potential.inverse_h2
        self._potential = potential
        self._H = [backend.gradient_and_blocks(layer, x, x, weight)[1] for layer in self.layers]

    def apply(self, r: Floats) -> Floats:
        """The sum of all layers' corrections."""
        assert self._potential is not None
        backend = self._potential.backend
        z = backend.solve(r, self._H[0], -1.0)
        if len(self.layers) == 1:
            return z
        finest, n = self.layers[0], backend.disc.n_vertices
        f, total = backend.zeros(n), backend.zeros(n)
        backend.prolong(finest, r, f)
        for layer, H in zip(self.layers[1:], self._H[1:], strict=True):
            backend.prolong(layer, backend.solve(backend.restrict(layer, f), H, -1.0), total)
        backend.add_scaled(z, 1.0, backend.restrict(finest, total))
        return z
