# SPDX-License-Identifier: BSD-3-Clause
"""Rollers: production passes and solvers with one direction of motion left, for fields that are known exactly.

femgal's own constraints hold a vertex in all three directions. Exact fields of finite elasticity need walls along which
the body slides. Here every force, product and correction of the backend below loses the components that rollers hold,
and nothing else changes: the same passes, smoothers, line searches and time stepping run.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend

Floats = NDArray[np.float64]


def on_rollers(backend: Backend, direction: int) -> Backend:
    """The backend with every vertex on rollers: it moves along one axis (0, 1 or 2) only."""
    return cast(Backend, _Rollers(backend, direction))


class _Rollers:
    def __init__(self, backend: Backend, direction: int) -> None:
        self._backend = backend
        self._moves = np.eye(3)[direction]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._backend, name)

    def gradient(self, x: Floats) -> Floats:
        return self._moves * self._backend.gradient(x)

    def hessian_product(self, x: Floats, d: Floats, *, definite: bool = False) -> Floats:
        return self._moves * self._backend.hessian_product(x, d, definite=definite)

    def nodal_gradient(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> Floats:
        return self._moves * self._backend.nodal_gradient(layer, x, xhat, inverse_h2)

    def nodal_product(self, layer: Layer, x: Floats, d: Floats, inverse_h2: float, *, definite: bool = False) -> Floats:
        return self._moves * self._backend.nodal_product(layer, x, d, inverse_h2, definite=definite)

    def gradient_and_blocks(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> tuple[Floats, Floats]:
        g, H = self._backend.gradient_and_blocks(layer, x, xhat, inverse_h2)
        return self._moves * g, H

    def correction(
        self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float, w: float = 1.0, *, scalar: bool = False
    ) -> tuple[Floats, float]:
        g, H = self.gradient_and_blocks(layer, x, xhat, inverse_h2)
        dx = self.solve(g, H, w, scalar=scalar)
        return dx, self._backend.dot(g, dx)

    def solve(self, g: Floats, H: Floats, w: float, *, scalar: bool = False) -> Floats:
        # What is held couples to nothing: the block is its one diagonal entry.
        return self._moves * self._backend.solve(g, H, w, scalar=True)
