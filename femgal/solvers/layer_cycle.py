# SPDX-License-Identifier: BSD-3-Clause
"""The symmetric cycle over all layers as a preconditioner: FAS applied to a linear system."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.solvers.smoother import step_lengths
from femgal.timestep.potential import IncrementalPotential

Floats = NDArray[np.float64]


@dataclass(eq=False)
class LayerCycle:
    """From z = 0, z += w_l P_l D_l^-1 P_l^T (r - A z) over the layers from fine to coarse and back to fine.

    Every layer is connected to the finest mesh, as in Lu et al. 2025, section 5.3.1, so a layer's residual is a product
    with A at the finest one, restricted; only the layer's active elements are visited. The cycle is its own transpose,
    and w_l = 2 / (1 + lambda_max(D_l^-1 A_l)) < 2 / lambda_max keeps it positive definite. lambda_max is estimated
    when the preconditioner is made anew, at the positions of then.

    Parameters
    ----------
    layers : Layers, finest first.
    """

    layers: tuple[Layer, ...]
    price: float = field(default=4.0, init=False)
    _H: list[Floats] = field(default_factory=list, init=False, repr=False)
    _w: Floats = field(default_factory=lambda: np.empty(0), init=False, repr=False)
    _at: tuple[IncrementalPotential, Floats] | None = field(default=None, init=False, repr=False)

    def refresh(self, potential: IncrementalPotential, x: Floats) -> None:
        """Blocks and step lengths of all layers at x."""
        backend, weight = potential.backend, potential.inverse_h2
        self._at = (potential, backend.copy(x))
        self._H = [backend.gradient_and_blocks(layer, x, x, weight)[1] for layer in self.layers]
        self._w = step_lengths("spectral", potential, self.layers)

    def apply(self, r: Floats) -> Floats:
        """One cycle, from zero."""
        assert self._at is not None
        (potential, x), finest = self._at, self.layers[0]
        backend = potential.backend
        f, z = backend.zeros(len(x)), backend.zeros(len(x))
        backend.prolong(finest, r, f)
        down = range(len(self.layers))
        order = [*down, *reversed(down[:-1])]
        for position, number in enumerate(order):
            layer = self.layers[number]
            left = backend.restrict(layer, f)
            if position > 0:
                backend.add_scaled(left, -1.0, backend.nodal_product(layer, x, z, potential.inverse_h2))
            backend.prolong(layer, backend.solve(left, self._H[number], -float(self._w[number])), z)
        return backend.restrict(finest, z)
